"""Agents that spawn one by one."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Flags
from kaju.model.elastic.bracket import Bracket
from kaju.model.elastic.krylov import Iteration
from kaju.model.elastic.problem import ACTIVE
from kaju.model.elastic.solver import lost_digits, rounding_notes

from .aims import Aim
from .balance import Balance
from .composite import Composite
from .curvature import Indicator, indicate
from .generations import Generation, Spawning
from .ground import Ground
from .held import first_agents
from .leaves import Leaves
from .nested import LAST, NestedMultigrid, energy_of, relative_error, settle
from .previous import Heirs, Standing
from .spawner import Spawner
from .tree_boxes import bracket_of_agents

ALGEBRAIC_SHARE = 0.05
"""Every generation is solved to this share of its estimated error, the last one further."""
ROUGH = 0.05
"""One cycle of previous agents is enough to tell within a per cent what they will leave."""


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
        self._generations: list[Generation] = []
        self._heirs = None
        if previous is None:
            self._stand(_first(ground))
        else:
            self._heirs = Heirs(ground, previous.balance.grid.leaves)
            self._stand(self._heirs.take_up(previous))
            self.error = previous.error

    @property
    def generations(self) -> list[Generation]:
        """The steps so far."""
        return self._generations

    @property
    def leaves(self) -> Leaves:
        """The agents of this generation."""
        return self.balance.grid.leaves

    @property
    def agents(self) -> int:
        """How many agents there are."""
        return len(self.leaves)

    @property
    def smallest(self) -> Flags:
        """Which agents are as small as may be."""
        return np.asarray(self.leaves.size <= self.ground.smallest)

    def outcome(self) -> Spawning:
        """Return the agents as they are."""
        return Spawning(
            self.balance, self.displacement, self.indicator, self.energy, self.error,
            self.aimed, list(self.generations), self.residuals, self.hierarchy.depth, self.reached,
            "" if self.reached else self.stopped, list(self.notes), self.retired, self.bracket,
        )  # fmt: skip

    def _stand(self, standing: Standing) -> None:
        self.balance, self.displacement, self.notes = standing
        self.hierarchy = NestedMultigrid(self.balance)

    def _begin(self) -> list[Iteration]:
        """Let agents of a previous answer settle roughly, retire, and spawn at once."""
        if self._heirs is None or self.generations:
            return super()._begin()
        runs = [self._settled(ROUGH, known=False)]
        within = self.aimed.error <= self.target
        # Only an error that adds up can be shared out; another is mended from the start.
        standing = _first(self.ground) if not (within or self.aim.adds_up) else self._regroup()
        while standing is not None:
            self._stand(standing)
            runs.append(self._settle(for_good=False))
            standing = self._regroup() if within else None
            within = self.aimed.error <= self.target
        self.retired = self._heirs.retired(self.leaves)
        return runs

    def _regroup(self) -> Standing | None:
        assert self._heirs is not None
        return self._heirs.regroup(self.balance, self.displacement, self.aimed)

    def _spawn(self, chosen: Flags) -> None:
        number, leaves = len(self.generations), self.leaves
        leaves = leaves.split(chosen, number, self.indicator.load * self.ground.scales.force)
        leaves = leaves.balanced(number, young=leaves.step == number)
        finer = Balance(Composite(self.ground, leaves))
        grown = self.hierarchy.grow(finer) @ self.displacement
        self.displacement = np.where(finer.grid.state == ACTIVE, grown, finer.grid.value)
        self.balance = finer

    def _settle(self, *, for_good: bool) -> Iteration:
        return self._settled(LAST if for_good else ALGEBRAIC_SHARE * self.error)

    def _settled(self, share: float, *, known: bool = True) -> Iteration:
        """Balance the forces to a relative algebraic error, and see what is left unbalanced."""
        # An algebraic error that is not `known`, still to be settled, will be a share of the error.
        run = settle(self.balance, self.hierarchy, self.displacement, share)
        self.indicator = indicate(self.balance, self.displacement)
        self.square = self.indicator.square
        self.energy = energy_of(self.balance, self.displacement)
        error = relative_error(self.square, self.energy)
        self.error = float(np.hypot(error, run.errors[-1] if known else ALGEBRAIC_SHARE * error))
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
        return bracket_of_agents(self.balance, self.displacement, settled)

    def _remember(self, iterations: int, chosen: Flags) -> None:
        leaves, load = self.leaves, self.indicator.load
        cost = (len(leaves), self.error, self.energy, iterations, self.aimed.error)
        self.generations.append(Generation(*cost, leaves.code, leaves.size, load, chosen))


def _first(ground: Ground) -> Standing:
    balance, notes = first_agents(ground)
    return Standing(balance, balance.grid.value.copy(), notes)
