"""Find the displacement at which springs and loads are in balance (Newton's method).

The linear systems on the way are solved by sparse LU factors without pivoting: their pivots tell
whether the tangent is positive definite, so whether there is a stable answer.

The springs come in as a *law*: a function from their elongations to their tensions and
stiffnesses. So the same iteration serves springs that are elastic, and springs whose answer
over one time step depends on what they went through before.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve_triangular

from kaju.arrays import Floats
from kaju.errors import BucklingError, ConvergenceError, MechanismError, TangentError
from kaju.factors import factors_of

from .assembler import Assembler, Geometry, along_springs, spring_forces, spring_geometry


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


def tangent_error(
    assembler: Assembler, geometry: Geometry, stiffness: Floats, direction: Floats, stage: float
) -> TangentError:
    """Return the error that names the nodes of a direction that meets no resistance at a stage."""
    network = assembler.network
    mode = assembler.expand(direction)
    moved = np.linalg.norm(mode, axis=1)
    most = np.argsort(-np.round(moved / moved.max(), 9), kind="stable")[:8]  # ties by name
    most = most[moved[most] > 0.05 * moved.max()]
    names = tuple(network.names[int(node)] for node in most)
    place = np.round(network.positions[most[0]], 6).tolist()
    shown = f"node{'s' if len(names) > 1 else ''} {', '.join(map(repr, names))}"
    first = "the first lies " if len(names) > 1 else ""
    where = f"the {shown} ({first}at {place} m before any load)"
    ends = along_springs(network, mode)
    stretched = stiffness @ np.einsum("ij,ij->i", ends, geometry.direction) ** 2
    if stretched > 1e-10 * (stiffness @ np.einsum("ij,ij->i", ends, ends)):  # to first order
        return BucklingError(
            f"at stage {stage:.6g} the network buckles: pressed springs let {where} move sideways "
            "without resistance; press less, hold what moves, or brace it by springs",
            names,
        )
    return MechanismError(
        f"at stage {stage:.6g} the network is a mechanism: {where} can move without any spring "
        "changing its length; add springs or supports there",
        names,
    )


SpringLaw = Callable[[Floats], tuple[Floats, Floats]]
"""From elongations (m), shape (m,), to tensions (N) and their growth with length (N/m)."""


class NetworkState(NamedTuple):
    """What a network has come to; in balance, if Newton's method found it."""

    displacement: Floats  # (m), shape (n, dimension)
    tension: Floats  # (N), shape (m,)
    residual: float = 0.0  # largest unbalanced force as a share of the largest force met
    corrections: int = 0  # number of linear systems solved
    stage: float = 0.0  # point of the load path


MOST = 25  # Corrections after which it gives up


def find_balance(
    assembler: Assembler,
    solver: DirectSolver,
    law: SpringLaw,
    displacement: Floats,
    force: Floats,
    *,
    given: Floats,
    force_scale: float,
    tolerance: float = 1e-12,
) -> NetworkState:
    """Correct a displacement until the springs carry the force.

    It starts near the answer (m), on its side of any instability. `given`: displacement (m) that
    the held coordinates shall reach; `force_scale`: force (N) to compare the
    residual with, if larger than those met here; `tolerance`: largest unbalanced force as a share
    of the largest force. After too many corrections it gives up by a `ConvergenceError`; a tangent
    on the way that is singular or indefinite raises `SingularTangentError`.
    """
    network = assembler.network
    jump = np.where(network.held, given - displacement, 0.0)
    geometry = spring_geometry(network, displacement)
    tension, stiffness = law(geometry.elongation)
    for corrections in range(MOST + 1):
        unbalanced = assembler.restrict(force + spring_forces(network, geometry, tension))
        force_scale = max(force_scale, np.abs(force).max(), np.abs(tension).max())
        residual = float(np.abs(unbalanced).max(initial=0.0))
        if residual <= tolerance * force_scale and not jump.any():
            return NetworkState(displacement, tension, residual / (force_scale or 1.0), corrections)
        if corrections == MOST:
            break
        if jump.any():
            change = assembler.force_change(geometry, tension, stiffness, jump)
            unbalanced = unbalanced + assembler.restrict(change)
        step = jump + solve_tangent(assembler, solver, geometry, tension, stiffness, unbalanced)
        share = 1.0 if jump.any() else _line_search(assembler, law, displacement, step, force)
        displacement = displacement + share * step
        jump = np.zeros_like(jump)
        geometry = spring_geometry(network, displacement)
        tension, stiffness = law(geometry.elongation)
    raise ConvergenceError(
        f"after {MOST} corrections {residual:.3g} N are still unbalanced, of "
        f"{force_scale:.3g} N at most; load in smaller increments"
    )


def solve_tangent(
    assembler: Assembler,
    solver: DirectSolver,
    geometry: Geometry,
    tension: Floats,
    stiffness: Floats,
    load: Floats,
) -> Floats:
    """Return the displacement (n, dimension) by which the tangent answers a load (f,)."""
    if not len(assembler.free):
        return assembler.expand(load)
    if not np.isfinite(geometry.direction).all():
        raise ConvergenceError("a spring shrank to nothing; load in smaller increments")
    solver.factorise(assembler.tangent(geometry, tension, stiffness))
    return assembler.expand(solver.solve(load))


def _line_search(
    assembler: Assembler, law: SpringLaw, displacement: Floats, step: Floats, force: Floats
) -> float:
    """Return the share of a Newton step after which less work is left along it.

    The work that the unbalanced force still does along the step is the slope of the energy;
    a full step is right when this slope has fallen, else halves of it are tried.
    """

    def slope(share: float) -> float:
        geometry = spring_geometry(assembler.network, displacement + share * step)
        tension, _ = law(geometry.elongation)
        unbalanced = force + spring_forces(assembler.network, geometry, tension)
        return abs(float(np.vdot(assembler.restrict(unbalanced), assembler.restrict(step))))

    first, share = slope(0.0), 1.0
    for _ in range(12):
        if slope(share) <= 0.9 * first:  # False where the slope is not a number
            return share
        share /= 2.0
    return 1.0  # at the end of the digits no share lowers the slope
