"""The elastic rule with agents as rows of arrays; pushes one after another are compiled.

The plain twin of `push` is the agent itself: `FaceAgent.act`.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.compiling import njit
from kaju.model.elastic.relaxation.push_state import PushEngine


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

    def relax_in_turn(self, level: int) -> None:
        """Let the agents of a level above γ act in turn, and in turn backwards."""
        state = self.state
        step = state.generation + 1
        self._book(*push_in_turn(state.threshold, step, state.levels[level]))

    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""
        state, faces = self.state, self.state.levels[0]
        step = state.generation + 1
        self._book(*push_largest(count, faces.measured, state.threshold, step, faces))

    def _book(self, pushes: int, released: float) -> None:
        self.idle = 0 if pushes else self.idle
        self.state.pushes += pushes
        self.state.energy -= released


@njit(cache=True)
def push(i, step, level):
    """Let agent i take all of its load, yield, and pass it on; return the energy released."""
    if level.spawn_step[i] == 0:
        level.spawn_step[i] = step
    load = level.left[i]
    level.displacement[i] += load / level.stiffness[i]
    level.left[i] -= load
    level.taken[i] += abs(load)
    for at in range(level.begin[i], level.begin[i + 1]):
        level.left[level.target[at]] += level.share[at] * load
    return 0.5 * (load / level.stiffness[i]) * load


@njit(cache=True)
def push_in_turn(threshold, step, level):
    """Let agents above γ act in turn, and in turn back; return pushes and the energy released."""
    pushes, released = 0, 0.0
    n = len(level.stiffness)
    for k in range(2 * n):
        i = min(k, 2 * n - 1 - k)
        if abs(level.left[i]) * level.weight[i] > threshold:
            released += push(i, step, level)
            pushes += 1
    return pushes, released


@njit(cache=True)
def push_largest(count, measured, threshold, step, level):
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
        released += push(i, step, level)
        # The loads of the agent and of all it passes on to have changed.
        for at in range(level.begin[i] - 1, level.begin[i + 1]):
            j = level.target[at] if at >= level.begin[i] else i
            if j < n:
                measured[j] = abs(level.left[j]) * level.weight[j]
                first = j // part * part
                most[j // part] = measured[first : first + part].max()
    return count, released
