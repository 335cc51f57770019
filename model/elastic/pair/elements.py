"""The elements of an agent, on the unit square or cube.

*Fits*: serendipity quadratics in hierarchical form, values at the corners and a bulge on each edge
(Zienkiewicz and Taylor, *The Finite Element Method*, vol. 1, ch. 8). *Balances*, in the plane:
Airy's function in the square of Fraeijs de Veubeke (1968) and Sander (1964): a cubic in each of the
four triangles between the diagonals, once differentiable across all lines. Its unknowns are phi,
phi_x, phi_y at the corners, and on each edge by how much the normal slope in the middle differs
from the mean of those at the ends. Both are given by what they are on edges, so that two squares,
or a square and a triangle, that share an edge share its unknowns.
"""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import combinations, product
from math import perm

import numpy as np

from kaju.arrays import Floats, Ints

DEEPEST_STEP = 3
"""An agent is halved at most so often in one generation."""
_PLACES = [(i, j) for i in range(4) for j in range(4 - i)]
"""Exponents of x and y of the monomials of a cubic."""


def corner_ends(dimension: int) -> Ints:
    """Return the corners of a box by their ends along the axes, shape (2^dimension, dimension)."""
    return np.array(list(product((0, 1), repeat=dimension)))


@lru_cache(maxsize=3)
def nodes(d: int) -> Ints:
    """Return the factor of each quadratic along every axis: 0 falls, 1 rises, 2 is a bulge."""
    ends = corner_ends(d)
    # Corners come first, then edges along x, y, z.
    bulges = [
        np.where(np.arange(d) == axis, 2, end) for axis in range(d) for end in ends if not end[axis]
    ]
    return np.array([*ends, *bulges])


@lru_cache(maxsize=2)
def edges_of(d: int) -> Ints:
    """Return the corners at both ends of every edge."""
    bulges, digits = nodes(d)[1 << d :], 1 << np.arange(d)[::-1]
    return np.stack([np.where(bulges == 2, end, bulges) @ digits for end in (0, 1)], axis=1)


