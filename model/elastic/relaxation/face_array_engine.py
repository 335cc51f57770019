"""The elastic rule with agents as rows of arrays, pushes one after another compiled.

The plain twin of the compiled functions is the agent itself: `FaceAgent.act`.
"""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.compiling import njit
from kaju.model.elastic.relaxation.push_state import PushEngine


@njit(cache=True)
def push(
    i, generation, spawn_step, indptr, target, share, stiffness, left, displacement, taken
):  # fmt: skip
    """Let agent i take all of its load, yield, and pass it on; return the energy released."""
    if spawn_step[i] == 0:
        spawn_step[i] = generation + 1
    load = left[i]
    displacement[i] += load / stiffness[i]
    left[i] -= load
    taken[i] += abs(load)
    for at in range(indptr[i], indptr[i + 1]):
        left[target[at]] += share[at] * load
    return 0.5 * (load / stiffness[i]) * load


@njit(cache=True)
def push_in_turn(
    backward, threshold, weight, generation, spawn_step, indptr, target, share, stiffness, left,
    displacement, taken,
):  # fmt: skip
    """Let every agent above γ act in its turn; return pushes and the energy released."""
    pushes, released = 0, 0.0
    n = len(stiffness)
    for k in range(n):
        i = n - 1 - k if backward else k
        if abs(left[i]) * weight[i] > threshold:
            released += push(
                i, generation, spawn_step, indptr, target, share, stiffness, left, displacement,
                taken,
            )  # fmt: skip
            pushes += 1
    return pushes, released


@njit(cache=True)
def push_largest(
    count, measured, threshold, weight, generation, spawn_step, indptr, target, share, stiffness,
    left, displacement, taken,
):  # fmt: skip
    """Let the agent with the largest load act, `count` times or until none exceeds γ."""
    # Returns the number of pushes and the energy released. The largest load of every part of
    # √n faces is kept; of equal ones the first acts.
    n, released = len(measured), 0.0
    part = int(np.sqrt(n)) + 1
    most = np.array([measured[k : k + part].max() for k in range(0, n, part)])
    for pushes in range(count):
        first = np.argmax(most) * part
        i = first + np.argmax(measured[first : first + part])
        if not measured[i] > threshold:
            return pushes, released
        released += push(
            i, generation, spawn_step, indptr, target, share, stiffness, left, displacement, taken
        )
        # The loads of the agent and of all it passes on to have changed.
        for at in range(indptr[i] - 1, indptr[i + 1]):
            j = target[at] if at >= indptr[i] else i
            if j < n:
                measured[j] = abs(left[j]) * weight[j]
                first = j // part * part
                most[j // part] = measured[first : first + part].max()
    return count, released


class ArrayPushEngine(PushEngine):
    """Lets agents act on arrays."""

    def relax_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own: a Jacobi step."""
        state, agents, faces = self.state, self.table.levels[level], self.state.levels[level]
        faces.spawn_step[acting[faces.spawn_step[acting] == 0]] = state.generation + 1
        before = faces.left[acting]
        yielded = loads / agents.stiffness[acting]
        faces.displacement[acting] += yielded
        faces.left[acting] -= loads
        faces.taken[acting] += np.abs(loads)
        passed = agents.shares[acting]
        amount = passed.data * np.repeat(loads, np.diff(passed.indptr))
        np.add.at(faces.left, passed.indices, amount)
        self._book(len(acting), 0.5 * float(yielded @ (before + faces.left[acting])))

    def relax_in_turn(self, level: int, backward: bool) -> None:
        """Let the agents of a level above γ act one after another: a Gauss-Seidel sweep."""
        self._book(*push_in_turn(backward, *self._arrays(level)))

    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""
        self._book(*push_largest(count, self.state.levels[0].measured, *self._arrays(0)))

    def wake_supports(self) -> None:
        """Do nothing: only objects are woken."""

    def _book(self, pushes: int, released: float) -> None:
        self.state.pushes += pushes
        self.state.energy -= released

    def _arrays(self, level: int) -> tuple[Any, ...]:
        """Return what the compiled functions take of a level, from γ on."""
        state, table, faces = self.state, self.table.levels[level], self.state.levels[level]
        return (
            *(state.threshold, faces.weight, state.generation, faces.spawn_step),
            *(table.shares.indptr, table.shares.indices, table.shares.data, table.stiffness),
            *(faces.left, faces.displacement, faces.taken),
        )
