"""`kaju.solve_petsc(scene)`: linear elasticity on as many processes as there are.

Every process calls it alike, under ``mpirun``, and has its own part of the body afterwards. With
one process the answer is an ordinary `ElasticResult`.

It is geometric multigrid with Galerkin operators, as PETSc's PCMG, for any body. The
interpolation is the same everywhere: along its normal a face takes ½ and ½ of the two coarse
faces round it, or the whole of one, across it ¾ and ¼. Coarse faces live on beyond the body and
its walls; only on the finest level are faces masked that do not move. So nothing has to be known
of the body on coarser levels: their operators are PᵀAP.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, vstack

from kaju import __version__
from kaju.arrays import Floats
from kaju.errors import ConvergenceError, MissingExtraError, SceneError
from kaju.model.elastic.arguments import SMALLEST, check_numbers
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal import fields
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.direct import interpolation_along, outer
from kaju.model.elastic.equal.fields import reactions
from kaju.model.elastic.equal.grid import Grid, grid_of
from kaju.model.elastic.equal.problem import FaceFields
from kaju.model.elastic.equal.staggered import Numbering, internal_force, stiffness_matrix
from kaju.model.elastic.equal.system import Solution
from kaju.model.scene import Scene

from .partition import Index, PetscLevel, Window, body_box, levels_of, window_of
from .pieces import Piece, PiecedResult, together

MOST_ITERATIONS = 500  # of which nearly incompressible bodies, without a mixed form, take too many


def solve_petsc(
    scene: Scene,
    tolerance: float | None = None,
    resolution: int | None = None,
    *,
    stage: int | None = None,
) -> ElasticResult | PiecedResult:
    """Solve a scene of squares or cubes as linear elasticity on PETSc, each process its own piece.

    All processes call it alike, under ``mpirun``.

    Parameters
    ----------
    tolerance : float, optional
        Relative error, in the energy norm, to which the equations of equal cells are solved; 1e-11
        unless given. `resolution`, `stage` and other errors are those of `kaju.solve`.

    Returns
    -------
    ElasticResult or PiecedResult
        The whole answer if there is one process, otherwise the piece of each.

    Raises
    ------
    MissingExtraError
        If petsc4py or mpi4py is not installed.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml")  # doctest: +SKIP
    >>> kaju.solve_petsc(scene).strain_energy  # doctest: +SKIP
    1.6e-08
    """
    comm = communicator()
    began = perf_counter()
    check_numbers(tolerance, resolution, stage, least=SMALLEST)
    # Forty random scenes then agree with `solve` to 1e-8 of the largest stress.
    rtol = 1e-11 if tolerance is None else tolerance
    first = comm.Get_rank() == 0
    division, notes = comm.bcast(together(comm, lambda: _examined(scene, stage, resolution, first)))
    grid = scene if division == 1 else scene.refine(division)
    from petsc4py import PETSc

    lower, upper = body_box(grid)
    levels = levels_of(tuple((upper - lower).tolist()), PETSc.COMM_WORLD)
    window = together(comm, lambda: window_of(grid, stage, levels[0]))
    rows = together(comm, lambda: rows_on(window))
    matrix, right, moves = assembled(levels[0], *rows)
    if not moves.sum():
        raise SceneError("body: none of its cells can move, so there is nothing to solve")
    hierarchy = PetscHierarchy(levels, matrix, moves)
    found, residuals, converged, coarser = _solved(hierarchy, right, rtol)
    local = levels[0].dm.createLocalVec()
    levels[0].dm.globalToLocal(found, local)
    faces = window.faces(local)
    pairs = enumerate(zip(internal_force(window.problem, faces), faces, strict=True))
    shares = (float(f[window.owned(a)] @ u[window.owned(a)]) for a, (f, u) in pairs)
    energy = float(comm.allreduce(0.5 * sum(shares)))
    # Relative error of the parents' answer, by its potential energy.
    missed = 2.0 * (coarser - _potential(matrix, found, right))
    known = np.isfinite(missed) and energy > 0.0
    error = sqrt(max(missed / (2.0 * energy), 0.0)) if known else 0.0
    errors = error, residuals[-1]
    own = faces, energy, "PETSc multigrid", *errors, residuals, converged, notes
    solution = Solution(*own)
    seconds = perf_counter() - began
    if comm.Get_size() == 1:
        origin = tuple((window.first + window.origin + 1).tolist())
        posed = Grid(grid, window.problem, origin, division)
        agents = CellAgents(scene, stage, division, solution, known=posed)
        result: ElasticResult | PiecedResult = ElasticResult(agents, seconds)
    else:
        result = _pieced(scene, stage, division, window, solution, comm, seconds)
    if not solution.converged:
        raise ConvergenceError(
            f"solve: after {solution.iterations} iterations of PETSc's multigrid the relative "
            f"residual is {solution.residuals[-1]:.2g}, short of {rtol:g}; take a larger "
            "tolerance, a smaller contrast of the materials, or wider members",
            tuple(solution.residuals),
            result,
        )
    return result


def _piece(window: Window, faces: FaceFields) -> Piece:
    """Return the answer on the process's own cells, in SI units."""
    problem, unit = window.problem, window.problem.scales
    ends = [corner - window.origin - 1 for corner in window.cells]
    own = tuple(slice(int(a), int(b)) for a, b in zip(*ends, strict=True))
    corners = tuple(slice(part.start, part.stop + 1) for part in own)
    stress = fields.cell_tensor(problem, fields.stress_parts(problem, faces))
    nodes = fields.node_displacement(problem, faces)[corners]
    lower, upper = (tuple((corner + window.first).tolist()) for corner in window.cells)
    found: dict[str, NDArray[Any]] = {
        "nodes": unit.displacement * nodes,
        "kind": problem.kinds[problem.inner][own],
        "displacement": unit.displacement * fields.cell_means(problem, faces)[own],
        "stress": unit.stress * stress[own],
    }
    return Piece(lower, upper, found)


