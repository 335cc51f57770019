"""From a problem to its displacements: which method, how far, and what it reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, log, sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .box_multigrid import BoxMultigrid, face_count, face_views, is_box
from .fallback import DIRECT_LIMIT, algebraic_preconditioner, solve_direct
from .incompressible import MixedForm
from .krylov import Iteration, conjugate_gradients, dot
from .problem import ElasticProblem, FaceFields
from .sparse_multigrid import SparseMultigrid
from .staggered import Numbering, internal_force, stiffness_matrix
from .transfer import coarsen

Vector = NDArray[np.float64]

ALGEBRAIC_SHARE = 0.15
"""Unless told otherwise, iterate until the algebraic error is this share of the grid's.

That is the error before the last correction, which takes nine tenths of it away.
"""
SMALL, SMALL_TOLERANCE = 100_000, 1e-10
"""Bodies of fewer faces are solved to this tolerance unless told otherwise: it costs little,
and forces balance to more digits than anyone prints."""
LOOSEST = 3e-3
"""But never stop above this."""
PATIENCE = 8
"""After this many iterations the rate decides whether to change the method."""
TOO_MANY = 60
"""More iterations than this in sight: change the method."""


class Multigrid(Protocol):
    """What the engine needs of a hierarchy."""

    @property
    def depth(self) -> int:
        """Number of levels."""

    def apply(self, x: Vector) -> Vector:
        """Return the stiffness times x."""

    def precondition(self, load: Vector) -> Vector:
        """Return one symmetric cycle's answer to a load."""

    def full_multigrid(self, load: Vector) -> tuple[Vector, float]:
        """Return a first answer, and the potential energy of the parents' answer."""


@dataclass
class Solution:
    """Displacements of all faces and how they were found; all scaled.

    Attributes
    ----------
    displacement : tuple of arrays
        Faces' displacements, rim included.
    energy : float
        Energy stored in body and foundation.
    method : str
        "full multigrid", "Galerkin multigrid", "mixed form", "direct", "algebraic multigrid".
    discretisation, algebraic : float
        Estimated relative errors in the energy norm: of the grid, and of the iteration.
    levels : int
    residuals : list of float
    converged : bool
    notes : list of str
        What the engine decided by itself.
    """

    displacement: FaceFields
    energy: float
    method: str
    discretisation: float
    algebraic: float
    levels: int
    residuals: list[float]
    converged: bool
    notes: list[str] = field(default_factory=list)

    @property
    def iterations(self) -> int:
        """Number of iterations after the start."""
        return max(len(self.residuals) - 1, 0)

    @property
    def error_estimate(self) -> float:
        """Estimated relative error in the energy norm."""
        return float(np.hypot(self.discretisation, self.algebraic))


def solve_problem(problem: ElasticProblem, tolerance: float | None = None) -> Solution:
    """Find the displacements at which every face is in balance.

    Parameters
    ----------
    problem : ElasticProblem
        A supported body (see `supports.check_supports`).
    tolerance : float, optional
        Relative algebraic error in the energy norm; by default well below the estimated
        error of the grid, and for small bodies 1e-10.
    """
    if tolerance is None and problem.dimension * problem.kinds.size < SMALL:
        tolerance = SMALL_TOLERANCE
    if problem.needs_mixed_form:
        return _solve_mixed(_System(problem), tolerance)
    if is_box(problem):
        box = BoxMultigrid(problem, sweeps=2 if problem.dimension == 2 else 3)
        return _solve_multigrid(_System(problem, box), box, "full multigrid", tolerance)
    system = _System(problem)
    matrix = stiffness_matrix(problem, system.numbering)
    hierarchy = SparseMultigrid(matrix, system.numbering)
    solution = _solve_multigrid(system, hierarchy, "Galerkin multigrid", tolerance)
    return (
        solution if solution.converged else _change_method(system, solution, hierarchy, tolerance)
    )


class _System:
    """Loads and unknowns of a problem as vectors."""

    def __init__(self, problem: ElasticProblem, box: BoxMultigrid | None = None) -> None:
        self.problem = problem
        self.box = box
        self._numbering: Numbering | None = None
        self.load = self.gather(problem.force)
        self.right = self.load
        self._given = 0.0
        if any(values.any() for values in problem.fixed):
            pull = internal_force(problem, problem.fixed)
            self._given = sum(
                float(np.vdot(a, b)) for a, b in zip(pull, problem.fixed, strict=True)
            )
            self.right = self.load - self.gather(pull)

    @property
    def numbering(self) -> Numbering:
        """Numbers of the faces that are free to move."""
        if self._numbering is None:
            self._numbering = Numbering(self.problem.face_states())
        return self._numbering

    def gather(self, fields: FaceFields) -> Vector:
        """Return the free faces' values as a vector; a box keeps its fixed faces, as zeros."""
        if self.box is None:
            return self.numbering.gather(fields)
        vector = np.empty(face_count(self.problem.shape))
        for view, values in zip(face_views(vector, self.problem.shape), fields, strict=True):
            view[:] = values[self.problem.inner]
        self.box.clear_fixed(0, vector)
        return vector

    def scatter(self, vector: Vector) -> FaceFields:
        """Return displacements of all faces, the given ones included."""
        fields = tuple(values.copy() for values in self.problem.fixed)
        if self.box is not None:
            for view, values in zip(face_views(vector, self.problem.shape), fields, strict=True):
                values[self.problem.inner] += view
        else:
            self.numbering.scatter(vector, fields)
        return fields

    def energy(self, x: Vector) -> float:
        """Return twice the stored energy of a solution x (or of what is nearly one)."""
        if self.right is self.load:
            return float(dot(x, self.load))
        return 2 * float(dot(x, self.load)) - float(dot(x, self.right)) + self._given


