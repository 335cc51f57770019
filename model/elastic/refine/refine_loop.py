"""The loop of adaptive refinement: solve, estimate, mark, refine (Doerfler 1996)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from math import inf, isfinite, log2
from typing import Any, ClassVar

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import fits_quadratics
from kaju.model.elastic.bounds.bound_cells import BoundCells
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
from kaju.model.elastic.cells.leaf_supports import HALVED, first_agents
from kaju.model.elastic.equal.krylov import Iteration
from kaju.model.elastic.equal.system import lost_digits, rounding_notes
from kaju.model.elastic.multigrid.nested import (
    LAST,
    NestedMultigrid,
    energy_of,
    relative_error,
    settle,
)
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.refine.estimator import Indicator, indicate
from kaju.model.elastic.refine.generations import OldGeneration, Spawning
from kaju.model.elastic.refine.targets import (
    DORFLER,
    GAIN,
    GAIN_OF_BOUNDS,
    SPARE,
    Aimed,
    mark_largest,
)

MOST_GENERATIONS = 60
PREDICTS, FAR, FAR_OF_BOUNDS = 500, 600.0, 10.0
"""From so many agents on their number in the end is predicted from the error; if it is so many
times above what is allowed, the loop ends: by estimates, and by bounds in the plane."""
NOTED_RESIDUAL = 1e-5  # Residual, as a share of the applied forces, from which on it is noted
MOST_BOUNDED_EARLY = {2: 0, 3: 4_000}
"""Up to so many agents bounds are worked out once before the end: of more they take too long. In
the plane they judge every generation."""
MOST_HALVINGS = 2  # Of agents at singular points, beyond the first, in one generation
SHARP_BUDGET = 0.1  # Share of the error budget for agents at points where stress is singular
STALLED = 0.95
"""Smallest agents that alone exceed the budget end the loop once a bound falls by less: to such a
share of the last one."""
LEAST_SHARE = 0.5  # Of the estimate that bounds are expected to be
FIRST_GUESS = 0.3  # Relative error assumed before the first generation
ALGEBRAIC_SHARE = 0.05
"""Every generation is iterated to this share of its estimated error, the last one further."""


class Target:
    """The error that the tolerance limits: in the energy norm, unless a subclass replaces it."""

    def estimate(self, spawner: RefineLoop) -> Aimed:
        """Return the estimated error of settled agents, and the marks for the next generation."""
        allowed = 2 * spawner.energy * (spawner.spare * spawner.target) ** 2
        marked = spawner.mark_for_energy(spawner.square, allowed)
        return Aimed(spawner.error, spawner.square, marked, allowed)

    def bounded(self, spawner: RefineLoop) -> Aimed:
        """Return the same with bounds; those of the energy norm are the loop's own."""
        return spawner.aimed


