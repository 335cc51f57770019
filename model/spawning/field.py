"""The displacement between the faces: linear in every leaf."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .composite import Composite, Floats
from .edges import Edges, Gradient
from .leaves import Flags, Index


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
        gradients, table = oriented(edges, axis == a)
        distance = (local[:, across] - 0.5) * grid.length[leaf]
        near = (distance > 0).astype(np.int64)
        shear = grid.ground.moduli.shear[leaves.kind[leaf]]
        for end in (0, 1):
            edge = _nearest_known(gradients, table[leaf], end, near)
            slopes = slope_weights(edges, gradients, edge, shear)
            for gradient, weight in zip(gradients, slopes, strict=True):
                weight = along[end] * distance * weight
                total = total + _pick(rows, edge, weight, len(gradient.valid)) @ gradient.matrix
                constant += weight * gradient.constant[edge]
    return sp.csr_array(total), constant


def oriented(edges: Edges, first: bool) -> tuple[tuple[Gradient, Gradient], Index]:
    """Return ∂u_a/∂b and ∂u_b/∂a, and the edges of leaves by end along a, then b.

    (a, b) is the pair of the edges, or the pair reversed unless `first`.
    """
    if first:
        return edges.gradients, edges.of_leaf
    return edges.gradients[::-1], edges.of_leaf.swapaxes(1, 2)


def slope_weights(
    edges: Edges, gradients: tuple[Gradient, Gradient], edge: Index, shear: Floats
) -> tuple[Floats, Floats]:
    """Return how a leaf's own ∂u_a/∂b at an edge follows from ∂u_a/∂b and ∂u_b/∂a there.

    Where the material changes along b the stress τ is common to both sides, and not the
    slope: ∂u_a/∂b = τ/μ - ∂u_b/∂a with the leaf's own μ. On a free surface τ is zero.
    """
    own, other = gradients
    ratio = edges.modulus[edge] / shear
    jump = own.jump[edge] & (ratio > 0)
    crossed = jump & other.jump[edge]
    known, surface = own.valid[edge], other.valid[edge] & ~own.valid[edge]
    first = np.where(jump, ratio, np.where(known, own.one_sided[edge], 0.0))
    second = np.where(jump, ratio - 1.0, np.where(surface, -1.0, 0.0))
    # Where it changes along both axes, strain and turn are told apart instead.
    first = np.where(crossed, 0.5 * ratio + 0.5, first)
    return first, np.where(crossed, 0.5 * ratio - 0.5, second)


def known_slopes(gradients: tuple[Gradient, Gradient]) -> Flags:
    """Tell at which edges the leaves' slopes are known: not where the material changes twice."""
    own, other = gradients
    return np.asarray((own.valid | other.valid) & ~(own.jump & other.jump))


def _nearest_known(
    gradients: tuple[Gradient, Gradient], table: Index, end: int, near: Index
) -> Index:
    """Return the nearest edge with a slope: at this end and on the near side, if it has one."""
    known = known_slopes(gradients)
    rows = np.arange(len(near))
    edge = table[rows, end, near]
    for other_end, flip in ((0, 1), (1, 0), (1, 1)):
        candidate = table[rows, end ^ other_end, near ^ flip]
        edge = np.where(~known[edge] & known[candidate], candidate, edge)
    return np.asarray(edge)


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
