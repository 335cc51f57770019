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

from dataclasses import dataclass
from itertools import pairwise, product
from math import sqrt
from time import perf_counter
from typing import Any

import numpy as np
from scipy.sparse import csr_array, vstack

from kaju.arrays import Flags, Floats
from kaju.errors import (
    ConvergenceError,
    MissingExtraError,
    ParameterError,
)
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal import fields
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import Grid, grid_of
from kaju.model.elastic.equal.problem import ACTIVE, ElasticProblem, FaceFields
from kaju.model.elastic.equal.reactions import reactions
from kaju.model.elastic.equal.staggered import internal_force
from kaju.model.elastic.equal.system import Solution
from kaju.model.scene import Scene

from .partition import (
    HALO,
    Box,
    Index,
    PetscLevel,
    PetscRows,
    PiecedBody,
    body_of,
    levels_of,
    materials_in,
    rows_of,
    scaled,
    slabs_of,
)
from .pieces import Piece, PiecedResult, together

TOLERANCE = 1e-11
MOST_ITERATIONS = 500
MOST_EXAMINED = 1_000_000
"""Up to so many cells one process looks whether the body is held and wide enough."""
_START = 1e-2


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
    scene : Scene
    tolerance : float, optional
        Relative error, in the energy norm, to which the equations of equal cells are solved; 1e-11
        unless given.
    resolution : int, optional
        Cells per cell of the scene along every axis; 1 unless given, or 2 where a member is one
        cell wide.
    stage : int, optional
        Stage of loading; by default the last.

    Returns
    -------
    ElasticResult or PiecedResult
        Of one process an `ElasticResult`; of several the piece of each.

    Raises
    ------
    MissingExtraError
        If petsc4py or mpi4py is not installed.
    SupportError, SceneError, ParameterError, ConvergenceError
        As of `kaju.solve`, on all processes alike.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml")  # doctest: +SKIP
    >>> kaju.solve_petsc(scene).strain_energy  # doctest: +SKIP
    1.6e-08
    """
    comm = communicator()
    began = perf_counter()
    rtol = _checked(tolerance, resolution)
    first = comm.Get_rank() == 0
    division, notes = comm.bcast(together(comm, lambda: _examined(scene, stage, resolution, first)))
    grid = scene if division == 1 else scene.refine(division)
    from petsc4py import PETSc

    body = together(comm, lambda: body_of(grid, stage))
    levels = levels_of(body.shape, PETSc.COMM_WORLD)
    present = together(comm, lambda: materials_in(body, levels[0].own))
    body = scaled(body, np.any(comm.allgather(present), axis=0))
    rows = together(comm, lambda: rows_on(body, levels[0]))
    matrix, right, moves = assembled(levels[0], rows)
    hierarchy = PetscHierarchy(levels, matrix, moves)
    solved = _solved(hierarchy, right, rtol)
    local = levels[0].dm.createLocalVec()
    levels[0].dm.globalToLocal(solved[0], local)
    window = together(comm, lambda: window_of(body, levels[0], local))
    energy = float(comm.allreduce(window.energy()))
    # Relative error of the parents' answer, by its potential energy.
    missed = 2.0 * (solved[3] - _potential(matrix, solved[0], right))
    known = np.isfinite(missed) and energy > 0.0
    error = sqrt(max(missed / (2.0 * energy), 0.0)) if known else 0.0
    solution = Solution(
        window.faces,
        energy,
        "PETSc multigrid",
        error,
        solved[1][-1],
        len(levels),
        solved[1],
        solved[2],
        notes,
    )
    result = _result(scene, stage, division, window, solution, comm, perf_counter() - began)
    if not solution.converged:
        raise ConvergenceError(
            f"solve: after {solution.iterations} iterations of PETSc's multigrid the relative "
            f"residual is {solution.residuals[-1]:.2g}, short of {rtol:g}; take a larger "
            "tolerance, a smaller contrast of the materials, or wider members",
            tuple(solution.residuals),
            result,
        )
    return result


@dataclass(frozen=True)
class PetscWindow:
    """A process's own cells and those around them, with their displacements."""

    body: PiecedBody
    problem: ElasticProblem
    origin: Index  # cell of the body at which the problem's rim begins
    cells: Box  # the process's own cells, without the rim
    faces: FaceFields  # scaled displacements
    owned: tuple[Flags, ...]  # which faces belong to the process

    def energy(self) -> float:
        """Return what this process's faces contribute to the energy (scaled)."""
        force = internal_force(self.problem, self.faces)
        terms = zip(force, self.faces, self.owned, strict=True)
        return 0.5 * sum(float(np.vdot(f[mine], u[mine])) for f, u, mine in terms)

    def piece(self) -> Piece:
        """Return the answer on the process's own cells, in SI units."""
        problem, unit = self.problem, self.problem.scales
        first = self.cells[0] - self.origin - 1
        last = self.cells[1] - self.origin - 1
        own = tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
        corners = tuple(slice(part.start, part.stop + 1) for part in own)
        stress = fields.cell_tensor(problem, fields.stress_parts(problem, self.faces))
        pressure = unit.modulus * unit.displacement / unit.length
        nodes = fields.node_displacement(problem, self.faces)[corners]
        return Piece(
            tuple(int(i) for i in self.cells[0] + self.body.lower),
            tuple(int(i) for i in self.cells[1] + self.body.lower),
            {"displacement": unit.displacement * nodes},
            {
                "kind": problem.kinds[problem.inner][own],
                "displacement": unit.displacement * fields.cell_means(problem, self.faces)[own],
                "stress": pressure * stress[own],
            },
        )

    def reactions(self) -> dict[str, Floats]:
        """Return what the supports bear by this process's faces (N)."""
        lattice, origin = self.body.scene.lattice, self.body.lower + self.origin + 1
        found = reactions(self.problem, self.faces, lattice, origin, self.owned)
        return {name: self.problem.scales.force * force for name, force in found.items()}