class RefineLoop(ABC):
    """Agents that settle, estimate their errors, and spawn, generation by generation.

    The loop is the same whether agents spawn one by one or block by block (the *elements* of the
    refinement), up to `most_agents`. `square` is the squared error (energy norm) of every element,
    `unbalanced` the load that every agent leaves unbalanced; `error` the relative estimate in the
    energy norm (a guess before agents settle); `aimed` the error that the tolerance limits, with
    the marks for the next generation; `stopped` why the loop ends above the tolerance: "depth",
    "agents", "iteration" or "blind". Goals read `balance`, `indicator` and `hierarchy`, which only
    single agents have.
    """

    most_proved: ClassVar[Mapping[int, int]] = MOST_PROVED  # Agents, by dimension
    spare = SPARE  # Share of the target that the last generation aims at
    square: Floats
    unbalanced: Floats
    aimed: Aimed
    displacement: Floats
    balance: Equilibrium
    indicator: Indicator
    hierarchy: NestedMultigrid

    def __init__(
        self, ground: PosedBody, tolerance: float, most_agents: int, aim: Target | None = None
    ) -> None:
        self.ground, self.tolerance, self.most_agents = ground, tolerance, most_agents
        self.aim = aim or Target()
        self._of_energy = aim is None
        self.error, self.energy = FIRST_GUESS, 0.0
        self.accuracy = FIRST_GUESS  # The least error that is known: estimated, or proved
        self.finished, self.stopped = False, ""
        self.bracket: EnergyBounds | str | None = None
        self.notes: list[str] = []
        self.residuals: list[float] = []
        self.generations: list[OldGeneration] = []
        self._needed = 0.0  # Agents whose estimate is expected to keep the tolerance
        # Expected ratio of the bound to the estimate.
        self._share = PROVED_AT[ground.dimension] if self._of_energy else 1.0
        self._marked: Flags | None = None

    @property
    @abstractmethod
    def leaves(self) -> LeafCells:
        """The agents of this generation."""

    @property
    @abstractmethod
    def smallest(self) -> Flags:
        """Which elements are as small as they may be."""

    @property
    @abstractmethod
    def sharp(self) -> Ints:
        """Elements at points where stress is singular."""

    @abstractmethod
    def outcome(self) -> Spawning:
        """Return the agents as they are."""

    @abstractmethod
    def _spawn(self, marked: Flags) -> None:
        """Replace agents by their children, which start from the prolonged displacement."""

    @abstractmethod
    def _solve(self, *, for_good: bool) -> tuple[Iteration, float]:
        """Solve, to a share of the last error or for good; return the relative algebraic error."""

    @abstractmethod
    def _estimate(self) -> tuple[float, Floats, Floats]:
        """Return the energy, the squared error of every element, and every agent's load."""

    @abstractmethod
    def _bound_cells(self) -> BoundCells:
        """Return the agents as energy bounds need them."""

    @property
    def agents(self) -> int:
        """How many agents there are."""
        return len(self.leaves)

    def _ended(self, levels: int) -> dict[str, Any]:
        """Return the fields of `Spawning` that do not depend on how agents are stored."""
        return {
            "energy": self.energy,
            "error": self.error,
            "generations": list(self.generations),
            "residuals": self.residuals,
            "levels": levels,
            "reached": self.reached,
            "stopped": "" if self.reached else self.stopped,
            "notes": list(self.notes),
            "known": self.bracket,
        }

    @property
    def target(self) -> float:
        """The estimated error at which the bound, if one is affordable, may keep the tolerance."""
        few = self.agents <= self.most_proved[self.ground.dimension]
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
        """Spawn, except in the first step, and settle."""
        if self._marked is not None:
            self.bracket = None  # that of the last generation
            self._spawn(self._marked)
        runs = [self._settle(for_good=False)]
        if self._ends():
            if not runs[-1].errors[-1] <= LAST:
                runs.append(self._settle(for_good=True))
                self._ends()
            last = runs[-1]
            if last.errors[-1] > 0.1 * max(self.accuracy, self.tolerance):
                self.stopped, self.finished = "iteration", True
            residual = self._residual() if last.converged else last.residuals[-1]
            if self.finished and (not last.converged or residual > NOTED_RESIDUAL):
                short = f"the forces on the agents balance to {residual:.1g} of the loads only"
                self.notes.append(short)
            self._prove()
        # A few large agents may turn about a hinge that their children stiffen.
        if self.finished or self.agents >= PREDICTS:
            rounding = self._rounding()
            self.notes += rounding if self.finished else []
        self.residuals = runs[-1].residuals
        self._marked = None if self.finished else self.aimed.marked
        leaves, iterations = self.leaves, sum(run.iterations for run in runs)
        spawn = self.aimed.marked & (not self.finished)
        spawn = np.repeat(spawn, len(leaves) // len(spawn))
        cost = (len(leaves), self.error, self.energy, iterations, self.aimed.error)
        self.generations.append(
            OldGeneration(*cost, leaves.code, leaves.size, self.unbalanced, spawn)
        )

    def _settle(self, *, for_good: bool) -> Iteration:
        """Solve, estimate the error, and mark."""
        run, algebraic = self._solve(for_good=for_good)
        self.energy, self.square, self.unbalanced = self._estimate()
        self.error = float(np.hypot(relative_error(self.square, self.energy), algebraic))
        self.aimed, self.accuracy = self.aim.estimate(self), self.error
        if self._certifies:
            self._judge()
        elif not for_good:  # which the expectation itself may ask for
            self._expect_bounds()
        return run

    @property
    def _certifies(self) -> bool:
        """Whether bounds judge every generation: in the plane they converge twice as fast."""
        return self._of_energy and fits_quadratics(self.ground.dimension, self.agents)

    def _judge(self) -> None:
        """Let the bounds say how far off the answer is, and which agents spawn."""
        self.bracket = self._bounds(settled=False)
        if not (isinstance(self.bracket, EnergyBounds) and self.bracket.error < inf):
            return
        if self.bracket.error > self.error:
            # Almost a hinge: bounds are far from their second order, and would ask for any number.
            return
        self._share, self.aimed = 1.0, self._by_bounds(self.bracket)
        self.accuracy = self.aimed.error

    def _by_bounds(self, bracket: EnergyBounds) -> Aimed:
        """Return the error that is proved, and the marks that let it fall to the tolerance."""
        # The bound is half the distance between two stresses (Prager and Synge 1947), and the
        # shares are the squared distances: their budget is that of twice the tolerance.
        shares = bracket.shares.reshape(len(self.square), -1).sum(axis=1)
        allowed = 2 * bracket.lower * (2 * SPARE * self.tolerance) ** 2
        # A halving takes about half of the share of a cell at a singular point: so many more follow
        # at once.
        sharp = shares[self.sharp]
        times = 1.0
        if allowed > 0.0:
            times = sharp.max(initial=0.0) * len(sharp) / (SHARP_BUDGET * allowed)
        more = int(np.clip(log2(max(times, 1.0)) - 1.0, 0, MOST_HALVINGS))
        gain = GAIN_OF_BOUNDS if self._certifies else GAIN
        marked = self.mark_for_energy(shares, allowed, gain)
        return Aimed(bracket.error, shares, marked, allowed, more_halvings=more)

    def _bounds(self, *, settled: bool = True) -> EnergyBounds | str:
        """Return bounds of the true energy, or why there are none; estimated if not settled."""
        return bracket_of(self._bound_cells(), settled)

    def mark(self, part: Floats, allowed: float, gain: float = GAIN) -> Flags:
        """Mark the elements with the largest contributions to an error."""
        dorfler = DORFLER[self.ground.dimension]
        return mark_largest(part, allowed, self.smallest, dorfler, gain)

    def mark_for_energy(self, part: Floats, allowed: float, gain: float = GAIN) -> Flags:
        """Return the same for the energy norm, and all that contribute most at singular points."""
        marked = self.mark(part, allowed, gain)
        if marked.any():
            # Elements at singular points are few, and a halving takes half of their squared error
            # at most. Refined with the others they would need generations of their own at the end.
            at, own = self.sharp, np.zeros(len(part))
            own[at] = part[at]
            marked |= mark_largest(own, SHARP_BUDGET * allowed, self.smallest, 1.0)
        return marked

    def _due(self, fewest: int, most: int) -> bool:
        """Tell whether to work out bounds once, long before the end, between so many agents."""
        expected = self._share != PROVED_AT[self.ground.dimension]
        return fewest <= self.agents <= most and not expected and self.target < self.error < inf

    def _expect_bounds(self) -> None:
        """Find the ratio of bounds to the estimate that is expected, where that is due."""
        if self._due(PREDICTS, MOST_BOUNDED_EARLY[self.ground.dimension]):
            self._measure_share(settled=False)

    def _measure_share(self, *, settled: bool) -> None:
        """Expect bounds to be in the end what they are of the estimate now."""
        bracket = self._bounds(settled=settled)
        if isinstance(bracket, EnergyBounds):
            self._share = min(max(bracket.error / self.error, LEAST_SHARE), 1.0)

    def _ends(self) -> bool:
        """Tell whether this is the last generation, and set why."""
        marked, expected = self.aimed.marked, 0.0
        if self._of_energy and self.ground.smallest == 1 and self.agents >= PREDICTS:
            # The error falls at most with the agents' size, so their number grows at least by the
            # error's ratio to the power of the dimension (unless a resolution limits their size);
            # bounds in the plane fall with the square of the size, more slowly at singular points.
            power, far = (1.4, FAR_OF_BOUNDS) if self._certifies else (self.ground.dimension, FAR)
            # Bounds above the solution itself say that agents are far from it, not how far.
            error = min(self.aimed.error, 1.0) if self._certifies else self.aimed.error
            expected = self.agents / far * (error / self.tolerance) ** power
        many = max(self._after(marked), expected) > self.most_agents
        if many or len(self.generations) + 1 == MOST_GENERATIONS:
            self.stopped = "agents"
        else:
            self.stopped = "" if marked.any() and not self._stalls() else "depth"
        self.finished = self.aimed.error <= self.target or bool(self.stopped)
        return self.finished

    def _stalls(self) -> bool:
        """Tell whether agents as small as they may be keep a bound from falling any further."""
        # They bend the fields of others as well, whose shares do not fall by halvings either.
        fixed = float(self.aimed.part[self.smallest].sum())
        if not (self._certifies and self.generations and fixed > self.aimed.allowed):
            return False
        return self.aimed.error > STALLED * self.generations[-1].aimed_error

    def _after(self, marked: Flags) -> int:
        """Return the number of agents after those marked have spawned."""
        more = ((1 << self.ground.dimension) - 1) * (self.agents // max(len(marked), 1))
        return self.agents + more * int(np.count_nonzero(marked))

    def _residual(self) -> float:
        """Return the residual relative to the applied forces alone, without those of supports."""
        return 0.0  # where no side is displaced, the iteration's residual says it

    def _rounding(self) -> list[str]:
        """Return notes on digits lost by rounding; refuse a body that loses too many."""
        return []

    def _prove(self) -> None:
        """Work out bounds, and go on where they miss the tolerance and a proof is affordable."""
        dimension = self.ground.dimension
        if self.agents > self.most_proved[dimension] or self.stopped == "iteration":
            return
        ratio = max(self.aimed.error / self.tolerance, 1.0) ** dimension
        self._needed = self._needed or ratio * self.agents
        if not self._of_energy:
            self._bound_goals()
            return
        if self.aimed.error > self.target:
            return
        known = self.bracket if self._certifies else None
        if not (isinstance(known, EnergyBounds) and known.balanced):
            self.bracket = self._bounds()
        if self.proved:
            return
        if isinstance(self.bracket, EnergyBounds):
            self._share = min(self.bracket.error / max(self.error, self.tolerance), 1.0)
            judged = self._by_bounds(self.bracket)
            if self._worth(judged.marked):
                self.aimed = self.aimed._replace(
                    marked=judged.marked, more_halvings=judged.more_halvings
                )
                self.finished = False
                return
        # Without a proof the estimate alone has to keep the tolerance.
        self._share = 1.0
        self.aimed = self.aim.estimate(self)
        if self.aimed.error > self.tolerance:
            self._ends()

    def _bound_goals(self) -> None:
        """Bound the goals, and go on where bounds contradict the estimates."""
        estimated, self.aimed = self.aimed, self.aim.bounded(self)
        if self.aimed.error > self.tolerance >= estimated.error:
            self.finished = not self._worth(self.aimed.marked)
            self.stopped = "blind" if self.finished else ""
        if self.finished and not isfinite(self.aimed.error):
            self.aimed = estimated

    def _worth(self, marked: Flags) -> bool:
        """Tell whether one more generation, for a proof, is affordable."""
        agents = self._after(marked)
        worth = worth_proving(agents, self._needed, self.ground.dimension)
        worth = worth and agents <= self.most_agents
        return bool(marked.any()) and worth and len(self.generations) + 2 < MOST_GENERATIONS


class LeafLoop(RefineLoop):
    """Agents that spawn one by one, on a composite grid; see `RefineLoop`."""

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
            zeros = np.zeros(self.agents)  # step and cause of first agents
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
        """Which agents are as small as they may be."""
        return np.asarray(self.leaves.size <= self.ground.smallest)

    @property
    def sharp(self) -> Ints:
        """Agents at points where stress is singular."""
        return self.leaves.holding(self.ground.sharp)

    def outcome(self) -> Spawning:
        """Return the agents as they are."""
        own = (self.balance, self.displacement, self.indicator, self.aimed)
        return Spawning(*own, **self._ended(self.hierarchy.depth))

    def _spawn(self, marked: Flags) -> None:
        number, leaves = len(self.generations), self.leaves
        leaves = leaves.split(marked, number, self.indicator.load * self.ground.scales.force)
        for _ in range(self.aimed.more_halvings):
            again = np.zeros(len(leaves), dtype=np.bool_)
            again[leaves.holding(self.ground.sharp)] = True
            again &= (leaves.step == number) & (leaves.size > self.ground.smallest)
            leaves = leaves.split(again, number, np.full(len(leaves), np.nan))
        leaves = leaves.balanced(number, young=leaves.step == number)
        self.balance = Equilibrium(CompositeGrid(self.ground, leaves))
        self.displacement = self.hierarchy.grow(self.balance, self.displacement)

    def _solve(self, *, for_good: bool) -> tuple[Iteration, float]:
        share = LAST if for_good else ALGEBRAIC_SHARE * self.accuracy
        run = settle(self.balance, self.hierarchy, self.displacement, share)
        return run, run.errors[-1]

    def _estimate(self) -> tuple[float, Floats, Floats]:
        self.indicator = indicate(self.balance, self.displacement)
        return energy_of(self.balance, self.displacement), *self.indicator

    def _residual(self) -> float:
        residual = (self.balance.force(self.displacement) - self.balance.load)[self.balance.free]
        applied = float(np.abs(self.balance.load).sum())
        return float(np.abs(residual).sum()) / applied if applied > 0.0 else 0.0

    def _rounding(self) -> list[str]:
        free, right = self.balance.free, self.balance.load - self.balance.pull
        stiffness = self.hierarchy.matrix.diagonal()
        return rounding_notes(lost_digits(self.displacement[free] * stiffness, right[free]))

    def _bound_cells(self) -> BoundCells:
        return boxes_of_agents(self.balance, self.displacement)
