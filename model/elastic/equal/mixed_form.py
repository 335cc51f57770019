"""Nearly incompressible bodies: the pressure as an unknown of its own.

When ν nears ½, λ grows without bound and drowns all else in the stiffness. With the
pressure p = λ div u of every cell as an unknown,

    2μ-block · u + divᵀ p = f,    div u − p/λ = 0,

nothing grows, and MINRES preconditioned by one multigrid cycle for the displacements and
1/(1/λ + 1/2μ) for the pressures takes a number of iterations that depends neither on ν nor
on the grid (Elman, Silvester & Wathen, Finite Elements and Fast Iterative Solvers, ch. 4).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats

from .hierarchy import Hierarchy
from .krylov import Iteration, minimal_residuals
from .problem import STIFF, ElasticProblem, without_pressure
from .staggered import Numbering, strain_matrix


class MixedForm:
    """Displacements and pressures of a nearly incompressible body."""

    def __init__(self, problem: ElasticProblem, numbering: Numbering) -> None:
        moduli = problem.moduli
        pressed = moduli.lateral > STIFF * moduli.shear
        kinds = problem.kinds[problem.kinds >= 0]
        cells = np.flatnonzero(pressed[kinds])
        rows = strain_matrix(problem, numbering)
        count = len(kinds)
        stretches = [rows[axis * count : (axis + 1) * count] for axis in range(problem.dimension)]
        divergence = sp.csr_array(sum(stretches[1:], start=stretches[0])[cells])
        lateral, shear = moduli.lateral[kinds][cells], moduli.shear[kinds][cells]
        self._compliance = 1.0 / lateral
        self._pressure = 1.0 / (1.0 / lateral + 0.5 / shear)
        self.block = Hierarchy(problem, without_pressure(moduli))
        place = np.flatnonzero(self.block.moving)
        self._size = self.block.moving.size
        self.divergence = sp.csr_array(
            (divergence.data, place[divergence.indices], divergence.indptr),
            shape=(len(cells), self._size),
        )
        self._gather = sp.csr_array(self.divergence.T)

    def solve(
        self, load: Floats, tolerance: float, guess: Floats | None = None, most: int = 300
    ) -> Iteration:
        """Return the displacements; the history is that of displacements and pressures."""
        whole = np.concatenate([load, np.zeros(len(self._pressure))])
        start, share = np.zeros_like(whole), 1.0
        if guess is not None and guess.any() and load.any():
            start = np.concatenate([guess, self.divergence @ guess / self._compliance])
            force = self._apply(start)
            start *= float(start @ whole) / float(start @ force)
            left = whole - self._apply(start)
            share, whole = self._norm(left) / self._norm(whole), left
        target = tolerance / max(share, tolerance)
        run = minimal_residuals(self._apply, self._precondition, whole, target, most)
        run.residuals = [share * residual for residual in run.residuals]
        run.errors = [share * error for error in run.errors]
        run.solution = (start + run.solution)[: self._size].copy()
        return run

    def _norm(self, r: Floats) -> float:
        return float(np.sqrt(r @ self._precondition(r)))

    def _apply(self, x: Floats) -> Floats:
        u, p = x[: self._size], x[self._size :]
        force = self.block.apply(u) + self._gather @ p
        return np.concatenate([force, self.divergence @ u - self._compliance * p])

    def _precondition(self, r: Floats) -> Floats:
        u = self.block.precondition(r[: self._size])
        return np.concatenate([u, self._pressure * r[self._size :]])