def _pieced(
    scene: Scene,
    stage: int | None,
    division: int,
    window: Window,
    solution: Solution,
    comm: Any,
    seconds: float,
) -> PiecedResult:
    """Return the answer of which this process has a piece."""
    problem, unit, faces = window.problem, window.problem.scales, solution.displacement
    piece = _piece(window, faces)
    mine = [np.zeros(values.shape, dtype=np.bool_) for values in faces]
    for axis, owned in enumerate(mine):
        owned[window.owned(axis)] = True
    origin = window.first + window.origin + 1
    borne = reactions(problem, faces, window.scene, origin, tuple(mine))
    reaction: dict[str, Floats] = {}
    for part in comm.allgather(borne):
        for name, force in part.items():
            reaction[name] = reaction.get(name, 0.0) + unit.force * force[: problem.dimension]
    figures = {
        "rule": "elastic",
        "plane": scene.plane,
        "agents": sum(comm.allgather(int(np.count_nonzero(piece.fields["kind"] >= 0)))),
        "strain_energy": solution.energy * unit.energy,
        "error_estimate": solution.error,
        "max_displacement": max(comm.allgather(piece.farthest)),
        "reaction": {name: force.tolist() for name, force in sorted(reaction.items())},
        "iterations": solution.iterations,
        "residual": solution.residuals[-1],
        "method": solution.method,
        "subdivision": division,
        "notes": list(solution.notes),
        "processes": comm.Get_size(),
        "seconds": max(comm.allgather(seconds)),
        "kaju_version": __version__,
    }
    return PiecedResult(scene, stage, (piece,), figures, comm)


def communicator() -> Any:
    """Return all processes, as mpi4py has them."""
    try:
        import petsc4py

        petsc4py.init(["kaju"])
        from mpi4py import MPI
        from petsc4py import PETSc  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "solve_petsc: needs petsc4py and mpi4py: apt-get install python3-petsc4py-real "
            "python3-mpi4py (Debian, for the system's Python; see docs/scale.md), or "
            f"pip install 'kaju[petsc]', which builds PETSc ({error})"
        ) from error
    return MPI.COMM_WORLD


