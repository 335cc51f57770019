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

from kaju.model.scene import Scene
from kaju.model.scene.kinds import RIGID

from .balanced import BalancedStress, reentrant_edges
from .compatible import CompatibleField
from .problem import ElasticProblem, FaceFields, Floats
from .staggered import axis_pairs, internal_force

BALANCED = 1e-6
"""Share of the loads that an answer may leave unbalanced, to be called balanced."""


@dataclass(frozen=True, eq=False)
class Bracket:
    """What is certain about an answer.

    Attributes
    ----------
    lower, upper : float
        Bounds of the true energy, scaled.
    distance : float
        ‖σ − Cε(v)‖: twice the error of the mean stress in the energy norm.
    error : float
        That error, relative to the true stress, at most.
    balance : float
        What the answer leaves unbalanced, relative to the forces that act.
    shares : array, shape (cells,)
        Every cell's part of the squared distance: where smaller cells would serve.
    normal, shear : arrays
        The mean stress: normal stresses, shape (d, cells), and shear stresses by pair of axes.
    """

    lower: float
    upper: float
    distance: float
    error: float
    balance: float
    shares: Floats
    normal: Floats
    shear: dict[tuple[int, int], Floats]


def refusal(problem: ElasticProblem) -> str:
    """Return why an answer has no bracket yet, in words; empty if it has one."""
    if any(np.any(shear) for shear in problem.surface_shear.values()):
        return "a load acts along the surface"
    if problem.dimension == 3:
        pairs = axis_pairs(3)
        if any(reentrant_edges(problem, pair).any() for pair in pairs):
            return "the solid has re-entrant edges"
    return ""


def bracket(problem: ElasticProblem, u: FaceFields, grid: Scene, stage: int | None) -> Bracket:
    """Hold the true energy between two that can be computed.

    Parameters
    ----------
    problem : ElasticProblem
        One without a `refusal`.
    u : tuple of arrays
        Face displacements that solve its equations, scaled.
    grid : Scene
        The scene on the problem's cells.
    stage : int or None
        Stage of loading.
    """
    body, side, traction = _loads(problem, grid, stage)
    stress = BalancedStress(problem, u, body)
    field = CompatibleField(problem, u, stress.cells, stress.law, side, traction, body)
    field.settle()
    tractions = stress.tractions()
    bed, wall_work = _at_supports(stress, field, tractions)
    complementary = float(stress.energies().sum()) + bed
    upper = complementary - wall_work
    moved = wall_work != 0.0 or any(np.any(fixed) for fixed in problem.fixed)
    if not moved:
        field.displacement *= _best_share(field)
    lower = field.work() - field.whole_energy()
    distance = sqrt(max(2.0 * (upper - lower), 0.0))
    # ‖(σ + Cε(v))/2‖, the mixed product being the work of loads and walls.
    mixed = field.work() + wall_work
    size = sqrt(max(0.5 * (complementary + mixed + field.whole_energy()), 0.0))
    true_size = sqrt(2.0 * lower) if not moved and lower > 0.0 else size - 0.5 * distance
    error = 0.5 * distance / true_size if true_size > 0.0 else inf
    if moved:
        lower = 0.5 * max(size - 0.5 * distance, 0.0) ** 2
        upper = 0.5 * (size + 0.5 * distance) ** 2
    normal, shear = _mean_stress(stress, field)
    return Bracket(
        lower, upper, distance, error, _unbalanced(problem, u, stress, tractions),
        _shares(stress, field), normal, shear,
    )  # fmt: skip


def _loads(
    problem: ElasticProblem, grid: Scene, stage: int | None
) -> tuple[Floats, tuple[np.ndarray, np.ndarray], Floats]:
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
        at = np.flatnonzero(kinds[tuple(beyond.T)] == RIGID)
        outward = 2.0 * upper - 1.0
        for component, given in enumerate(field.side_displacement(at, direction)):
            if component == axis:
                traction = tractions[direction, at]
            else:
                pair = (min(axis, component), max(axis, component))
                ends = stress.plain.shear[pair][..., at]
                ends = ends[upper] if pair[0] == axis else ends[:, upper]
                traction = ends.mean(axis=0)
            work += outward * float(np.vdot(traction, given))
    return bed, work


def _mean_stress(
    stress: BalancedStress, field: CompatibleField
) -> tuple[Floats, dict[tuple[int, int], Floats]]:
    """Return the mean of the balanced and the compatible stress in every cell."""
    normal, shear = stress.means()
    strain, law = field.mean_strains(), stress.law
    volume = np.trace(strain, axis1=1, axis2=2)
    d = len(normal)
    for axis in range(d):
        along = law.lateral * volume + (law.stretch - law.lateral) * strain[:, axis, axis]
        normal[axis] = 0.5 * (normal[axis] + along)
    return normal, {
        (a, b): 0.5 * (tau + 2.0 * law.shear * strain[:, a, b]) for (a, b), tau in shear.items()
    }


def _shares(stress: BalancedStress, field: CompatibleField) -> Floats:
    """Return every cell's part of the squared distance, but for what balances out between cells.

    In a cell the product of the two stresses is by their means but for terms that are small where
    the cell is small.
    """
    strain = field.mean_strains()
    normal, shear = stress.means()
    product = sum(normal[a] * strain[:, a, a] for a in range(len(normal)))
    product = product + sum(2.0 * tau * strain[:, a, b] for (a, b), tau in shear.items())
    return np.maximum(2.0 * (stress.energies() + field.energies() - product), 0.0)


def _unbalanced(
    problem: ElasticProblem, u: FaceFields, stress: BalancedStress, tractions: Floats
) -> float:
    """Return the largest load left on a face, relative to the largest stress."""
    left = 0.0
    for force, load, state in zip(
        internal_force(problem, u), problem.force, problem.face_states(), strict=True
    ):
        left = max(left, float(np.abs(force - load)[state == 2].max(initial=0.0)))
    largest = float(np.abs(tractions).max(initial=0.0))
    return left / largest if largest > 0.0 else 0.0
