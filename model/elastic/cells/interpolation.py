"""The displacement between the faces: linear in every leaf."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.cells.composite_grid import CompositeGrid, Edges, Gradient, sum_rows


def interpolation(
    grid: CompositeGrid, points: Floats, leaf: Ints, axis: int
) -> tuple[sp.csr_array, Floats]:
    """Return u_axis at points (units), each in or on a leaf, as ``matrix @ u + constant``."""
    # Along its axis the displacement is linear between the leaf's two sides, across it linear with
    # the gradient at the nearest edge that has one (on a free surface: at the opposite edge).
    leaves = grid.leaves
    local = (points - leaves.lower[leaf]) / leaves.size[leaf, None]
    along = (1.0 - local[:, axis], local[:, axis])
    rows, start = grid.slopes
    side = leaf * 2 * grid.dimension + 2 * axis
    index, weight = [side, side + 1], [*along]
    constant = np.zeros(len(leaf))
    for (a, b), edges in grid.edges.items():
        if axis not in (a, b):
            continue
        across, count = a + b - axis, len(edges.modulus)
        gradients, table = oriented(edges, axis == a)
        # In `rows` the gradients of a pair follow one another, ∂u_a/∂b first.
        offsets = (0, count) if axis == a else (count, 0)
        distance = (local[:, across] - 0.5) * grid.length[leaf]
        apart = np.flatnonzero(distance)
        near = (distance[apart] > 0).astype(np.int64)
        around, shear = table[leaf[apart]], grid.ground.moduli.shear[leaves.kind[leaf[apart]]]
        for end in (0, 1):
            edge = nearest_defined(gradients, around, end, near)
            slopes = slope_weights(edges, gradients, edge, shear)
            for gradient, offset, slope in zip(gradients, offsets, slopes, strict=True):
                share = along[end][apart] * distance[apart] * slope
                index.append(np.zeros_like(leaf))
                weight.append(np.zeros(len(leaf)))
                index[-1][apart], weight[-1][apart] = start[a, b] + offset + edge, share
                constant[apart] += share * gradient.constant[edge]
    return sum_rows(rows, np.stack(index, axis=1), np.stack(weight, axis=1)), constant


def oriented(edges: Edges, first: bool) -> tuple[tuple[Gradient, Gradient], Ints]:
    """Return ∂u_a/∂b and ∂u_b/∂a, and the edges of leaves by end along a, then b."""
    # (a, b) is the pair of the edges if `first`, else its reverse.
    if first:
        return edges.gradients, edges.of_leaf
    return edges.gradients[::-1], edges.of_leaf.swapaxes(1, 2)


def slope_weights(
    edges: Edges, gradients: tuple[Gradient, Gradient], edge: Ints, shear: Floats
) -> tuple[Floats, Floats]:
    """Return how a leaf's own ∂u_a/∂b at an edge follows from ∂u_a/∂b and ∂u_b/∂a there."""
    # Where the material changes along b the shear stress τ is continuous, the slope is not:
    # ∂u_a/∂b = τ/μ - ∂u_b/∂a with the leaf's own μ. On a free surface τ is zero.
    own, other = gradients
    valid = own.valid[edge]
    first = np.where(valid, own.one_sided[edge], 0.0)
    second = np.where(other.valid[edge] & ~valid, -1.0, 0.0)
    at = np.flatnonzero(own.jump[edge] & (edges.modulus[edge] > 0))
    if len(at):
        ratio = edges.modulus[edge[at]] / shear[at]
        # Where it changes along both axes, only the strain follows from τ; the rotation is kept.
        crossed = other.jump[edge[at]]
        first[at] = np.where(crossed, 0.5 * ratio + 0.5, ratio)
        second[at] = np.where(crossed, 0.5 * ratio - 0.5, ratio - 1.0)
    return first, second


def defined_slopes(gradients: tuple[Gradient, Gradient], edge: Ints) -> Flags:
    """Tell at which edges the leaves' slopes are defined: the material changes once at most."""
    own, other = gradients
    defined = own.valid[edge] | other.valid[edge]
    return np.asarray(defined & ~(own.jump[edge] & other.jump[edge]))


def nearest_defined(
    gradients: tuple[Gradient, Gradient], table: Ints, end: int, near: Ints
) -> Ints:
    """Return the nearest edge with a slope, first that at `end` and on the `near` side."""
    edge = table[np.arange(len(near)), end, near]
    missing = np.flatnonzero(~defined_slopes(gradients, edge))
    for other_end, flip in ((0, 1), (1, 0), (1, 1)):
        candidate = table[missing, end ^ other_end, near[missing] ^ flip]
        found = defined_slopes(gradients, candidate)
        edge[missing[found]] = candidate[found]
        missing = missing[~found]
    return np.asarray(edge)


def prolongation(coarse: CompositeGrid, fine: CompositeGrid) -> sp.csr_array:
    """Return the matrix that prolongs displacements from coarse faces to fine ones."""
    # Every leaf of `fine` lies in one of `coarse`, the last whose Morton code is not greater.
    parents = np.searchsorted(coarse.leaves.code, fine.leaves.code, side="right") - 1
    order, blocks = [], []
    for axis in range(fine.dimension):
        here = np.flatnonzero(fine.axis == axis)
        blocks.append(interpolation(coarse, fine.place[here], parents[fine.owner[here]], axis)[0])
        order.append(here)
    stacked = sp.vstack(blocks, format="csr")
    return sp.csr_array(stacked[np.argsort(np.concatenate(order), kind="stable")])
