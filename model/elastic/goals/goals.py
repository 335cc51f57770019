"""Errors of quantities of interest, by dual solutions.

A quantity J depends on the displacement by its derivative j. The displacement z = K⁻¹ j that j
would cause as a force tells how much J feels a force anywhere (Maxwell's influence function;
the dual solution of Becker & Rannacher 2001). With the second differences C u and C z of both,
as in `displacement_error`, J is off by about

    z·C'C u = Σ C u · C z,

a sum over the agents. Terms of different sign may cancel, which is not relied on: the estimate is
half-way between the sum and that of their sizes. Agents are marked by the product of the two
errors, η(u)·η(z), which has no sign.

A mean displacement or stress J is the work of forces g: J = g·u. With z the displacement that
they cause, the potential energy of the loads f ± t g is

    Π± = Π(f) ∓ t J + t² Π(g),    so that    J = (Π₋ − Π₊) / 2t,

and both lie between bounds: those of u ± t z (`energy_bounds`). With t the ratio of the errors of
u and z, J is known but for half the product of the distances that their two stresses have each
(Greenberg 1948, Prager & Synge 1947), and lies round the work of the mean fields.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.elastic.bounds.bound_cells import BoundCells, Loads
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.energy_bounds import bracket_of
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import CellFields
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.equal.krylov import Iteration, dot
from kaju.model.elastic.goals.displacement_error import DisplacementTarget
from kaju.model.elastic.goals.functionals import Value, functional_of
from kaju.model.elastic.goals.goal_regions import ExactCover
from kaju.model.elastic.goals.quantities import (
    DISPLACEMENT,
    HOOP,
    Quantity,
    Stress,
    ToleranceAt,
    described,
    named,
    quantities_of,
    quantity_from,
)
from kaju.model.elastic.multigrid.nested import LAST, NestedMultigrid
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import LeafForces, PosedBody
from kaju.model.elastic.refine.estimator import Curvature, SecondDifferences
from kaju.model.elastic.refine.refine_loop import RefineLoop, Target
from kaju.model.elastic.refine.targets import SPARE, Aimed, Answer
from kaju.model.results.result import finite

FACTOR = 1.25  # Of the estimate, found on random plane bodies
MOST = 50  # Quantities at a time
BLIND = {2: 0.75, 3: 1.5}
"""Where bounds are so many times the estimates, these miss a part of the errors: in the plane,
where bounds are of second order, at hinges; else they are a tenth to a half of the estimates."""
WIDE = 100.0
"""Bounds so many times the estimates say nothing of the value, which stays that of the agents: in
rubber, of which mean stresses have bounds as large as themselves."""
ROUNDING = 1e-13  # Share of the energies that rounding may take
SMALL = 1e-12
"""Share of a displacement's square that stands for the energy of its error if there is none."""
ALGEBRAIC_SHARE, FIRST_GUESS = 0.05, 0.3
"""Dual solutions are solved to this share of their own error, at first of a guess at it."""


Asked = str | tuple[Quantity, ...] | None  # What `goal` asks for in its shortest form


class Goal(NamedTuple):
    """What has been found of a quantity."""

    quantity: Quantity
    value: float | Floats  # In m, Pa or N; a vector has shape (dimension,)
    error_estimate: float  # Estimated error of the value, of a vector in length
    # The same relative to the value or, where that is smaller, to a hundredth of the largest
    # displacement, stress or reaction of all
    relative_error: float
    error_bound: float | None = None  # What the error of the value is at most; a theorem
    relative_bound: float | None = None
    no_bound: str = ""  # Why there is none; empty if there is

    def figures(self) -> dict[str, Any]:
        """Return its entry in a summary."""
        return {
            "value": np.asarray(self.value).tolist(),
            "error_estimate": finite(self.error_estimate),
            "relative_error": finite(self.relative_error),
            "error_bound": self.error_bound,
        }

    def doubt(self, tolerance: float) -> str:
        """Say what is not proved of it; empty if it is within the tolerance for certain."""
        if self.relative_bound is not None and self.relative_bound <= tolerance:
            return ""
        estimate = f"{named(self.quantity)}: the error is estimated as {self.relative_error:.2g}"
        if self.relative_bound is None:
            return f"{estimate}, without a proof: {self.no_bound}"
        return f"{estimate}, and proved to be below {self.relative_bound:.2g}"


