"""Few cells, or those that iterations cannot solve: by sparse factors."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, reduce
from math import sqrt

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from kaju.arrays import Floats
from kaju.factors import factors_of

from .krylov import Iteration, dot
from .problem import ACTIVE, ElasticProblem, coarse_box, ghost_weights_of, is_box, without_pressure
from .staggered import Numbering, stiffness_matrix
from .system import Solution, System, judge_rounding, missed

DIRECT_LIMIT = {2: 1_200_000, 3: 40_000}
"""Up to this many faces factors fit in memory, where multigrid is slow."""
REFINED = 1e-5  # Residual, of the loads, at most, after iterative refinement of a direct answer
GUARD = 1e-11  # Share of its diagonal that regularises a matrix whose faces may be dependent


class Factors:
    """The factors of a body of few cells, and of cells twice as large, whatever the loads."""

    def __init__(self, problem: ElasticProblem) -> None:
        self.body = replace(problem, force=(), fixed=(), surface_shear={})
        self.numbering = Numbering(problem.face_states)
        self.matrix = stiffness_matrix(problem, self.numbering)
        self.factor = factors_of(self.matrix)

    @cached_property
    def smallest_pivot(self) -> float:
        """The least that elimination leaves of a face's stiffness, as a share of it."""
        own = self.matrix.diagonal()[np.argsort(self.factor.perm_c)]
        return float(np.min(np.abs(self.factor.U.diagonal()) / own))

    @cached_property
    def _coarse(self) -> tuple[sp.csr_array, SuperLU]:
        """The interpolation from cells twice as large, and the factors of their stiffness."""
        if is_box(self.body):
            coarse = coarse_box(self.body)
            numbering = Numbering(coarse.face_states)
            prolong = prolongation(self.numbering, ghost_weights_of(self.body))
            prolong = prolong[:, np.concatenate([s.ravel() == ACTIVE for s in numbering.states])]
            return prolong, factors_of(stiffness_matrix(coarse, numbering))
        whole = prolongation(self.numbering)
        prolong = whole[:, np.diff(whole.tocsc().indptr) > 0]
        felt = prolong.T.tocsr() @ (self.matrix @ prolong)
        # Coarse faces beyond the surface may follow from each other.
        guard = GUARD * felt.diagonal() + (felt.diagonal() <= 0.0)
        return prolong, factors_of(felt + sp.diags_array(guard))

    def missed_by_coarse(self, system: System, x: Floats) -> float:
        """Return the relative error of cells twice as large, by their energy."""
        if self.body.needs_mixed_form:
            return self._rough(x, system.energy(x))
        prolong, factor = self._coarse
        coarse = np.asarray(prolong @ factor.solve(prolong.T @ system.right))
        work = dot(coarse, system.right)
        potential = 0.5 * dot(coarse, self.matrix @ coarse) - work
        return missed(potential, -0.5 * dot(x, system.right), system.energy(x))

    def _rough(self, x: Floats, whole: float) -> float:
        """Return the relative energy norm of x less its mean over cells twice as large."""
        # Nearly incompressible, these would lock; the pressure's part is left out.
        prolong = prolongation(self.numbering)
        weight, mean = prolong.T @ np.ones_like(x), prolong.T @ x
        mean = np.divide(mean, weight, out=np.zeros_like(mean), where=weight > 0.1)
        rough = x - prolong @ mean
        moduli = without_pressure(self.body.moduli)
        energy = dot(rough, stiffness_matrix(self.body, self.numbering, moduli) @ rough)
        return sqrt(max(energy / whole, 0.0)) if whole > 0.0 else 0.0


_last: list[Factors] = []
"""Factors of the last body of few cells: other loads on it are solved at once."""


def _same_body(ours: ElasticProblem, theirs: ElasticProblem) -> bool:
    """Tell whether two problems are of the same body, alike supported, whatever their loads."""
    if ours.plane != theirs.plane or not np.array_equal(ours.kinds, theirs.kinds):
        return False
    one, other = (
        (*problem.moduli, *problem.spring, *(problem.edges or {}).values())
        for problem in (ours, theirs)
    )
    return len(one) == len(other) and all(map(np.array_equal, one, other))


def prolongation(numbering: Numbering, ghost_weights: Floats | None = None) -> sp.csr_array:
    """Return how free faces follow all faces of cells twice as large."""
    # With weights for every side, faces beyond it follow from the two inside: see
    # `hierarchy.ghost_weights_of`.
    blocks = []
    for axis, state in enumerate(numbering.states):
        lines = []
        for a, count in enumerate(state.shape):
            line = _interpolation(count, a == axis)
            if ghost_weights is not None and a != axis:
                line = line @ _ghosts_from_inside(line.shape[1], ghost_weights[2 * a : 2 * a + 2])
            lines.append(line)
        whole = reduce(lambda one, other: sp.csr_array(sp.kron(one, other)), lines)
        blocks.append(whole[np.flatnonzero(state == ACTIVE)])
    return sp.csr_array(sp.block_diag(blocks, format="csr"))


def _interpolation(count: int, normal: bool) -> sp.csr_array:
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
    # The error of the grid is that of an iteration that did not serve, or else found here; factors
    # of few cells, of which it is found, are kept.
    few = discretisation is None
    try:
        if few and not (_last and _same_body(_last[0].body, problem)):
            _last[:] = [Factors(problem)]
        factors = _last[0] if few else Factors(problem)
    except RuntimeError:
        return None
    system, lost = System(problem, factors.numbering), 0.0
    run = _solve_direct(factors, system.right)
    if discretisation is None:
        if not run.converged:
            return None
        discretisation = factors.missed_by_coarse(system, run.solution)
        lost = float(np.finfo(np.float64).eps / factors.smallest_pivot)
    solution = system.solution(run, "direct", discretisation, 1)
    judge_rounding(system, solution, factors.matrix.diagonal() * run.solution, lost)
    return solution


def _solve_direct(factors: Factors, load: Floats) -> Iteration:
    """Solve by factors, with two steps of iterative refinement."""
    matrix, factor = factors.matrix, factors.factor
    x = np.asarray(factor.solve(load))
    scale = float(np.sqrt(dot(load, load))) or 1.0
    run = Iteration(x)
    for _ in range(3):
        residual = load - matrix @ x
        step = np.asarray(factor.solve(residual))
        run.residuals.append(float(np.sqrt(dot(residual, residual))) / scale)
        energy = abs(dot(load, x)) or 1.0
        run.errors.append(float(np.sqrt(max(dot(residual, step), 0.0) / energy)))
        if run.residuals[-1] < 1e-14:
            break
        x += step
    run.converged = bool(np.isfinite(run.residuals[-1]) and run.residuals[-1] < REFINED)
    return run
