"""From a problem to its displacements: by sparse factors of few cells, by multigrid of many."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from math import inf, log, sqrt

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from kaju.arrays import Floats, Ints, first_largest
from kaju.errors import SceneError
from kaju.factors import factors_of
from kaju.stopping import interrupt_requested

from .hierarchy import (
    GUARD,
    Hierarchy,
    coarse_box,
    ghost_weights_of,
    is_box,
)
from .krylov import Iteration, conjugate_gradients, dot
from .mixed_form import MixedForm, without_pressure
from .problem import ACTIVE, FIXED, ElasticProblem, FaceFields
from .staggered import Numbering, internal_force, stiffness_matrix

FEW = {2: 50_000, 3: 3_000}
"""So many cells are solved by factors, which need no compiled loop; a second or two at most."""
DIRECT_LIMIT = {2: 1_200_000, 3: 40_000}
"""Up to this many faces factors fit in memory, where multigrid is slow."""
REFINED = 1e-5  # Residual, of the loads, at most, after iterative refinement of a direct answer
UNBALANCED, NOTEWORTHY = 0.1, 1e-5
"""Shares of the loads that rounding leaves unbalanced: refused above the first, noted above the
second."""
ALGEBRAIC_SHARE = 0.15
"""By default the algebraic error before the last correction, which takes nine tenths of it away, is
at most this share of the grid's."""
LOOSEST = 3e-3  # But never stop above this
SMALL, SMALL_TOLERANCE = 100_000, 1e-10
"""Bodies of fewer faces are by default solved to this tolerance: it costs little, and forces
balance to more digits than anyone prints."""
BALANCE, FIRST_RATE = 1e-2, 0.1
"""Supports and loads differ by at most this share of the error that is stated, after a last
correction that is taken to leave the second share where no rate is known yet."""
MENDED = 300  # Iterations more, for forces of nearly incompressible bodies to balance
PATIENCE, TOO_MANY, MOST = 16, 60, 1000
"""After the first number of iterations (stiff grains in a soft body take several to be moved as a
whole) the rate tells how many it takes: if more than the second, factors are taken, or if these do
not fit, iterations up to the third."""


@dataclass
class Solution:
    """Displacements of all faces and how they were found; all scaled."""

    displacement: FaceFields  # Faces' displacements, ghost cells included
    energy: float  # Energy stored in body and foundation
    method: str  # "direct", "full multigrid", "Galerkin multigrid", "mixed form"
    discretisation: float  # Estimated relative error in the energy norm: of the grid,
    algebraic: float  # and of the iteration
    levels: int
    residuals: list[float]
    converged: bool
    notes: list[str] = field(default_factory=list)  # What the solver decided by itself

    @property
    def iterations(self) -> int:
        """Number of iterations after the start."""
        return max(len(self.residuals) - 1, 0)

    @property
    def error(self) -> float:
        """Estimated relative error in the energy norm."""
        return float(np.hypot(self.discretisation, self.algebraic))


def solve_problem(
    problem: ElasticProblem,
    tolerance: float | None = None,
    start: FaceFields | None = None,
    *,
    iterate: bool = False,
) -> Solution:
    """Find the displacements at which every face of a supported body is in balance."""
    # To a relative algebraic error in the energy norm, by default well below the estimated error of
    # the grid, and for small bodies 1e-10; iterations may start from displacements of as many
    # faces. Few cells are solved by factors, unless it is asked to `iterate`.
    if not iterate and np.count_nonzero(problem.kinds >= 0) <= FEW[problem.dimension]:
        solution = _by_factors(problem)
        if solution is not None:
            return solution
    if tolerance is None and problem.dimension * problem.kinds.size < SMALL:
        tolerance = SMALL_TOLERANCE
    if problem.needs_mixed_form:
        return _by_mixed_form(problem, tolerance, start)
    return _by_multigrid(problem, tolerance, start)


