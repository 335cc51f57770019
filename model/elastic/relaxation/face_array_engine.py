"""The elastic rule with agents as rows of arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.relaxation.push_state import PushEngine

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.push_loops import LevelArrays


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
        from kaju.model.elastic.relaxation.push_loops import push_in_turn

        state = self.state
        step = state.generation + 1
        self._book(*push_in_turn(backward, state.threshold, step, self._arrays(level)))

    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""
        from kaju.model.elastic.relaxation.push_loops import push_largest

        state, measured = self.state, self.state.levels[0].measured
        step = state.generation + 1
        self._book(*push_largest(count, measured, state.threshold, step, self._arrays(0)))

    def wake_supports(self) -> None:
        """Do nothing: only objects are woken."""

    def _book(self, pushes: int, released: float) -> None:
        self.state.pushes += pushes
        self.state.energy -= released

    def _arrays(self, level: int) -> LevelArrays:
        from kaju.model.elastic.relaxation.push_loops import LevelArrays

        table, faces = self.table.levels[level], self.state.levels[level]
        shares = table.shares
        return LevelArrays(
            *(shares.indptr, shares.indices, shares.data, table.stiffness, faces.weight),
            *(faces.left, faces.displacement, faces.taken, faces.spawn_step),
        )
