"""The elastic rule with agents as rows of arrays, pushes one after another compiled.

The plain twin of the compiled functions is the agent itself: `FaceAgent.act`.
"""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.compiling import njit
from kaju.model.elastic.relaxation.push_state import PushState
from kaju.model.elastic.relaxation.push_table import PushTable


@njit(cache=True)
def push(i, indptr, target, share, stiffness, left, displacement, taken):
    """Let agent i take all of its load, yield, and pass it on; return the energy released."""
    load = left[i]
    displacement[i] += load / stiffness[i]
    left[i] -= load
    taken[i] += abs(load)
    for at in range(indptr[i], indptr[i + 1]):
        left[target[at]] += share[at] * load
    return 0.5 * (load / stiffness[i]) * load


@njit(cache=True)
def push_in_turn(
    backward, threshold, generation, weight, spawn_step, indptr, target, share, stiffness, left,
    displacement, taken,
):  # fmt: skip
    """Let every agent whose load exceeds γ act when its turn comes."""
    # Returns the number of pushes and the energy released.
    pushes, released = 0, 0.0
    n = len(stiffness)
    for k in range(n):
        i = n - 1 - k if backward else k
        if abs(left[i]) * weight[i] > threshold:
            if spawn_step[i] == 0:
                spawn_step[i] = generation + 1
            released += push(i, indptr, target, share, stiffness, left, displacement, taken)
            pushes += 1
    return pushes, released


@njit(cache=True)
def push_largest(
    count, measured, threshold, generation, weight, spawn_step, indptr, target, share, stiffness,
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
        if spawn_step[i] == 0:
            spawn_step[i] = generation + 1
        released += push(i, indptr, target, share, stiffness, left, displacement, taken)
        for at in range(indptr[i] - 1, indptr[i + 1]):
            j = target[at] if at >= indptr[i] else i
            if j < n:
                measured[j] = abs(left[j]) * weight[j]
                first = j // part * part
                most[j // part] = measured[first : first + part].max()
    return count, released


class ArrayPushEngine:
    """Lets agents act, level by level, on arrays."""

    def __init__(self, table: PushTable) -> None:
        self.table = table
        self.reset()

    def reset(self) -> None:
        """Put the loads on the body, before anybody has yielded."""
        self.state = PushState(self.table)

    def push_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own."""
        state, agents, ground = self.state, self.table.levels[level], self.state.grounds[level]
        ground.spawn_step[acting[ground.spawn_step[acting] == 0]] = state.generation + 1
        before = ground.left[acting]
        yielded = loads / agents.stiffness[acting]
        ground.displacement[acting] += yielded
        ground.left[acting] -= loads
        ground.taken[acting] += np.abs(loads)
        passed = agents.shares[acting]
        amount = passed.data * np.repeat(loads, np.diff(passed.indptr))
        np.add.at(ground.left, passed.indices, amount)
        state.energy -= 0.5 * float(yielded @ (before + ground.left[acting]))
        state.pushes += len(acting)

    def push_in_turn(self, level: int, backward: bool) -> int:
        """Let the agents of a level above the threshold act one after another."""
        state = self.state
        pushes, released = push_in_turn(
            backward, state.threshold, state.generation, *self._arrays(level)
        )
        return self._book(pushes, released)

    def push_largest(self, count: int) -> int:
        """Let the agent with the largest load act, `count` times."""
        state = self.state
        pushes, released = push_largest(
            count, state.measured(0), state.threshold, state.generation, *self._arrays(0)
        )
        return self._book(pushes, released)

    def _book(self, pushes: int, released: float) -> int:
        self.state.pushes += pushes
        self.state.energy -= released
        return pushes

    def _arrays(self, level: int) -> tuple[Any, ...]:
        table, ground = self.table.levels[level], self.state.grounds[level]
        shares = table.shares
        return (
            *(ground.weight, ground.spawn_step, shares.indptr, shares.indices, shares.data),
            *(table.stiffness, ground.left, ground.displacement, ground.taken),
        )
