"""Square leaves of a quadtree over an array of equal squares."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.leaves import morton
from kaju.model.scene.curves import Point

DEPTH = 16  # how often a first leaf can be halved
_AROUND = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y])


@dataclass(frozen=True, eq=False)
class SquareLeaves:
    """Leaves by lower corner and edge, in whole units of 2^-16 of the first leaves' edge.

    Sizes of leaves that touch differ by two at most.
    """

    x: Ints
    y: Ints
    size: Ints
    shape: tuple[int, int]  # number of first leaves along x and y

    unit = 2.0**-DEPTH

    @classmethod
    def first(cls, shape: tuple[int, int]) -> SquareLeaves:
        """Return the largest leaves."""
        i, j = (grid.ravel() for grid in np.indices(shape, dtype=np.int64))
        return cls(i << DEPTH, j << DEPTH, np.full(i.size, 1 << DEPTH, np.int64), shape)

    def __len__(self) -> int:
        return len(self.x)

    def only(self, chosen: Flags | Ints) -> SquareLeaves:
        """Return some of the leaves."""
        return SquareLeaves(self.x[chosen], self.y[chosen], self.size[chosen], self.shape)

    def lower(self) -> Floats:
        """Return the lower corners, in edges of the first leaves. Shape (n, 2)."""
        return np.asarray(np.stack([self.x, self.y], axis=1) * self.unit, dtype=np.float64)

    def squares(self, chosen: Ints) -> list[list[Point]]:
        """Return the corners of some of the leaves, counter-clockwise from the lower left one."""
        low = self.lower()[chosen]
        high = low + (self.size[chosen] * self.unit)[:, None]
        ends = zip(low.tolist(), high.tolist(), strict=True)
        return [[(x0, y0), (x1, y0), (x1, y1), (x0, y1)] for (x0, y0), (x1, y1) in ends]

    @property
    def code(self) -> Ints:
        """Morton codes of the lower corners: those within a larger leaf follow one another."""
        return morton(np.stack([self.x, self.y], axis=1))

    @cached_property
    def _order(self) -> tuple[Ints, Ints]:
        """Return the Morton codes in order, and whose each is."""
        code = self.code
        order = np.argsort(code)
        return code[order], order

    def at(self, points: Floats) -> Ints:
        """Return the leaf that holds each point (in edges of the first leaves), -1 for none."""
        places = np.floor(points / self.unit).astype(np.int64)
        code, order = self._order
        found = order[np.searchsorted(code, morton(places), side="right") - 1]
        dx, dy = places[:, 0] - self.x[found], places[:, 1] - self.y[found]
        size = self.size[found]
        within = (dx >= 0) & (dy >= 0) & (dx < size) & (dy < size)
        return np.where(within, found, -1)

    def as_small_as(self, others: SquareLeaves) -> SquareLeaves:
        """Return the leaves, halved where others within them are smaller."""
        leaves = self
        while (larger := leaves.size[at := leaves.at(others.lower())] > others.size).any():
            leaves = leaves.split(np.isin(np.arange(len(leaves)), at[larger]))
        return leaves

    def split(self, halvings: Flags | Ints) -> SquareLeaves:
        """Return the leaves halved so many times each, and others that became too large."""
        leaves, left = self, halvings.astype(np.int64)
        fresh = np.zeros(len(self), dtype=np.bool_)
        while True:
            chosen = left > 0
            if not chosen.any():
                left = leaves._too_large(np.flatnonzero(fresh)).astype(np.int64)
                if not left.any():
                    return leaves
                continue
            half, x, y = leaves.size[chosen] // 2, leaves.x[chosen], leaves.y[chosen]
            leaves = SquareLeaves(
                np.concatenate([leaves.x[~chosen], x, x + half, x, x + half]),
                np.concatenate([leaves.y[~chosen], y, y, y + half, y + half]),
                np.concatenate([leaves.size[~chosen], half, half, half, half]),
                self.shape,
            )
            fresh = np.concatenate([fresh[~chosen], np.ones(4 * len(half), dtype=np.bool_)])
            left = np.concatenate([left[~chosen], np.tile(left[chosen] - 1, 4)])

    def _too_large(self, beside: Ints) -> Flags:
        """Tell which leaves touch one of these that is of less than half their size."""
        size = self.size[beside, None]
        # a leaf twice as large or larger holds the middle of an equal neighbour's place
        x = self.x[beside, None] + 0.5 * size + size * _AROUND[:, 0]
        y = self.y[beside, None] + 0.5 * size + size * _AROUND[:, 1]
        other = self.at(np.stack([x.ravel(), y.ravel()], axis=1) * self.unit)
        bad = np.zeros(len(self), dtype=np.bool_)
        bad[other[(other >= 0) & (self.size[other] > 2 * np.repeat(size, 8))]] = True
        return bad