def _examined(
    scene: Scene, stage: int | None, resolution: int | None, first: bool
) -> tuple[int, list[str]]:
    """Let the first process look whether a small body is held and wide enough."""
    if scene.lattice.size > 1_000_000:
        note = "more than 1,000,000 cells: not examined for loose or slender parts"
        return resolution or 1, [note]
    if not first:
        return 1, []
    grid = grid_of(scene, stage, resolution or 1)
    return grid.division, list(grid.notes)


Solved = tuple[Any, list[float], bool, float]


def _solved(hierarchy: PetscHierarchy, right: Any, rtol: float) -> Solved:
    """Return displacements, residuals, whether they suffice, and the coarser level's potential."""
    start = right.duplicate()
    start.set(0.0)
    coarser = np.nan
    if len(hierarchy.matrices) > 1:
        restrict = hierarchy.interpolations[0]
        parents, load = hierarchy.matrices[1].createVecs()
        restrict.multTranspose(right, load)
        hierarchy.solver(1, 1e-2, MOST_ITERATIONS).solve(load, parents)
        coarser = _potential(hierarchy.matrices[1], parents, load)
        restrict.mult(parents, start)
    solver = hierarchy.solver(0, rtol, MOST_ITERATIONS)
    solver.setInitialGuessNonzero(True)
    solver.solve(right, start)
    whole = right.duplicate()
    solver.getPC().apply(right, whole)
    size = sqrt(max(float(right.dot(whole)), np.finfo(float).tiny))
    residuals = [float(value) / size for value in solver.getConvergenceHistory()]
    return start, residuals, solver.getConvergedReason() > 0, coarser


def _potential(matrix: Any, x: Any, right: Any) -> float:
    force = matrix.createVecLeft()
    matrix.mult(x, force)
    return 0.5 * float(x.dot(force)) - float(x.dot(right))


def rows_on(window: Window) -> tuple[Index, csr_array, Floats, Floats]:
    """Return numbers of a process's faces, their rows of the matrix, loads, and 1 if they move."""
    problem, level = window.problem, window.level
    numbering = Numbering(problem.face_states)
    stiffness = stiffness_matrix(problem, numbering)
    load = numbering.gather(problem.force)
    load -= numbering.gather(internal_force(problem, window.lift))
    names = np.empty(numbering.size, dtype=np.int64)
    picked, row = [], []
    for axis, number in enumerate(numbering.number):
        names[number[number >= 0]] = level.numbers(axis, np.argwhere(number >= 0) + window.origin)
        picked.append(number[window.owned(axis)])
        row.append(level.numbers(axis, level.owned(axis)))
    mine, numbers = np.concatenate(picked), np.concatenate(row)
    moves = mine >= 0
    # The rows of faces that move, and ones on the diagonal for the others.
    chosen = stiffness[mine[moves]].tocoo()
    entry_row = np.concatenate([np.flatnonzero(moves)[chosen.row], np.flatnonzero(~moves)])
    column = np.concatenate([names[chosen.col], numbers[~moves]])
    assert (column >= 0).all()
    value = np.concatenate([chosen.data, np.ones(np.count_nonzero(~moves))])
    matrix = csr_array((value, (entry_row, column)), shape=(len(mine), level.size))
    right = np.zeros(len(mine))
    right[moves] = load[mine[moves]]
    return numbers, matrix, right, moves.astype(np.float64)


def assembled(
    level: PetscLevel, row: Index, matrix: csr_array, load: Floats, active: Floats
) -> tuple[Any, Any, Any]:
    """Return stiffness matrix, right-hand side, and a vector that is 1 at faces that move."""
    right, moves = level.dm.createGlobalVec(), level.dm.createGlobalVec()
    place = row - right.getOwnershipRange()[0]
    right.getArray()[place], moves.getArray()[place] = load, active
    return _matrix(matrix, place, right, right), right, moves


def _matrix(rows: csr_array, place: Index, like: Any, columns: Any) -> Any:
    """Return a PETSc matrix of this process's rows, each at its place among them."""
    from petsc4py import PETSc

    ordered = rows[np.argsort(place)]
    parts = ordered.indptr.astype(PETSc.IntType), ordered.indices.astype(PETSc.IntType)
    sizes = like.getSizes(), columns.getSizes()
    return PETSc.Mat().createAIJ(sizes, csr=(*parts, ordered.data), comm=like.getComm())