def settled(problem: ElasticProblem, solution: Solution, target: float) -> Solution:
    """Let an answer settle further: to a relative algebraic error in the energy norm."""
    # Here that is what the last correction leaves: twice as much of it as the one before left.
    if solution.algebraic <= target:
        return solution
    if solution.method not in ("full multigrid", "Galerkin multigrid"):
        return solve_problem(problem, target, solution.displacement)
    hierarchy = Hierarchy(problem)
    system = System(problem, hierarchy)

    def left(run: Iteration) -> float:
        before, last = [solution.algebraic, *run.errors][-2:]
        return last * min(2.0 * last / before, 1.0)

    start = system.unknown(solution.displacement)
    run = _iterate(
        system, hierarchy, start, lambda run: left(run) <= target or run.at_rounding(1e-9)
    )
    return replace(solution, displacement=system.displacement(run.solution), algebraic=left(run))


def followed(problem: ElasticProblem, start: FaceFields | None, tolerance: float) -> Solution:
    """Solve a body that is one of many alike, from the displacement of the one before."""
    # To a relative algebraic error in the energy norm; that of the grid is not looked at. The
    # energy is off by the square of that error.
    hierarchy = Hierarchy(problem)
    system = System(problem, hierarchy)
    x = system.unknown(start) if start else hierarchy.full_multigrid(system.right)[0]
    run = _iterate(system, hierarchy, x, lambda run: run.errors[-1] <= tolerance)
    if not run.converged and not interrupt_requested():
        return solve_problem(problem, tolerance, start)
    solution = system.solution(run, "Galerkin multigrid", 0.0, len(hierarchy.levels))
    x = run.solution
    solution.energy += 0.5 * (dot(x, system.right) - dot(x, hierarchy.apply(x)))
    return solution


class System:
    """A problem's loads on the faces that are free to move, for the displacement less a lift.

    The lift falls linearly from moved sides to those opposite. Without it the unknown would jump at
    a moved side, and the coarse levels' answer with it, by more the finer the grid.
    """

    def __init__(self, problem: ElasticProblem, space: Hierarchy | Numbering) -> None:
        self.problem, self._space = problem, space
        self.load = space.gather(problem.force)
        self.right = self.load  # less the forces that hold the lift
        self._lift_energy, self._lift = 0.0, problem.fixed
        if any(values.any() for values in problem.fixed):
            origin = np.zeros(problem.dimension, dtype=np.int64)
            self._lift = lift(problem, _moved_sides(problem), origin, np.array(problem.shape))
            force = internal_force(problem, self._lift)
            pairs = zip(force, self._lift, strict=True)
            self._lift_energy = sum(float(np.vdot(a, b)) for a, b in pairs)
            self.right = self.load - space.gather(force)

    def unknown(self, displacement: FaceFields) -> Floats:
        """Return the vector of which `displacement` is the inverse."""
        found = self._space.gather(displacement)
        return found if self.right is self.load else found - self._space.gather(self._lift)

    def displacement(self, unknown: Floats) -> FaceFields:
        """Return displacements of all faces, the given ones included."""
        if self.right is not self.load:
            unknown = unknown + self._space.gather(self._lift)
        fields = tuple(values.copy() for values in self.problem.fixed)
        self._space.scatter(unknown, fields)
        return fields

    @cached_property
    def loads(self) -> float:
        """The sum of all forces' sizes."""
        return float(np.abs(self.right).sum()) or 1.0

    def energy(self, x: Floats) -> float:
        """Return twice the stored energy of a solution x (or of what is nearly one)."""
        if self.right is self.load:
            return dot(x, self.load)
        return 2 * dot(x, self.load) - dot(x, self.right) + self._lift_energy

    def unbalanced(self, displacement: FaceFields) -> float:
        """Return the residual of the faces that can move, as a share of loads and reactions."""
        inner = internal_force(self.problem, displacement)
        held = (f[s == FIXED] for f, s in zip(inner, self.problem.face_states, strict=True))
        borne = sum(float(np.vdot(force, force)) for force in held)
        whole = max(borne, dot(self.load, self.load))
        residual = self.load - self._space.gather(inner)
        return float(np.sqrt(dot(residual, residual) / whole)) if whole > 0.0 else 0.0

    def solution(self, run: Iteration, method: str, missed: float, levels: int) -> Solution:
        """Return an iteration that has ended as a solution."""
        return Solution(
            displacement=self.displacement(run.solution),
            energy=0.5 * self.energy(run.solution),
            method=method,
            discretisation=missed,
            algebraic=run.errors[-1],
            levels=levels,
            residuals=run.residuals,
            converged=run.converged,
        )