def window_of(body: PiecedBody, level: PetscLevel, local: Any) -> PetscWindow:
    """Return a process's part of the answer, from PETSc's local vector with its ghosts."""
    shape = np.array(body.shape)
    cells = np.maximum(level.own[0], 0), np.minimum(level.own[1], shape)
    problem, origin = body.window(cells, halo=HALO - 1)
    values = local.getArray(readonly=True).reshape(
        *(level.ghosts[1] - level.ghosts[0])[::-1], level.dm.getEntriesPerElement()
    )
    d = problem.dimension
    slots = [level.dm.getLocationSlot(name, 0) for name in ("left", "down", "back")[:d]]
    faces, owned = [], []
    begin = body.lift(problem, origin)
    for axis, state in enumerate(problem.face_states):
        field = begin[axis]
        place = np.argwhere(state == ACTIVE)
        at = place + origin
        known = np.all((at >= level.ghosts[0]) & (at < level.ghosts[1]), axis=1)
        place, at = place[known], at[known] - level.ghosts[0]
        field[tuple(place.T)] += values[..., slots[axis]].T[tuple(at.T)]
        faces.append(field)
        mine = np.zeros(field.shape, dtype=bool)
        own = level.owned(axis) - origin
        inside = np.all((own >= 0) & (own < np.array(field.shape)), axis=1)
        mine[tuple(own[inside].T)] = True
        owned.append(mine)
    return PetscWindow(body, problem, origin, cells, tuple(faces), tuple(owned))


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


def _checked(tolerance: float | None, resolution: int | None) -> float:
    if tolerance is not None and not 1e-14 <= tolerance < 1.0:
        raise ParameterError(f"tolerance: must lie between 1e-14 and 1, got {tolerance!r}")
    if resolution is not None and (resolution != int(resolution) or resolution < 1):
        raise ParameterError(f"resolution: must be a whole number, 1 or more, got {resolution!r}")
    return TOLERANCE if tolerance is None else tolerance


def _examined(
    scene: Scene, stage: int | None, resolution: int | None, first: bool
) -> tuple[int, list[str]]:
    """Let the first process look whether a small body is held and wide enough."""
    if scene.lattice.size > MOST_EXAMINED:
        note = f"more than {MOST_EXAMINED:,} cells: not examined for loose or slender parts"
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
        hierarchy.solver(1, _START, MOST_ITERATIONS).solve(load, parents)
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