class DualSolution:
    """The derivative of a component of a quantity by forces, followed through generations."""

    def __init__(self) -> None:
        self._balance: Equilibrium | None = None
        self._displacement = np.zeros(0)
        self.off = FIRST_GUESS  # Its own error in the energy norm, relative

    def of(self, derivative: Floats, balance: Equilibrium, hierarchy: NestedMultigrid) -> Floats:
        """Return the displacement of the free faces for the derivative as a force."""
        if balance is self._balance:
            return self._displacement
        share = ALGEBRAIC_SHARE * self.off

        def done(run: Iteration) -> bool:
            return run.errors[-1] <= share

        start = hierarchy.prolonged(self._displacement)
        self._displacement = hierarchy.solve(derivative, start, done).solution
        self._balance = balance
        return self._displacement

    def under(
        self, balance: Equilibrium, forces: LeafForces, hierarchy: NestedMultigrid
    ) -> tuple[Equilibrium, Floats, float]:
        """Return the dual problem of forces, its displacement, and the energy of its error."""
        found = under_forces(balance, forces)
        load, z = found.load[found.free], found.grid.value.copy()

        def done(run: Iteration) -> bool:
            return run.errors[-1] <= LAST or run.at_rounding()

        z[found.free] = hierarchy.solve(load, self._displacement, done).solution
        return found, z, self.off**2 * float(dot(load, z[found.free]))


class GoalTarget(Target):
    """The largest relative error of some quantities."""

    def __init__(self, quantities: tuple[Quantity, ...], ground: PosedBody) -> None:
        self._functionals = [functional_of(quantity, ground) for quantity in quantities]
        self._duals = [[DualSolution() for _ in f.directions] for f in self._functionals]

    def estimate(self, spawner: RefineLoop) -> Aimed:
        """Return the estimated error of settled agents, and the marks for the next generation."""
        grid = spawner.balance.grid
        large = np.any([f.coarse(grid) for f in self._functionals], axis=0)
        large &= grid.leaves.size > grid.ground.smallest
        if large.any():
            return Aimed(inf, large.astype(np.float64), large, 0.0)
        fields = CellFields(spawner.balance, spawner.displacement)
        curvature = Curvature(spawner.balance)
        second = curvature.of(spawner.displacement)
        answers, parts = [], []
        for functional, duals in zip(self._functionals, self._duals, strict=True):
            value = functional.of(fields)
            errors, part = _estimated(value, duals, spawner, curvature, second)
            error = float(np.linalg.norm(errors)) + value.sampling_error
            scale = value.scale or 1.0
            answers.append(Answer(value.value, error, error / scale, scale))
            parts.append(part / scale)
        return _aimed(spawner, answers, parts)

    def bounded(self, spawner: RefineLoop) -> Aimed:
        """Return the answers with their bounds."""
        # Agents across the boundary of a region have to spawn first.
        grid = spawner.balance.grid
        covers = [functional.parts(grid) for functional in self._functionals]
        cut = np.zeros(len(grid.leaves), dtype=np.bool_)
        for cover in covers:
            cut |= False if isinstance(cover, str) else cover.cut
        if cut.any():
            return Aimed(inf, cut.astype(np.float64), cut, 0.0)
        own = boxes_of_agents(spawner.balance, spawner.displacement)
        answers, parts = [], []
        for number, (answer, cover) in enumerate(zip(spawner.aimed.answers, covers, strict=True)):
            bounds = cover if isinstance(cover, str) else self._bounds(spawner, own, number, cover)
            answers.append(_certain(answer, bounds, grid.dimension))
            shares = [] if isinstance(bounds, str) else [one.shares for one in bounds]
            parts.append(sum(shares, np.zeros(len(cut))) / answer.scale)
        found = _aimed(spawner, answers, parts)
        return found if found.part.any() else found._replace(part=spawner.aimed.part)

    def _bounds(
        self, spawner: RefineLoop, own: BoundCells, number: int, cover: ExactCover
    ) -> list[FunctionalBounds] | str:
        """Return bounds of the components of a quantity, or why there are none."""
        found, error = [], float(spawner.indicator.square.sum())
        forces = self._functionals[number].loads(spawner.balance.grid, cover)
        for dual, force in zip(self._duals[number], forces, strict=True):
            problem, z, dual_error = dual.under(spawner.balance, force, spawner.hierarchy)
            bounds = bounds_of_work(own, boxes_of_agents(problem, z), error, dual_error)
            if isinstance(bounds, str):
                return bounds
            found.append(bounds)
        return found


