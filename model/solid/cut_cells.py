"""Which cells a solid fills, cuts and leaves empty, and what share of the cut ones it fills."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.equal.staggered import padded
from kaju.model.scene.shapes import Points, Shape

EMPTY, CUT, WHOLE = 0, 1, 2
PARTS = 4  # parts of a cut cell along every axis, on whose tetrahedra the level is taken as linear
_PATHS = np.array(
    [
        np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(way)]], 0)
        for way in permutations(range(3))
    ]
)
"""Corners of the six tetrahedra of a cube: all the ways along its edges to the opposite corner."""


class SolidBody(NamedTuple):
    """A body in space: what fills an array of cubes, and shapes that cover it one after another."""

    shape: tuple[int, ...]
    edge: float  # Of a cell (m)
    filled: bool  # Whether the array is body where no shape covers it
    shapes: tuple[tuple[Shape, bool], ...]  # Each with whether it is body

    def sorts(self, low: Points, high: Points) -> NDArray[np.int8]:
        """Return of boxes whether they are surely WHOLE, or EMPTY; all others are CUT."""
        found = np.full(len(low), WHOLE if self.filled else EMPTY, dtype=np.int8)
        for shape, body in self.shapes:
            own = WHOLE if body else EMPTY
            inside, apart = shape.relation(low, high)
            crossed = np.where(found == own, own, CUT)
            found = np.where(inside, own, np.where(apart, found, crossed)).astype(np.int8)
        return found

    def level(self, points: Points) -> Floats:
        """Return about how far points lie outside of the body (m), below 0 within."""
        found = np.full(len(points), -np.inf if self.filled else np.inf)
        for shape, body in self.shapes:
            own = shape.level(points, sqrt(3.0) * self.edge / PARTS)
            found = np.minimum(found, own) if body else np.maximum(found, -own)
        return found

    def cells(self) -> NDArray[np.int8]:
        """Return the sorts of all cells, as an array of them."""
        found = []
        places = np.argwhere(np.ones(self.shape, dtype=np.bool_))
        for part in _parts(places):
            low: Floats = np.asarray(part * self.edge)
            found.append(self.sorts(low, low + self.edge))
        return np.concatenate(found).reshape(self.shape)

    def shares(self, sorts: NDArray[np.int8]) -> Floats:
        """Return what share of the eighths of every cell is body: an array of cells half as large.

        An estimate: the level is taken as linear on small tetrahedra.
        """
        found = np.where(sorts == WHOLE, 1.0, 0.0)
        for axis in range(3):
            found = np.repeat(found, 2, axis)
        half = PARTS // 2
        for cut in _parts(np.argwhere(sorts == CUT)):
            line = np.arange(PARTS + 1) / PARTS
            within = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
            points = ((cut[:, None, None, None] + within) * self.edge).reshape(-1, 3)
            filled = filled_shares(self.level(points).reshape(len(cut), *within.shape[:3]))
            eighths = filled.reshape(len(cut), 2, half, 2, half, 2, half).mean(axis=(2, 4, 6))
            for end in product((0, 1), repeat=3):
                found[tuple((2 * cut + end).T)] = eighths[(slice(None), *end)]
        return found


def _parts(places: Ints) -> Sequence[Ints]:
    return np.array_split(places, max(1, -(-len(places) // 20_000)))


def filled_shares(level: Floats) -> Floats:
    """Return the share of small cubes where a level is below 0, linear on six tetrahedra of each.

    `level` has the values at the cubes' corners, shape (n, a + 1, b + 1, c + 1).
    """
    count = [m - 1 for m in level.shape[1:]]

    def at(corner: Ints) -> Floats:
        return level[(slice(None), *(slice(c, c + m) for c, m in zip(corner, count, strict=True)))]

    total = np.zeros((len(level), *count))
    for path in _PATHS:
        total += below_zero(np.stack([at(corner) for corner in path]))
    return np.asarray(total / len(_PATHS))


def below_zero(values: Floats) -> Floats:
    """Return the share of tetrahedra where a linear function of corners (4, ...) is below 0."""
    a, b, c, d = np.sort(values, axis=0)

    def along(low: Floats, high: Floats) -> Floats:
        """Return which share of an edge, from its lower end on, is below 0."""
        return np.asarray(low / np.where(low < high, low - high, -1.0))

    ab, ac, ad, bc, bd = along(a, b), along(a, c), along(a, d), along(b, c), along(b, d)
    one = ab * ac * ad
    two = ac * ad + (1.0 - ac) * bc * bd + ac * (1.0 - ad) * bd
    three = 1.0 - (1.0 - ad) * (1.0 - bd) * (1.0 - along(c, d))
    cases: list[Flags] = [a >= 0.0, b >= 0.0, c >= 0.0, d >= 0.0]
    return np.select(cases, [np.zeros_like(one), one, two, three], 1.0)


def thick(cells: Flags) -> Flags:
    """Return the cells that are part of two by two by two of them: what is thinner turns freely."""
    ends = list(product((slice(None, -1), slice(1, None)), repeat=3))
    found = np.zeros_like(cells)
    if min(cells.shape) > 1:
        blocks = np.logical_and.reduce([cells[end] for end in ends])
        for end in ends:
            found[end] |= blocks
    return found


def edge_shares(eighths: Floats, pair: tuple[int, int]) -> Floats:
    """Return what share of the box round every edge is body, one more along both axes of a pair.

    Beyond the array there is as much as on this side of it.
    """
    (along,) = {0, 1, 2} - set(pair)
    found = _pairwise(eighths, along)
    for axis in pair:
        found = _pairwise(padded(found, (axis,)), axis)
    return found


def _pairwise(values: Floats, axis: int) -> Floats:
    lines = np.moveaxis(values, axis, 0)
    return np.moveaxis(0.5 * (lines[::2] + lines[1::2]), 0, axis)
