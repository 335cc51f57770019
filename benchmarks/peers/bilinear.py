"""The peer on equal cells: bilinear (trilinear) elements with one local matrix for all of them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from kaju.arrays import Floats

from .problems import Problem
from .sparse import Solver, assembled, solved


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

    local = local_stiffness(d, *problem.lame) * size ** (d - 2)
    matrix = assembled(local, number[nodes])

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
        slopes = np.stack(
            [
                np.where(corners[:, axis] == 1, 1.0, -1.0)
                * np.delete(factors, axis, axis=1).prod(axis=1)
                for axis in range(dimension)
            ],
            axis=1,
        )
        volume = lateral * np.einsum("ia,jb->iajb", slopes, slopes)
        crossed = shear * np.einsum("ib,ja->iajb", slopes, slopes)
        along = shear * np.einsum("ij,ab->iajb", slopes @ slopes.T, unit)
        total = total + 0.5**dimension * (volume + crossed + along)
    return np.asarray(total).reshape(corners.size, corners.size)
