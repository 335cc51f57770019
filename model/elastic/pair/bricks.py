"""The brick of 20 nodes: quadratic serendipity displacements of a unit cube.

The functions are hierarchical: eight are trilinear, one for each corner, and twelve are the bulges
of the edges, 1 in the middle of an edge and 0 at all corners (Zienkiewicz and Taylor, *The Finite
Element Method*, vol. 1, ch. 8). Stresses are kept as six numbers: xx, yy, zz, xy, xz, yz.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from kaju.arrays import Floats, Ints

CORNERS: Ints = np.array(list(product((0, 1), repeat=3)))
EDGES: Ints = np.array(
    [
        (a, b)
        for a in range(8)
        for b in range(a + 1, 8)
        if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1
    ]
)
"""The two corners at the ends of each of the twelve edges."""
NODES = 20
SHEARS = ((0, 1), (0, 2), (1, 2))
MOST_HALVINGS = 2
"""A leaf is halved so often at most between two generations: once, and once more beside others."""


def gauss(count: int, dimension: int = 3) -> tuple[Floats, Floats]:
    """Return points, shape (n, dimension), and weights of a Gauss rule on the unit cube."""
    line, weight = np.polynomial.legendre.leggauss(count)
    points = np.array(list(product(0.5 * (line + 1.0), repeat=dimension)))
    return points, np.array([np.prod(w) for w in product(0.5 * weight, repeat=dimension)])


def values(places: Floats) -> Floats:
    """Return the functions at places from 0 to 1, shape (n, 20)."""
    share = np.where(CORNERS[:, None], places, 1.0 - places)
    found = [*share.prod(axis=2)]
    for a, b in EDGES:
        along = int(np.flatnonzero(CORNERS[a] != CORNERS[b])[0])
        across = np.delete(share[a], along, axis=1).prod(axis=1)
        found.append(4.0 * places[:, along] * (1.0 - places[:, along]) * across)
    return np.stack(found, axis=1)


def slopes(places: Floats) -> Floats:
    """Return the functions' derivatives at places from 0 to 1, shape (n, 20, 3)."""
    share = np.where(CORNERS[:, None], places, 1.0 - places)
    sign = 2.0 * CORNERS - 1.0
    found = np.empty((len(places), NODES, 3))
    for k in range(3):
        found[:, :8, k] = (np.delete(share, k, axis=2).prod(axis=2) * sign[:, None, k]).T
    for e, (a, b) in enumerate(EDGES):
        along = int(np.flatnonzero(CORNERS[a] != CORNERS[b])[0])
        t = places[:, along]
        one, other = (k for k in range(3) if k != along)
        found[:, 8 + e, along] = 4.0 * (1.0 - 2.0 * t) * share[a, :, one] * share[a, :, other]
        found[:, 8 + e, one] = 4.0 * t * (1.0 - t) * sign[a, one] * share[a, :, other]
        found[:, 8 + e, other] = 4.0 * t * (1.0 - t) * sign[a, other] * share[a, :, one]
    return found


def strain_rows(places: Floats) -> Floats:
    """Return the strains of the 60 unknowns (node by node) at places, shape (n, 6, 60)."""
    slope = slopes(places)
    rows = np.zeros((len(places), 6, NODES, 3))
    for k in range(3):
        rows[:, k, :, k] = slope[:, :, k]
    for row, (a, b) in enumerate(SHEARS):
        rows[:, 3 + row, :, a] = slope[:, :, b]
        rows[:, 3 + row, :, b] = slope[:, :, a]
    return rows.reshape(len(places), 6, 3 * NODES)


def law_of(lateral: float, shear: float) -> Floats:
    """Return the matrix from strains to stresses, shape (6, 6)."""
    law = np.diag([2.0 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lateral
    return law


def stiffness(lateral: float, shear: float) -> Floats:
    """Return the stiffness matrix of the unit cube, shape (60, 60)."""
    points, weights = gauss(3)
    rows = strain_rows(points)
    return np.asarray(
        np.einsum("pai,ab,pbj,p->ij", rows, law_of(lateral, shear), rows, weights, optimize=True)
    )


@lru_cache(maxsize=1)
def descents() -> Floats:
    """Return every descendant's nodes by those of the brick it came from, shape (n, 20, 20).

    The first is the brick itself, then come the 8 halves and the 64 quarters, x fastest, as the
    leaves of an octree follow one another.
    """
    found = [np.eye(NODES)]
    for level in range(1, MOST_HALVINGS + 1):
        many = 1 << level
        for z, y, x in product(range(many), repeat=3):
            corner = (np.array([x, y, z]) + CORNERS) / many
            middle = values(0.5 * (corner[EDGES[:, 0]] + corner[EDGES[:, 1]]))
            at_corners = values(corner)
            # A bulge is what the middle has beyond the mean of the ends.
            ends = 0.5 * (at_corners[EDGES[:, 0]] + at_corners[EDGES[:, 1]])
            found.append(np.concatenate([at_corners, middle - ends]))
    return np.array(found)


FIRST_OF_LEVEL = np.cumsum([0] + [8**level for level in range(MOST_HALVINGS)])
"""Place in `descents` of the first descendant of so many halvings."""


def on_side(side: int) -> Ints:
    """Return which nodes lie on a side: 0 and 1 are the ends along x, 2 and 3 along y, and so on.

    The corners come first, then the edges.
    """
    axis, end = divmod(side, 2)
    corner = CORNERS[:, axis] == end
    return np.flatnonzero(np.concatenate([corner, corner[EDGES].all(axis=1)]))


@lru_cache(maxsize=1)
def side_loads() -> Floats:
    """Return the work of tractions on the nodes: 1, and one linear along each axis.

    Shape (6 sides, 1 + 3, 20); along the side's own axis there is none, and the linear ones are 0
    in the middle and ±1/2 at the ends.
    """
    flat, weights = gauss(3, 2)
    found = np.zeros((6, 4, NODES))
    for side in range(6):
        axis, end = divmod(side, 2)
        points = np.insert(flat, axis, float(end), axis=1)
        growing = np.concatenate([np.ones((len(points), 1)), points - 0.5], axis=1)
        growing[:, 1 + axis] = 0.0
        found[side] = np.einsum("pg,pn,p->gn", growing, values(points), weights)
    return found


@lru_cache(maxsize=1)
def side_masses() -> Floats:
    """Return what an even bed on each side does to the nodes, shape (6, 20, 20)."""
    flat, weights = gauss(3, 2)
    points = [np.insert(flat, side // 2, float(side % 2), axis=1) for side in range(6)]
    return np.array([np.einsum("pi,pj,p->ij", values(at), values(at), weights) for at in points])


@lru_cache(maxsize=1)
def means() -> Floats:
    """Return the mean of every function over the cube: what an even force does to the nodes."""
    points, weights = gauss(3)
    return np.asarray(weights @ values(points))


@lru_cache(maxsize=1)
def from_gauss() -> Floats:
    """Return the trilinear continuation of values at 2 × 2 × 2 Gauss points to the corners."""
    points, _ = gauss(2)
    return np.asarray(np.linalg.inv(trilinear(points)))


def trilinear(places: Floats) -> Floats:
    """Return the corners' trilinear functions at places, shape (n, 8)."""
    return np.asarray(np.where(CORNERS[:, None], places, 1.0 - places).prod(axis=2).T)