def _result(
    scene: Scene,
    stage: int | None,
    division: int,
    window: PetscWindow,
    solution: Solution,
    comm: Any,
    seconds: float,
) -> ElasticResult | PiecedResult:
    body, unit = window.body, window.problem.scales
    figures = {
        "rule": "elastic",
        "plane": scene.plane,
        "strain_energy": solution.energy * unit.force * unit.displacement,
        "error_estimate": solution.error,
        "iterations": solution.iterations,
        "residual": solution.residuals[-1],
        "levels": solution.levels,
        "method": solution.method,
        "subdivision": division,
        "notes": list(solution.notes),
        "seconds": seconds,
    }
    if comm.Get_size() == 1:
        origin = tuple(int(i) for i in body.lower + window.origin + 1)
        posed = Grid(body.scene, window.problem, origin, division)
        return ElasticResult(CellAgents(scene, stage, division, solution, known=posed), seconds)
    return PiecedResult.of_processes(
        scene, body.scene, stage, window.piece(), window.reactions(), figures, comm
    )


def rows_on(body: PiecedBody, level: PetscLevel) -> list[PetscRows]:
    """Return the rows of a process's own faces."""
    return [rows_of(body, level, cells) for cells in slabs_of(level.own)]


def assembled(level: PetscLevel, parts: list[PetscRows]) -> tuple[Any, Any, Any]:
    """Return stiffness matrix, right-hand side, and a vector that is 1 at faces that move."""
    row = np.concatenate([part.row for part in parts])
    right, moves = level.dm.createGlobalVec(), level.dm.createGlobalVec()
    first, _ = right.getOwnershipRange()
    right.getArray()[row - first] = np.concatenate([part.right for part in parts])
    moves.getArray()[row - first] = np.concatenate([part.active for part in parts])
    rows = vstack([part.matrix for part in parts], format="csr")
    return _matrix(rows, row - first, right, right), right, moves


def _matrix(rows: csr_array, place: Index, like: Any, columns: Any) -> Any:
    """Return a PETSc matrix of this process's rows, each at its place among them."""
    from petsc4py import PETSc

    ordered = rows[np.argsort(place)]
    csr = (
        ordered.indptr.astype(PETSc.IntType),
        ordered.indices.astype(PETSc.IntType),
        ordered.data,
    )
    sizes = like.getSizes(), columns.getSizes()
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=like.getComm())


def interpolation(fine: PetscLevel, coarse: PetscLevel, moves: Any = None) -> Any:
    """Return the matrix from the coarse faces to those fine ones that move."""
    like, columns = fine.dm.createGlobalVec(), coarse.dm.createGlobalVec()
    first, _ = like.getOwnershipRange()
    d = len(fine.shape)
    rows, matrices = [], []
    for axis in range(d):
        faces = fine.owned(axis)
        row = fine.numbers(axis, faces)
        terms = [_parents(faces[:, a], a == axis) for a in range(d)]
        column = np.empty((len(faces), 2**d), dtype=np.int64)
        weight = np.empty((len(faces), 2**d))
        for k, choice in enumerate(product((0, 1), repeat=d)):
            parents = np.stack([terms[a][c][0] for a, c in enumerate(choice)], axis=1)
            column[:, k] = coarse.numbers(axis, parents)
            weight[:, k] = np.prod([terms[a][c][1] for a, c in enumerate(choice)], axis=0)
        if moves is not None:
            weight *= moves.getArray(readonly=True)[row - first][:, None]
        # Where both parents along the normal are the same one, their weights are added.
        entries = (np.repeat(np.arange(len(row)), 2**d), column.ravel())
        rows.append(row - first)
        matrices.append(csr_array((weight.ravel(), entries), shape=(len(row), coarse.size)))
    place = np.concatenate(rows)
    return _matrix(vstack(matrices, format="csr"), place, like, columns)


def _parents(face: Index, along: bool) -> list[tuple[Index, Floats]]:
    """Return two coarse faces beside fine ones, and their weights, along the normal or across."""
    parent, even = face // 2, face % 2 == 0
    if along:
        first = np.where(even, 1.0, 0.5)
        return [(parent, first), (np.where(even, parent, parent + 1), 1.0 - first)]
    beside = np.where(even, parent - 1, parent + 1)
    return [(parent, np.full(len(face), 0.75)), (beside, np.full(len(face), 0.25))]


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
        """Return conjugate gradients, preconditioned by V-cycles from a level downwards.

        `tolerance` is of the residual in the preconditioner's norm: nearly the relative error in
        energy.
        """
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
