"""Solve the linearised equilibrium, and say when it has no stable answer.

Two ways, chosen by size: sparse LU factors without pivoting, whose pivots tell whether the
tangent is positive definite; and conjugate gradients with algebraic multigrid (smoothed
aggregation over the rigid body modes; needs pyamg), which meet a direction of negative
curvature when it is not.

References
----------
P. Vaněk, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and
fourth order elliptic problems", Computing 56 (1996) 179-196.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csc_array, csr_array, csr_matrix, diags_array
from scipy.sparse.linalg import spsolve_triangular

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, ParameterError, needing
from kaju.factors import factors_of, rigid_motions

from .assembler import Assembler
from .springs import Method


class SingularTangentError(ArithmeticError):
    """The tangent has a direction without resistance; `TangentError` then names its nodes."""

    def __init__(self, direction: Floats) -> None:
        super().__init__("the tangent is not positive definite")
        self.direction = direction


class MultigridSolver:
    """Solves with the last tangent; coarse levels serve for `patience` iterations."""

    name = "conjugate gradients with algebraic multigrid"

    def __init__(self, assembler: Assembler, tolerance: float = 1e-9, patience: int = 60) -> None:
        with needing(
            f"{len(assembler.free)} free coordinates are too many for sparse LU, and "
            "algebraic multigrid needs pyamg: pip install 'kaju[amg]', or ask for "
            "method='direct' and have memory for it"
        ):
            self._pyamg = import_module("pyamg")
        self._modes = rigid_body_modes(assembler)
        held = assembler.network.held
        whole_nodes = (held == held[:, :1]).all()  # then the tangent has a block for each
        self._block = assembler.network.dimension if whole_nodes else 1
        self._tolerance = tolerance
        self._patience = patience
        self._cycle: Any = None

    def factorise(self, tangent: csc_array) -> None:
        """Take the tangent; the coarse levels stay those of an earlier one if there is one."""
        # The tangent is symmetric, so its columns read as rows are the same matrix.
        self._tangent = csr_matrix(
            (tangent.data, tangent.indices, tangent.indptr), shape=tangent.shape
        )
        self._diagonal = self._tangent.diagonal()
        if np.any(self._diagonal <= 0.0):
            unit = np.zeros(tangent.shape[0])
            unit[int(np.argmin(self._diagonal))] = 1.0
            raise SingularTangentError(unit)

    def solve(self, load: Floats) -> Floats:
        """Return the displacement of the free coordinates under a load on them."""
        if not load.any():
            return np.zeros_like(load)
        if self._cycle is None:
            self._build()
        solution, iterations = self._conjugate_gradients(load)
        if iterations > self._patience:
            self._cycle = None
        return solution

    def _build(self) -> None:
        matrix: Any = self._tangent
        if self._block > 1:
            matrix = matrix.tobsr((self._block, self._block))
        levels = self._pyamg.smoothed_aggregation_solver(
            matrix,
            B=self._modes,
            symmetry="symmetric",
            presmoother=("gauss_seidel", {"sweep": "forward"}),
            postsmoother=("gauss_seidel", {"sweep": "backward"}),
            improve_candidates=None,  # the rigid body modes are smooth already
            max_coarse=60,
        )
        self._cycle = levels.aspreconditioner(cycle="V")

    def _conjugate_gradients(self, load: Floats, limit: int = 1000) -> tuple[Floats, int]:
        """Solve; raise `SingularTangentError` at the first direction without resistance.

        The start is a little of everything, so that a symmetric load meets the directions in
        which a symmetric network buckles.
        """
        solution = np.random.default_rng(0).standard_normal(len(load))
        residual = self._tangent @ solution
        share = 0.01 * float(np.linalg.norm(load) / np.linalg.norm(residual))
        solution *= share
        residual = load - share * residual
        direction = np.zeros_like(load)
        goal, former = self._tolerance * float(np.linalg.norm(load)), 1.0
        for iteration in range(limit):
            if float(np.linalg.norm(residual)) <= goal:
                return solution, iteration
            proposed = self._cycle @ residual
            gain = float(residual @ proposed)
            direction = proposed + (gain / former) * direction
            answer = self._tangent @ direction
            curvature = float(direction @ answer)
            scale = float((direction * self._diagonal) @ direction)
            if curvature <= 1e-14 * scale:
                raise SingularTangentError(direction / np.linalg.norm(direction))
            step = gain / curvature
            solution += step * direction
            residual -= step * answer
            former = gain
        raise ConvergenceError(
            f"{limit} iterations left a residual of {np.linalg.norm(residual):.3g} N, above "
            f"{goal:.3g} N; the network may be close to giving way: press less, or ask for "
            "method='direct'"
        )


def rigid_body_modes(assembler: Assembler) -> Floats:
    """Return shifts, then turns, at the free coordinates: shape (f, 3), in space (f, 6)."""
    positions = assembler.network.positions - assembler.network.positions.mean(axis=0)
    positions /= np.abs(positions).max() or 1.0
    node, axis = np.divmod(assembler.free, assembler.network.dimension)
    return rigid_motions(positions[node], axis)


_DIRECT_UP_TO = {2: 400_000, 3: 40_000}
"""Free coordinates up to which the factors fit into about 2 GB, by dimension."""

_ROUNDING = 1e-13
"""Pivots below this share of the diagonal are zero but for rounding."""


class TangentSolver(Protocol):
    """Takes tangents one after the other and solves with the last."""

    name: str

    def factorise(self, tangent: csc_array) -> None:
        """Prepare for `solve`; raises `SingularTangentError` where that can be seen already."""

    def solve(self, load: Floats) -> Floats:
        """Return the displacement of the free coordinates under a load on them."""


def tangent_solver(assembler: Assembler, method: Method = "auto") -> TangentSolver:
    """Choose how to solve; "auto" goes by the number of free coordinates."""
    if method not in ("auto", "direct", "multigrid"):
        raise ParameterError(f"method: must be 'auto', 'direct' or 'multigrid', got {method!r}")
    small = len(assembler.free) <= _DIRECT_UP_TO[assembler.network.dimension]
    if method == "direct" or (method == "auto" and small):
        return DirectSolver()
    return MultigridSolver(assembler)


class DirectSolver:
    """Sparse LU on the diagonal's own pivots, in the order of the (assembler's) rows or another.

    For a symmetric matrix U = D Lᵀ, so by Sylvester's law of inertia the signs of the pivots
    D are those of the eigenvalues.
    """

    name = "sparse LU"

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
