"""From a problem to its displacements: which method, how far, and what it reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError
from kaju.stopping import stopped

from .fallback import DIRECT_LIMIT, solve_direct
from .krylov import Iteration, conjugate_gradients, dot
from .problem import FIXED, ElasticProblem, FaceFields
from .staggered import internal_force
from .system import Prepared, System, likeness, same_body

Vector = NDArray[np.float64]

ROUNDING = 1e-14
"""Loads that differ by less, of their largest, are the same."""
ALIKE = 1e-2
"""Loads that differ by less, in the mean, from a multiple of others are nearly proportional."""
UNBALANCED, NOTEWORTHY = 0.1, 1e-5
"""Shares of the loads that rounding leaves unbalanced: refused above the first, noted above the
second."""
ALGEBRAIC_SHARE = 0.15
"""Unless told otherwise, iterate until the algebraic error is this share of the grid's.

That is the error before the last correction, which takes nine tenths of it away.
"""
SMALL, SMALL_TOLERANCE = 100_000, 1e-10
"""Bodies of fewer faces are solved to this tolerance unless told otherwise: it costs little,
and forces balance to more digits than anyone prints."""
BALANCE, FIRST_RATE = 1e-2, 0.1
"""Supports and loads differ by at most this share of the error that is stated, after a last
correction that leaves the second share of what there was if nothing is known of it."""
LOOSEST = 3e-3
"""But never stop above this."""
MENDED = 300
"""Iterations more, for forces of nearly incompressible bodies to balance."""
PATIENCE = 16
"""After this many iterations the rate decides whether to change the method: stiff grains in a soft
body take several to be moved as a whole, in which nothing seems to be gained."""
TOO_MANY = 60
"""More iterations than this in sight: change the method."""


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
    prepared : Prepared, optional
        Serves for other loads on the same body, unless that is large.
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
    prepared: Prepared | None = field(default=None, repr=False)

    @property
    def iterations(self) -> int:
        """Number of iterations after the start."""
        return max(len(self.residuals) - 1, 0)

    @property
    def error_estimate(self) -> float:
        """Estimated relative error in the energy norm."""
        return float(np.hypot(self.discretisation, self.algebraic))


class Answered(NamedTuple):
    """A problem with its solution, from which one that is like it may start."""

    problem: ElasticProblem
    solution: Solution


def solve_problem(
    problem: ElasticProblem, tolerance: float | None = None, previous: Answered | None = None
) -> Solution:
    """Find the displacements at which every face is in balance.

    Parameters
    ----------
    problem : ElasticProblem
        A supported body (see `supports.check_supports`).
    tolerance : float, optional
        Relative algebraic error in the energy norm; by default well below the estimated
        error of the grid, and for small bodies 1e-10.
    previous : Answered, optional
        A problem on as many cells. If body and supports are the same its matrices serve again,
        and its displacements are where the iteration starts if the loads are alike too.
    """
    if tolerance is None and problem.dimension * problem.kinds.size < SMALL:
        tolerance = SMALL_TOLERANCE
    if previous is None or not same_body(previous.problem, problem):
        return _prepared_solve(System(problem, Prepared(problem)), tolerance, None)
    old, solution = previous
    gap, rest = likeness((*old.force, *old.fixed), (*problem.force, *problem.fixed))
    target = tolerance or _default_target(solution.discretisation)
    if gap <= ROUNDING and solution.converged and solution.algebraic <= target:
        residuals = solution.residuals[-1:]
        return replace(solution, notes=list(solution.notes), residuals=residuals)
    system = System(problem, solution.prepared or Prepared(problem))
    # Unless loads are nearly in proportion the parents' answer is the better start.
    guess = system.unknown(solution.displacement) if rest <= ALIKE else None
    return _prepared_solve(system, tolerance, guess)


def settled(problem: ElasticProblem, solution: Solution, target: float) -> Solution:
    """Let an answer settle further: to a relative algebraic error in the energy norm.

    Here that is what the last correction leaves: twice as much of it as the one before left.
    """
    if solution.algebraic <= target:
        return solution
    if solution.method not in ("full multigrid", "Galerkin multigrid"):
        return solve_problem(problem, target, Answered(problem, solution))
    system = System(problem, solution.prepared or Prepared(problem))
    hierarchy, start = system.prepared.hierarchy, system.unknown(solution.displacement)
    more, force = hierarchy.levels[0].u, hierarchy.levels[0].load  # Space that is there already.

    def left(run: Iteration) -> float:
        before, last = [solution.algebraic, *run.errors][-2:]
        return last * min(2.0 * last / before, 1.0)

    run = conjugate_gradients(
        lambda x: hierarchy.apply(x, force),
        lambda load: hierarchy.precondition(load, more),
        system.right,
        start,
        lambda run: left(run) <= target or _at_rounding(run),
        energy=system.energy,
    )
    return replace(solution, displacement=system.displacement(run.solution), algebraic=left(run))


def _prepared_solve(system: System, tolerance: float | None, guess: Vector | None) -> Solution:
    solution = _solve(system, tolerance, guess)
    _judge_rounding(system, solution)
    solution.prepared = system.prepared if system.prepared.worth_keeping else None
    return solution


def _judge_rounding(system: System, solution: Solution) -> None:
    """Say, or refuse, where so many digits are lost that forces do not balance."""
    prepared = system.prepared
    if not system.right.any():
        return
    if system.problem.needs_mixed_form:
        lost = _unbalanced(system, solution.displacement)
    else:
        x = system.gather(solution.displacement)
        lost = lost_digits(prepared.hierarchy.resisted(x), system.right)
        if solution.method == "direct" and len(x) <= SMALL:
            lost = max(lost, float(np.finfo(np.float64).eps / prepared.smallest_pivot))
            lost = max(lost, solution.residuals[-1])
    solution.notes += rounding_notes(lost)


def lost_digits(stiffness_times_x: Vector, right: Vector) -> float:
    """Return about which share of the loads rounding leaves unbalanced.

    A face's force is the difference of far larger ones where the body hardly resists (a soft bed,
    a hinge) or hardly shrinks (a pressure λ div u).
    """
    square = float(dot(right, right))
    lost = np.finfo(np.float64).eps * float(np.linalg.norm(stiffness_times_x))
    return lost / sqrt(square) if square > 0.0 else 0.0


def rounding_notes(lost: float) -> list[str]:
    """Return what is to be said of a share of the loads that rounding leaves unbalanced.

    Raises
    ------
    SceneError
        If it is too large for an answer.
    """
    if lost > UNBALANCED:
        share = f"about {lost:.1g}" if lost < 1.0 else "all"
        raise SceneError(
            f"body: it resists its loads so little that rounding leaves {share} of them "
            "unbalanced: stiffen the support, bed or hinge that yields, or bring the stiffnesses "
            "of materials and supports nearer to each other"
        )
    if lost > NOTEWORTHY:
        return [f"rounding leaves about {lost:.1g} of the loads unbalanced"]
    return []


def _unbalanced(system: System, displacement: FaceFields) -> float:
    """Return what is left on the faces that can move, as a share of the loads and reactions."""
    problem = system.problem
    inner = internal_force(problem, displacement)
    held = (f[s == FIXED] for f, s in zip(inner, problem.face_states(), strict=True))
    borne = sum(float(np.vdot(force, force)) for force in held)
    whole = max(borne, float(dot(system.load, system.load)))
    left = system.load - system.gather(inner)
    return float(np.sqrt(dot(left, left) / whole)) if whole > 0.0 else 0.0


def _default_target(discretisation: float) -> float:
    return min(max(ALGEBRAIC_SHARE * discretisation, 1e-12), LOOSEST)


def _solve(system: System, tolerance: float | None, guess: Vector | None) -> Solution:
    prepared = system.prepared
    if system.problem.needs_mixed_form:
        return _solve_mixed(system, tolerance, guess)
    start, coarser = prepared.hierarchy.full_multigrid(system.right, guess)
    if not prepared.slow:
        solution = _solve_multigrid(system, start, coarser, tolerance)
        if solution.converged or prepared.hierarchy.plain or stopped():
            return solution
        prepared.slow = f"geometric multigrid was slow after {solution.iterations} iterations"
        start = system.unknown(solution.displacement)
    return _change_method(system, start, coarser, tolerance)


class _Watch:
    """Decide after every iteration whether to go on."""

    def __init__(
        self, system: System, tolerance: float | None, discretisation: Callable[[Iteration], float]
    ) -> None:
        self._system, self._tolerance = system, tolerance
        self._estimate = discretisation
        self.discretisation = 0.0  # of no load at all, which needs no look
        self.slow = False

    def __call__(self, run: Iteration) -> bool:
        if len(run.errors) == 1:
            self.discretisation = self._estimate(run)
        target = self._tolerance
        if target is None:
            target = _default_target(self.discretisation)
        stated = max(target, self.discretisation)
        if (run.errors[-1] <= target and _held(self._system, run, stated)) or _at_rounding(run):
            return True
        if run.iterations >= PATIENCE:
            start = max(len(run.errors) - PATIENCE, 0)
            rate = (run.errors[-1] / run.errors[start]) ** (1 / (len(run.errors) - 1 - start))
            left = log(target / run.errors[-1]) / log(rate) if 0 < rate < 1 else inf
            self.slow = run.iterations + left > TOO_MANY
        return self.slow


def _held(system: System, run: Iteration, stated: float) -> bool:
    """Tell whether supports will bear the loads, to a share of the error that is stated."""
    last = run.rate or FIRST_RATE
    return last * system.unheld(run.left) <= BALANCE * stated


def _at_rounding(run: Iteration) -> bool:
    """Tell whether the residual has stopped falling because no digits are left."""
    recent = run.residuals[-4:]
    return (
        len(run.residuals) > 8
        and min(recent) > 0.5 * min(run.residuals[:-4])
        and (run.errors[-1] < 1e-9)
    )


def _solve_multigrid(
    system: System, start: Vector, coarser: float, tolerance: float | None
) -> Solution:
    hierarchy = system.prepared.hierarchy

    def discretisation(run: Iteration) -> float:
        whole = system.energy(run.solution)
        potential = -0.5 * (float(dot(run.solution, system.right)) + run.held_back)
        return _missed(coarser, potential - 0.5 * run.errors[0] ** 2 * whole, whole)

    watch = _Watch(system, tolerance, discretisation)
    more, force = hierarchy.levels[0].u, hierarchy.levels[0].load  # Space that is there already.
    run = conjugate_gradients(
        lambda x: hierarchy.apply(x, force),
        lambda load: hierarchy.precondition(load, more),
        system.right,
        start,
        watch,
        most=200,
        energy=system.energy,
    )
    run.converged = run.converged and not watch.slow
    method = "full multigrid" if system.prepared.hierarchy.plain else "Galerkin multigrid"
    solution = _solution(system, run, method, watch.discretisation, hierarchy.depth)
    # Of second order in what the iteration left, where the load's work is of first.
    x, right = run.solution, system.right
    solution.energy += 0.5 * float(dot(x, right) - dot(x, hierarchy.apply(x, force)))
    return solution


def _potential(system: System, x: Vector) -> float:
    force = system.prepared.hierarchy.apply(x)
    return 0.5 * float(dot(x, force)) - float(dot(x, system.right))


def _missed(coarser: float, potential: float, whole: float) -> float:
    """Return the relative error of the parents' answer, by its potential energy."""
    return sqrt(max(2 * (coarser - potential) / whole, 0.0)) if whole > 0.0 else 0.0


