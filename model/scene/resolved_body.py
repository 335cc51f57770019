"""A body made ready to be asked: the kind of any cell, worked out when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import floor, prod

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import Material
from kaju.arrays import Flags, Ints

from .lattice import Cells, Lattice
from .pictures import Picture, check_size
from .shapes import Shape

CellBox = tuple[Ints, Ints]
"""Lower corner, included, and upper corner, not included, of a box of cells."""

_SLAB = 1_000_000


@dataclass(frozen=True, eq=False)
class FilledShape:
    """A shape and the kind of the cells whose centres lie in it."""

    shape: Shape
    kind: int


@dataclass(frozen=True, eq=False)
class ResolvedBody:
    """The kinds of the cells of an array and of what lies beyond its sides."""

    lattice: Lattice
    base: int | NDArray[np.int16]  # kind of every cell under the regions: one for all, or one each
    regions: tuple[FilledShape, ...]  # what lies over it, the later over the earlier
    beyond: Ints  # kind of what lies beyond each of the lattice's sides
    materials: tuple[Material, ...]  # that kinds from 0 upwards stand for
    picture: Picture | None  # the body cell by cell, if it was given so

    @property
    def box(self) -> CellBox:
        """All cells of the array."""
        shape = np.asarray(self.lattice.shape, dtype=np.int64)
        return np.zeros_like(shape), shape

    @property
    def uniform(self) -> bool:
        """Whether every cell of the array is the same."""
        return isinstance(self.base, int) and not self.regions

    def same(self, other: ResolvedBody) -> bool:
        """Tell whether another body has the same cells, shapes and sides."""
        ours, theirs = (
            (one.lattice, [(region.shape, region.kind) for region in one.regions])
            for one in (self, other)
        )
        arrays = (self.base, other.base), (self.beyond, other.beyond)
        return ours == theirs and all(np.array_equal(a, b) for a, b in arrays)

    def kinds(self, cells: Cells) -> Ints:
        """Return the kind of each cell, those outside the array included."""
        side = self.lattice.side_beyond(cells)
        if isinstance(self.base, int):
            kinds = np.append(self.beyond, self.base)[side]
            if not self.regions:
                return kinds
        else:
            kinds = self.beyond[side]
        inside = side < 0
        here = cells[inside]
        found = kinds[inside] if isinstance(self.base, int) else self.base[tuple(here.T)]
        if self.regions:
            centres = self.lattice.centres(here)
            for region in self.regions:
                found[region.shape.contains(centres)] = region.kind
        kinds[inside] = found
        return kinds

    def bounds(self) -> CellBox:
        """Return a box outside of which there is no body."""
        boxes = [self.cells_of(region.shape) for region in self.regions if region.kind >= 0]
        if not isinstance(self.base, int):
            body = self.base >= 0
            if body.any():
                boxes.append(_tight(body))
        elif self.base >= 0:
            return self.box
        if not boxes:
            lower, _ = self.box
            return lower, lower
        lower = np.min([low for low, _ in boxes], axis=0)
        return lower, np.max([high for _, high in boxes], axis=0)

    def cells_of(self, shape: Shape) -> CellBox:
        """Return a box of cells outside of which a shape has no cell's centre."""
        corners = np.array(list(product(*zip(*shape.extent, strict=True))))
        places, last = self.lattice.coordinates(corners), np.asarray(self.lattice.shape)
        least, most = self.lattice.offsets
        low = np.clip(np.floor(places.min(axis=0)) - np.ceil(most), 0, last)
        high = np.clip(np.ceil(places.max(axis=0)) - np.floor(least) + 1, 0, last)
        return low.astype(np.int64), np.maximum(low, high).astype(np.int64)

    def layer(self, box: CellBox, side: int) -> CellBox:
        """Return the part of a box that lies in the array's outermost layer at one of its sides."""
        axis, upper_end = divmod(side, 2)
        lower, upper = (corner.copy() for corner in box)
        edge = self.lattice.shape[axis] - 1 if upper_end else 0
        lower[axis], upper[axis] = max(lower[axis], edge), min(upper[axis], edge + 1)
        return lower, np.maximum(lower, upper)

    def rasterise(self) -> NDArray[np.int16]:
        """Return the kinds of all cells, shape `lattice.shape`."""
        shape = self.lattice.shape
        check_size(shape, "body.cells")
        if isinstance(self.base, int):
            kinds = np.full(shape, self.base, dtype=np.int16)
        else:
            kinds = self.base.copy()
        for region in self.regions:
            for cells in slabs(self.cells_of(region.shape)):
                inside = region.shape.contains(self.lattice.centres(cells))
                kinds[tuple(cells[inside].T)] = region.kind
        return kinds


def _tight(body: Flags) -> CellBox:
    lower, upper = [], []
    for axis in range(body.ndim):
        others = tuple(other for other in range(body.ndim) if other != axis)
        filled = np.flatnonzero(body.any(axis=others))
        lower.append(filled[0])
        upper.append(filled[-1] + 1)
    return np.array(lower, dtype=np.int64), np.array(upper, dtype=np.int64)


def count(box: CellBox) -> int:
    """Return the number of cells in a box; exact, however large."""
    return prod(int(high) - int(low) for low, high in zip(*box, strict=True))


def grid(lower: Ints, upper: Ints) -> Cells:
    """Return all cells with lower <= cell < upper, the last axis running fastest."""
    return _all_combinations([np.arange(a, b) for a, b in zip(lower, upper, strict=True)])


def _all_combinations(ranges: list[Ints]) -> Cells:
    return np.stack([axis.ravel() for axis in np.meshgrid(*ranges, indexing="ij")], axis=1)


def slabs(box: CellBox, axis: int = 0) -> Iterator[Cells]:
    """Yield all cells of a box in pieces of about a million."""
    lower, upper = box
    length = int(upper[axis] - lower[axis])
    layer = max(1, count(box) // max(1, length))
    thickness = max(1, _SLAB // layer)
    for start in range(0, length, thickness):
        first, last = lower.copy(), upper.copy()
        first[axis] += start
        last[axis] = min(first[axis] + thickness, upper[axis])
        if layer > 2 * _SLAB and axis + 1 < len(lower):
            yield from slabs((first, last), axis + 1)
        else:
            yield grid(first, last)


def sample(box: CellBox, most: int = 100_000) -> Cells:
    """Return at most about `most` cells spread evenly over a box, its corners included."""
    lower, upper = box
    each = max(2, floor(most ** (1.0 / len(lower))))
    return _all_combinations(
        [
            np.unique(np.linspace(low, high - 1, min(each, int(high - low))).astype(np.int64))
            for low, high in zip(lower, upper, strict=True)
        ]
    )