def lift(problem: ElasticProblem, moved: Floats, origin: Ints, cells: Ints) -> FaceFields:
    """Return displacements that fall linearly from those of moved sides to the sides opposite."""
    # Of a body of so many cells, or of a window whose first cell is `origin`; `moved` is the
    # displacement of the body's sides, shape (axis, end, component).
    fields = []
    for component, fixed in enumerate(problem.fixed):
        field = np.zeros_like(fixed)
        for axis, (lower, upper) in enumerate(moved[:, :, component]):
            # Faces along the axis lie between the cells, those across in their middle.
            last = max(cells[axis] - (axis != component), 1)
            share = (np.arange(fixed.shape[axis]) - 1 + origin[axis]) / last
            share = np.clip(share, 0.0, 1.0)
            along = lower * (1.0 - share) + upper * share
            field += along.reshape([-1 if a == axis else 1 for a in range(problem.dimension)])
        fields.append(np.where(problem.face_states[component] == ACTIVE, field, fixed))
    return tuple(fields)


def _moved_sides(problem: ElasticProblem) -> Floats:
    """Return by what the sides of a body are moved."""
    d = problem.dimension
    moved = np.zeros((d, 2, d))
    for component, fixed in enumerate(problem.fixed):
        for axis in range(d):
            lines = np.moveaxis(fixed, axis, 0)
            # The wall's own faces along the axis, ghosts beyond it across.
            first, last = (1, -2) if axis == component else (0, -1)
            # Corner ghost cells, and the walls at both ends of a side, belong to other sides.
            beside = tuple(
                slice(2, -2) if a == component else slice(1, -1) for a in range(d) if a != axis
            )
            for end, layer in enumerate((first, last)):
                # The value of largest size: what a side is moved by where nothing else holds it.
                values = lines[layer][beside].ravel()
                if values.size:
                    moved[axis, end, component] = values[first_largest(np.abs(values))]
    return moved


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


def _by_factors(problem: ElasticProblem) -> Solution | None:
    """Solve few cells by factors; None if these are singular."""
    try:
        if not (_last and _same_body(_last[0].body, problem)):
            _last[:] = [Factors(problem)]
    except RuntimeError:
        return None
    factors = _last[0]
    system = System(problem, factors.numbering)
    run = _solve_direct(factors, system.right)
    if not run.converged:
        return None
    missed = factors.missed_by_coarse(system, run.solution)
    solution = system.solution(run, "direct", missed, 1)
    pivots = float(np.finfo(np.float64).eps / factors.smallest_pivot)
    _judge_rounding(system, solution, factors.matrix.diagonal() * run.solution, pivots)
    return solution


def _factorised(problem: ElasticProblem, discretisation: float) -> Solution:
    """Solve by factors where an iteration does not serve."""
    try:
        factors = Factors(problem)
    except RuntimeError as error:
        raise SceneError(
            "body: some of its cells hang together by single faces, about which they turn freely; "
            "give a larger resolution (2 halves the cells), or strategy='spawning'"
        ) from error
    system = System(problem, factors.numbering)
    run = _solve_direct(factors, system.right)
    solution = system.solution(run, "direct", discretisation, 1)
    _judge_rounding(system, solution, factors.matrix.diagonal() * run.solution)
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


def _judge_rounding(
    system: System, solution: Solution, resisted: Floats, lost: float = 0.0
) -> None:
    """Say, or refuse, where so many digits are lost that forces do not balance."""
    if not system.right.any():
        return
    if system.problem.needs_mixed_form:
        lost = system.unbalanced(solution.displacement)
    else:
        lost = max(lost, lost_digits(resisted, system.right))
        if solution.method == "direct":
            lost = max(lost, solution.residuals[-1])
    solution.notes += rounding_notes(lost)


