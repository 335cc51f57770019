"""Where the numbers of the tangent stand: worked out once, used in every increment.

The tangent is made of blocks: one for every node, and one for every pair of nodes that a
spring joins, which stands at two mirrored places. Only the blocks change; which of their
numbers goes where in the sparse matrix does not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from .springs import Floats, SpringNetwork

Numbers = NDArray[np.int64]


class Pattern(NamedTuple):
    """The tangent of a network but for its numbers."""

    indices: NDArray[np.int32]
    """Rows of the entries, column by column."""
    pointer: NDArray[np.int32]
    """Where each column starts."""
    source: NDArray[np.intp]
    """For every entry, which number of the blocks it is."""
    pair: Numbers
    """For every spring, the pair of nodes it joins."""
    nodes: int
    pairs: int

    def fill(self, network: SpringNetwork, blocks: Floats) -> csc_array:
        """Return the tangent whose springs have the blocks (m, dimension, dimension)."""
        dimension = network.dimension
        summed = np.empty((dimension, dimension, self.nodes + self.pairs))
        for a in range(dimension):
            for b in range(a, dimension):
                values = np.ascontiguousarray(blocks[:, a, b])
                summed[a, b, : self.nodes] = np.bincount(
                    network.springs[:, 0], values, self.nodes
                ) + np.bincount(network.springs[:, 1], values, self.nodes)
                summed[a, b, self.nodes :] = -np.bincount(self.pair, values, self.pairs)
                summed[b, a] = summed[a, b]
        data = summed.ravel()[self.source]
        size = len(self.pointer) - 1
        return csc_array((data, self.indices, self.pointer), shape=(size, size))


def tangent_pattern(network: SpringNetwork, order: Numbers) -> Pattern:
    """Work out the pattern for nodes eliminated in an order (n,)."""
    nodes, dimension = network.positions.shape
    rank = np.empty(nodes, dtype=np.int64)
    rank[order] = np.arange(nodes)
    low, high, pair = _pairs(rank[network.springs], nodes)
    # Blocks in the matrix by row and column, and the block in the storage each one is.
    row = np.concatenate([np.arange(nodes), low, high])
    column = np.concatenate([np.arange(nodes), high, low])
    block = np.concatenate([order, *(2 * [nodes + np.arange(len(low))])])
    sort = np.argsort(column * nodes + row)
    row, column, block = row[sort], column[sort], block[sort]

    free = ~network.held[order]
    number = (np.cumsum(free) - 1).reshape(free.shape)  # of every free coordinate
    place_in_node = np.cumsum(free, axis=1) - 1
    height = free.sum(axis=1)  # rows that a node's blocks have
    above = np.cumsum(height[row]) - height[row]  # entries above a block in its column
    above -= above[np.searchsorted(column, column)]
    column_height = np.bincount(column, height[row], nodes).astype(np.int64)
    pointer = np.concatenate([[0], np.cumsum(np.repeat(column_height, height))])

    indices = np.empty(pointer[-1], dtype=np.int32)
    source = np.empty(pointer[-1], dtype=np.intp)
    for a in range(dimension):
        for b in range(dimension):
            kept = np.flatnonzero(free[row, a] & free[column, b])
            i, j = row[kept], column[kept]
            place = pointer[number[j, b]] + above[kept] + place_in_node[i, a]
            indices[place] = number[i, a]
            source[place] = (a * dimension + b) * (nodes + len(low)) + block[kept]
    return Pattern(indices, pointer.astype(np.int32), source, pair, nodes, len(low))


def _pairs(ends: Numbers, nodes: int) -> tuple[Numbers, Numbers, Numbers]:
    """Lower and higher end of every pair that is joined, and the pair of every spring."""
    low, high = np.minimum(*ends.T), np.maximum(*ends.T)
    joined, pair = np.unique(low * nodes + high, return_inverse=True)
    return joined // nodes, joined % nodes, pair