class FunctionalBounds(NamedTuple):
    """A quantity that lies within `off` of `middle`; scaled."""

    middle: float
    off: float
    blind: float  # `off` over the product of the estimated errors of both solutions
    shares: Floats  # shape (agents,): Every agent's part of `off`


def bounds_of_work(
    own: BoundCells, dual: BoundCells, error: float, dual_error: float
) -> FunctionalBounds | str:
    """Return bounds of the work of the dual problem's forces, or why there are none."""
    # `own` are the agents under the loads, `dual` under the forces; with the estimated energies of
    # the errors of both.
    sizes = (float(np.abs(boxes.mesh.start).max(initial=0.0)) for boxes in (own, dual))
    larger = [off + SMALL * u**2 for off, u in zip((error, dual_error), sizes, strict=True)]
    share = sqrt(larger[0] / larger[1]) if min(larger) > 0.0 else 1.0
    more, less = (bracket_of(_sum(own, dual, sign * share)) for sign in (1.0, -1.0))
    if isinstance(more, str):
        return more
    if isinstance(less, str):
        return less
    (low, high), (least, most) = more.potential, less.potential
    middle, off = least + most - low - high, most - least + high - low
    off += ROUNDING * (abs(low) + abs(high) + abs(least) + abs(most))
    off *= 0.25 / share
    # The part of the loads that agents do not take works on the dual displacement.
    off += own.data_error * (sqrt(0.5 * more.upper) + sqrt(0.5 * less.upper)) / share
    shares = (more.shares + less.shares) / (8.0 * share)
    return FunctionalBounds(
        0.25 * middle / share, off, off / sqrt(larger[0] * larger[1] or 1.0), shares
    )


def _sum(first: BoundCells, second: BoundCells, share: float) -> BoundCells:
    """Return boxes under the loads of the first, and a share of those of the second."""
    forces = zip(first.loads, second.loads._replace(force=share * second.loads.force), strict=True)
    held = [
        one._replace(value=one.value + share * two.value)
        for one, two in zip(first.held, second.held, strict=True)
    ]
    start = first.mesh.start + share * second.mesh.start
    return replace(
        first,
        sigma=first.sigma + share * second.sigma,
        shear={pair: tau + share * second.shear[pair] for pair, tau in first.shear.items()},
        body=first.body + share * second.body,
        uneven=first.uneven | second.uneven,
        loads=Loads(*(np.concatenate(columns) for columns in forces)),
        held=held,
        mesh=first.mesh._replace(start=start),
        moved=first.moved + share * second.moved,
        of=max(first.largest, abs(share) * second.largest),
    )


class _UnderForces(PosedBody):
    """A body under some forces only; nothing that holds it moves."""

    def __init__(self, ground: PosedBody, forces: LeafForces) -> None:
        self.__dict__.update(ground.__dict__)
        self._only = forces

    def forces(self, leaves: LeafCells) -> LeafForces:
        return self._only

    def given(self, side: int) -> Floats:
        return np.zeros(self.dimension)


def under_forces(balance: Equilibrium, forces: LeafForces) -> Equilibrium:
    """Return the same agents under the forces of a dual problem."""
    ground = _UnderForces(balance.grid.ground, forces)
    if balance.grid.value.any() or balance.offset.any():
        return Equilibrium(CompositeGrid(ground, balance.grid.leaves))
    return balance.loaded_by(ground)


