"""From the first agents to the last: solve, look for unbalanced load, spawn, and again."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from math import inf, isfinite
from typing import Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.energy_bounds import (
    MOST_PROVED,
    PROVED_AT,
    EnergyBounds,
    bracket_of,
    worth_proving,
)
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.leaf_cells import LeafCells
from kaju.model.elastic.cells.leaf_supports import HALVED, first_agents
from kaju.model.elastic.multigrid.krylov import Iteration
from kaju.model.elastic.multigrid.nested import (
    LAST,
    NestedMultigrid,
    energy_of,
    relative_error,
    settle,
)
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.refine.estimator import Indicator, indicate
from kaju.model.elastic.refine.generations import Generation, Spawning
from kaju.model.elastic.refine.targets import BULK, SPARE, Aimed, mark_largest
from kaju.model.elastic.solver import lost_digits, rounding_notes

MOST_GENERATIONS = 60
TELLING, FAR = 500, 600.0
"""From so many agents on they tell how many more it takes; so many times too many are not tried."""
TOLD = 1e-5  # Share of the applied forces that may be left on agents without a word
ASKED = {2: 0, 3: 4_000}
"""So many at most are asked for bounds before they have settled: more take too long, and in the
plane bounds say much the same everywhere."""
EARLY = 0.1
"""Of the error allowed: what those at points without a limit of stress may keep together."""
LEAST_SHARE = 0.5  # Of the estimate, that bounds are expected to be
FIRST_GUESS = 0.3  # Of the first generation's error
ALGEBRAIC_SHARE = 0.05
"""Every generation is solved to this share of its estimated error, the last one further."""


class Target:
    """What the tolerance is about: the error in the energy norm, unless a subclass says else."""

    def look(self, spawner: RefineLoop) -> Aimed:
        """Return how far off the agents are, after they have settled."""
        allowed = 2 * spawner.energy * (SPARE * spawner.target) ** 2
        marked = spawner.mark_for_energy(spawner.square, allowed)
        return Aimed(spawner.error, spawner.square, marked, allowed)

    def bounded(self, spawner: RefineLoop) -> Aimed:
        """Return the same with what is certain of it, if that is not for the agents to find."""
        return spawner.aimed


class RefineLoop(ABC):
    """Agents that settle, look for what they leave unbalanced, and spawn, step by step.

    They spawn one by one, or the agents of a block together; `most_agents` ends that short of the
    tolerance, which is about the error in the energy norm unless an `aim` is given. `square` is the
    energy of the error by those who spawn together, `left` the load that every agent leaves;
    `error` the estimate in the energy norm (the target before agents settle); `aimed` the error
    that the tolerance is about, and who has to spawn for it; `stopped` why there is no step left
    short of it: "depth", "agents", "iteration" or "blind". Goals ask single agents for `balance`,
    `displacement`, `indicator` and `hierarchy`.
    """

    square: Floats
    left: Floats
    aimed: Aimed
    balance: Equilibrium
    displacement: Floats
    indicator: Indicator
    hierarchy: NestedMultigrid

    def __init__(
        self, ground: PosedBody, tolerance: float, most_agents: int, aim: Target | None = None
    ) -> None:
        self.ground, self.tolerance, self.most_agents = ground, tolerance, most_agents
        self.aim = aim or Target()
        self._of_energy = aim is None
        self.error, self.energy = FIRST_GUESS, 0.0
        self.finished, self.stopped = False, ""
        self.bracket: EnergyBounds | str | None = None
        self.notes: list[str] = []
        self.residuals: list[float] = []
        self.generations: list[Generation] = []
        self._estimated = 0.0
        self._share = PROVED_AT[ground.dimension] if self._of_energy else 1.0
        self._marked: Flags | None = None

    @property
    @abstractmethod
    def leaves(self) -> LeafCells:
        """The agents of this generation."""

    @property
    @abstractmethod
    def smallest(self) -> Flags:
        """Which of those who spawn together are as small as may be."""

    @property
    @abstractmethod
    def sharp(self) -> Ints:
        """Which of those who spawn together are at points where stress has no limit."""

    @abstractmethod
    def outcome(self) -> Spawning:
        """Return the agents as they are."""

    @abstractmethod
    def _spawn(self, marked: Flags) -> None:
        """Replace agents by their children, who begin as their parents stand."""

    @abstractmethod
    def _settle(self, *, for_good: bool) -> Iteration:
        """Balance the forces, to a share of the error before or for good, and look."""

    @abstractmethod
    def _bounds(self, *, settled: bool = True) -> EnergyBounds | str:
        """Hold the true energy between two that can be computed; estimate them if not settled."""

    @property
    def agents(self) -> int:
        """How many agents there are."""
        return len(self.leaves)

    def _ended(self, levels: int) -> dict[str, Any]:
        """Return what is to be told of agents as they are, with so many levels of multigrid."""
        return {
            "energy": self.energy,
            "error": self.error,
            "generations": list(self.generations),
            "residuals": self.residuals,
            "levels": levels,
            "reached": self.reached,
            "stopped": "" if self.reached else self.stopped,
            "notes": list(self.notes),
            "bracket": self.bracket,
        }

    @property
    def target(self) -> float:
        """The estimated error at which bounds, if there can be any, may keep the tolerance."""
        few = self.agents <= MOST_PROVED[self.ground.dimension]
        return self.tolerance / self._share if few else self.tolerance

    @property
    def proved(self) -> bool:
        """Whether the bound keeps the tolerance."""
        return isinstance(self.bracket, EnergyBounds) and self.bracket.error <= self.tolerance

    @property
    def reached(self) -> bool:
        """Whether the tolerance is kept, by the bound or the estimate."""
        return (self.aimed.error <= self.tolerance or self.proved) and self.stopped != "iteration"

    def step(self) -> None:
        """Spawn, but for the first time, and settle."""
        if self._marked is not None:
            self.bracket = None  # of those that were there before
            self._spawn(self._marked)
        runs = [self._settle(for_good=False)]
        self._expect()
        if self._ends():
            if not runs[-1].errors[-1] <= LAST:
                runs.append(self._settle(for_good=True))
                self._ends()
            last = runs[-1]
            if last.errors[-1] > 0.1 * max(self.error, self.tolerance):
                self.stopped, self.finished = "iteration", True
            left = last.residuals[-1] if not last.converged else self._left_of_loads()
            if self.finished and (not last.converged or left > TOLD):
                short = f"the forces on the agents balance to {left:.1g} of the loads only"
                self.notes.append(short)
            self._prove()
        # A few large agents may turn about a hinge that their children stiffen.
        if self.finished or self.agents >= TELLING:
            said = self._rounding()
            self.notes += said if self.finished else []
        self.residuals = runs[-1].residuals
        self._marked = None if self.finished else self.aimed.marked
        leaves, iterations = self.leaves, sum(run.iterations for run in runs)
        spawn = self.aimed.marked & (not self.finished)
        spawn = np.repeat(spawn, len(leaves) // len(spawn))
        cost = (len(leaves), self.error, self.energy, iterations, self.aimed.error)
        self.generations.append(Generation(*cost, leaves.code, leaves.size, self.left, spawn))

    def mark(self, part: Floats, allowed: float) -> Flags:
        """Choose who spawns: those with the largest parts in an error (see `mark_largest`)."""
        return mark_largest(part, allowed, self.smallest, BULK[self.ground.dimension])

    def mark_for_energy(self, part: Floats, allowed: float) -> Flags:
        """Choose who spawns for the energy norm: first those where stress has no limit."""
        marked = self.mark(part, allowed)
        if marked.any():
            # They are few, and each step takes half of their error at most: in the end all others
            # would settle once more for them.
            at, own = self.sharp, np.zeros(len(part))
            own[at] = part[at]
            marked |= mark_largest(own, EARLY * allowed, self.smallest, 1.0)
        return marked

    def _expect(self) -> None:
        """Ask bounds once, long before the end, for which share of the estimate they will be."""
        known = self._share != PROVED_AT[self.ground.dimension]
        some = TELLING <= self.agents <= ASKED[self.ground.dimension]
        if known or not some or not self.target < self.error < inf:
            return
        bracket = self._bounds(settled=False)
        if isinstance(bracket, EnergyBounds):
            self._share = min(max(bracket.error / self.error, LEAST_SHARE), 1.0)

    def _ends(self) -> bool:
        """Tell whether no step is left."""
        marked, expected = self.aimed.marked, 0.0
        if self._of_energy and self.ground.smallest == 1 and self.agents >= TELLING:
            # They grow in number at least with the error's fall to the power of the dimension,
            # unless a resolution does not let them be smaller.
            expected = self.agents * (self.error / self.tolerance) ** self.ground.dimension
        many = self._after(marked) > self.most_agents or expected > FAR * self.most_agents
        if many or len(self.generations) + 1 == MOST_GENERATIONS:
            self.stopped = "agents"
        else:
            self.stopped = "" if marked.any() else "depth"
        self.finished = self.aimed.error <= self.target or bool(self.stopped)
        return self.finished

    def _after(self, marked: Flags) -> int:
        """Return how many agents there are when some have spawned."""
        more = ((1 << self.ground.dimension) - 1) * (self.agents // max(len(marked), 1))
        return self.agents + more * int(np.count_nonzero(marked))

    def _left_of_loads(self) -> float:
        """Return what is left beside the applied forces; those of moved sides may be far larger."""
        return 0.0

    def _rounding(self) -> list[str]:
        """Say what rounding leaves unbalanced; refuse what it hides before more agents spawn."""
        return []

    def _prove(self) -> None:
        """Go on where the mean stress may be further off than the tolerance."""
        dimension = self.ground.dimension
        if self.agents > MOST_PROVED[dimension] or self.stopped == "iteration":
            return
        ratio = max(self.aimed.error / self.tolerance, 1.0) ** dimension
        self._estimated = self._estimated or ratio * self.agents
        if not self._of_energy:
            self._bound_goals()
            return
        if self.aimed.error > self.target:
            return
        self.bracket = self._bounds()
        if self.proved:
            return
        if isinstance(self.bracket, EnergyBounds):
            self._share = min(self.bracket.error / max(self.error, self.tolerance), 1.0)
            # The bound is half the distance of two stresses, of which the shares are the squares.
            shares = self.bracket.shares.reshape(len(self.square), -1).sum(axis=1)
            allowed = 2 * self.bracket.lower * (2 * SPARE * self.tolerance) ** 2
            marked = self.mark_for_energy(shares, allowed)
            if self._worth(marked):
                self.aimed, self.finished = self.aimed._replace(marked=marked), False
                return
        # Without a proof the estimate has to do.
        self._share = 1.0
        if self.aimed.error > self.tolerance:
            self.aimed = self.aim.look(self)
            self._ends()

    def _bound_goals(self) -> None:
        """Hold goals between bounds, and go on where these say that estimates are blind."""
        estimated, self.aimed = self.aimed, self.aim.bounded(self)
        if self.aimed.error > self.tolerance >= estimated.error:
            self.finished = not self._worth(self.aimed.marked)
            self.stopped = "blind" if self.finished else ""
        if self.finished and not isfinite(self.aimed.error):
            self.aimed = estimated

    def _worth(self, marked: Flags) -> bool:
        """Tell whether to go on for a proof if these spawn."""
        agents = self._after(marked)
        worth = worth_proving(agents, self._estimated, self.ground.dimension)
        worth = worth and agents <= self.most_agents
        return bool(marked.any()) and worth and len(self.generations) + 2 < MOST_GENERATIONS


class LeafLoop(RefineLoop):
    """Agents of which each may spawn; see `RefineLoop`."""

    indicator: Indicator

    def __init__(
        self,
        ground: PosedBody,
        tolerance: float,
        most_agents: int,
        aim: Target | None = None,
        previous: Spawning | None = None,
    ) -> None:
        super().__init__(ground, tolerance, most_agents, aim)
        if previous is None:
            self.balance, self.notes = first_agents(ground)
            self.displacement = self.balance.grid.value.copy()
        else:
            self.balance, self.error = previous.balance.loaded_by(ground), previous.error
            zeros = np.zeros(self.agents)  # as if they had been there from the start
            first = replace(self.leaves, step=zeros.astype(np.int64), cause=zeros)
            self.balance.grid.leaves = first
            self.displacement = previous.displacement.copy()
            self.notes = [note for note in previous.notes if note.endswith(HALVED)]
        self.hierarchy = NestedMultigrid(self.balance)

    @property
    def leaves(self) -> LeafCells:
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

    def _spawn(self, marked: Flags) -> None:
        number, leaves = len(self.generations), self.leaves
        leaves = leaves.split(marked, number, self.indicator.load * self.ground.scales.force)
        leaves = leaves.balanced(number, young=leaves.step == number)
        self.balance = Equilibrium(CompositeGrid(self.ground, leaves))
        self.displacement = self.hierarchy.grow(self.balance, self.displacement)

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

    def _bounds(self, *, settled: bool = True) -> EnergyBounds | str:
        return bracket_of(boxes_of_agents(self.balance, self.displacement), settled)
