"""The agents of a body as the leaves of a quadtree or octree.

A leaf is a square or cube, named by the integer coordinates of its lower corner and by its
edge, both counted in *units*, the smallest cells that could ever spawn. The leaves are kept
in the order of their Morton codes, so that the leaf around any point is found by bisection
(a linear octree; Gargantini 1982). Nothing is stored where there is no body.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.bound_cells import corner_ends

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
"""How digits move apart, step by step, until there is room for those of the other axes."""


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


@dataclass(frozen=True, eq=False)
class LeafCells:
    """Agents of one body, in the order of their Morton codes."""

    lower: Ints  # Lower corners (units). Shape (n, dimension)
    size: Ints  # Edges (units), powers of two. Shape (n,)
    kind: Ints  # Material. Shape (n,)
    step: Ints  # Spawning step in which the agent came to be. Shape (n,)
    cause: Floats
    """Load (N) that its parent left unbalanced; 0 for those that were there from the start, NaN
    where a parent spawned before it settled or to keep neighbours alike in size. Shape (n,)."""
    code: Ints  # Morton codes of the lower corners. Shape (n,)

    @classmethod
    def of(cls, lower: Ints, size: Ints, kind: Ints, step: Ints, cause: Floats) -> LeafCells:
        """Return leaves in order."""
        code = morton(lower)
        order = np.argsort(code, kind="stable")
        return cls(lower[order], size[order], kind[order], step[order], cause[order], code[order])

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
        # Beyond the array a coordinate has digits that are too high, or a sign.
        high = np.bitwise_or.reduce(points, axis=1) >> BITS[self.dimension]
        code = morton(points)
        at = np.searchsorted(self.code, code, "right") - 1
        # The last leaf that begins before the cell holds it, if its codes reach so far.
        held = (high == 0) & (at >= 0) & (code - self.code[at] < self.size[at] ** self.dimension)
        return np.where(held, at, -1)

    def holding(self, points: Ints) -> Ints:
        """Return the leaves that hold any of some unit cells."""
        at = np.unique(self.find(points))
        return np.asarray(at[at >= 0])

    def split(self, chosen: Flags, step: int, cause: Floats) -> LeafCells:
        """Return the leaves with the chosen ones replaced by their children."""
        # `cause` gives, per leaf, what is noted with its children.
        d = self.dimension
        # A leaf's children take its place in the order: corner after corner, x the fastest.
        corners = corner_ends(d)[:, ::-1]
        many = len(corners)
        count = np.where(chosen, many, 1)
        parent = np.repeat(np.arange(len(self)), count)
        child = np.arange(len(parent)) - np.repeat(np.cumsum(count) - count, count)
        new = chosen[parent]
        size = np.where(new, self.size[parent] // 2, self.size[parent])
        lower = self.lower[parent] + corners[np.where(new, child, 0)] * size[:, None]
        return LeafCells(
            lower,
            size,
            self.kind[parent],
            np.where(new, step, self.step[parent]),
            np.where(new, cause[parent], self.cause[parent]),
            self.code[parent] + np.where(new, child * size**d, 0),
        )

    def merged(self) -> LeafCells:
        """Return the leaves with complete families of one kind replaced by their parents."""
        d, many = self.dimension, 1 << self.dimension
        # In the order of the codes a family stands together, its first child at its corner.
        first = np.arange(max(len(self) - many + 1, 0))
        last = first + many - 1
        whole = np.all(self.lower[first] % (2 * self.size[first, None]) == 0, axis=1)
        whole &= self.code[last] - self.code[first] == (many - 1) * self.size[first] ** d
        for child in range(1, many):
            whole &= self.size[first + child] == self.size[first]
            whole &= self.kind[first + child] == self.kind[first]
        start, size, stay = first[whole], self.size.copy(), np.ones(len(self), dtype=np.bool_)
        size[start] *= 2
        for child in range(1, many):
            stay[start + child] = False
        return replace(self, size=size).only(stay)

    def only(self, chosen: Flags | Ints) -> LeafCells:
        """Return some of the leaves."""
        columns: tuple[Any, ...] = (
            self.lower,
            self.size,
            self.kind,
            self.step,
            self.cause,
            self.code,
        )
        return LeafCells(*(column[chosen] for column in columns))

    def _too_large_beside(self, young: Ints) -> tuple[Flags, Flags]:
        """Return which leaves are too large for neighbours among the young, and which of these."""
        chosen, crowded = np.zeros(len(self), dtype=np.bool_), np.zeros(len(young), dtype=np.bool_)
        lower, size, kind = self.lower[young], self.size[young], self.kind[young]
        for way in product((-1, 0, 1), repeat=self.dimension):
            if not any(way):
                continue
            step = np.array(way, dtype=np.int64)
            other = self.find(np.asarray(lower + step * size[:, None], dtype=np.int64))
            large = (other >= 0) & (self.size[other] > size)
            unlike = self.size[other] > 2 * size
            if np.abs(way).sum() == 1:
                unlike |= self.kind[other] != kind
            large &= unlike
            chosen[other[large]] = True
            crowded |= large
        return chosen, crowded

    def balanced(self, step: int, young: Flags | None = None) -> LeafCells:
        """Return leaves of which no two neighbours differ by more than a factor of two."""
        # Where two materials meet at a face, the leaves on both sides are of one size: small faces
        # on a stiff large leaf would be held by its soft neighbours only. Where all but some
        # `young` leaves are known to be balanced, these alone look about.
        leaves = self
        looking = np.arange(len(leaves)) if young is None else np.flatnonzero(young)
        while len(looking):
            chosen, crowded = leaves._too_large_beside(looking)
            if not chosen.any():
                break
            fresh, crowd = leaves.code[chosen], leaves.code[looking[crowded]]
            ends = fresh + leaves.size[chosen] ** self.dimension
            leaves = leaves.split(chosen, step, np.full(len(leaves), np.nan))
            at = np.searchsorted(fresh, leaves.code, side="right") - 1
            again = (at >= 0) & (leaves.code < ends[np.maximum(at, 0)])
            # Those beside a leaf that was much too large look once more.
            again[np.searchsorted(leaves.code, crowd)] = True
            looking = np.flatnonzero(again)
        return leaves
