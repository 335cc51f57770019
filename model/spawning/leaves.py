"""The agents of a body as the leaves of a quadtree or octree.

A leaf is a square or cube, named by the integer coordinates of its lower corner and by its
edge, both counted in *units*, the smallest cells that could ever spawn. The leaves are kept
in the order of their Morton codes, so that the leaf around any point is found by bisection
(a linear octree; Gargantini 1982). Nothing is stored where there is no body.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

BITS = {2: 30, 3: 20}
"""Binary digits of a coordinate in units; the code needs as many for every axis."""

_SPREAD = {
    2: (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ),
    3: (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ),
}


def morton(points: Index) -> Index:
    """Return the Morton codes of points (units, not negative), shape (n, dimension)."""
    d = points.shape[1]
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(d):
        spread = points[:, axis].astype(np.uint64)
        for shift, mask in _SPREAD[d]:
            spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
        code |= spread << np.uint64(axis)
    return code.astype(np.int64)


@dataclass(frozen=True, eq=False)
class Leaves:
    """Agents of one body, in the order of their Morton codes.

    Attributes
    ----------
    lower : int array, shape (n, dimension)
        Lower corners (units).
    size : int array, shape (n,)
        Edges (units), powers of two.
    kind : int array, shape (n,)
        Material.
    step : int array, shape (n,)
        Spawning step in which the agent came to be.
    cause : float array, shape (n,)
        Load (N) that its parent left unbalanced; 0 for those that were there from the start,
        NaN for those that spawned only to keep neighbours alike in size.
    code : int array, shape (n,)
        Morton codes of the lower corners.
    """

    lower: Index
    size: Index
    kind: Index
    step: Index
    cause: NDArray[np.float64]
    code: Index

    @classmethod
    def of(
        cls, lower: Index, size: Index, kind: Index, step: Index, cause: NDArray[np.float64]
    ) -> Leaves:
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

    def find(self, points: Index) -> Index:
        """Return the leaf that holds each unit cell, -1 where there is none."""
        limit = 1 << BITS[self.dimension]
        known = np.all((points >= 0) & (points < limit), axis=1)
        inside = points if known.all() else np.where(known[:, None], points, 0)
        at = np.searchsorted(self.code, morton(inside), side="right") - 1
        place = np.maximum(at, 0)
        offset = inside - self.lower[place]
        held = known & (at >= 0) & np.all((offset >= 0) & (offset < self.size[place, None]), axis=1)
        return np.where(held, at, -1)

    def split(self, chosen: Flags, step: int, cause: NDArray[np.float64]) -> Leaves:
        """Return the leaves with the chosen ones replaced by their children.

        `cause` gives, per leaf, what is noted with its children.
        """
        d = self.dimension
        corners = np.array(list(product((0, 1), repeat=d)), dtype=np.int64)
        half = self.size[chosen] // 2
        lower = self.lower[chosen][:, None] + corners * half[:, None, None]
        many = len(corners)
        stay = ~chosen
        return Leaves.of(
            np.concatenate([self.lower[stay], lower.reshape(-1, d)]),
            np.concatenate([self.size[stay], np.repeat(half, many)]),
            np.concatenate([self.kind[stay], np.repeat(self.kind[chosen], many)]),
            np.concatenate([self.step[stay], np.full(many * len(half), step)]),
            np.concatenate([self.cause[stay], np.repeat(cause[chosen], many)]),
        )

    def merged(self) -> Leaves:
        """Return the leaves with every complete family of one kind replaced by its parent."""
        d, many = self.dimension, 1 << self.dimension
        # In the order of the codes a family stands together, its first child at its corner.
        first = np.arange(len(self) - many + 1)
        last = first + many - 1
        parent = 2 * self.size[first]
        whole = np.all(self.lower[first] % parent[:, None] == 0, axis=1)
        whole &= self.code[last] - self.code[first] == (many - 1) * self.size[first] ** d
        for child in range(1, many):
            whole &= self.size[first + child] == self.size[first]
            whole &= self.kind[first + child] == self.kind[first]
        start = np.flatnonzero(whole)
        gone = (start[:, None] + np.arange(many)).ravel()
        stay = np.ones(len(self), dtype=np.bool_)
        stay[gone] = False
        stay[start] = True
        size = self.size.copy()
        size[start] *= 2
        return Leaves.of(
            self.lower[stay], size[stay], self.kind[stay], self.step[stay], self.cause[stay]
        )

    def balanced(self, step: int) -> Leaves:
        """Return leaves of which no two neighbours differ by more than a factor of two.

        Where two materials meet at a face, the leaves on both sides are of one size: small
        faces on a stiff large leaf would be held by its soft neighbours only.
        """
        leaves = self
        directions = np.array([s for s in product((-1, 0, 1), repeat=self.dimension) if any(s)])
        young = np.ones(len(leaves), dtype=np.bool_)
        while young.any():
            chosen = np.zeros(len(leaves), dtype=np.bool_)
            code, crowded = leaves.code[young], np.zeros(np.count_nonzero(young), dtype=np.bool_)
            size, lower, kind = leaves.size[young], leaves.lower[young], leaves.kind[young]
            for way in directions:
                beside = leaves.find(lower + way * size[:, None])
                ratio = leaves.size[beside] // size
                other = (leaves.kind[beside] != kind) & (np.abs(way).sum() == 1)
                unfit = (beside >= 0) & ((ratio > 2) | ((ratio > 1) & other))
                chosen[beside[unfit]] = True
                crowded |= unfit
            if not chosen.any():
                break
            fresh = leaves.code[chosen]
            ends = fresh + leaves.size[chosen] ** self.dimension
            leaves = leaves.split(chosen, step, np.full(len(leaves), np.nan))
            at = np.searchsorted(fresh, leaves.code, side="right") - 1
            young = (at >= 0) & (leaves.code < ends[np.maximum(at, 0)])
            # Those beside a leaf that was much too large look once more.
            young |= np.isin(leaves.code, code[crowded])
        return leaves
