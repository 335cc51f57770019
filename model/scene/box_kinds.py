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
from kaju.model.scene.shapes import Points, Relation, Shape

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


def relation(shape: Shape, low: Points, high: Points) -> Relation:
    """Tell which boxes of centres lie surely inside a shape, and which surely outside.

    A centre on the edge is inside: `Shape.relation`, of boxes that touch, is asked a little wider.
    """
    if np.array_equal(low, high):
        inside = shape.contains(low)
        return inside, ~inside
    margin = 1e-6 * (high - low)
    return shape.relation(low - margin, high + margin)
