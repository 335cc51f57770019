"""Few cells, or those that iterations cannot solve: by sparse factors."""

from __future__ import annotations

from functools import reduce

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats
from kaju.factors import factors_of

from .krylov import Iteration, dot
from .problem import ACTIVE, ElasticProblem, coarse_box, ghost_weights_of, is_box, without_pressure
from .staggered import Numbering, stiffness_matrix
from .system import NOTEWORTHY, Solution, System, judge_rounding, missed

DIRECT_LIMIT = {2: 1_200_000, 3: 40_000}
"""Up to this many faces factors fit in memory, where multigrid is slow."""
GUARD = 1e-11  # Share of its diagonal that regularises a matrix whose faces may be dependent


def _missed_by_coarse(
    system: System, numbering: Numbering, matrix: sp.csr_array, x: Floats
) -> float:
    """Return the relative error of cells twice as large, by their energy."""
    problem, whole = system.problem, system.energy(x)
    if problem.needs_mixed_form:
        # Nearly incompressible, these would lock. So what x differs in from its mean over them
        # counts, by its energy less the pressure's part.
        prolong = prolongation(numbering)
        weight, mean = prolong.T @ np.ones_like(x), prolong.T @ x
        mean = np.divide(mean, weight, out=np.zeros_like(mean), where=weight > 0.1)
        rough = x - prolong @ mean
        felt = stiffness_matrix(problem, numbering, without_pressure(problem.moduli))
        return missed(0.5 * dot(rough, felt @ rough), whole)
    if is_box(problem):
        coarse = coarse_box(problem)
        own = Numbering(coarse.face_states)
        prolong = prolongation(numbering, ghost_weights_of(problem))
        prolong = prolong[:, np.concatenate([s.ravel() == ACTIVE for s in own.states])]
        felt = stiffness_matrix(coarse, own)
    else:
        prolong = prolongation(numbering)
        prolong = prolong[:, np.diff(prolong.tocsc().indptr) > 0]
        felt = prolong.T.tocsr() @ (matrix @ prolong)
        # Coarse faces beyond the surface may follow from each other.
        felt = felt + sp.diags_array(GUARD * felt.diagonal() + (felt.diagonal() <= 0.0))
    parents = np.asarray(prolong @ factors_of(felt).solve(prolong.T @ system.right))
    potential = 0.5 * dot(parents, matrix @ parents) - dot(parents, system.right)
    return missed(potential + 0.5 * dot(x, system.right), whole)


def prolongation(numbering: Numbering, ghost_weights: Floats | None = None) -> sp.csr_array:
    """Return how free faces follow all faces of cells twice as large."""
    # With weights for every side, faces beyond it follow from the two inside: see
    # `hierarchy.ghost_weights_of`.
    blocks = []
    for axis, state in enumerate(numbering.states):
        lines = []
        for a, count in enumerate(state.shape):
            line = interpolation_along(count, a == axis)
            if ghost_weights is not None and a != axis:
                line = line @ _ghosts_from_inside(line.shape[1], ghost_weights[2 * a : 2 * a + 2])
            lines.append(line)
        blocks.append(outer(lines)[np.flatnonzero(state == ACTIVE)])
    return sp.csr_array(sp.block_diag(blocks, format="csr"))


def outer(lines: list[sp.csr_array]) -> sp.csr_array:
    """Return how places of a grid follow coarse ones, by how they do along each axis."""
    return reduce(lambda one, other: sp.csr_array(sp.kron(one, other)), lines)


def interpolation_along(count: int, normal: bool) -> sp.csr_array:
    """Return how places along a line, the first of them ghosts, follow coarse ones."""
    # Linear along the normal, and across it from the two nearest, ¾ to ¼.
    place, coarse = np.arange(count), (np.arange(count) + 1) // 2
    odd = place % 2
    other = coarse + 1 - odd if normal else coarse + 1 - 2 * odd
    own = 0.5 + 0.5 * odd if normal else np.full(count, 0.75)
    entries = np.concatenate([own, 1.0 - own]), (np.tile(place, 2), np.append(coarse, other))
    return sp.csr_array(entries, shape=(count, (count + 1) // 2 + 1))


def _ghosts_from_inside(count: int, weights: Floats) -> sp.csr_array:
    """Return how places along a line follow from all but the first and the last."""
    inner, last = np.arange(1, count - 1), count - 1
    row = np.append(inner, [0, 0, last, last])
    column = np.append(inner, [1, 2, last - 1, last - 2])
    value = np.concatenate([np.ones(len(inner)), *weights])
    return sp.csr_array((value, (row, column)), shape=(count, count))


def by_factors(problem: ElasticProblem, discretisation: float | None = None) -> Solution | None:
    """Solve by factors; None if these are singular."""
    # The error of the grid is that of an iteration that did not serve, or else found here.
    numbering = Numbering(problem.face_states)
    matrix = stiffness_matrix(problem, numbering)
    try:
        factors = factors_of(matrix)
    except RuntimeError:
        return None
    system, lost, own = System(problem, numbering), 0.0, matrix.diagonal()
    load, run = system.right, Iteration(np.asarray(factors.solve(system.right)))
    scale = float(np.sqrt(dot(load, load))) or 1.0
    for _ in range(3):  # two steps of iterative refinement
        residual = load - matrix @ run.solution
        step = np.asarray(factors.solve(residual))
        run.residuals.append(float(np.sqrt(dot(residual, residual))) / scale)
        energy = abs(dot(load, run.solution)) or 1.0
        run.errors.append(float(np.sqrt(max(dot(residual, step), 0.0) / energy)))
        if run.residuals[-1] < 1e-14:
            break
        run.solution += step
    run.converged = bool(np.isfinite(run.residuals[-1]) and run.residuals[-1] < NOTEWORTHY)
    if discretisation is None:
        if not run.converged:
            return None
        discretisation = _missed_by_coarse(system, numbering, matrix, run.solution)
        # The least that elimination leaves of a face's stiffness, as a share of it.
        pivot = np.min(np.abs(factors.U.diagonal()) / own[np.argsort(factors.perm_c)])
        lost = float(np.finfo(np.float64).eps / pivot)
    solution = system.solution(run, "direct", discretisation)
    judge_rounding(system, solution, own * run.solution, lost)
    return solution
