"""What fills whole boxes of cells, found without looking at every cell.

The boxes are those of a quadtree or octree: 2^k cells along every edge, at multiples of
2^k. A box that lies in one shape or outside of all of them is of one kind; one that an
edge of a shape may cross counts as mixed, and its parts have to be asked again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags
from kaju.model.scene.cell_types import AIR
from kaju.model.scene.lattice import Cells
from kaju.model.scene.resolved_body import ResolvedBody
from kaju.model.scene.shapes import Ball, Box, Mask, Points, Polygon, Shape

MIXED = -99
"""A box that may hold cells of several kinds."""

Kinds = NDArray[np.int64]


class BoxKinds:
    """Answers for a body; keeps a pyramid of kinds for a body given cell by cell."""

    def __init__(self, resolved: ResolvedBody) -> None:
        self._resolved = resolved
        self._pyramid: list[NDArray[np.int16]] = []
        if not isinstance(resolved.base, int):
            self._pyramid = _pyramid(resolved.base)

    def kinds(self, lower: Cells, exponent: int) -> Kinds:
        """Return the kind that fills each box of 2^exponent cells a side from `lower`, or MIXED."""
        shape = np.asarray(self._resolved.lattice.shape)
        upper = lower + (1 << exponent)
        inside = np.all((lower >= 0) & (upper <= shape), axis=1)
        beyond = (upper <= 0) | (lower >= shape)
        outside = np.any(beyond, axis=1)
        found = np.full(len(lower), MIXED, dtype=np.int64)
        found[outside] = self._outside(lower[outside], upper[outside], beyond[outside])
        found[inside] = self._inside(lower[inside], exponent)
        return found

    def _outside(self, lower: Cells, upper: Cells, beyond: Flags) -> Kinds:
        """Beyond one side its condition holds, beyond two there is air."""
        shape = np.asarray(self._resolved.lattice.shape)
        axis = np.argmax(beyond, axis=1)
        each = np.arange(len(lower))
        index = 2 * axis + (lower[each, axis] >= shape[axis])
        along = np.ones_like(beyond)
        along[each, axis] = False
        straddles = np.any(along & ~beyond & ((lower < 0) | (upper > shape)), axis=1)
        kind = np.where(beyond.sum(axis=1) > 1, AIR, self._resolved.beyond[index])
        return np.where(straddles & (kind != AIR), MIXED, kind)

    def _inside(self, lower: Cells, exponent: int) -> Kinds:
        base, h = self._resolved.base, self._resolved.lattice.cell_size
        if isinstance(base, int):
            kind = np.full(len(lower), base, dtype=np.int64)
        elif exponent < len(self._pyramid):
            kind = self._pyramid[exponent][tuple((lower >> exponent).T)].astype(np.int64)
        else:
            kind = np.full(len(lower), MIXED, dtype=np.int64)
        # A box is of a region's kind if the region holds the centres of all of its cells.
        low = np.asarray((lower + 0.5) * h)
        high = np.asarray((lower + (1 << exponent) - 0.5) * h)
        for region in self._resolved.regions:
            inside, apart = relation(region.shape, low, high)
            crossed = np.where(kind == region.kind, kind, MIXED)
            kind = np.where(inside, region.kind, np.where(apart, kind, crossed))
        return kind


def _pyramid(base: NDArray[np.int16]) -> list[NDArray[np.int16]]:
    """Return the kinds of the boxes of 1, 2, 4, ... cells, MIXED where they differ."""
    levels = [base]
    while max(levels[-1].shape) > 1:
        values = levels[-1]
        for axis in range(values.ndim):
            pad = [(0, values.shape[a] % 2 if a == axis else 0) for a in range(values.ndim)]
            lines = np.moveaxis(np.pad(values, pad, constant_values=MIXED), axis, 0)
            pair = np.where(lines[0::2] == lines[1::2], lines[0::2], MIXED)
            values = np.moveaxis(pair, 0, axis).astype(np.int16)
        levels.append(values)
    return levels


def relation(shape: Shape, low: Points, high: Points) -> tuple[Flags, Flags]:
    """Tell which boxes of centres lie surely inside a shape, and which surely outside.

    Other than for solids (`SolidShape.relation`), a centre on the edge is inside.
    """
    if np.array_equal(low, high):
        inside = shape.contains(low)
        return inside, ~inside
    lower, upper = shape.extent
    margin = 1e-9 * (np.abs(lower) + np.abs(upper))
    apart = np.any((high < lower - margin) | (low > upper + margin), axis=1)
    if isinstance(shape, Box):
        return shape.contains(low) & shape.contains(high), apart
    if isinstance(shape, Ball):
        centre, reach = np.asarray(shape.centre), shape.radius * (1 + 1e-9)
        far = np.maximum(np.abs(low - centre), np.abs(high - centre))
        near = np.maximum(np.maximum(low - centre, centre - high), 0.0)
        inside = np.einsum("ij,ij->i", far, far) < (shape.radius * (1 - 1e-9)) ** 2
        return inside, apart | (np.einsum("ij,ij->i", near, near) > reach**2)
    if isinstance(shape, Polygon):
        whole = ~_crossed_by_edge(shape, low, high)
        within = shape.contains(low)
        return whole & within, apart | (whole & ~within)
    if isinstance(shape, Mask):
        return _dark_all_over(shape, low, high) & ~apart, apart
    return np.zeros(len(low), dtype=np.bool_), apart


def _crossed_by_edge(shape: Polygon, low: Points, high: Points) -> Flags:
    """Tell which boxes an edge of the polygon may cross (separating axes)."""
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    crossed = np.zeros(len(low), dtype=np.bool_)
    corners = np.asarray(shape.corners)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        middle, reach = 0.5 * (start + end), 0.5 * np.abs(end - start)
        normal = np.array([start[1] - end[1], end[0] - start[0]])
        close = np.all(np.abs(centre - middle) <= (half + reach) * (1 + 1e-9), axis=1)
        offset = np.abs((centre - middle) @ normal)
        crossed |= close & (offset <= (half @ np.abs(normal)) * (1 + 1e-9))
    return crossed


def _dark_all_over(shape: Mask, low: Points, high: Points) -> Flags:
    """Tell which boxes see only dark pixels."""
    lower, upper = shape.extent
    pixels = np.asarray(shape.dark.shape)
    scale = pixels / (upper - lower)
    first = np.floor((low - lower) * scale - 1e-6).astype(np.int64)
    last = np.floor((high - lower) * scale + 1e-6).astype(np.int64) + 1
    within = np.all((first >= 0) & (last <= pixels), axis=1)
    first, last = np.clip(first, 0, pixels), np.clip(last, 0, pixels)
    light = np.pad(np.cumsum(np.cumsum(~shape.dark, axis=0), axis=1), ((1, 0), (1, 0)))
    (a, b), (c, d) = first.T, last.T
    return np.asarray(within & (light[c, d] - light[a, d] - light[c, b] + light[a, b] == 0))
