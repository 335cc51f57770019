"""Many cells: by conjugate gradients with multigrid, nearly incompressible ones by a mixed form."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import inf, log

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, minres

from kaju.arrays import Floats
from kaju.errors import SceneError
from kaju.stepping import interrupt_requested

from .direct import DIRECT_LIMIT, by_factors
from .hierarchy import Hierarchy
from .krylov import Iteration, conjugate_gradients, dot, rate_of
from .problem import ElasticProblem, FaceFields, without_pressure
from .staggered import Numbering, strain_matrix
from .system import NOTEWORTHY, Solution, System, judge_rounding, missed


class MixedForm:
    """Displacements and pressures of a nearly incompressible body.

    When ν nears ½, λ drowns all else in the stiffness. With the pressure p = λ div u of every cell
    as an unknown, 2μ-block · u + divᵀ p = f and div u − p/λ = 0, nothing grows, and MINRES
    preconditioned by one multigrid cycle for the displacements and 1/(1/λ + 1/2μ) for the pressures
    takes a number of iterations that depends neither on ν nor on the grid (Elman, Silvester &
    Wathen, Finite Elements and Fast Iterative Solvers, ch. 4).
    """

    def __init__(self, problem: ElasticProblem, numbering: Numbering) -> None:
        moduli = problem.moduli
        pressed = moduli.lateral > moduli.shear
        kinds = problem.kinds[problem.kinds >= 0]
        cells = np.flatnonzero(pressed[kinds])
        rows = strain_matrix(problem, numbering)
        count = len(kinds)
        stretches = [rows[axis * count : (axis + 1) * count] for axis in range(problem.dimension)]
        divergence = sp.csr_array(sum(stretches[1:], start=stretches[0])[cells])
        lateral, shear = moduli.lateral[kinds][cells], moduli.shear[kinds][cells]
        self._compliance = 1.0 / lateral
        self._pressure = 1.0 / (1.0 / lateral + 0.5 / shear)
        self.block = Hierarchy(problem, without_pressure(moduli))
        place = np.flatnonzero(self.block.moving)
        self._size = self.block.moving.size
        self.divergence = sp.csr_array(
            (divergence.data, place[divergence.indices], divergence.indptr),
            shape=(len(cells), self._size),
        )
        self._gather = sp.csr_array(self.divergence.T)

    def solve(self, load: Floats, tolerance: float, guess: Floats | None = None) -> Iteration:
        """Return the displacements; the history is that of displacements and pressures."""
        whole = np.concatenate([load, np.zeros(len(self._pressure))])
        guess = np.zeros_like(load) if guess is None else guess
        start = np.concatenate([guess, self.divergence @ guess / self._compliance])
        scale, run = float(np.sqrt(dot(load, load))) or 1.0, Iteration(start.copy())

        def note(x: Floats) -> None:
            left = whole - self._apply(x)
            run.solution[:] = x
            run.residuals.append(float(np.sqrt(dot(left, left))) / scale)
            if run.residuals[-1] <= tolerance or interrupt_requested():
                raise StopIteration

        with suppress(StopIteration):
            note(start)
            shape, rounding = (len(whole),) * 2, 1e-16
            matrix, inverse = (
                LinearOperator(shape, matvec=way, dtype=np.float64)
                for way in (self._apply, self._precondition)
            )
            minres(matrix, whole, start, rtol=rounding, maxiter=MOST, M=inverse, callback=note)
        left = self._norm(whole - self._apply(run.solution))
        run.errors = [left / (self._norm(whole) or 1.0)]
        # Of steel on rubber of ν = 0.4999 rounding leaves an error of 3e-8.
        run.converged = run.errors[-1] <= max(tolerance, 1e-7)
        run.solution = run.solution[: self._size].copy()
        return run

    def _norm(self, r: Floats) -> float:
        """Return about the energy norm of what a residual leaves."""
        return float(np.sqrt(r @ self._precondition(r)))

    def _apply(self, x: Floats) -> Floats:
        u, p = x[: self._size], x[self._size :]
        force = self.block.apply(u) + self._gather @ p
        return np.concatenate([force, self.divergence @ u - self._compliance * p])

    def _precondition(self, r: Floats) -> Floats:
        u = self.block.precondition(r[: self._size])
        return np.concatenate([u, self._pressure * r[self._size :]])


SMALL = 100_000
"""Bodies of fewer faces are by default solved to 1e-10: it costs little, and forces balance to more
digits than anyone prints."""
MOST = 1000  # Iterations, where factors do not fit


def by_iterations(
    problem: ElasticProblem, tolerance: float | None = None, start: FaceFields | None = None
) -> Solution:
    """Solve a body of any number of cells: see `solver.solve_problem`."""
    if tolerance is None and problem.dimension * problem.kinds.size < SMALL:
        tolerance = 1e-10
    if problem.needs_mixed_form:
        return _by_mixed_form(problem, tolerance, start)
    return _by_multigrid(problem, tolerance, start)


def continued(
    problem: ElasticProblem, start: FaceFields | None, tolerance: float
) -> Solution | None:
    """Iterate to a relative algebraic error, from a displacement; None if that is not reached."""
    hierarchy = Hierarchy(problem)
    system = System(problem, hierarchy)
    x = system.unknown(start) if start else hierarchy.full_multigrid(system.right)[0]
    run = _iterate(system, hierarchy, x, lambda run: run.errors[-1] <= tolerance)
    if not run.converged and not interrupt_requested():
        return None
    return _of_multigrid(system, hierarchy, run, 0.0)


def _of_multigrid(system: System, hierarchy: Hierarchy, run: Iteration, missed: float) -> Solution:
    """Return an iteration that has ended as a solution."""
    method = "full multigrid" if hierarchy.plain else "Galerkin multigrid"
    solution = system.solution(run, method, missed)
    # Of second order in what the iteration left, where the load's work is of first.
    x, right = run.solution, system.right
    solution.energy += 0.5 * (dot(x, right) - dot(x, hierarchy.apply(x)))
    return solution


def _by_multigrid(
    problem: ElasticProblem, tolerance: float | None, start: FaceFields | None
) -> Solution:
    hierarchy = Hierarchy(problem)
    system = System(problem, hierarchy)
    guess = None if start is None else system.unknown(start)
    x, coarser = hierarchy.full_multigrid(system.right, guess)

    def discretisation(run: Iteration) -> float:
        whole = system.energy(run.solution)
        potential = -0.5 * (dot(run.solution, system.right) + run.held_back)
        return missed(coarser - potential + 0.5 * run.errors[0] ** 2 * whole, whole)

    watch = _Watch(system, tolerance, discretisation)
    run = _iterate(system, hierarchy, x, watch)
    notes = []
    stuck = watch.slow or not run.converged
    if stuck and not hierarchy.plain and not interrupt_requested():
        notes = [f"geometric multigrid was slow after {run.iterations} iterations"]
        if np.count_nonzero(hierarchy.moving) <= DIRECT_LIMIT[problem.dimension]:
            return _factorised(problem, watch.discretisation, notes[0])
        watch.patient = True
        run = _iterate(system, hierarchy, run.solution, watch, MOST)
    run.converged = run.converged and not watch.slow
    solution = _of_multigrid(system, hierarchy, run, watch.discretisation)
    solution.notes += notes
    judge_rounding(system, solution, hierarchy.resisted(run.solution))
    return solution


def _iterate(
    system: System,
    hierarchy: Hierarchy,
    start: Floats,
    done: Callable[[Iteration], bool],
    most: int = 200,
) -> Iteration:
    more, force = hierarchy.levels[0].u, hierarchy.levels[0].load  # Space that is there already.
    return conjugate_gradients(
        lambda x: hierarchy.apply(x, force),
        lambda load: hierarchy.precondition(load, more),
        system.right,
        start,
        done,
        most=most,
        energy=system.energy,
    )


class _Watch:
    """Decide after every iteration whether to go on."""

    def __init__(
        self, system: System, tolerance: float | None, discretisation: Callable[[Iteration], float]
    ) -> None:
        self._system, self._tolerance = system, tolerance
        self._estimate: Callable[[Iteration], float] | None = discretisation
        self.discretisation = 0.0  # of no load at all, which needs no look
        self.slow = self.patient = False

    def __call__(self, run: Iteration) -> bool:
        if self._estimate is not None:
            self.discretisation, self._estimate = self._estimate(run), None
        if (target := self._tolerance) is None:
            # The last correction takes nine tenths of what is left away.
            target = min(max(0.15 * self.discretisation, 1e-12), 3e-3)
        stated = max(target, self.discretisation)
        # Supports are to bear the loads, to a hundredth of the error that is stated and to 1e-4,
        # after a last correction that leaves a tenth where no rate is known yet.
        residual = run.residual.reshape(self._system.problem.dimension, -1).sum(axis=1)
        rate = rate_of(run.residuals[-6:]) or 0.1
        unborne = rate * np.abs(residual).max() / self._system.loads
        borne = unborne <= min(0.01 * stated, 1e-4)
        past = run.residuals  # which have stopped falling where no digits are left
        stalled = len(past) > 8 and min(past[-4:]) > 0.5 * min(past[:-4])
        if (run.errors[-1] <= target and borne) or (stalled and run.errors[-1] < 1e-9):
            self.slow = False
            return True
        # Stiff grains in a soft body take several iterations to be moved as a whole. Then the rate
        # tells how many more: if they are too many, factors are taken.
        if run.iterations >= 16 and not self.patient:
            rate = rate_of(run.errors[-16:])
            more = log(target / run.errors[-1]) / log(rate) if 0 < rate < 1 else inf
            self.slow = run.iterations + more > 60
        return self.slow and not self.patient


def _factorised(problem: ElasticProblem, discretisation: float, why: str) -> Solution:
    """Solve by factors where an iteration does not serve."""
    if (solution := by_factors(problem, discretisation)) is None:
        raise SceneError(
            "body: some of its cells hang together by single faces, about which they turn freely; "
            "give a larger resolution (2 halves the cells), or a tolerance, so that agents spawn"
        )
    solution.notes.append(f"{why}: factorised instead")
    return solution


def _by_mixed_form(
    problem: ElasticProblem, tolerance: float | None, start: FaceFields | None
) -> Solution:
    numbering = Numbering(problem.face_states)
    mixed = MixedForm(problem, numbering)
    system = System(problem, mixed.block)
    tolerance = min(tolerance or 1e-8, 1e-8)
    run = mixed.solve(system.right, tolerance, None if start is None else system.unknown(start))
    lost = system.unbalanced(system.displacement(run.solution))
    if run.converged and lost > NOTEWORTHY and len(system.right) <= SMALL:
        # Moved sides press a nearly incompressible body far harder than it yields.
        tolerance = max(0.1 * tolerance * NOTEWORTHY / lost, 1e-15)
        more = mixed.solve(system.right, tolerance, run.solution)
        if system.unbalanced(system.displacement(more.solution)) < lost:
            more.converged = True  # as the first was: what is asked for here may not be reached
            run = more
    rough = mixed.block.rough(run.solution)
    roughness = 0.5 * dot(rough, mixed.block.apply(rough))
    discretisation = missed(roughness, system.energy(run.solution))
    if not run.converged and numbering.size <= DIRECT_LIMIT[problem.dimension]:
        return _factorised(problem, discretisation, "the mixed form did not converge")
    solution = system.solution(run, "mixed form", discretisation)
    judge_rounding(system, solution, run.solution)
    return solution
