"""Where load is left unbalanced, and the error that this stands for.

Children that take their parents' displacements by interpolation feel none of its
curvature: the stress that changes from one agent to the next, ahead and beside, is the load
that they leave unbalanced. Interpolated linearly over an edge h, a displacement with the
second derivative u″ is off by a strain whose mean square is (h u″)²/12. So

    η² = V h²/12 · (2μ Σ u_a,aa² + λ Σ (div u),a² + μ Σ u_a,bb²)

is the square of the error of one agent in the energy norm, and √(Σ η² / 2U) the relative
error of all (U: strain energy).
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from .balance import Balance
from .composite import Composite, Floats
from .field import known_slopes, oriented, slope_weights


class Indicator(NamedTuple):
    """Per leaf the square of its error (energy norm) and its unbalanced load; both scaled."""

    square: Floats
    load: Floats


def indicate(balance: Balance, u: Floats) -> Indicator:
    """Return what every agent would leave unbalanced if its children only followed it."""
    grid, d = balance.grid, balance.grid.dimension
    n, kind, h = len(grid.leaves), grid.leaves.kind, grid.length
    moduli = grid.ground.moduli
    shear, lateral = moduli.shear[kind], moduli.lateral[kind]
    stretch = (balance.strains[: n * d] @ u).reshape(d, n)
    volume_change = stretch.sum(axis=0)
    total, load = np.zeros(n), np.zeros(n)
    for a in range(d):
        ahead = _change_ahead(grid, stretch[a], a)
        pressure = np.maximum(lateral, 0.0) * _change_ahead(grid, volume_change, a)
        own = (2 * shear) ** 2 * ahead
        total += 2 * shear * ahead + pressure
        for b in range(d):
            if b != a:
                beside = _change_beside(grid, u, a, b) ** 2
                total += shear * beside
                own += shear**2 * beside
        load = np.maximum(load, np.sqrt(own))
    volume = h**d
    return Indicator(volume * h**2 / 12.0 * total, volume * load)


def _change_ahead(grid: Composite, value: Floats, axis: int) -> Floats:
    """Return the mean square slope of a leaf's value along an axis, within its material.

    Of the small neighbours on one side all count alike, each by its share of that side.
    """
    kind, h, n = grid.leaves.kind, grid.length, len(grid.leaves)
    total, count = np.zeros(n), np.zeros(n)
    share = 0.5 ** (grid.dimension - 1)
    for side in (2 * axis, 2 * axis + 1):
        other = grid.beside[:, side]
        # A large leaf names one of its small neighbours only, but each of these names it.
        leaf = np.flatnonzero((other >= 0) & (kind[other] == kind) & (h[other] >= h))
        beyond = other[leaf]
        square = ((value[beyond] - value[leaf]) / (0.5 * (h[beyond] + h[leaf]))) ** 2
        large = share * (h[beyond] > h[leaf])
        total += np.bincount(leaf, square, n) + np.bincount(beyond, large * square, n)
        count += np.bincount(leaf, minlength=n) + np.bincount(beyond, large, n)
    return np.asarray(total / np.where(count > 0, count, 1.0))


def _change_beside(grid: Composite, u: Floats, a: int, b: int) -> Floats:
    """Return ∂²u_a/∂b² of every leaf, from the slopes at its edges."""
    edges = grid.edges[min(a, b), max(a, b)]
    gradients, table = oriented(edges, a < b)
    values = [gradient.matrix @ u + gradient.constant for gradient in gradients]
    known = known_slopes(gradients)
    shear = grid.ground.moduli.shear[grid.leaves.kind]
    total, count = np.zeros((len(shear), 2)), np.zeros((len(shear), 2))
    for end, far in product((0, 1), repeat=2):
        edge = table[:, end, far]
        own, other = slope_weights(edges, gradients, edge, shear)
        slope = own * values[0][edge] + other * values[1][edge]
        total[:, far] += np.where(known[edge], slope, 0.0)
        count[:, far] += known[edge]
    mean = total / np.maximum(count, 1)
    return np.asarray(
        np.where((count > 0).all(axis=1), (mean[:, 1] - mean[:, 0]) / grid.length, 0.0)
    )
