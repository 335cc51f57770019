"""How the peers solve their equations: PARDISO, SuperLU, or pyamg on blocks."""

from __future__ import annotations

from typing import Any, Literal

from kaju.arrays import Floats
from kaju.factors import rigid_motions

Solver = Literal["pardiso", "superlu", "pyamg"]
RESIDUAL = 1e-6
"""Relative residual at which the iteration ends: well below the error of these meshes."""


def solved(matrix: Any, right: Floats, places: Floats, solver: Solver) -> Floats:
    """Solve a positive definite system; the nodes' places (m) tell pyamg rigid motions."""
    if solver == "pardiso":
        return by_pardiso(matrix, right)
    if solver == "superlu":
        from scipy.sparse.linalg import splu

        options = {"SymmetricMode": True}
        ordered = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": options}
        return splu(matrix.tocsc(), **ordered).solve(right)
    import numpy as np
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
