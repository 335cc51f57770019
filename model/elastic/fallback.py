"""When geometric multigrid is the wrong tool: a sparse direct solve or algebraic multigrid.

Thin frames and combs defeat geometric parents, which merge what air separates. A direct
solve is quick while the body is small; algebraic multigrid by smoothed aggregation
(Vaněk, Mandel & Brezina 1996), told the rigid motions, copes with larger ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU

from kaju import factors
from kaju.errors import SceneError

from .krylov import Iteration, dot
from .problem import ACTIVE
from .staggered import Numbering

Vector = NDArray[np.float64]

DIRECT_LIMIT = {2: 1_200_000, 3: 40_000}
"""Up to this many faces a factorisation is quick and fits in memory."""

REFINED = 1e-5
"""Share of the loads that a refined answer may leave unbalanced: what rounding leaves of bodies
that hardly resist."""


def factorise(matrix: sp.csr_array) -> SuperLU:
    """Return the factors of a symmetric positive definite matrix.

    Raises
    ------
    SceneError
        If it is singular.
    OutOfMemoryError
        If the factors do not fit in memory.
    """
    try:
        return factors.factors_of(matrix)
    except RuntimeError as error:
        raise SceneError(
            "body: some of its cells hang together by single faces, about which they turn freely; "
            "give a larger resolution (2 halves the cells), or strategy='spawning'"
        ) from error


def solve_direct(matrix: sp.csr_array, factor: SuperLU, load: Vector) -> Iteration:
    """Solve by the factors of a matrix, with two steps of iterative refinement."""
    x = np.asarray(factor.solve(load))
    scale = float(np.sqrt(dot(load, load))) or 1.0
    run = Iteration(x)
    for _ in range(3):
        left = load - matrix @ x
        step = np.asarray(factor.solve(left))
        run.residuals.append(float(np.sqrt(dot(left, left))) / scale)
        energy = abs(float(dot(load, x))) or 1.0
        run.errors.append(float(np.sqrt(max(float(dot(left, step)), 0.0) / energy)))
        if run.residuals[-1] < 1e-14:
            break
        x += step
    run.converged = bool(np.isfinite(run.residuals[-1]) and run.residuals[-1] < REFINED)
    return run


def algebraic_preconditioner(
    matrix: sp.csr_array, numbering: Numbering
) -> Callable[[Vector], Vector] | None:
    """Return a cycle of pyamg's smoothed aggregation; None if pyamg is not installed."""
    try:
        import pyamg
    except ImportError:
        return None
    modes = rigid_motions(numbering)
    csr = sp.csr_matrix(matrix)
    hierarchy = pyamg.smoothed_aggregation_solver(
        csr, B=modes, strength=("symmetric", {"theta": 0.0})
    )
    cycle = hierarchy.aspreconditioner(cycle="V")

    def precondition(load: Vector) -> Vector:
        return np.asarray(cycle.matvec(load))

    return precondition


def rigid_motions(numbering: Numbering) -> NDArray[np.float64]:
    """Return the rigid motions' face displacements, one column each."""
    faces = [np.argwhere(state == ACTIVE) for state in numbering.states]
    d = len(faces)
    axis = np.repeat(np.arange(d), [len(some) for some in faces])
    places = np.concatenate(faces) + 0.5 * (axis[:, None] != np.arange(d))
    modes = factors.rigid_motions(places, axis)
    modes[:, d:] -= modes[:, d:].mean(axis=0)
    return modes
