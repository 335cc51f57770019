"""The agents of a body as the leaves of a quadtree or octree.

A leaf is a square or cube, named by the integer coordinates of its lower corner and by its
edge, both counted in *units*, the smallest cells that could ever spawn. The leaves are kept
in the order of their Morton codes, so that the leaf around any point is found by bisection
(a linear octree; Gargantini 1982). Nothing is stored where there is no body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from itertools import product

import numpy as np

from kaju.arrays import Flags, Ints

BITS = {2: 30, 3: 20}
"""Binary digits of a coordinate in units; the code needs as many for every axis."""
_SPREAD = {
    2: (
        (16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333), (1, 0x5555555555555555),
    ),
    3: (
        (32, 0x001F00000000FFFF), (16, 0x001F0000FF0000FF), (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
    ),
}  # fmt: skip
"""Shifts and masks that interleave binary digits with room for those of the other axes."""


def morton(points: Ints) -> Ints:
    """Return the Morton codes of points (units, not negative), shape (n, dimension)."""
    found = np.zeros(len(points), dtype=np.int64)
    for axis in range(points.shape[1]):
        digits = points[:, axis].astype(np.int64)
        for shift, mask in _SPREAD[points.shape[1]]:
            digits |= digits << shift
            digits &= mask
        found |= digits << axis
    return found


def corner_ends(dimension: int) -> Ints:
    """Return the corners of a box by their ends along the axes, shape (2^dimension, dimension)."""
    return np.array(list(product((0, 1), repeat=dimension)))


def corners(code: Ints, dimension: int) -> Ints:
    """Return the points (units) that Morton codes stand for, shape (n, dimension)."""
    point = np.zeros((len(code), dimension), dtype=np.int64)
    for bit in range(BITS[dimension]):
        for axis in range(dimension):
            point[:, axis] |= ((code >> (dimension * bit + axis)) & 1) << bit
    return point


@dataclass(frozen=True, eq=False)
class LeafCells:
    """Agents of one body, in the order of their Morton codes."""

    lower: Ints  # Lower corners (units). Shape (n, dimension)
    size: Ints  # Edges (units), powers of two. Shape (n,)
    kind: Ints  # Material. Shape (n,)
    code: Ints  # Morton codes of the lower corners. Shape (n,)

    @classmethod
    def of(cls, lower: Ints, size: Ints, kind: Ints) -> LeafCells:
        """Return leaves sorted by their codes."""
        code = morton(lower)
        order = np.argsort(code, kind="stable")
        return cls(lower[order], size[order], kind[order], code[order])

    def __len__(self) -> int:
        return len(self.size)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.lower.shape[1])

    @property
    def upper(self) -> Ints:
        """Upper corners (units). Shape (n, dimension)."""
        return np.asarray(self.lower + self.size[:, None])

    def find(self, points: Ints) -> Ints:
        """Return the leaf that holds each unit cell, -1 where there is none."""
        # Coordinates beyond the array have more digits than a code holds, or a sign.
        high = reduce(np.bitwise_or, points.T) >> BITS[self.dimension]
        code = morton(points)
        at = np.searchsorted(self.code, code, "right") - 1
        # The last leaf that begins before the cell holds it, if its codes reach so far.
        held = (high == 0) & (at >= 0) & (code - self.code[at] < self.size[at] ** self.dimension)
        return np.where(held, at, -1)

    def holding(self, points: Ints) -> Ints:
        """Return the leaves that hold any of some unit cells."""
        at = np.unique(self.find(points))
        return np.asarray(at[at >= 0])

    def split(self, chosen: Flags) -> LeafCells:
        """Return the leaves with the chosen ones replaced by their children."""
        d = self.dimension
        # Children take their parent's place in the order, x fastest; `child` counts them.
        corners = corner_ends(d)[:, ::-1]
        many = len(corners)
        count = np.where(chosen, many, 1)
        parent = np.repeat(np.arange(len(self)), count)
        child = np.arange(len(parent)) - np.repeat(np.cumsum(count) - count, count)
        new = chosen[parent]
        size = np.where(new, self.size[parent] // 2, self.size[parent])
        lower = self.lower[parent] + corners[np.where(new, child, 0)] * size[:, None]
        code = self.code[parent] + np.where(new, child * size**d, 0)
        return LeafCells(lower, size, self.kind[parent], code)

    def only(self, chosen: Flags | Ints) -> LeafCells:
        """Return some of the leaves."""
        columns = self.lower, self.size, self.kind, self.code
        return LeafCells(*(column[chosen] for column in columns))

    def parents_in(self, before: LeafCells) -> Ints:
        """Return in which of some larger leaves each lies."""
        return np.asarray(np.searchsorted(before.code, self.code, "right") - 1)

    def balanced(self) -> LeafCells:
        """Return the leaves refined until neighbours differ at most by a factor of two (2:1)."""
        # Where two materials meet at a face, the leaves on both sides have the same size: hanging
        # faces of a stiff large leaf would be held by its soft neighbours only.
        leaves, largest = self, int(self.size.max())
        while True:
            asking = np.flatnonzero(leaves.size <= largest)
            lower, size, kind = (a[asking] for a in (leaves.lower, leaves.size, leaves.kind))
            chosen = np.zeros(len(leaves), dtype=np.bool_)
            for offset in product((-1, 0, 1), repeat=self.dimension):
                other = leaves.find(lower + np.array(offset, dtype=np.int64) * size[:, None])
                too_large = leaves.size[other] > 2 * size
                if np.abs(offset).sum() == 1:  # across a face, where materials may meet
                    too_large |= (leaves.size[other] > size) & (leaves.kind[other] != kind)
                chosen[other[(other >= 0) & too_large]] = True
            if not chosen.any():
                return leaves
            # Next only those can ask that are as small as the new ones.
            largest = int(leaves.size[chosen].max()) // 2
            leaves = leaves.split(chosen)
