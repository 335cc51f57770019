"""The displacement between the faces: linear in every leaf."""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .composite import Composite, Edges, Floats, Gradient
from .leaves import Index


def interpolation(
    grid: Composite, points: Floats, leaf: Index, axis: int
) -> tuple[sp.csr_array, Floats]:
    """Return u_axis at points as ``matrix @ u + constant``.

    Along its axis the displacement runs linearly between the leaf's two sides, across it
    by the gradients at the edges that are nearest; where these lie on a free surface, by
    those opposite.

    Parameters
    ----------
    points : array, shape (n, dimension)
        Places (units).
    leaf : int array, shape (n,)
        Leaf that each point lies in or on.
    """
    d, leaves = grid.dimension, grid.leaves
    local = (points - leaves.lower[leaf]) / leaves.size[leaf, None]
    rows = np.arange(len(leaf))
    total = sp.csr_array((len(leaf), grid.size))
    constant = np.zeros(len(leaf))
    along = (1.0 - local[:, axis], local[:, axis])
    for end in (0, 1):
        pick = _pick(rows, leaf * 2 * d + 2 * axis + end, along[end], grid.mean.shape[0])
        total = total + pick @ grid.mean
    for (a, b), edges in grid.edges.items():
        if axis not in (a, b):
            continue
        across = a + b - axis
        gradient, table = oriented(edges, axis == a)
        distance = (local[:, across] - 0.5) * grid.length[leaf]
        near = (distance > 0).astype(np.int64)
        for end in (0, 1):
            edge, found = _nearest_valid(gradient, table[leaf], end, near)
            weight = np.where(found, along[end] * distance * gradient.one_sided[edge], 0.0)
            pick = _pick(rows, edge, weight, len(gradient.valid))
            total = total + pick @ gradient.matrix
            constant += weight * gradient.constant[edge]
    return sp.csr_array(total), constant


def oriented(edges: Edges, first: bool) -> tuple[Gradient, Index]:
    """Return ∂u_a/∂b of a pair, or the other, and the edges of leaves by end along a, then b."""
    if first:
        return edges.gradients[0], edges.of_leaf
    return edges.gradients[1], edges.of_leaf.swapaxes(1, 2)


def _nearest_valid(
    gradient: Gradient, table: Index, end: int, near: Index
) -> tuple[Index, NDArray[np.bool_]]:
    """Return the nearest edge with a gradient: at this end and the near side, if it has one."""
    rows = np.arange(len(near))
    edge = table[rows, end, near]
    found = gradient.valid[edge]
    for other_end, flip in list(product((0, 1), repeat=2))[1:]:
        candidate = table[rows, end ^ other_end, near ^ flip]
        better = ~found & gradient.valid[candidate]
        edge = np.where(better, candidate, edge)
        found |= better
    return edge, found


def _pick(rows: Index, columns: Index, weight: Floats, width: int) -> sp.csr_array:
    return sp.csr_array((weight, (rows, columns)), shape=(len(rows), width))


def prolongation(coarse: Composite, fine: Composite) -> sp.csr_array:
    """Return the displacement of the fine faces by that of the coarse ones.

    The leaves of `fine` are those of `coarse` or lie inside of them.
    """
    order, blocks = [], []
    for axis in range(fine.dimension):
        here = np.flatnonzero(fine.axis == axis)
        parent = coarse.leaves.find(fine.leaves.lower[fine.owner[here]])
        blocks.append(interpolation(coarse, fine.place[here], parent, axis)[0])
        order.append(here)
    stacked = sp.csr_array(sp.vstack(blocks, format="csr"))
    back = np.argsort(np.concatenate(order), kind="stable")
    return sp.csr_array(stacked[back])


def gradients(grid: Composite, u: Floats, a: int, b: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Return ∂u_a/∂b at the edges of the two axes, and where there is any.

    A free surface carries no shear: there ∂u_a/∂b is −∂u_b/∂a.
    """
    edges = grid.edges[min(a, b), max(a, b)]
    own, other = edges.gradients if a < b else edges.gradients[::-1]
    value = own.one_sided * (own.matrix @ u + own.constant)
    opposite = -(other.matrix @ u + other.constant)
    take = ~own.valid & other.valid
    return np.where(own.valid, value, np.where(take, opposite, 0.0)), own.valid | take
