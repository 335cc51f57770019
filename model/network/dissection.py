"""In which order to eliminate the nodes, so that the factors stay sparse.

Nested dissection by position: the nodes are cut in two halves across their longest side,
again and again; the nodes along the cut are eliminated after both halves. For a lattice in
the plane the factors then hold O(n log n) numbers.

References
----------
A. George, "Nested dissection of a regular finite element mesh", SIAM Journal on Numerical
Analysis 10 (1973) 345-363.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SMALL = 24
"""Parts up to this size are not cut further: the factorisation treats them as one block."""


def elimination_order(
    positions: NDArray[np.float64], springs: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the node numbers in the order in which to eliminate them, shape (n,)."""
    nodes = len(positions)
    part = np.ones(nodes, dtype=np.int64)  # node of a binary tree: children 2p and 2p + 1
    open_ = np.ones(nodes, dtype=bool)  # not yet on a cut, in a part that is still large
    for _ in range(60):
        members = np.flatnonzero(open_)
        _, group, size = np.unique(part[members], return_inverse=True, return_counts=True)
        open_[members[size[group] <= _SMALL]] = False
        large = size[group] > _SMALL
        if not large.any():
            break
        members, (_, group) = members[large], np.unique(group[large], return_inverse=True)
        upper = _upper_half(positions[members], group)
        parent = part.copy()
        part[members] = 2 * part[members] + upper
        cut = _lower_ends_of_cut_springs(springs, parent, part, open_)
        part[cut] = parent[cut]
        open_[cut] = False
    return _children_first(part)


def _upper_half(positions: NDArray[np.float64], group: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell for every node whether it lies in the upper half of its group's longest side."""
    order = np.argsort(group, kind="stable")
    start = np.flatnonzero(np.diff(group[order], prepend=-1))
    size = np.diff(start, append=len(group))
    extent = np.maximum.reduceat(positions[order], start) - np.minimum.reduceat(
        positions[order], start
    )
    coordinate = positions[np.arange(len(group)), np.argmax(extent, axis=1)[group]]
    ranked = np.lexsort((coordinate, group))
    upper = np.empty(len(group), dtype=bool)
    upper[ranked] = np.arange(len(group)) - np.repeat(start, size) >= np.repeat(size // 2, size)
    return upper


def _lower_ends_of_cut_springs(
    springs: NDArray[np.int64],
    parent: NDArray[np.int64],
    part: NDArray[np.int64],
    open_: NDArray[np.bool_],
) -> NDArray[np.int64]:
    first, second = springs[:, 0], springs[:, 1]
    crossing = open_[first] & open_[second]
    crossing &= (parent[first] == parent[second]) & (part[first] != part[second])
    first, second = first[crossing], second[crossing]
    return np.unique(np.where(part[first] < part[second], first, second))


def _children_first(part: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sort nodes so that every part comes after the two parts it was cut into."""
    depth = np.floor(np.log2(part)).astype(np.int64)
    right_end = (part + 1 - (1 << depth)) / 2.0**depth  # of the part's share of the unit line
    return np.lexsort((np.arange(len(part)), -depth, right_end))
