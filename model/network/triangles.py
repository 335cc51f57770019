"""Triangles of springs, and which of them a load has turned inside out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .springs import Floats, SpringNetwork, Springs


def triangles(springs: Springs) -> NDArray[np.int64]:
    """Return every three nodes of which each is joined to both others, shape (t, 3)."""
    joined = np.unique(np.sort(springs, axis=1), axis=0)  # by lower end, then by higher
    nodes = int(joined.max()) + 1
    low, high = joined.T
    # Two springs with the same lower end make a triangle if their higher ends are joined.
    following = np.searchsorted(low, low, side="right") - np.arange(len(low)) - 1
    first = np.repeat(np.arange(len(low)), following)
    start = np.cumsum(following) - following
    second = first + 1 + np.arange(len(first)) - np.repeat(start, following)
    key = low * nodes + high
    wanted = high[first] * nodes + high[second]
    found = key[np.minimum(np.searchsorted(key, wanted), len(key) - 1)] == wanted
    corners: NDArray[np.int64]
    corners = np.stack([low[first], high[first], high[second]], axis=1)[found]
    return corners


def turned_over(network: SpringNetwork, displacement: Floats) -> NDArray[np.int64]:
    """Return the triangles of a plane network that lie the other way round, shape (k, 3).

    There a node has passed through the spring between two others, as no piece of matter
    could. In space a triangle has no sense, and none is returned.
    """
    if network.dimension != 2:
        return np.empty((0, 3), dtype=np.int64)
    corners = triangles(network.springs)
    before = _areas(network.positions, corners)
    after = _areas(network.positions + displacement, corners)
    return corners[before * after < 0.0]


def _areas(positions: Floats, corners: NDArray[np.int64]) -> Floats:
    """Twice the area of each triangle (m²), positive if it runs counter-clockwise."""
    (ax, ay), (bx, by) = ((positions[corners[:, k]] - positions[corners[:, 0]]).T for k in (1, 2))
    areas: Floats = ax * by - ay * bx
    return areas
