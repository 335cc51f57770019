"""The two elements of a square agent, on the unit square.

*Fits*: serendipity quadratics, values at the four corners and a bulge on each edge. *Balances*:
Airy's function in the square of Fraeijs de Veubeke (1968) and Sander (1964): a cubic in each of the
four triangles between the diagonals, once differentiable across all lines. Its unknowns are phi,
phi_x, phi_y at the corners, and on each edge by how much the normal slope in the middle differs
from the mean of those at the ends. Both are given by what they are on edges, so that two squares,
or a square and a triangle, that share an edge share its unknowns.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import numpy as np

from kaju.arrays import Floats, Ints

CORNERS = np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)])
EDGES = np.array([(0, 2), (1, 3), (0, 1), (2, 3)])
"""Corners at the ends of the edges: two along x (lower, upper), two along y (left, right)."""
SIDE_OF_EDGE = np.array([2, 3, 0, 1])
"""The side that an edge is: lower and upper one of x, then of y."""
EDGE_OF_SIDE = np.array([2, 3, 0, 1])
DEEPEST_STEP = 3
"""An agent is halved at most so often in one generation."""
_PLACES = [(i, j) for i in range(4) for j in range(4 - i)]
"""Exponents of x and y of the monomials of a cubic."""


def quadratic_values(points: Floats) -> Floats:
    """Return the values of the eight quadratics at points of the unit square, shape (n, 8)."""
    x, y = points.T
    along_x, along_y = 4.0 * x * (1.0 - x), 4.0 * y * (1.0 - y)
    bilinear = [(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y]
    bulges = [along_x * (1 - y), along_x * y, along_y * (1 - x), along_y * x]
    return np.stack([*bilinear, *bulges], axis=1)


def quadratic_slopes(points: Floats) -> Floats:
    """Return the slopes of the eight quadratics, shape (n, 8, 2)."""
    x, y = points.T
    along_x, along_y = 4.0 * x * (1.0 - x), 4.0 * y * (1.0 - y)
    down_x, down_y = 4.0 * (1.0 - 2.0 * x), 4.0 * (1.0 - 2.0 * y)
    by_x = [y - 1, -y, 1 - y, y, down_x * (1 - y), down_x * y, -along_y, along_y]
    by_y = [x - 1, 1 - x, -x, x, -along_x, along_x, down_y * (1 - x), down_y * x]
    return np.stack([np.stack(by_x, axis=1), np.stack(by_y, axis=1)], axis=2)


def _monomials(points: Floats, order: tuple[int, int] = (0, 0)) -> Floats:
    """Return a derivative of the ten monomials of a cubic at points, shape (n, 10)."""
    columns = []
    for powers in _PLACES:
        factor, left = 1.0, []
        for power, times in zip(powers, order, strict=True):
            for step in range(times):
                factor *= power - step
            left.append(max(power - times, 0))
        columns.append(factor * points[:, 0] ** left[0] * points[:, 1] ** left[1])
    return np.stack(columns, axis=1)


@lru_cache(maxsize=1)
def _airy_coefficients() -> Floats:
    """Return what the 16 unknowns make of the cubics in the four triangles, shape (4, 10, 16)."""
    rows, values = [], []

    def demand(
        triangles: dict[int, float], points: Floats, order: tuple[int, int], by: Floats
    ) -> None:
        row = np.zeros((len(points), 4, 10))
        for triangle, sign in triangles.items():
            row[:, triangle] = sign * _monomials(points, order)
        rows.append(row.reshape(len(points), 40))
        values.append(np.broadcast_to(by, (len(points), 16)))

    orders = ((0, 0), (1, 0), (0, 1))
    share = np.linspace(0.0, 1.0, 5)[:, None]
    for corner, place in enumerate(CORNERS):
        first, second = (t for t, ends in enumerate(EDGES) if corner in ends)
        for number, order in enumerate(orders):
            # The two triangles at a half diagonal agree on it, and have the corner's values.
            between = (1.0 - share) * place + share * 0.5
            demand({first: 1.0, second: -1.0}, between, order, np.zeros(16))
            demand({first: 1.0}, place[None], order, np.eye(16)[3 * corner + number])
    for edge, (start, end) in enumerate(EDGES):
        normal = 2 if edge < 2 else 1  # phi_y across edges along x, phi_x across those along y
        by = np.eye(16)[12 + edge] + 0.5 * np.eye(16)[[3 * start + normal, 3 * end + normal]].sum(
            axis=0
        )
        middle = 0.5 * (CORNERS[[start]] + CORNERS[[end]])
        demand({edge: 1.0}, middle, orders[normal], by)
    found = np.linalg.lstsq(np.vstack(rows), np.vstack(values), rcond=None)[0]
    return np.asarray(found).reshape(4, 10, 16)


def _triangle_of(points: Floats) -> Ints:
    """Return in which of the four triangles points lie: by the edge that each has."""
    x, y = points.T
    low, left = y <= np.minimum(x, 1.0 - x), x <= np.minimum(y, 1.0 - y)
    high = y >= np.maximum(x, 1.0 - x)
    return np.where(low, 0, np.where(high, 1, np.where(left, 2, 3)))


def airy(points: Floats, order: tuple[int, int], triangle: Ints | None = None) -> Floats:
    """Return a derivative of phi at points by the 16 unknowns, shape (n, 16)."""
    triangle = _triangle_of(points) if triangle is None else triangle
    cubics = _airy_coefficients()[triangle]
    return np.asarray(np.einsum("nk,nkj->nj", _monomials(points, order), cubics))


def airy_stress(points: Floats, triangle: Ints | None = None) -> Floats:
    """Return xx, yy and xy of the stress of phi at points, shape (n, 3, 16)."""
    parts = [airy(points, (0, 2), triangle), airy(points, (2, 0), triangle)]
    return np.stack([*parts, -airy(points, (1, 1), triangle)], axis=1)


def strain_rows(points: Floats) -> Floats:
    """Return xx, yy and twice xy of the strain of the quadratics at points, shape (n, 3, 16)."""
    slopes = quadratic_slopes(points)
    rows = np.zeros((len(points), 3, 8, 2))
    rows[:, 0, :, 0], rows[:, 1, :, 1] = slopes[..., 0], slopes[..., 1]
    rows[:, 2, :, 0], rows[:, 2, :, 1] = slopes[..., 1], slopes[..., 0]
    return rows.reshape(len(points), 3, 16)


@lru_cache(maxsize=1)
def rule() -> tuple[Floats, Floats, Ints]:
    """Return points, weights and triangles of a rule of degree 5 on each of the four triangles."""
    # Seven points a triangle (Radon 1948), in the triangle's own coordinates.
    a, b = (6.0 - sqrt(15.0)) / 21.0, (6.0 + sqrt(15.0)) / 21.0
    own = [(1 / 3, 1 / 3, 1 / 3)]
    own += [(c, c, 1 - 2 * c) for c in (a, b)] + [(c, 1 - 2 * c, c) for c in (a, b)]
    own += [(1 - 2 * c, c, c) for c in (a, b)]
    weight = [9.0 / 40.0, *[(155.0 - sqrt(15.0)) / 1200.0, (155.0 + sqrt(15.0)) / 1200.0] * 3]
    triangles = [np.array([CORNERS[i], CORNERS[j], (0.5, 0.5)]) for i, j in EDGES]
    points = np.concatenate([np.array(own) @ triangle for triangle in triangles])
    return points, np.tile(0.25 * np.array(weight), 4), np.repeat(np.arange(4), 7)


@lru_cache(maxsize=1)
def strains() -> Floats:
    """Return the strains of the quadratics at the points of the rule, shape (28, 3, 16)."""
    return strain_rows(rule()[0])


@lru_cache(maxsize=1)
def stresses() -> Floats:
    """Return the stresses of phi at the points of the rule, shape (28, 3, 16)."""
    points, _, triangle = rule()
    return airy_stress(points, triangle)


@lru_cache(maxsize=2)
def forms(balances: bool) -> Floats:
    """Return the products of stresses (or strains): like normals, unlike ones, shear."""
    rows, weights = stresses() if balances else strains(), rule()[1]
    xx, yy, xy = rows[:, 0], rows[:, 1], rows[:, 2]

    def product(one: Floats, other: Floats) -> Floats:
        return np.asarray(np.einsum("pi,pj,p->ij", one, other, weights))

    like = product(xx, xx) + product(yy, yy)
    return np.stack([like, product(xx, yy) + product(yy, xx), product(xy, xy)])


@lru_cache(maxsize=1)
def edge_tractions() -> Floats:
    """Return the forces that edges hand on to a square, and first moments, by phi: (4, 2, 2, 16).

    By edge, force or moment, and axis. Forces are those on the square (outward normals); moments
    are those of each component along the edge, about its middle.
    """
    found = np.zeros((4, 2, 2, 16))
    line, weight = (np.asarray(x) for x in np.polynomial.legendre.leggauss(2))
    for edge, (start, end) in enumerate(EDGES):
        normal, sign = (1, 2.0 * edge - 1.0) if edge < 2 else (0, 2.0 * edge - 5.0)
        for at, share in zip(0.5 * line, 0.5 * weight, strict=True):
            point = (0.5 - at) * CORNERS[[start]] + (0.5 + at) * CORNERS[[end]]
            xx, yy, xy = airy_stress(point, np.array([edge]))[0]
            traction = sign * np.stack([xy, yy] if normal else [xx, xy])
            found[edge, 0] += share * traction
            found[edge, 1] += share * at * traction
    return np.asarray(found, dtype=np.float64)


@lru_cache(maxsize=1)
def airy_of_tractions() -> Floats:
    """Return phi by the tractions of `edge_tractions` where these balance: shape (16, 4, 2, 2)."""
    found = np.linalg.pinv(edge_tractions().reshape(16, 16), rcond=1e-10)
    return np.asarray(found, dtype=np.float64).reshape(16, 4, 2, 2)


@lru_cache(maxsize=2)
def child_maps(balances: bool) -> Floats:
    """Return unknowns of all squares of one halved up to `DEEPEST_STEP` times by its own.

    The first is the square itself, then its 2 x 2, 4 x 4 ... parts, x fastest; shape (m, 16, 16).
    Lengths count in the square's own edge, so that slopes of phi shrink with it.
    """
    own = np.stack([_child_map(balances, np.array([x, y])) for y in (0, 1) for x in (0, 1)])
    found = [np.eye(16)[None]]
    for step in range(1, DEEPEST_STEP + 1):
        y, x = np.divmod(np.arange(4**step), 1 << step)
        above = (y // 2) * (1 << (step - 1)) + x // 2
        found.append(own[x % 2 + 2 * (y % 2)] @ found[-1][above])
    return np.concatenate(found)


FIRST_PART = np.cumsum([0] + [4**step for step in range(DEEPEST_STEP + 1)])
"""Where the parts of a square that is halved so often begin in `child_maps`."""


def _child_map(balances: bool, offset: Floats) -> Floats:
    """Return the unknowns of one of the four children of a square by its own."""
    points = 0.5 * (CORNERS + offset)
    middles = 0.5 * (points[EDGES[:, 0]] + points[EDGES[:, 1]])
    if not balances:
        values = quadratic_values(points)
        bulges = quadratic_values(middles) - values[EDGES].mean(axis=1)
        return np.kron(np.concatenate([values, bulges]), np.eye(2))
    found = np.zeros((16, 16))
    found[0:12:3] = airy(points, (0, 0))
    found[1:12:3], found[2:12:3] = 0.5 * airy(points, (1, 0)), 0.5 * airy(points, (0, 1))
    for edge, (start, end) in enumerate(EDGES):
        normal, order = (2, (0, 1)) if edge < 2 else (1, (1, 0))
        slope = 0.5 * airy(middles[[edge]], order)[0]
        found[12 + edge] = slope - found[[3 * start + normal, 3 * end + normal]].mean(axis=0)
    return np.asarray(found)


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
