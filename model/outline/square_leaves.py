"""Square leaves of a quadtree over an array of equal squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaju.arrays import Flags, Floats, Ints

DEPTH = 16
"""How often a first leaf can be halved."""
_ROW = np.int64(1) << 31


@dataclass(frozen=True, eq=False)
class SquareLeaves:
    """Leaves by lower corner and edge, in whole units of 2^-16 of the first leaves' edge.

    Sizes of leaves that touch differ by two at most.
    """

    x: Ints
    y: Ints
    size: Ints
    shape: tuple[int, int]
    """Number of first leaves along x and y."""

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

    def at(self, points: Floats) -> Ints:
        """Return the leaf that holds each point (in edges of the first leaves), -1 for none."""
        found = np.full(len(points), -1, dtype=np.int64)
        place = np.floor(points / self.unit).astype(np.int64)
        for size in np.unique(self.size):
            rows = np.flatnonzero(self.size == size)
            keys = self.x[rows] * _ROW + self.y[rows]
            order = np.argsort(keys)
            low = place // size * size
            wanted = low[:, 0] * _ROW + low[:, 1]
            spot = np.minimum(np.searchsorted(keys[order], wanted), len(rows) - 1)
            hit = (keys[order][spot] == wanted) & (low >= 0).all(axis=1)
            found[hit] = rows[order[spot[hit]]]
        return found

    def split(self, halvings: Flags | Ints) -> SquareLeaves:
        """Return the leaves halved so many times each, and others that became too large."""
        leaves, left = self, halvings.astype(np.int64)
        while True:
            chosen = left > 0
            if not chosen.any():
                left = leaves._too_large().astype(np.int64)
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
            left = np.concatenate([left[~chosen], np.tile(left[chosen] - 1, 4)])

    def _too_large(self) -> Flags:
        """Tell which leaves touch one of less than half their size."""
        bad = np.zeros(len(self), dtype=np.bool_)
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                middle = np.stack([self.x, self.y], axis=1) + 0.5 * self.size[:, None]
                beside = middle + self.size[:, None] * np.array([dx, dy])
                # a leaf twice as large or larger holds the middle of an equal neighbour's place
                other = self.at(beside * self.unit)
                found = np.flatnonzero(other >= 0)
                larger = found[self.size[other[found]] > 2 * self.size[found]]
                bad[other[larger]] = True
        return bad
