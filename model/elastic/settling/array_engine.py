"""The elastic rule with agents as rows of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from .kernels import push_in_turn, push_largest, seat
from .state import Floats, Integers, PushState
from .table import PushTable


class ArrayPushEngine:
    """Lets agents act, level by level, on arrays.

    Parameters
    ----------
    table : PushTable
        Who passes how much to whom.
    """

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
