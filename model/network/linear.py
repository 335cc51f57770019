"""Solve the linearised equilibrium, and say when it has no stable answer.

Sparse LU factors without pivoting: their pivots tell whether the tangent is positive definite.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve_triangular

from kaju.arrays import Floats
from kaju.factors import factors_of


class SingularTangentError(ArithmeticError):
    """The tangent has a direction without resistance; `TangentError` then names its nodes."""

    def __init__(self, direction: Floats) -> None:
        super().__init__("the tangent is not positive definite")
        self.direction = direction


_ROUNDING = 1e-13
"""Pivots below this share of the diagonal are zero but for rounding."""


class DirectSolver:
    """Sparse LU on the diagonal's own pivots, in the order of the (assembler's) rows or another.

    For a symmetric matrix U = D Lᵀ, so by Sylvester's law of inertia the signs of the pivots
    D are those of the eigenvalues.
    """

    def __init__(self, order: str = "NATURAL") -> None:
        self._factors: Any = None
        self._order = order

    def factorise(self, tangent: csc_array) -> None:
        """Compute the factors; raise `SingularTangentError` unless all pivots are positive."""
        self._factors = None  # give their memory back before the new ones need it
        try:
            self._factors = factors_of(tangent, order=self._order)
        except RuntimeError as singular:  # a column of zeros was left
            raise SingularTangentError(_weak_direction(tangent)) from singular
        diagonal = np.abs(tangent.diagonal())[self._factors.perm_c.argsort()]
        pivoted = not np.array_equal(self._factors.perm_r, self._factors.perm_c)
        if pivoted or (self._factors.U.diagonal() <= _ROUNDING * diagonal).any():
            raise SingularTangentError(_weak_direction(tangent))

    def solve(self, load: Floats) -> Floats:
        """Return the displacement of the free coordinates under a load on them."""
        return np.asarray(self._factors.solve(load))


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
    weakest = direction = direction / np.linalg.norm(direction)
    for _ in range(4):  # inverse iterations turn it towards the weakest one
        answer = factors.solve(direction)
        size = np.linalg.norm(answer)
        if not 0.0 < size < np.inf:
            break
        direction = answer / size
        if direction @ (tangent @ direction) < weakest @ (tangent @ weakest):
            weakest = direction
    return weakest
