"""Multigrid for bodies of any form and any mix of materials.

A parent's stiffness is what its children's feel when they follow it: P'AP, with P the
interpolation of `transfer` (Galerkin's condition). It is robust where the moduli jump by
10⁶ and next to holes. One symmetric V-cycle with Gauss-Seidel sweeps is the preconditioner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from .krylov import best_of, dot
from .staggered import Numbering
from .transfer import coarsen

Vector = NDArray[np.float64]

PARENTS_AT_ONCE = 100_000


# Rows are short: sums that may be reordered become vectors, which costs more than it saves.
@njit(cache=True)
def sweep_rows(indptr, indices, values, inverse, load, x, backward):  # type: ignore[no-untyped-def]
    """Let every row in turn yield to its residual: one Gauss-Seidel sweep in place."""
    n = len(load)
    for k in range(n):
        i = n - 1 - k if backward else k
        left = load[i]
        for at in range(indptr[i], indptr[i + 1]):
            left -= values[at] * x[indices[at]]
        x[i] += left * inverse[i]


@dataclass
class Level:
    """One grid: its matrix, and the way to and from its parents."""

    matrix: sp.csr_array
    inverse: Vector
    prolong: sp.csr_array | None = None

    def sweep(self, load: Vector, x: Vector, *, backward: bool) -> None:
        """One Gauss-Seidel sweep, in the opposite order if `backward`."""
        m = self.matrix
        sweep_rows(m.indptr, m.indices, m.data, self.inverse, load, x, backward)


class SparseMultigrid:
    """Galerkin multigrid on the active faces.

    Parameters
    ----------
    matrix : sparse array
        Stiffness of the finest grid.
    numbering : Numbering
        Its active faces.
    sweeps : int
        Gauss-Seidel sweeps before and after the visit to the parents.
    coarsest : int
        A level of at most this many faces is factorised.
    """

    def __init__(
        self, matrix: sp.csr_array, numbering: Numbering, sweeps: int = 2, coarsest: int = 800
    ) -> None:
        self.sweeps = sweeps
        self.levels = [_level(matrix)]
        # Even a small body has parents: what they miss is the estimate of the grid's error.
        while self.levels[-1].matrix.shape[0] > (coarsest if len(self.levels) > 1 else 12):
            numbering, prolong = coarsen(numbering)
            fine = self.levels[-1]
            if prolong.shape[1] > 0.7 * prolong.shape[0]:
                break
            fine.prolong = prolong
            self.levels.append(_level(_galerkin(fine.matrix, prolong)))
        self._direct = splu(_regular(self.levels[-1].matrix))

    def apply(self, x: Vector) -> Vector:
        """Return the finest grid's stiffness times x."""
        return np.asarray(self.levels[0].matrix @ x)

    def precondition(self, load: Vector) -> Vector:
        """Return one V-cycle's answer to a load."""
        return self._cycle(0, load)

    def full_multigrid(self, load: Vector, guess: Vector | None = None) -> tuple[Vector, float]:
        """Start from the coarsest answer and improve it level by level.

        On the finest level from the best combination of the parents' answer and the guess.

        Returns
        -------
        start : array
            The finest grid's first answer.
        energy : float
            Potential energy, on the finest grid, of the parents' answer before it was improved.
        """
        loads = [load]
        for level in self.levels[:-1]:
            assert level.prolong is not None
            loads.append(np.asarray(level.prolong.T @ loads[-1]))
        x, energy = np.asarray(self._direct.solve(loads[-1])), 0.0
        for at in range(len(self.levels) - 2, -1, -1):
            level = self.levels[at]
            assert level.prolong is not None
            coarser = np.asarray(level.prolong @ x)
            left = loads[at] - level.matrix @ coarser
            energy = -0.5 * float(dot(loads[at], coarser) + dot(left, coarser))
            if at == 0 and guess is not None:
                forces = load - left, self.apply(guess)
                coarser, force = best_of(load, coarser, forces[0], guess, forces[1])
                left = load - force
            x = coarser + self._cycle(at, left)
        return x, energy

    @property
    def depth(self) -> int:
        """Number of levels."""
        return len(self.levels)

    def _cycle(self, at: int, load: Vector) -> Vector:
        level = self.levels[at]
        if level.prolong is None:
            return np.asarray(self._direct.solve(load))
        x = np.zeros_like(load)
        for _ in range(self.sweeps):
            level.sweep(load, x, backward=False)
        left = load - level.matrix @ x
        x += level.prolong @ self._cycle(at + 1, np.asarray(level.prolong.T @ left))
        for _ in range(self.sweeps):
            level.sweep(load, x, backward=True)
        return x


def _galerkin(matrix: sp.csr_array, prolong: sp.csr_array) -> sp.csr_array:
    """Return P'AP, some rows at a time: all at once would need several times the memory."""
    restrict = sp.csr_array(prolong.T)
    parts = [
        (restrict[first : first + PARENTS_AT_ONCE] @ matrix) @ prolong
        for first in range(0, restrict.shape[0], PARENTS_AT_ONCE)
    ]
    return parts[0] if len(parts) == 1 else sp.csr_array(sp.vstack(parts, format="csr"))


def _level(matrix: sp.csr_array) -> Level:
    diagonal = matrix.diagonal()
    inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    return Level(matrix, inverse)


def _regular(matrix: sp.csr_array) -> sp.csc_array:
    """Guard the coarsest matrix against parents that no child depends on."""
    diagonal = matrix.diagonal()
    guard = np.where(diagonal > 0, 1e-14 * diagonal, 1.0)
    return sp.csc_array(matrix + sp.diags_array(guard))
