"""Agents that spawn one by one."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Flags, Ints
from kaju.model.elastic.bracket import Bracket, bracket_of
from kaju.model.elastic.krylov import Iteration
from kaju.model.elastic.problem import ACTIVE
from kaju.model.elastic.solver import lost_digits, rounding_notes

from .balance import Balance
from .composite import Composite
from .curvature import Indicator, indicate
from .generations import Spawning
from .ground import Ground
from .held import HALVED, first_agents
from .leaves import Leaves
from .nested import LAST, NestedMultigrid, energy_of, relative_error, settle
from .spawner import Aim, Spawner
from .tree_boxes import boxes_of_agents

ALGEBRAIC_SHARE = 0.05
"""Every generation is solved to this share of its estimated error, the last one further."""


class LeafSpawner(Spawner):
    """Agents of which each may spawn; see `Spawner`."""

    indicator: Indicator

    def __init__(
        self,
        ground: Ground,
        tolerance: float,
        most_agents: int,
        aim: Aim | None = None,
        previous: Spawning | None = None,
    ) -> None:
        super().__init__(ground, tolerance, most_agents, aim)
        if previous is None:
            self.balance, self.notes = first_agents(ground)
            self.displacement = self.balance.grid.value.copy()
        else:
            self.balance, self.error = previous.balance.loaded_by(ground), previous.error
            self.balance.grid.leaves = self.leaves.as_first()
            self.displacement = previous.displacement.copy()
            self.notes = [note for note in previous.notes if note.endswith(HALVED)]
        self.hierarchy = NestedMultigrid(self.balance)

    @property
    def leaves(self) -> Leaves:
        """The agents of this generation."""
        return self.balance.grid.leaves

    @property
    def smallest(self) -> Flags:
        """Which agents are as small as may be."""
        return np.asarray(self.leaves.size <= self.ground.smallest)

    @property
    def sharp(self) -> Ints:
        """Which agents are at points where stress has no limit."""
        return self.leaves.holding(self.ground.sharp)

    def outcome(self) -> Spawning:
        """Return the agents as they are."""
        own = (self.balance, self.displacement, self.indicator, self.aimed)
        return Spawning(*own, **self._ended(self.hierarchy.depth))

    def _spawn(self, chosen: Flags) -> None:
        number, leaves = len(self.generations), self.leaves
        leaves = leaves.split(chosen, number, self.indicator.load * self.ground.scales.force)
        leaves = leaves.balanced(number, young=leaves.step == number)
        finer = Balance(Composite(self.ground, leaves))
        grown = self.hierarchy.grow(finer) @ self.displacement
        self.displacement = np.where(finer.grid.state == ACTIVE, grown, finer.grid.value)
        self.balance = finer

    def _settle(self, *, for_good: bool) -> Iteration:
        share = LAST if for_good else ALGEBRAIC_SHARE * self.error
        run = settle(self.balance, self.hierarchy, self.displacement, share)
        self.indicator = indicate(self.balance, self.displacement)
        self.square, self.left = self.indicator
        self.energy = energy_of(self.balance, self.displacement)
        self.error = float(np.hypot(relative_error(self.square, self.energy), run.errors[-1]))
        self.aimed = self.aim.look(self)
        return run

    def _left_of_loads(self) -> float:
        """Return what is left beside the applied forces; those of moved sides may be far larger."""
        rest = (self.balance.force(self.displacement) - self.balance.load)[self.balance.free]
        applied = float(np.abs(self.balance.load).sum())
        return float(np.abs(rest).sum()) / applied if applied > 0.0 else 0.0

    def _rounding(self) -> list[str]:
        """Say what rounding leaves unbalanced; refuse what it hides before more agents spawn."""
        free, right = self.balance.free, self.balance.load - self.balance.pull
        stiffness = self.hierarchy.matrix.diagonal()
        return rounding_notes(lost_digits(self.displacement[free] * stiffness, right[free]))

    def _bounds(self, *, settled: bool = True) -> Bracket | str:
        return bracket_of(boxes_of_agents(self.balance, self.displacement), settled)