@lru_cache(maxsize=2)
def on_sides(d: int) -> Ints:
    """Return the nodes on each side (x lower, x upper, y lower ...): corners, then edges."""
    return np.array([np.flatnonzero(nodes(d)[:, s // 2] == s % 2) for s in range(2 * d)])


CORNERS, EDGES = corner_ends(2).astype(np.float64), edges_of(2)
EDGE_OF_SIDE = on_sides(2)[:, 2] - 4
"""Which of the EDGES a side is."""


@lru_cache(maxsize=8)
def gauss(count: int, d: int) -> tuple[Floats, Floats]:
    """Return points, shape (n, d), and weights of Gauss' rule on the unit square or cube."""
    line, weight = np.polynomial.legendre.leggauss(count)
    points = np.array(list(product(0.5 * (line + 1.0), repeat=d)))
    return points, np.array([np.prod(w) for w in product(0.5 * weight, repeat=d)])


def _factors(points: Floats) -> tuple[Floats, Floats]:
    """Return the three factors of quadratics along every axis, and their slopes, (n, d, 3)."""
    t, one = points[..., None], np.ones((*points.shape, 1))
    own = np.concatenate([1.0 - t, t, 4.0 * t * (1.0 - t)], axis=2)
    return own, np.concatenate([-one, one, 4.0 - 8.0 * t], axis=2)


def quadratic_values(points: Floats) -> Floats:
    """Return the values of the quadratics at points, shape (n, nodes)."""
    d = points.shape[1]
    own, which = _factors(points)[0], nodes(d)
    return np.asarray(np.prod([own[:, k, which[:, k]] for k in range(d)], axis=0))


def strain_rows(points: Floats) -> Floats:
    """Return normal strains, then twice the shear strains, by unknowns: (n, strains, unknowns)."""
    d = points.shape[1]
    (own, slope), which = _factors(points), nodes(d)
    by_axis = [
        np.prod([(slope if k == by else own)[:, k, which[:, k]] for k in range(d)], axis=0)
        for by in range(d)
    ]
    slopes = np.stack(by_axis, axis=2)
    pairs = [(k, k) for k in range(d)] + list(combinations(range(d), 2))
    rows = np.zeros((len(points), len(pairs), *slopes.shape[1:]))
    for row, (a, b) in enumerate(pairs):
        rows[:, row, :, a], rows[:, row, :, b] = slopes[..., b], slopes[..., a]
    return rows.reshape(len(points), len(pairs), slopes.shape[1] * d)


@lru_cache(maxsize=2)
def side_loads(d: int) -> Floats:
    """Return what tractions on a side do to its nodes: of force 1, and of first moments 1.

    Shape (d, nodes of a side); moments are those along its own axes, over its length.
    """
    points, weights = gauss(3, d - 1)
    growing = np.concatenate([np.ones((len(points), 1)), 12.0 * (points - 0.5)], axis=1)
    return np.asarray((growing * weights[:, None]).T @ quadratic_values(points))


def _monomials(points: Floats, order: tuple[int, int] = (0, 0)) -> Floats:
    """Return a derivative of the ten monomials of a cubic at points, shape (n, 10)."""
    factor = [perm(i, order[0]) * perm(j, order[1]) for i, j in _PLACES]
    left = np.maximum(np.subtract(_PLACES, order), 0)
    return np.asarray(factor * np.prod(points[:, None] ** left, axis=2))


@lru_cache(maxsize=1)
def _beyond() -> Floats:
    """Return what vanishes twice on either diagonal in monomials: its square times 1, x and y."""
    places = gauss(5, 2)[0]
    square = (places @ [[1.0, 1.0], [-1.0, 1.0]] - [0.0, 1.0]) ** 2
    values = square[:, :, None] * np.insert(places, 0, 1.0, axis=1)[:, None]
    found = np.linalg.lstsq(_monomials(places), values.reshape(-1, 6), rcond=None)[0]
    return np.round(found).reshape(10, 2, 3)


def _pieces(points: Floats, order: tuple[int, int]) -> Floats:
    """Return a derivative at points of cubics, and of those beyond either diagonal, (n, 16)."""
    cubics = _monomials(points, order)
    there = points @ [[1.0, 1.0], [-1.0, 1.0]] > [0.0, 1.0]
    more = there[:, :, None] * np.tensordot(cubics, _beyond(), 1)
    return np.concatenate([cubics, more.reshape(-1, 6)], axis=1)


@lru_cache(maxsize=1)
def _by_unknowns() -> Floats:
    """Return what the 16 unknowns make of these pieces, shape (16, 16)."""
    found = np.empty((16, 16))
    orders = (0, 0), (1, 0), (0, 1)
    for k, order in enumerate(orders):
        found[k:12:3] = _pieces(CORNERS, order)
    for edge, ends in enumerate(EDGES):
        normal = 2 if edge < 2 else 1  # phi_y across edges along x, phi_x across those along y
        middle = _pieces(CORNERS[ends].mean(axis=0)[None], orders[normal])[0]
        found[12 + edge] = middle - found[3 * ends + normal].mean(axis=0)
    return np.round(12.0 * np.linalg.inv(found)) / 12.0  # as they are


def airy(points: Floats, order: tuple[int, int]) -> Floats:
    """Return a derivative of phi at points by the 16 unknowns, shape (n, 16)."""
    return np.asarray(_pieces(points, order) @ _by_unknowns())


def airy_stress(points: Floats) -> Floats:
    """Return xx, yy and xy of the stress of phi at points, shape (n, 3, 16)."""
    return np.stack([airy(points, (0, 2)), airy(points, (2, 0)), -airy(points, (1, 1))], axis=1)


@lru_cache(maxsize=2)
def rule(d: int) -> tuple[Floats, Floats]:
    """Return points and weights of a rule of degree 4 on each of the four triangles.

    In space it is Gauss' rule on the cube.
    """
    points, weights = gauss(3, d)
    if d == 3:
        return points, weights
    # A square drawn together to a triangle: along its edge, and from the middle to this.
    along, away = points.T[:, :, None]
    ends = CORNERS[EDGES][:, :, None] - 0.5
    points = 0.5 + away * ((1.0 - along) * ends[:, 0] + along * ends[:, 1])
    return points.reshape(-1, 2), np.tile(0.5 * weights * away[:, 0], 4)


@lru_cache(maxsize=2)
def strains(d: int) -> Floats:
    """Return the strains of the quadratics at the points of the rule."""
    return strain_rows(rule(d)[0])


@lru_cache(maxsize=1)
def stresses() -> Floats:
    """Return the stresses of phi, even ones and those of forces within: (points, 3, 16 + 3 + 2).

    At the points of the rule; forces are met by stresses that grow along each axis.
    """
    points = rule(2)[0]
    even = np.tile(np.eye(3), (len(points), 1, 1))
    growing = (0.5 - points)[:, None] * np.eye(3, 2)
    return np.concatenate([airy_stress(points), even, growing], axis=2)


@lru_cache(maxsize=1)
def edge_tractions() -> Floats:
    """Return the forces that sides hand on to a square, and first moments, by phi: (4, 2, 2, 16).

    By side, force or moment, and axis. Forces are those on the square (outward normals); moments
    are those of each component along the side, about its middle.
    """
    found = np.zeros((4, 2, 2, 16))
    line, weight = (0.5 * np.asarray(x) for x in np.polynomial.legendre.leggauss(2))
    for side, (start, end, _) in enumerate(on_sides(2)):
        points = np.outer(0.5 - line, CORNERS[start]) + np.outer(0.5 + line, CORNERS[end])
        stress = airy_stress(points)
        # xx and xy on the left and right, xy and yy below and above
        traction = (2.0 * (side % 2) - 1.0) * stress[:, [2, 1] if side > 1 else [0, 2]]
        found[side] = np.einsum("kp,pai->kai", [weight, weight * line], traction)
    return found


@lru_cache(maxsize=1)
def airy_of_tractions() -> Floats:
    """Return phi by the tractions of `edge_tractions` where these balance: shape (16, 4, 2, 2)."""
    found = np.linalg.pinv(edge_tractions().reshape(16, 16), rcond=1e-10)
    return np.asarray(found, dtype=np.float64).reshape(16, 4, 2, 2)


@lru_cache(maxsize=3)
def child_maps(balances: bool, d: int = 2) -> Floats:
    """Return unknowns of all parts of an agent halved up to `DEEPEST_STEP` times by its own.

    The first is the agent itself, then its 2 x 2, 4 x 4 ... parts, x fastest; of displacements
    each component by itself. Lengths count in the agent's own edge: slopes of phi shrink with it.
    """
    points = gauss(5, d)[0]
    values = partial(airy, order=(0, 0)) if balances else quadratic_values
    # A child's own functions are equal to its parent's within it, as multiples of 1/192.
    children = [
        np.linalg.lstsq(values(points), values(0.5 * (points + offset)), rcond=None)[0]
        for offset in corner_ends(d)[:, ::-1]
    ]
    own = np.round(192.0 * np.stack(children)) / 192.0
    found = [np.eye(own.shape[1])[None]]
    for step in range(1, DEEPEST_STEP + 1):
        many = 1 << step
        place = np.array(np.unravel_index(np.arange(many**d), (many,) * d))
        which = np.ravel_multi_index(tuple(place % 2), (2,) * d)
        above = np.ravel_multi_index(tuple(place // 2), (many // 2,) * d)
        found.append(own[which] @ found[-1][above])
    return np.concatenate(found)


def without_plane(phi: Floats) -> Floats:
    """Return phi of squares (unit edges) without a linear function, which has no stress."""
    # Of a function with a large linear part rounding would leave no curvature at small squares.
    rest = phi.reshape(*phi.shape[:-1], 16).copy()
    value, by_x, by_y = (rest[..., k].copy() for k in range(3))
    for corner, (x, y) in enumerate(CORNERS):
        rest[..., 3 * corner] -= value + by_x * x + by_y * y
        rest[..., 3 * corner + 1] -= by_x
        rest[..., 3 * corner + 2] -= by_y
    return rest
