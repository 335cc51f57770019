"""The least stress within a box that has given tractions: linear on its crossed parts.

A box is halved along every axis, and every part cut from its middle through its edges (in solids
through the middles of its sides as well): 4 triangles a quarter, 24 tetrahedra an eighth. On each
the stress is linear, without a jump of tractions between them. Whatever linear tractions its sides
have, if only they are in balance, there is such a stress; the one of least energy is a fixed matrix
per material.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.bounds.stress_function import strains_of_nodes, stresses_of_unknowns
from kaju.model.elastic.moduli import Moduli, by_law

Point = tuple[float, ...]
STIFFEST = 1e6
"""C₁₂ over μ, at most: ν up to 0.4999995."""


@dataclass(frozen=True, eq=False)
class Macroelement:
    """Energy and mean stress within a box of unit edge by its tractions and the force within."""

    quadratic: Floats  # Shape (data, data)
    # Mean normal stresses, then shear stresses pair by pair; shape (d (d + 1) / 2, data)
    linear: Floats
    parts: Floats  # The data of every part; shape (2^d, data of a part, data)
    # Stresses at the corners of the simplices of a part; shape (simplices, d + 1, d (d + 1) / 2,
    # data of a part)
    stress: Floats

    @classmethod
    def of_laws(cls, dimension: int, law: Moduli, box: Ints) -> list[tuple[Ints, Macroelement]]:
        """Return boxes of one material each, and their form."""
        laws = by_law(np.stack(law)[:, box])
        return [(box[some], _form(dimension, *map(float, one))) for some, one in laws]

    def energy(self, data: Floats) -> Floats:
        """Return the energies by data, shape (n, data)."""
        return np.asarray(0.5 * np.einsum("ni,ni->n", data @ self.quadratic, data))

    def mean(self, data: Floats) -> Floats:
        """Return the mean stresses, shape (d (d + 1) / 2, n)."""
        return np.asarray(self.linear @ data.T)

    def at(self, data: Floats, inside: Floats) -> Floats:
        """Return stresses, like `mean`, at a place in each of n boxes, shape (n, d) from 0 to 1."""
        d = inside.shape[1]
        upper = (inside >= 0.5).astype(np.int64)
        octant = upper @ (1 << np.arange(d)[::-1])
        simplex, weight = inside_simplices(_simplices(d), 2.0 * inside - upper)
        found = np.empty((len(self.linear), len(inside)))
        for one, corners in product(range(len(self.parts)), range(len(self.stress))):
            here = np.flatnonzero((octant == one) & (simplex == corners))
            own = data[here] @ self.parts[one].T
            found[:, here] = np.einsum("nk,kcp,np->cn", weight[here], self.stress[corners], own)
        return found


@lru_cache(maxsize=64)
def products_of(
    form: Macroelement, like: float, unlike: float, shear: float
) -> list[tuple[Floats, Floats, Floats, Floats]]:
    """Return products with stress functions and with strains of nodes, part by part."""
    # Tables, shape (data, 16), of what every part of a plane box adds to the products of the whole
    # box as an element, then of the part as an element of its own; for unit elements. The numbers
    # are the compliance.
    points, weight, which, share = triangle_points(_simplices(2))
    stress = np.einsum("nk,nkcd->ncd", share, form.stress[which])

    def products_at(inside: Floats, by_data: Floats) -> tuple[Floats, Floats]:
        xx, yy, xy = stresses_of_unknowns(inside)
        strain = np.stack([like * xx + unlike * yy, like * yy + unlike * xx, shear * xy])
        felt, on_nodes = (
            np.einsum("n,ncd,cin->di", weight, by_data, one, optimize=True)
            for one in (strain, strains_of_nodes(inside))
        )
        return felt, on_nodes

    found = []
    for end, part in zip(corner_ends(2), form.parts, strict=True):
        by_data = stress @ part
        whole = products_at(0.5 * (points + end), 0.25 * by_data)
        found.append((*whole, *products_at(points, by_data)))
    return found


def triangle_points(triangles: list[list[Point]]) -> tuple[Floats, Floats, Ints, Floats]:
    """Return points in triangles of equal area, their weights, triangles, and shares of corners."""
    # A rule of seven points is exact for polynomials of degree 5 (Radon 1948).
    root = 15.0**0.5
    shares, weights = [[1 / 3] * 3], [9 / 40]
    for near, weight in (((6 - root) / 21, 155 - root), ((6 + root) / 21, 155 + root)):
        shares += [np.roll([1 - 2 * near, near, near], k).tolist() for k in range(3)]
        weights += [weight / 1200] * 3
    count = len(triangles)
    share = np.tile(np.array(shares), (count, 1))
    which = np.repeat(np.arange(count), len(weights))
    points = np.einsum("nk,nkd->nd", share, np.array(triangles)[which])
    return points, np.tile(np.array(weights) / count, count), which, share


@lru_cache(maxsize=2)
def balance_rows(dimension: int, halves: int) -> Floats:
    """Return force and moments on a box of unit edge by its tractions and the force within."""
    # Sides are cut into 1 or 2 `halves` along each axis. Data are, for every side, part, component
    # and mode (the mean, and the slope along each axis of the side), the stress; and the force. The
    # shape is (d (d + 1) / 2, data).
    d = dimension
    parts = list(product(range(halves), repeat=d - 1))
    force = np.zeros((d, 2 * d, len(parts), d, d))
    moment = np.zeros((d, *force.shape))  # ∫ r_k t_i: k, then i by component
    for side, (number, part) in product(range(2 * d), enumerate(parts)):
        axis, upper = divmod(side, 2)
        share = (2.0 * upper - 1.0) / len(parts)
        across = [k for k in range(d) if k != axis]
        for i in range(d):
            force[i, side, number, i, 0] = share
            moment[axis, i, side, number, i, 0] = share * (upper - 0.5)
            for mode, (k, at) in enumerate(zip(across, part, strict=True), start=1):
                moment[k, i, side, number, i, 0] = share * ((at + 0.5) / halves - 0.5)
                moment[k, i, side, number, i, mode] = share / (12.0 * halves)
    turns = [moment[i, j] - moment[j, i] for i, j in combinations(range(d), 2)]
    rows = np.concatenate([force, turns]).reshape(d + len(turns), -1)
    within = np.eye(len(rows), d)
    return np.concatenate([rows, within], axis=1)


@lru_cache(maxsize=64)
def _form(dimension: int, stretch: float, lateral: float, shear: float) -> Macroelement:
    """Work the form out: parts of least energy, and the least tractions between them."""
    d = dimension
    # A softer law only adds to the energy of a stress, and rounding leaves room for no stiffer one.
    twice, lateral = stretch - lateral, min(lateral, STIFFEST * shear)
    stretch = lateral + twice
    softest = min(twice, shear, stretch + (d - 1) * lateral)
    part = _part(d, stretch, lateral, shear)
    sides, halves = 2 * d, 1 << (d - 1)
    count = sides * halves * d * d + d
    inner = d * halves  # sides between parts
    ends = corner_ends(d)
    eye = np.eye(d * d)
    take = np.zeros((len(ends), part.quadratic.shape[0], count + inner * d * d))
    for number, end in enumerate(ends):
        for side in range(sides):
            axis, upper = divmod(side, 2)
            place = int("".join(str(end[k]) for k in range(d) if k != axis), 2)
            outside = end[axis] == upper
            at = (side * halves if outside else axis * halves) + place
            start = at * d * d + (0 if outside else count)
            take[number, side * d * d : (side + 1) * d * d, start : start + d * d] = eye
        take[number, sides * d * d :, count - d : count] = 0.5 * np.eye(d)
    # Stresses are taken by the least modulus, so that materials of any stiffness are alike.
    share = 1.0 / len(ends)
    energy = (
        softest * share * np.einsum("pia,ij,pjb->ab", take, part.quadratic, take, optimize=True)
    )
    rows = np.concatenate([balance_rows(d, 1) @ one for one in take])
    zero = np.zeros((len(rows), len(rows)))
    system = np.block([[energy[count:, count:], rows[:, count:].T], [rows[:, count:], zero]])
    right = np.concatenate([energy[count:, :count], rows[:, :count]])
    between = -(np.linalg.pinv(system, rcond=1e-10, hermitian=True) @ right)[: inner * d * d]
    whole = take @ np.concatenate([np.eye(count), between])
    quadratic = share * np.einsum("pia,ij,pjb->ab", whole, part.quadratic, whole, optimize=True)
    mean = share * np.einsum("ki,pia->ka", part.linear, whole)
    return Macroelement(quadratic, mean, whole, part.stress)


def _part(d: int, stretch: float, lateral: float, shear: float) -> Macroelement:
    """Return the form of one part, of unit edge."""
    stress, free = _stresses(d)
    law = np.full((d, d), lateral) + (stretch - lateral) * np.eye(d)
    pairs = d * (d - 1) // 2
    compliance = np.zeros((d + pairs, d + pairs))
    compliance[:d, :d] = np.linalg.inv(law)
    compliance[d:, d:] = np.eye(pairs) / shear
    corners = d + 1
    count = len(_simplices(d))
    mass = (np.ones((corners, corners)) + np.eye(corners)) / (corners * (corners + 1) * count)
    blocks = stress.shape[0] // (corners * (d + pairs))

    def weigh(field: Floats) -> Floats:
        each = field.reshape(blocks, corners, d + pairs, -1)
        heavy = np.einsum("kl,ij,tljx->tkix", mass, compliance, each, optimize=True)
        return np.asarray(heavy.reshape(field.shape))

    heavy = weigh(free)
    stress = stress - free @ np.linalg.solve(free.T @ heavy, heavy.T @ stress)
    each = stress.reshape(count, corners, d + pairs, -1)
    return Macroelement(
        stress.T @ weigh(stress), each.mean(axis=(0, 1)), np.eye(stress.shape[1])[None], each
    )


@lru_cache(maxsize=2)
def _stresses(d: int) -> tuple[Floats, Floats]:
    """Return a stress for all data of a part, and those that need none, column by column."""
    # The stress is (normal stresses, shear stresses) at the corners of every simplex.
    rows, data = _conditions(d)
    left, size, right = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(size > 1e-10 * size[0]))
    stress = right[:rank].T @ ((left[:, :rank].T @ data) / size[:rank, None])
    return stress, right[rank:].T


def _conditions(d: int) -> tuple[Floats, Floats]:
    """Return ``rows @ stress = data @ given``: balance, equal tractions, and those of the sides."""
    pairs = list(combinations(range(d), 2))
    kinds, simplices = d + len(pairs), _simplices(d)
    tensor = np.zeros((kinds, d, d))  # by stress components
    tensor[range(d), range(d), range(d)] = 1.0
    for number, (i, j) in enumerate(pairs, start=d):
        tensor[number, i, j] = tensor[number, j, i] = 1.0
    rows: list[Floats] = []
    data: list[Floats] = []
    facets: dict[tuple[Point, ...], list[int]] = {}

    def condition() -> tuple[Floats, Floats, Floats]:
        """Add a row for each axis; return views by corners, by sides' tractions, and by forces."""
        rows.append(np.zeros((d, len(simplices), d + 1, kinds)))
        data.append(np.zeros((d, 2 * d * d * d + d)))
        return rows[-1], data[-1][:, :-d].reshape(d, 2 * d, d, d), data[-1][:, -d:]

    for number, points in enumerate(simplices):
        slope = np.linalg.inv(np.c_[np.ones(d + 1), np.array(points)])[1:]
        row, _, force = condition()
        row[:, number] = np.einsum("jk,cij->ikc", slope, tensor)
        force[:] = -np.eye(d)
        for facet in combinations(sorted(points), d):
            facets.setdefault(facet, []).append(number)
    for facet, owners in facets.items():
        normal = np.linalg.svd(np.diff(np.array(facet), axis=0))[2][-1]
        traction = np.einsum("j,cij->ic", normal, tensor)
        axis = int(np.argmax(np.abs(normal)))
        for point in facet:
            row, given, _ = condition()
            for sign, number in zip((1.0, -1.0), owners, strict=False):
                row[:, number, simplices[number].index(point)] = sign * traction
            if len(owners) == 1:
                across = [point[k] - 0.5 for k in range(d) if k != axis]
                mode = normal[axis] * np.array([1.0, *across])
                given[range(d), 2 * axis + int(point[axis]), range(d)] = mode
    return np.concatenate([row.reshape(d, -1) for row in rows]), np.concatenate(data)


def _simplices(d: int) -> list[list[Point]]:
    """Return the corners of the simplices of a part: each has its middle, and that of a side."""
    if d == 1:
        return [[(0.0,), (1.0,)]]
    return [
        [*((*point[:axis], end, *point[axis:]) for point in points), (0.5,) * d]
        for points in _simplices(d - 1)
        for axis, end in product(range(d), (0.0, 1.0))
    ]


def inside_simplices(simplices: Sequence[Sequence[Point]], place: Floats) -> tuple[Ints, Floats]:
    """Return the simplex that each place lies in, and how much of each of its corners it is."""
    to = np.stack([np.linalg.inv(np.c_[np.ones(len(one)), np.array(one)]) for one in simplices])
    share = np.einsum("ni,sik->nsk", np.c_[np.ones(len(place)), place], to)
    simplex = share.min(axis=2).argmax(axis=1)
    return simplex, share[np.arange(len(place)), simplex]