def _solution(
    system: System, run: Iteration, method: str, discretisation: float, levels: int
) -> Solution:
    return Solution(
        displacement=system.displacement(run.solution),
        energy=0.5 * system.energy(run.solution),
        method=method,
        discretisation=discretisation,
        algebraic=run.errors[-1],
        levels=levels,
        residuals=run.residuals,
        converged=run.converged,
    )


def _change_method(
    system: System, start: Vector, coarser: float, tolerance: float | None
) -> Solution:
    """Take the direct solver while the body is small, else algebraic multigrid."""
    prepared, right = system.prepared, system.right
    hierarchy, depth = prepared.hierarchy, prepared.hierarchy.depth
    missed = _missed(coarser, _potential(system, start), system.energy(start))
    if prepared.numbering.size <= DIRECT_LIMIT[system.problem.dimension]:
        run, method, depth = _factorised(system), "direct", 1
        note = "factorised instead"
    else:
        precondition, method = prepared.algebraic, "algebraic multigrid"
        note = "algebraic multigrid instead"
        if precondition is None:
            precondition, method = hierarchy.precondition, "Galerkin multigrid"
            note = "pyamg (pip install 'kaju[amg]') would be quicker"
        target = tolerance or max(ALGEBRAIC_SHARE * missed, 1e-9)
        run = conjugate_gradients(
            hierarchy.apply,
            precondition,
            right,
            start,
            lambda run: (
                (run.errors[-1] <= target and _held(system, run, max(missed, target)))
                or _at_rounding(run)
            ),
            most=1000,
            energy=system.energy,
        )
    missed = _missed(coarser, _potential(system, run.solution), system.energy(run.solution))
    solution = _solution(system, run, method, missed, depth)
    solution.notes.append(f"{prepared.slow}: {note}")
    return solution


