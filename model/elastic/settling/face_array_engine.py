"""The elastic rule with agents as rows of arrays, pushes one after another compiled.

The plain twin of the compiled functions is the agent itself: `FaceAgent.act`.
"""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

from typing import Any

import numpy as np

from kaju.compiling import njit

from .push_state import Floats, Integers, PushState
from .table import PushTable


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
    """Let every agent whose load exceeds γ act when its turn comes.

    Returns the number of pushes and the energy released.
    """
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
def seat(measured):
    """Set up a tournament: node k holds the better of the players at nodes 2k and 2k + 1.

    Players are faces, the larger load wins, of equal ones the lower number. Unlike in a
    heap a player keeps its seat, so that its new load is one climb of log₂ n matches.
    """
    seats = 1
    while seats < len(measured):
        seats *= 2
    tree = np.full(2 * seats, -1, dtype=np.int64)
    for i in range(len(measured)):
        tree[seats + i] = i
    for node in range(seats - 1, 0, -1):
        tree[node] = _winner(tree[2 * node], tree[2 * node + 1], measured)
    return tree


@njit(cache=True)
def _winner(first, second, measured):
    if second < 0 or (first >= 0 and measured[first] >= measured[second]):
        return first
    return second


@njit(cache=True)
def replay(tree, measured, i):
    """Play the matches of face i again after its load has changed."""
    node = (len(tree) // 2 + i) // 2
    while node > 0:
        tree[node] = _winner(tree[2 * node], tree[2 * node + 1], measured)
        node //= 2


@njit(cache=True)
def push_largest(
    count, tree, measured, threshold, generation, weight, spawn_step, indptr, target, share,
    stiffness, left, displacement, taken,
):  # fmt: skip
    """Let the agent with the largest load act, `count` times or until none exceeds γ.

    Returns the number of pushes and the energy released.
    """
    released = 0.0
    for pushes in range(count):
        i = tree[1]
        if not measured[i] > threshold:
            return pushes, released
        if spawn_step[i] == 0:
            spawn_step[i] = generation + 1
        released += push(i, indptr, target, share, stiffness, left, displacement, taken)
        measured[i] = abs(left[i]) * weight[i]
        replay(tree, measured, i)
        for at in range(indptr[i], indptr[i + 1]):
            j = target[at]
            if j < len(measured):
                measured[j] = abs(left[j]) * weight[j]
                replay(tree, measured, j)
    return count, released


class ArrayPushEngine:
    """Lets agents act, level by level, on arrays."""

    def __init__(self, table: PushTable) -> None:
        self.table = table
        self.reset()

    def reset(self) -> None:
        """Put the loads on the body, before anybody has yielded."""
        self.state = PushState(self.table)
        self.tree = seat(self.state.measured(0))

    def push_together(self, level: int, acting: Integers, loads: Floats) -> None:
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
            count, self.tree, state.measured(0), state.threshold, state.generation, *self._arrays(0)
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
