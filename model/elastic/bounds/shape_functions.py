"""Displacements within a box: linear along every axis, and a quadratic for each edge.

The functions are hierarchical: a box without the quadratics is the bilinear one, and a quadratic
is 1 in the middle of its edge and 0 at all corners.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.bounds.bound_cells import corner_ends

EDGES = ((0, 2), (1, 3), (0, 1), (2, 3))
"""Corners at the ends of a plane box's edges: two along the first axis, two along the second."""
BULGE = 2.0 / 3.0  # Mean of a quadratic over its edge


def gauss_points(dimension: int, count: int) -> tuple[Floats, Floats]:
    """Return the points, shape (n, dimension), and weights of a Gauss rule on the unit box."""
    line, weight = np.polynomial.legendre.leggauss(count)
    points = np.array(list(product(0.5 * (line + 1.0), repeat=dimension)))
    weights = np.array([np.prod(one) for one in product(0.5 * weight, repeat=dimension)])
    return points, weights


def shape_values(inside: Floats, quadratic: bool) -> Floats:
    """Return the functions' values, shape (functions, n), at places of shape (n, d) from 0 to 1."""
    ends = corner_ends(inside.shape[1])
    values = np.where(ends[:, None], inside, 1.0 - inside).prod(axis=2)
    if not quadratic:
        return np.asarray(values)
    bulge = [
        4.0 * along * (1.0 - along) * across
        for along, other in zip(inside.T, inside.T[::-1], strict=True)
        for across in (1.0 - other, other)
    ]
    return np.concatenate([values, bulge])


def shape_slopes(inside: Floats, quadratic: bool) -> Floats:
    """Return the functions' derivatives, shape (functions, n, d)."""
    d, ends = inside.shape[1], corner_ends(inside.shape[1])
    share = np.where(ends[:, None], inside, 1.0 - inside)
    slopes = np.stack(
        [
            np.delete(share, b, axis=2).prod(axis=2) * (2.0 * ends[:, None, b] - 1.0)
            for b in range(d)
        ],
        axis=2,
    )
    if not quadratic:
        return slopes
    more = np.empty((4, *inside.shape))
    for edge, (axis, end) in enumerate(product((0, 1), repeat=2)):
        along, other = inside[:, axis], inside[:, 1 - axis]
        more[edge, :, axis] = 4.0 * (1.0 - 2.0 * along) * (other if end else 1.0 - other)
        more[edge, :, 1 - axis] = 4.0 * along * (1.0 - along) * (1.0 if end else -1.0)
    return np.concatenate([slopes, more])


@lru_cache(maxsize=3)
def element_stiffness(dimension: int, quadratic: bool = False) -> Floats:
    """Return the nodal forces by displacements, for each of C₁₁, C₁₂ and μ."""
    points, weights = gauss_points(dimension, 3)
    slopes = shape_slopes(points, quadratic)
    products = np.einsum("ina,jnb,n->abij", slopes, slopes, weights)
    count, axes = len(slopes), range(dimension)
    forms = np.zeros((3, count, dimension, count, dimension))
    for a, b in product(axes, axes):
        if a == b:
            forms[0, :, a, :, a] = products[a, a]
        else:
            forms[1, :, a, :, b] = products[a, b]
            forms[2, :, a, :, a] += products[b, b]
            forms[2, :, a, :, b] += products[b, a]
    return forms.reshape(3, count * dimension, count * dimension)


@lru_cache(maxsize=3)
def mean_slopes(dimension: int, quadratic: bool) -> Floats:
    """Return the functions' mean derivatives over the box, shape (functions, d)."""
    points, weights = gauss_points(dimension, 3)
    return np.asarray(np.einsum("ina,n->ia", shape_slopes(points, quadratic), weights))


@lru_cache(maxsize=3)
def mean_values(dimension: int, quadratic: bool) -> Floats:
    """Return the functions' means over the box, shape (functions,)."""
    points, weights = gauss_points(dimension, 3)
    return np.asarray(shape_values(points, quadratic) @ weights)


@lru_cache(maxsize=3)
def side_mass(dimension: int, quadratic: bool) -> Floats:
    """Return the mass matrix of a side of unit size: what an even bed does to its nodes."""
    points, weights = gauss_points(dimension - 1, 3)
    values = shape_values(points, quadratic=False)
    if quadratic:
        along = points[:, 0]
        values = np.concatenate([values, [4.0 * along * (1.0 - along)]])
    return np.asarray(np.einsum("in,jn,n->ij", values, values, weights))
