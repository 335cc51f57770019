"""The peer on equal cells: bilinear (trilinear) elements with one local matrix for all of them.

Equations are solved by PARDISO, SuperLU, or pyamg on blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any, Literal

import numpy as np
from scipy.sparse import coo_array, triu

from kaju.arrays import Floats, Ints, rigid_motions
from kaju.factors import factors_of

from .problems import Problem

Solver = Literal["pardiso", "superlu", "pyamg"]
RESIDUAL = 1e-6
"""Relative residual at which the iteration ends: well below the error of these meshes."""


def solve(problem: Problem, division: int, solver: Solver) -> Callable[[], Floats]:
    """Solve a problem and return a function that looks the displacements up.

    Parameters
    ----------
    division : int
        Elements per edge of a cell of the picture; even, so that its middle is a node.
    """
    d, size = problem.dimension, problem.edge / division
    filled = np.argwhere(problem.split(division))
    corners = np.array(list(np.ndindex(*(2,) * d)))
    shape = tuple(n * division + 1 for n in problem.picture.shape)
    nodes = np.stack(
        [np.ravel_multi_index(tuple((filled + corner).T), shape) for corner in corners], axis=1
    )
    moves = np.zeros(shape, dtype=np.bool_)
    moves.ravel()[nodes.ravel()] = True
    moves[..., 0] = False  # the ground
    number = np.where(moves.ravel(), np.cumsum(moves) - 1, -1)
    places = np.argwhere(moves) * size

    matrix = assembled(local_stiffness(d, *problem.lame) * size ** (d - 2), number[nodes])

    load = np.zeros((len(places), d))
    loaded = problem.pressed((filled + 0.5) * size, size)
    upper = number[nodes[loaded][:, corners[:, -1] == 1]]
    np.subtract.at(load[:, -1], upper, problem.force / upper.size)

    found = np.zeros((len(number), d))
    found[moves.ravel()] = solved(matrix, load.ravel(), places, solver).reshape(-1, d)
    middles = np.rint(problem.points / size).astype(np.int64)
    return lambda: found[np.ravel_multi_index(tuple(middles.T), shape)]


def local_stiffness(dimension: int, lateral: float, shear: float) -> Floats:
    """Return the matrix of a unit square or cube, corner by corner, by Gauss's rule."""
    corners = np.array(list(np.ndindex(*(2,) * dimension)))
    unit, total = np.eye(dimension), 0.0
    for point in product((0.5 - 12**-0.5, 0.5 + 12**-0.5), repeat=dimension):
        factors = np.where(corners == 1, point, 1.0 - np.array(point))
        others = [np.delete(factors, axis, axis=1).prod(axis=1) for axis in range(dimension)]
        slopes = np.where(corners == 1, 1.0, -1.0) * np.transpose(others)
        volume = lateral * np.einsum("ia,jb->iajb", slopes, slopes)
        crossed = shear * np.einsum("ib,ja->iajb", slopes, slopes)
        along = shear * np.einsum("ij,ab->iajb", slopes @ slopes.T, unit)
        total = total + 0.5**dimension * (volume + crossed + along)
    return np.asarray(total).reshape(corners.size, corners.size)


def assembled(local: Floats, number: Ints) -> Any:
    """Return the matrix of elements: their own, (elements, nodes × d, nodes × d) or one for all.

    `number`: that of their nodes among those that move, -1 of those that do not.
    """
    elements, nodes = number.shape
    d, size = local.shape[-1] // nodes, number.max() + 1
    unknown = d * number[:, :, None] + np.arange(d)
    unknown[number < 0] = -1
    unknown = unknown.reshape(elements, -1).astype(np.int32)
    full = (elements, *local.shape[-2:])
    row = np.broadcast_to(unknown[:, :, None], full)
    column = np.broadcast_to(unknown[:, None, :], full)
    free = (row >= 0) & (column >= 0)
    entries = np.broadcast_to(local, full)[free], (row[free], column[free])
    return coo_array(entries, shape=(d * size,) * 2).tocsr()


def solved(matrix: Any, right: Floats, places: Floats, solver: Solver) -> Floats:
    """Solve a positive definite system; the nodes' places (m) tell pyamg rigid motions."""
    if solver == "pardiso":
        import pypardiso

        factors = pypardiso.PyPardisoSolver(mtype=2)  # Cholesky's: the upper half is enough
        found: Floats = factors.solve(triu(matrix, format="csr"), right)
        factors.free_memory(everything=True)
        return found
    if solver == "superlu":
        return factors_of(matrix).solve(right)
    import pyamg

    d = places.shape[1]
    centred = np.repeat(places - places.mean(axis=0), d, axis=0)
    hierarchy = pyamg.smoothed_aggregation_solver(
        matrix.tobsr((d, d)),
        B=rigid_motions(centred, np.arange(matrix.shape[0]) % d),
        strength=("symmetric", {"theta": 0.0}),
        max_coarse=300,
    )
    return hierarchy.solve(right, tol=RESIDUAL, accel="cg", maxiter=500)
