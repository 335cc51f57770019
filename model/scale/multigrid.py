"""Geometric multigrid with Galerkin operators, as PETSc's PCMG, for any body.

The interpolation is the same everywhere: along its normal a face takes ½ and ½ of the two coarse
faces round it, or the whole of one, across it ¾ and ¼. Coarse faces live on beyond the body and
its walls; only on the finest level are faces masked that do not move. So nothing has to be known
of the body on coarser levels: their operators are PᵀAP.
"""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np

from kaju.arrays import Floats

from .partition import Index, Level
from .windows import Body, Rows, rows_of, slabs_of


def rows_on(body: Body, level: Level) -> list[Rows]:
    """Return the rows of a process's own faces."""
    return [rows_of(body, level, cells) for cells in slabs_of(level.own)]


def assembled(level: Level, parts: list[Rows]) -> tuple[Any, Any, Any]:
    """Return stiffness matrix, right-hand side, and a vector that is 1 at faces that move."""
    row = np.concatenate([part.row for part in parts])
    right, moves = level.dm.createGlobalVec(), level.dm.createGlobalVec()
    first, _ = right.getOwnershipRange()
    right.getArray()[row - first] = np.concatenate([part.right for part in parts])
    moves.getArray()[row - first] = np.concatenate([part.active for part in parts])
    return _matrix(parts, row - first, right), right, moves


def _matrix(parts: list[Rows], place: Index, like: Any, columns: Any = None) -> Any:
    """Return a PETSc matrix of rows in any order."""
    from petsc4py import PETSc

    counts = np.concatenate([np.diff(part.start) for part in parts])
    order = np.argsort(place, kind="stable")
    starts = np.concatenate([[0], np.cumsum(counts[order])])
    begins = np.concatenate([[0], np.cumsum(counts)])[:-1][order]
    take = np.repeat(begins - starts[:-1], counts[order]) + np.arange(starts[-1])
    column = np.concatenate([part.column for part in parts])[take]
    value = np.concatenate([part.value for part in parts])[take]
    sizes = like.getSizes(), (like if columns is None else columns).getSizes()
    csr = (starts.astype(PETSc.IntType), column.astype(PETSc.IntType), value)
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=like.getComm())


def interpolation(fine: Level, coarse: Level, moves: Any = None) -> Any:
    """Return the matrix from the coarse faces to the fine ones.

    Parameters
    ----------
    fine, coarse : Level
    moves : Vec, optional
        1 at fine faces that move, 0 at the others, whose rows vanish.
    """
    like, columns = fine.dm.createGlobalVec(), coarse.dm.createGlobalVec()
    first, _ = like.getOwnershipRange()
    d = len(fine.shape)
    parts = []
    for axis in range(d):
        faces = fine.owned(axis)
        row = fine.numbers(axis, faces)
        terms = [_along(faces[:, a]) if a == axis else _across(faces[:, a]) for a in range(d)]
        column = np.empty((len(faces), 2**d), dtype=np.int64)
        weight = np.empty((len(faces), 2**d))
        for k, choice in enumerate(product((0, 1), repeat=d)):
            parents = np.stack([terms[a][c][0] for a, c in enumerate(choice)], axis=1)
            column[:, k] = coarse.numbers(axis, parents)
            weight[:, k] = np.prod([terms[a][c][1] for a, c in enumerate(choice)], axis=0)
        if moves is not None:
            weight *= moves.getArray(readonly=True)[row - first][:, None]
        whole = faces[:, axis] % 2 == 0  # both parents along the normal are then the same one
        keep = np.ones(column.shape, dtype=bool)
        second = np.array([choice[axis] for choice in product((0, 1), repeat=d)], dtype=bool)
        keep[np.ix_(whole, second)] = False
        start = np.concatenate([[0], np.cumsum(keep.sum(axis=1))])
        nothing = np.zeros(len(row))
        parts.append(Rows(row, start, column[keep], weight[keep], nothing, nothing > 0))
    place = np.concatenate([part.row for part in parts]) - first
    return _matrix(parts, place, like, columns)


def _along(face: Index) -> list[tuple[Index, Floats]]:
    whole = face % 2 == 0
    return [
        (face // 2, np.where(whole, 1.0, 0.5)),
        (np.where(whole, face // 2, face // 2 + 1), np.where(whole, 0.0, 0.5)),
    ]


def _across(face: Index) -> list[tuple[Index, Floats]]:
    parent = face // 2
    beside = np.where(face % 2 == 0, parent - 1, parent + 1)
    return [(parent, np.full(len(face), 0.75)), (beside, np.full(len(face), 0.25))]


class Hierarchy:
    """Matrices of all levels, the finest first, and solvers that start on any of them.

    Parameters
    ----------
    levels : list of Level
    matrix : Mat
        Of the finest level.
    moves : Vec
        1 at the finest faces that move.
    """

    def __init__(self, levels: list[Level], matrix: Any, moves: Any) -> None:
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

        Parameters
        ----------
        start : int
            The level that is solved.
        tolerance : float
            Of the residual in the norm that the preconditioner gives: nearly the error in the
            energy norm, relative to the solution.
        most : int
            Iterations at most.
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