def _solve_mixed(system: System, tolerance: float | None, guess: Vector | None) -> Solution:
    prepared, mixed = system.prepared, system.prepared.mixed
    tolerance = min(tolerance or 1e-8, 1e-8)
    run = mixed.solve(system.right, tolerance, guess)
    lost = _unbalanced(system, system.displacement(run.solution))
    if run.converged and lost > NOTEWORTHY and len(system.right) <= SMALL:
        # Moved sides press a nearly incompressible body far harder than it yields.
        tolerance = max(0.1 * tolerance * NOTEWORTHY / lost, 1e-15)
        more = mixed.solve(system.right, tolerance, run.solution, most=MENDED)
        if _unbalanced(system, system.displacement(more.solution)) < lost:
            more.converged = True  # as the first was: what is asked for here may not be reached
            run = more
    rough = mixed.block.rough(run.solution)
    roughness = float(dot(rough, mixed.block.apply(rough)))
    whole = system.energy(run.solution)
    discretisation = sqrt(max(roughness / whole, 0.0)) if whole > 0 else 0.0
    solution = _solution(system, run, "mixed form", discretisation, mixed.block.depth)
    if not run.converged and prepared.numbering.size <= DIRECT_LIMIT[system.problem.dimension]:
        solution = _solution(system, _factorised(system), "direct", discretisation, 1)
        solution.notes.append("the mixed form did not converge: factorised instead")
    return solution


def _factorised(system: System) -> Iteration:
    """Solve by factors of the matrix."""
    prepared = system.prepared
    load = system.right[prepared.hierarchy.moving]
    run = solve_direct(prepared.matrix, prepared.factor, load)
    run.solution = prepared.spread(run.solution)
    return run
