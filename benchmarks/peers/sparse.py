"""How the peers solve their equations: PARDISO, SuperLU, or pyamg on blocks."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from scipy.sparse import coo_array

from kaju.arrays import Floats, Ints
from kaju.factors import factors_of, rigid_motions

Solver = Literal["pardiso", "superlu", "pyamg"]
RESIDUAL = 1e-6
"""Relative residual at which the iteration ends: well below the error of these meshes."""


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
        return by_pardiso(matrix, right)
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


def by_pardiso(matrix: Any, right: Floats) -> Floats:
    """Solve by the MKL's Cholesky factors, of which the upper half is enough."""
    import pypardiso
    from scipy.sparse import triu

    solver = pypardiso.PyPardisoSolver(mtype=2)
    found: Floats = solver.solve(triu(matrix, format="csr"), right)
    solver.free_memory(everything=True)
    return found