def lost_digits(stiffness_times_x: Floats, right: Floats) -> float:
    """Return about which share of the loads rounding leaves unbalanced."""
    # A face's force is the difference of far larger ones where the body hardly resists (a soft bed,
    # a hinge) or hardly shrinks (a pressure λ div u).
    square = dot(right, right)
    lost = np.finfo(np.float64).eps * float(np.linalg.norm(stiffness_times_x))
    return lost / sqrt(square) if square > 0.0 else 0.0


def rounding_notes(lost: float) -> list[str]:
    """Return what is to be said of a share of the loads that rounding leaves unbalanced."""
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
        return missed(coarser, potential - 0.5 * run.errors[0] ** 2 * whole, whole)

    watch = _Watch(system, tolerance, discretisation)
    run = _iterate(system, hierarchy, x, watch)
    notes = []
    if watch.slow and not hierarchy.plain and not interrupt_requested():
        notes = [f"geometric multigrid was slow after {run.iterations} iterations"]
        if np.count_nonzero(hierarchy.moving) <= DIRECT_LIMIT[problem.dimension]:
            solution = _factorised(problem, watch.discretisation)
            solution.notes.append(f"{notes[0]}: factorised instead")
            return solution
        watch.patient = True
        run = _iterate(system, hierarchy, run.solution, watch, MOST)
        run.converged = run.converged and not watch.slow
    run.converged = run.converged and not watch.slow
    method = "full multigrid" if hierarchy.plain else "Galerkin multigrid"
    solution = system.solution(run, method, watch.discretisation, len(hierarchy.levels))
    # Of second order in what the iteration left, where the load's work is of first.
    x, right = run.solution, system.right
    solution.energy += 0.5 * (dot(x, right) - dot(x, hierarchy.apply(x)))
    solution.notes += notes
    _judge_rounding(system, solution, hierarchy.resisted(x))
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
        target = self._tolerance
        if target is None:
            target = min(max(ALGEBRAIC_SHARE * self.discretisation, 1e-12), LOOSEST)
        stated = max(target, self.discretisation)
        # Supports are to bear the loads, to a share of the error that is stated.
        residual = run.residual.reshape(self._system.problem.dimension, -1).sum(axis=1)
        unborne = (run.rate or FIRST_RATE) * np.abs(residual).max() / self._system.loads
        borne = unborne <= BALANCE * stated
        if (run.errors[-1] <= target and borne) or run.at_rounding(1e-9):
            self.slow = False
            return True
        if run.iterations >= PATIENCE and not self.patient:
            start = max(len(run.errors) - PATIENCE, 0)
            rate = (run.errors[-1] / run.errors[start]) ** (1 / (len(run.errors) - 1 - start))
            more = log(target / run.errors[-1]) / log(rate) if 0 < rate < 1 else inf
            self.slow = run.iterations + more > TOO_MANY
        return self.slow and not self.patient


def missed(coarser: float, potential: float, whole: float) -> float:
    """Return the relative error of the parents' answer, by its potential energy."""
    return sqrt(max(2 * (coarser - potential) / whole, 0.0)) if whole > 0.0 else 0.0


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
        more = mixed.solve(system.right, tolerance, run.solution, most=MENDED)
        if system.unbalanced(system.displacement(more.solution)) < lost:
            more.converged = True  # as the first was: what is asked for here may not be reached
            run = more
    rough = mixed.block.rough(run.solution)
    roughness = float(dot(rough, mixed.block.apply(rough)))
    whole = system.energy(run.solution)
    discretisation = sqrt(max(roughness / whole, 0.0)) if whole > 0 else 0.0
    if not run.converged and numbering.size <= DIRECT_LIMIT[problem.dimension]:
        solution = _factorised(problem, discretisation)
        solution.notes.append("the mixed form did not converge: factorised instead")
        return solution
    solution = system.solution(run, "mixed form", discretisation, len(mixed.block.levels))
    _judge_rounding(system, solution, run.solution)
    return solution
