"""Solve the linearised equilibrium, and say when it has no stable answer.

Two ways, chosen by size: sparse LU factors without pivoting, whose pivots tell whether the
tangent is positive definite; and conjugate gradients with algebraic multigrid (smoothed
aggregation over the rigid body modes; needs pyamg), which meet a direction of negative
curvature when it is not.
"""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve_triangular

from kaju.errors import ParameterError
from kaju.model.factors import factors_of

from .assembler import Assembler
from .multigrid import MultigridSolver
from .springs import Floats
from .weakness import GivesWayError

Method = Literal["auto", "direct", "multigrid"]

_DIRECT_UP_TO = {2: 400_000, 3: 40_000}
"""Free coordinates up to which the factors fit into about 2 GB, by dimension."""

_ROUNDING = 1e-13
"""Pivots below this share of the diagonal are zero but for rounding."""


class TangentSolver(Protocol):
    """Takes tangents one after the other and solves with the last."""

    name: str

    def factorise(self, tangent: csc_array) -> None:
        """Prepare for `solve`; raises `GivesWayError` where that can be seen already."""

    def solve(self, load: Floats) -> Floats:
        """Return the displacement of the free coordinates under a load on them."""


def tangent_solver(assembler: Assembler, method: Method = "auto") -> TangentSolver:
    """Choose how to solve; "auto" goes by the number of free coordinates.

    Raises
    ------
    ParameterError
        If the method is unknown.
    MissingExtraError
        If multigrid is asked for, or needed for the size, and pyamg is not installed.
    """
    if method not in ("auto", "direct", "multigrid"):
        raise ParameterError(f"method: must be 'auto', 'direct' or 'multigrid', got {method!r}")
    small = len(assembler.free) <= _DIRECT_UP_TO[assembler.network.dimension]
    if method == "direct" or (method == "auto" and small):
        return DirectSolver()
    return MultigridSolver(assembler)


class DirectSolver:
    """Sparse LU in the order of the assembler's rows, on the diagonal's own pivots.

    For a symmetric matrix U = D Lᵀ, so by Sylvester's law of inertia the signs of the pivots
    D are those of the eigenvalues.
    """

    name = "sparse LU"

    def __init__(self) -> None:
        self._factors: Any = None

    def factorise(self, tangent: csc_array) -> None:
        """Compute the factors; raise `GivesWayError` unless all pivots are positive."""
        self._factors = None  # give their memory back before the new ones need it
        try:
            self._factors = factors_of(tangent, order="NATURAL")
        except RuntimeError as singular:  # a column of zeros was left
            raise GivesWayError(_weak_direction(tangent)) from singular
        pivoted = not np.array_equal(self._factors.perm_r, self._factors.perm_c)
        if pivoted or _bad_pivots(self._factors, tangent).any():
            raise GivesWayError(_weak_direction(tangent))

    def solve(self, load: Floats) -> Floats:
        """Return the displacement of the free coordinates under a load on them."""
        solution: Floats = self._factors.solve(load)
        return solution


def _bad_pivots(factors: Any, tangent: csc_array) -> Any:
    """Tell which pivots are negative, or zero but for rounding, in the order of elimination."""
    diagonal = np.abs(tangent.diagonal())[factors.perm_c.argsort()]
    return factors.U.diagonal() <= _ROUNDING * diagonal


def _weak_direction(tangent: csc_array) -> Floats:
    """Return a direction z with zᵀ A z ≤ 0 but for rounding, of unit length.

    With A = L D Lᵀ and the first bad pivot d at row k, Lᵀ z = eₖ gives zᵀ A z = d. The tiny
    shift lets the elimination pass an exact zero; rows before k do not feel it.
    """
    diagonal = np.abs(tangent.diagonal())
    diagonal[diagonal == 0.0] = np.abs(tangent.data).max(initial=0.0) or 1.0
    factors = factors_of(tangent + diags_array(1e-15 * diagonal), order="NATURAL")
    share = factors.U.diagonal() / diagonal[factors.perm_c.argsort()]
    bad = np.flatnonzero(share <= _ROUNDING)
    row = int(bad[0]) if len(bad) else int(np.argmin(share))
    unit = np.zeros(row + 1)
    unit[row] = 1.0
    direction = np.zeros(tangent.shape[0])
    upper = csr_array(factors.L[: row + 1, : row + 1].T)
    direction[: row + 1] = spsolve_triangular(upper, unit, lower=False)
    direction = direction[factors.perm_c]
    return _towards_weakest(factors, tangent, direction / np.linalg.norm(direction))


def _towards_weakest(factors: Any, tangent: csc_array, direction: Floats) -> Floats:
    """Turn a weak direction towards the weakest one by a few inverse iterations."""
    weakest = direction
    for _ in range(4):
        answer = factors.solve(direction)
        size = np.linalg.norm(answer)
        if not 0.0 < size < np.inf:
            break
        direction = answer / size
        if direction @ (tangent @ direction) < weakest @ (tangent @ weakest):
            weakest = direction
    return weakest