class _Watch:
    """Decide after every iteration whether to go on."""

    def __init__(
        self, tolerance: float | None, discretisation: Callable[[Iteration], float]
    ) -> None:
        self._tolerance = tolerance
        self._estimate = discretisation
        self.discretisation = inf
        self.slow = False

    def __call__(self, run: Iteration) -> bool:
        if len(run.errors) == 1:
            self.discretisation = self._estimate(run)
        target = self._tolerance
        if target is None:
            target = min(max(ALGEBRAIC_SHARE * self.discretisation, 1e-12), LOOSEST)
        if run.errors[-1] <= target or _at_rounding(run):
            return True
        if run.iterations >= PATIENCE:
            start = max(len(run.errors) - PATIENCE, 0)
            rate = (run.errors[-1] / run.errors[start]) ** (1 / (len(run.errors) - 1 - start))
            left = log(target / run.errors[-1]) / log(rate) if rate < 1 else inf
            self.slow = run.iterations + left > TOO_MANY
        return self.slow


def _at_rounding(run: Iteration) -> bool:
    """Tell whether the residual has stopped falling because no digits are left."""
    recent = run.residuals[-4:]
    return (
        len(run.residuals) > 8
        and min(recent) > 0.5 * min(run.residuals[:-4])
        and (run.errors[-1] < 1e-9)
    )


def _solve_multigrid(
    system: _System, hierarchy: Multigrid, method: str, tolerance: float | None
) -> Solution:
    right = system.right
    x, coarser = hierarchy.full_multigrid(right)
    first = [0.0]

    def discretisation(run: Iteration) -> float:
        whole = system.energy(run.solution)
        if whole <= 0.0:
            return 0.0
        gained = 2 * (coarser - first[0]) / whole + run.errors[0] ** 2
        return sqrt(max(gained, 0.0))

    apply = hierarchy.apply
    first[0] = 0.5 * float(dot(x, apply(x))) - float(dot(x, right))
    watch = _Watch(tolerance, discretisation)
    run = conjugate_gradients(
        apply, hierarchy.precondition, right, x, watch, most=200, energy=system.energy
    )
    run.converged = run.converged and not watch.slow
    solution = _solution(system, run, method, watch.discretisation, hierarchy.depth)
    # Of second order in what the iteration left, where the load's work is of first.
    left = float(dot(run.solution, right)) - float(dot(run.solution, apply(run.solution)))
    solution.energy += 0.5 * left
    return solution


def _solution(
    system: _System, run: Iteration, method: str, discretisation: float, levels: int
) -> Solution:
    return Solution(
        displacement=system.scatter(run.solution),
        energy=0.5 * system.energy(run.solution),
        method=method,
        discretisation=discretisation,
        algebraic=run.errors[-1],
        levels=levels,
        residuals=run.residuals,
        converged=run.converged,
    )


def _change_method(
    system: _System, slow: Solution, hierarchy: SparseMultigrid, tolerance: float | None
) -> Solution:
    """Take the direct solver while the body is small, else algebraic multigrid."""
    matrix, right = hierarchy.levels[0].matrix, system.right
    note = f"geometric multigrid was slow after {slow.iterations} iterations"
    if len(right) <= DIRECT_LIMIT[system.problem.dimension]:
        run = solve_direct(matrix, right)
        solution = _solution(system, run, "direct", slow.discretisation, 1)
        solution.notes.append(f"{note}: factorised instead")
        return solution
    precondition = algebraic_preconditioner(matrix, system.numbering)
    method = "algebraic multigrid"
    if precondition is None:
        precondition, method = hierarchy.precondition, "Galerkin multigrid"
        note += "; pyamg (pip install 'kaju[amg]') would be quicker"
    else:
        note += ": algebraic multigrid instead"
    target = tolerance or max(ALGEBRAIC_SHARE * slow.discretisation, 1e-9)
    start = system.numbering.gather(slow.displacement)
    run = conjugate_gradients(
        hierarchy.apply,
        precondition,
        right,
        start,
        lambda run: run.errors[-1] <= target or _at_rounding(run),
        most=1000,
        energy=system.energy,
    )
    solution = _solution(system, run, method, slow.discretisation, slow.levels)
    solution.notes.append(note)
    return solution


def _solve_mixed(system: _System, tolerance: float | None) -> Solution:
    mixed = MixedForm(system.problem, system.numbering)
    run = mixed.solve(system.right, min(tolerance or 1e-8, 1e-8))
    roughness = _roughness(mixed.block, system.numbering, run.solution)
    whole = system.energy(run.solution)
    discretisation = sqrt(max(roughness / whole, 0.0)) if whole > 0 else 0.0
    solution = _solution(system, run, "mixed form", discretisation, mixed.block.depth)
    if not run.converged and len(system.right) <= DIRECT_LIMIT[system.problem.dimension]:
        matrix = stiffness_matrix(system.problem, system.numbering)
        direct = solve_direct(matrix, system.right)
        solution = _solution(system, direct, "direct", discretisation, 1)
        solution.notes.append("the mixed form did not converge: factorised instead")
    return solution


def _roughness(block: SparseMultigrid, numbering: Numbering, x: Vector) -> float:
    """Return the energy of what the parents cannot represent of x."""
    _, prolong = coarsen(numbering)
    weight = np.asarray(prolong.T @ np.ones(prolong.shape[0]))
    mean = np.divide(prolong.T @ x, weight, out=np.zeros_like(weight), where=weight > 0.1)
    rest = x - prolong @ mean
    return float(dot(rest, block.apply(rest)))