def interpolation(fine: PetscLevel, coarse: PetscLevel, moves: Any = None) -> Any:
    """Return the matrix from the coarse faces to those fine ones that move."""
    like, columns = fine.dm.createGlobalVec(), coarse.dm.createGlobalVec()
    numbers, blocks = [], []
    for axis in range(len(fine.shape)):
        faces = fine.owned(axis)
        numbers.append(fine.numbers(axis, faces) - like.getOwnershipRange()[0])
        lines = []
        for a, (first, last) in enumerate(zip(faces.min(axis=0), faces.max(axis=0), strict=True)):
            line = interpolation_along(fine.shape[a] + 2 + (a == axis), a == axis)
            lines.append(line[first + 1 : last + 2])  # places along a line begin with a ghost
        weights = outer(lines).tocoo()
        parents = np.unravel_index(weights.col, [line.shape[1] for line in lines])
        column = coarse.numbers(axis, np.stack(parents, axis=1) - 1)
        shape = len(faces), coarse.size
        blocks.append(csr_array((weights.data, (weights.row, column)), shape=shape))
    place, matrix = np.concatenate(numbers), csr_array(vstack(blocks, format="csr"))
    if moves is not None:
        matrix = csr_array(diags_array(moves.getArray(readonly=True)[place]) @ matrix)
    return _matrix(matrix, place, like, columns)


class PetscHierarchy:
    """Matrices of all levels, the finest first, and solvers that start on any of them."""

    def __init__(self, levels: list[PetscLevel], matrix: Any, moves: Any) -> None:
        from petsc4py import PETSc

        self.matrices, self.interpolations = [matrix], []
        for fine, coarse in pairwise(levels):
            masked = moves if fine is levels[0] else None
            self.interpolations.append(interpolation(fine, coarse, masked))
            self.matrices.append(self.matrices[-1].ptap(self.interpolations[-1]))
        for coarse_matrix in self.matrices[1:]:
            # Coarse faces far from the body move nothing; they must not be divided by.
            diagonal = coarse_matrix.getDiagonal()
            values = diagonal.getArray()
            values[values == 0.0] = 1.0
            coarse_matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
            coarse_matrix.setDiagonal(diagonal)

    def solver(self, start: int, tolerance: float, most: int) -> Any:
        """Return conjugate gradients with V-cycles, to a `tolerance` of about the energy norm."""
        from petsc4py import PETSc

        matrices, depth = self.matrices[start:], len(self.matrices) - start - 1
        outer = PETSc.KSP().create(comm=matrices[0].getComm())
        outer.setOptionsPrefix(f"kaju_{start}_")
        outer.setOperators(matrices[0])
        outer.setType("cg")
        outer.setNormType(PETSc.KSP.NormType.NATURAL)
        outer.setTolerances(rtol=tolerance, atol=0.0, max_it=most)
        outer.setConvergenceHistory(most + 1, reset=True)
        cycle = outer.getPC()
        if depth == 0:
            _factorise(cycle)
        else:
            cycle.setType("mg")
            cycle.setMGLevels(depth + 1)
            for k in range(depth):
                cycle.setMGInterpolation(depth - k, self.interpolations[start + k])
                smoother = cycle.getMGSmoother(depth - k)
                smoother.setOperators(matrices[k])
                smoother.setType("richardson")
                smoother.setTolerances(max_it=1)
                smoother.setNormType(PETSc.KSP.NormType.NONE)
                smoother.getPC().setType("sor")  # symmetric, each process on its own rows
            coarsest = cycle.getMGCoarseSolve()
            coarsest.setOperators(matrices[-1])
            coarsest.setType("preonly")
            _factorise(coarsest.getPC())
        outer.setFromOptions()
        return outer


def _factorise(pc: Any) -> None:
    """Let every process factorise the whole of a small matrix."""
    pc.setType("redundant" if pc.getComm().getSize() > 1 else "lu")
