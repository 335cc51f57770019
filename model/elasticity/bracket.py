"""Two wrong answers that know how wrong they are: the true energy between them.

A stress σ that balances the loads and a displacement v that fits the supports lie on opposite ends
of a diameter of a circle (in function space) on which the true stress lies (Prager and Synge 1947,
the hypercircle):

    ‖σ − Cε(v)‖² = ‖σ − σ_true‖² + ‖Cε(v) − σ_true‖²

in the energy norm, whatever the materials. So the mean of the two stresses is off by *exactly* half
of their distance, and the complementary energy of σ and the potential energy of v hold the true
energy between them. No constant is unknown, and no assumption is made about smoothness.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene import Scene
from kaju.model.scene.kinds import RIGID, ROLLER

from .balanced import BalancedStress, Law, reentrant_edges
from .compatible import CompatibleField
from .engine import Answered, Solution, solve_problem
from .problem import ACTIVE, ElasticProblem, FaceFields, Floats
from .staggered import axis_pairs, internal_force

Index = NDArray[np.int64]
Means = tuple[Floats, dict[tuple[int, int], Floats]]
"""Normal stresses along every axis, and shear stresses by pair of axes."""

BALANCED = 1e-6
"""Share of the largest stress that an answer may leave on a face, to be called balanced."""
SETTLED = 1e-11
"""Algebraic error that is no part of the bounds any more."""


@dataclass(frozen=True, eq=False)
class Bracket:
    """What is certain about an answer, scaled.

    Attributes
    ----------
    lower, upper : float
        Bounds of the true energy.
    error : float
        Error of the mean stress in the energy norm, relative to the true stress, at most.
    shares : array, shape (cells,)
        Every cell's part of the squared distance: where smaller cells would serve.
    stress : array, shape (cells, dimension, dimension)
        The mean stress.
    """

    lower: float
    upper: float
    error: float
    shares: Floats
    stress: Floats


def bracket_of(
    problem: ElasticProblem, solution: Solution, grid: Scene, stage: int | None
) -> Bracket | str:
    """Hold the true energy between two that can be computed.

    Parameters
    ----------
    problem : ElasticProblem
    solution : Solution
        Its answer; what the iteration left is settled first.
    grid : Scene
        The scene on the problem's cells.
    stage : int or None
        Stage of loading.

    Returns
    -------
    Bracket or str
        In words why there is none, where the theorem does not reach.
    """
    out_of_reach = _out_of_reach(problem)
    if out_of_reach:
        return out_of_reach
    u = solution.displacement
    if solution.algebraic > SETTLED:
        u = solve_problem(problem, SETTLED, Answered(problem, solution)).displacement
    body, side, traction = _loads(problem, grid, stage)
    stress = BalancedStress(problem, u, body)
    tractions = stress.tractions()
    left = _unbalanced(problem, u, tractions)
    if not left <= BALANCED:
        return f"the answer does not balance: {left:.1e} of the largest stress is left on a face"
    field = CompatibleField(problem, u, stress.cells, stress.law, side, traction, body)
    if field.jumps:
        return "the supports give a corner two displacements at once"
    field.settle()
    return _between(stress, field, tractions)


def _out_of_reach(problem: ElasticProblem) -> str:
    """Return what the balanced stress does not know yet, in words; empty if it knows all."""
    if any(np.any(shear) for shear in problem.surface_shear.values()):
        return "a load acts along the surface"
    solid = problem.dimension == 3
    if solid and any(reentrant_edges(problem, pair).any() for pair in axis_pairs(3)):
        return "the solid has re-entrant edges"
    return ""


def _between(stress: BalancedStress, field: CompatibleField, tractions: Floats) -> Bracket:
    """Compare the two stresses: the hypercircle."""
    bed, wall_work = _at_supports(stress, field, tractions)
    own = stress.energies()
    complementary = float(own.sum()) + bed
    moved = any(bool(np.any(fixed)) for fixed in field.problem.fixed)
    if not moved:
        field.displacement *= _best_share(field)
    upper, lower = complementary - wall_work, field.work() - field.whole_energy()
    radius = 0.5 * sqrt(max(2.0 * (upper - lower), 0.0))
    if moved:
        # ‖(σ + Cε(v))/2‖, the product of the two being the work of loads and walls.
        both = complementary + field.whole_energy() + field.work() + wall_work
        middle = sqrt(max(0.5 * both, 0.0))
        smallest = max(middle - radius, 0.0)
        lower, upper = 0.5 * smallest**2, 0.5 * (middle + radius) ** 2
    else:
        smallest = sqrt(2.0 * max(lower, 0.0))
    error = radius / smallest if smallest > 0.0 else (inf if radius > 0.0 else 0.0)
    means, strain = stress.means(), field.mean_strains()
    shares = _shares(own + field.energies(), means, strain)
    return Bracket(lower, upper, error, shares, _mean_stress(stress.law, means, strain))


def _loads(
    problem: ElasticProblem, grid: Scene, stage: int | None
) -> tuple[Floats, tuple[Index, Index], Floats]:
    """Return forces within the cells, and those by their sides: which, and the vectors."""
    applied = grid.applied(stage)
    lower = np.asarray(grid.bounds()[0], dtype=np.int64)
    number = np.full(problem.kinds.shape, -1)
    solid = problem.kinds >= 0
    number[solid] = np.arange(np.count_nonzero(solid))
    cell = number[tuple((applied.cells - lower + 1).T)]
    force = applied.force / problem.scales.force
    body = np.zeros((problem.dimension, np.count_nonzero(solid)))
    within = applied.direction < 0
    np.add.at(body.T, cell[within], force[within])
    return body, (cell[~within], applied.direction[~within]), force[~within]


def _best_share(field: CompatibleField) -> float:
    """Return by what to multiply a field so that its potential energy is least."""
    whole = 2.0 * field.whole_energy()
    return field.work() / whole if whole > 0.0 else 1.0


def _at_supports(
    stress: BalancedStress, field: CompatibleField, tractions: Floats
) -> tuple[float, float]:
    """Return the complementary energy of the beds, and the work of the tractions at moved walls."""
    bed = work = 0.0
    for cell, direction, stiffness in field.beds:
        bed += float((0.5 * tractions[direction, cell] ** 2 / stiffness).sum())
    kinds = stress.problem.kinds
    for direction in range(2 * stress.problem.dimension):
        axis, upper = divmod(direction, 2)
        beyond = stress.cells.copy()
        beyond[:, axis] += 2 * upper - 1
        kind = kinds[tuple(beyond.T)]
        outward = 2.0 * upper - 1.0
        for component in range(stress.problem.dimension):
            # A side that slides is moved across itself alone.
            holds = (kind == RIGID) | ((kind == ROLLER) & (component == axis))
            at = np.flatnonzero(holds)
            given = field.side_displacement(at, direction)[component]
            if component == axis:
                traction = tractions[direction, at]
            else:
                pair = (min(axis, component), max(axis, component))
                ends = stress.plain.shear[pair][..., at]
                ends = ends[upper] if pair[0] == axis else ends[:, upper]
                traction = ends.mean(axis=0)
            work += outward * float(np.vdot(traction, given))
    return bed, work


def _mean_stress(law: Law, means: Means, strain: Floats) -> Floats:
    """Return the mean of the balanced and the compatible stress in every cell."""
    normal, shear = means
    volume = np.trace(strain, axis1=1, axis2=2)
    found = np.empty_like(strain)
    for axis, own in enumerate(normal):
        along = law.lateral * volume + (law.stretch - law.lateral) * strain[:, axis, axis]
        found[:, axis, axis] = 0.5 * (own + along)
    for (a, b), tau in shear.items():
        found[:, a, b] = found[:, b, a] = 0.5 * (tau + 2.0 * law.shear * strain[:, a, b])
    return found


def _shares(energies: Floats, means: Means, strain: Floats) -> Floats:
    """Return every cell's part of the squared distance, but for what balances out between cells.

    In a cell the product of the two stresses is by their means but for terms that are small where
    the cell is small.
    """
    normal, shear = means
    product = sum(own * strain[:, a, a] for a, own in enumerate(normal))
    product = product + sum(2.0 * tau * strain[:, a, b] for (a, b), tau in shear.items())
    return np.asarray(np.maximum(2.0 * (energies - product), 0.0))


def _unbalanced(problem: ElasticProblem, u: FaceFields, tractions: Floats) -> float:
    """Return the largest load left on a face, relative to the largest traction."""
    held = internal_force(problem, u)
    states = problem.face_states()
    left = max(
        float(np.abs(force - load)[state == ACTIVE].max(initial=0.0))
        for force, load, state in zip(held, problem.force, states, strict=True)
    )
    largest = float(np.abs(tractions).max(initial=0.0))
    return left / largest if largest > 0.0 else 0.0