def _certain(answer: Answer, found: list[FunctionalBounds] | str, dimension: int) -> Answer:
    """Return an answer with its bound: round the middle of what is possible, unless it is wide."""
    if isinstance(found, str):
        return answer._replace(no_bound=found)
    bound = float(np.linalg.norm([bounds.off for bounds in found]))
    middle = np.array([bounds.middle for bounds in found])
    blind = max(bounds.blind for bounds in found)
    error = min(answer.error * max(1.0, blind / BLIND[dimension]) ** 2, bound)
    if bound > WIDE * error:
        bound += float(np.linalg.norm(middle - answer.value))
        middle = answer.value
    return Answer(middle, error, error / answer.scale, answer.scale, bound)


def _estimated(
    value: Value,
    duals: list[DualSolution],
    spawner: RefineLoop,
    curvature: Curvature,
    second: SecondDifferences,
) -> tuple[list[float], Floats]:
    """Return the errors of a quantity's components, and what every agent adds at most."""
    # `second` are the second differences of the settled displacement.
    balance, squares = spawner.balance, spawner.indicator.square
    errors, part, free = [], np.zeros(len(squares)), balance.free
    for row, dual in enumerate(duals):
        derivative = value.derivatives[row, free]
        z = np.zeros(balance.grid.size) if value.held is None else value.held[row].copy()
        z[free] = dual.of(derivative, balance, spawner.hierarchy)
        walls = curvature.resting if value.walls is None else value.walls[row]
        dual_second = curvature.of(z, walls)
        own = curvature.energy(dual_second, dual_second)
        whole = float(dot(derivative, z[free]))
        square = float(own.sum()) / whole if whole > 0.0 else 0.0
        dual.off = min(sqrt(square), 1.0)
        both = curvature.energy(second, dual_second)
        # The body's own stiffness, K + C'C, yields less to a force than K alone.
        error = 0.5 * (abs(float(both.sum())) + float(np.abs(both).sum())) / (1.0 + square)
        errors.append(FACTOR * error)
        part += np.sqrt(squares * own)
    return errors, part


def _aimed(spawner: RefineLoop, answers: list[Answer], parts: list[Floats]) -> Aimed:
    """Mark agents for the quantities that are not within the tolerance."""
    wanted = SPARE * spawner.tolerance
    worst = max(answer.relative_error for answer in answers)
    open_parts = [p for p, a in zip(parts, answers, strict=True) if a.relative_error > wanted]
    part = np.sum(open_parts or parts, axis=0)
    allowed = float(part.sum()) * (wanted / worst if worst > 0.0 else 1.0)
    marked = spawner.mark(part, allowed)
    return Aimed(worst, part, marked, allowed, tuple(answers))


def aim_of(tolerance_at: Asked, ground: PosedBody) -> Target | None:
    """Return what the tolerance is about, None for the energy norm."""
    if tolerance_at is None:
        return None
    if isinstance(tolerance_at, str):
        return DisplacementTarget()
    return GoalTarget(tolerance_at, ground)


def asked(tolerance_at: ToleranceAt | None) -> Asked:
    """Return what the tolerance is about in its shortest form."""
    if tolerance_at is None or (isinstance(tolerance_at, str) and tolerance_at == DISPLACEMENT):
        return tolerance_at
    quantities = quantities_of(tolerance_at)
    if any(isinstance(one, Stress) and one.component == HOOP for one in quantities):
        raise ParameterError(
            f"goal: {HOOP!r} is the stress along a true outline; give the region one "
            '(outline = "true")'
        )
    if len(quantities) > MOST:
        raise ParameterError(
            f"goal: {len(quantities)} quantities are more than {MOST}, and each takes a "
            f"solution of its own; ask for the mean of a region, or for {DISPLACEMENT!r}"
        )
    return quantities


def told(tolerance_at: Asked) -> str | list[dict[str, Any]] | None:
    """Return what the tolerance is about as plain values."""
    if isinstance(tolerance_at, tuple):
        return [described(quantity) for quantity in tolerance_at]
    return tolerance_at


def asked_again(plain: str | list[dict[str, Any]] | None) -> Asked:
    """Return what the tolerance is about by the plain values of `told`."""
    return tuple(quantity_from(values) for values in plain) if isinstance(plain, list) else plain
