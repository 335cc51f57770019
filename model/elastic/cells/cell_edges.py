"""The edges between the faces of leaves of several sizes, and the shear strain they carry.

An edge has a shear strain like any other edge of the staggered grid: the normal
displacements on its four sides, each taken from the smaller of the leaves there (or from
the middle of a leaf that reaches round the edge), over the distances between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints, moved
from kaju.model.elastic.cells.leaf_cells import LeafCells, morton
from kaju.model.elastic.staggered import Pair, modulus_between
from kaju.model.scene.cell_types import AIR, DISPLACED

if TYPE_CHECKING:
    from kaju.model.elastic.cells.composite_grid import CompositeGrid


@dataclass(frozen=True, eq=False)
class Gradient:
    """∂u_a/∂b at the edges of a pair of axes: ``matrix @ u + constant``."""

    matrix: sp.csr_array  # Shape (edges, faces)
    constant: Floats  # From displaced walls. Shape (edges,)
    valid: Flags  # Whether there is a face, or a wall, on both sides. Shape (edges,)
    one_sided: Floats
    """1; 2 at a wall, where the face is only half the distance away. Shape (edges,)."""
    wall: Ints
    """Side of the array on which the wall lies, 2·dimension inside, -1 without a wall. Shape
    (edges,)."""
    pull: Floats  # Derivative by the wall's displacement. Shape (edges,)
    jump: Flags
    """Whether the material changes along b, so that ∂u_a/∂b differs on both sides. Shape
    (edges,)."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges along one axis (in two dimensions: the corners), between a pair of axes."""

    gradients: tuple[Gradient, Gradient]  # ∂u_a/∂b and ∂u_b/∂a for the pair (a, b)
    modulus: Floats  # Shear modulus, zero at free surfaces. Shape (edges,)
    weight: Floats  # Volume that each edge stands for. Shape (edges,)
    of_leaf: Ints
    """Edge at the lower or upper end of a leaf along a and along b. Shape (leaves, 2, 2)."""


def lay_edges(grid: CompositeGrid, pair: Pair) -> Edges:
    """Return the edges between a pair of axes; `grid` has its faces laid."""
    leaves = grid.leaves
    point, reach, around, far, of_leaf = _ends_of_leaves(leaves, grid.beside, *pair)
    kinds = np.where(around >= 0, leaves.kind[around], AIR)
    for row, ends in enumerate(product((-1, 0), repeat=2)):
        bare = np.flatnonzero(around[row] < 0)
        cell = point[bare]
        cell[:, pair] += ends
        kinds[row, bare] = grid.ground.kinds_at(cell)
    modulus = modulus_between(kinds, grid.ground.moduli.shear)
    grads, spans = [], []
    for a, b in (pair, pair[::-1]):
        turn = [0, 1, 2, 3] if a == pair[0] else [0, 2, 1, 3]
        gradient, span = _gradient(
            grid, a, b, point, around[turn], far[turn], kinds[turn], modulus > 0
        )
        grads.append(gradient)
        spans.append(span)
    weight = spans[0] * spans[1]
    if grid.dimension == 3:
        weight *= reach / grid.ground.cell
    edges = Edges((grads[0], grads[1]), modulus, weight, of_leaf)
    size = np.where(around >= 0, leaves.size[around], 0)
    return _with_concave_corners(edges, around, np.where(kinds == kinds[0], size, 0))


def _ends_of_leaves(
    leaves: LeafCells, beside: Ints, a: int, b: int
) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Lay the edges between axes a < b, each as long as the largest leaf round it."""
    # Returns where every edge begins, its length, the leaves round there, and round its second half
    # ((a-, b-), (a-, b+), (a+, b-), (a+, b+); -1 for none), and the edges at the ends of leaves
    # along a and b.
    n, d = leaves.lower.shape
    leaf, end = np.repeat(np.arange(n), 4), np.tile(np.arange(4), n)
    upper, right = end >> 1, end & 1
    point = leaves.lower[leaf]
    point[:, a] += upper * leaves.size[leaf]
    point[:, b] += right * leaves.size[leaf]
    _, first, number = np.unique(morton(point), return_index=True, return_inverse=True)
    leaf, end, point, upper, right = (x[first] for x in (leaf, end, point, upper, right))
    east, north = beside[leaf, 2 * a + upper], beside[leaf, 2 * b + right]
    across = np.where(east >= 0, beside[east, 2 * b + right], -1)
    round_it = np.stack([leaf, east, north, across])
    plain = np.all((round_it >= 0) & (leaves.size[round_it] == leaves.size[leaf]), axis=0)
    around = np.empty((4, len(leaf)), dtype=np.int64)
    # A leaf has an edge at its upper end if it lies before it.
    for ahead, other in zip((3, 1, 2, 0), round_it, strict=True):
        around[end ^ ahead, np.arange(len(leaf))] = other
    odd = np.flatnonzero(~plain)
    around[:, odd] = _look_round(leaves, point[odd], a, b)
    far, reach = around, leaves.size[leaf]
    reach[odd] = np.where(around[:, odd] >= 0, leaves.size[around[:, odd]], 0).max(axis=0)
    if d == 3:
        along, far = 3 - a - b, around.copy()
        point[odd, along] -= point[odd, along] % reach[odd]
        around[:, odd] = _look_round(leaves, point[odd], a, b)
        middle = point[odd]
        middle[:, along] += reach[odd] // 2
        far[:, odd] = _look_round(leaves, middle, a, b)
        # Ends in the middle of a longer edge are ends of that.
        _, first, longer = np.unique(morton(point), return_index=True, return_inverse=True)
        point, reach, around, far = point[first], reach[first], around[:, first], far[:, first]
        number = longer[number]
    return point, reach, around, far, number.reshape(n, 2, 2)


def _look_round(leaves: LeafCells, point: Ints, a: int, b: int) -> Ints:
    """Return the leaves in the four quadrants round points."""
    found = []
    for first, second in product((-1, 0), repeat=2):
        found.append(leaves.find(moved(moved(point, a, first), b, second)))
    return np.stack(found)


def _gradient(
    grid: CompositeGrid,
    a: int,
    b: int,
    point: Ints,
    quads: Ints,
    far: Ints,
    kinds: Ints,
    stiff: Flags,
) -> tuple[Gradient, Floats]:
    """Return ∂u_a/∂b and the distance between its two ends."""
    # `quads` are the leaves (a-, b-), (a-, b+), (a+, b-), (a+, b+) of the edge, `far` those of its
    # second half.
    count = len(point)
    index, weight, offset, present = _sides_of_edges(grid, quads, far, a)
    # A wall lies as far beyond the edge as the face that it holds lies before it.
    both = present.all(axis=0)
    span = np.where(both, 1.0, 2.0) * offset
    span = np.where(span > 0, span, 1.0)
    constant, pull = np.zeros(count), np.zeros(count)
    wall = np.full(count, -1, dtype=np.int64)
    for end in (0, 1):
        sign = 2.0 * end - 1.0
        bare = np.flatnonzero(~present[end] & stiff & present[1 - end])
        pull[bare] = sign / span[bare]
        beyond = point[bare]
        beyond[:, b] += end - 1
        outside = grid.outside(beyond, 2 * b + end)
        wall[bare] = np.where(outside, 2 * b + end, 2 * grid.dimension)
        moved = outside & np.any(kinds[[end, 2 + end]][:, bare] == DISPLACED, axis=0)
        constant[bare[moved]] += pull[bare[moved]] * grid.ground.given(2 * b + end)[a]
    matrix = sum_rows(grid.mean, index, weight / span[:, None])
    one_sided = np.where(both, 1.0, 2.0)
    # Leaves that touch only at their corners have no slope between them.
    joined = ((quads[0] >= 0) & (quads[1] >= 0)) | ((quads[2] >= 0) & (quads[3] >= 0))
    body = np.all(kinds >= 0, axis=0)
    jump = body & ((kinds[0] != kinds[1]) | (kinds[2] != kinds[3]))
    valid = (both & joined) | (wall >= 0)
    return Gradient(matrix, constant, valid, one_sided, wall, pull, jump), span


def _sides_of_edges(
    grid: CompositeGrid, quads: Ints, far: Ints, a: int
) -> tuple[Ints, Floats, Floats, Flags]:
    """Return what u_a is before and behind edges, along b."""
    # These are the sides of leaves whose displacements count and their weights, the distance
    # between both, and whether there is any: that of the smaller leaf, or of the middle of one that
    # reaches round the edge, which moves by the mean of its two sides.
    size, count = grid.leaves.size, quads.shape[1]
    index, weight = np.zeros((count, 4), dtype=np.int64), np.zeros((count, 4))
    offset, present = np.zeros(count), (quads[:2] >= 0) | (quads[2:] >= 0)
    for end in (0, 1):
        low, high, there = quads[end], quads[2 + end], present[end]
        take_low = (low >= 0) & ((high < 0) | (size[low] <= size[high]))
        chosen = np.where(take_low, low, high)
        next_to = np.where(take_low, far[end], far[2 + end])
        first = (chosen * grid.dimension + a) * 2 + take_low
        second = np.where(next_to >= 0, (next_to * grid.dimension + a) * 2 + take_low, first)
        inside, single = low == high, first == second
        second = np.where(inside, first - take_low + 1, second)
        first, single = np.where(inside, first - take_low, first), single & ~inside
        half = np.where(there, 0.5 if end else -0.5, 0.0)
        index[:, 2 * end : 2 * end + 2] = np.where(there, [first, second], 0).T
        weight[:, 2 * end] = np.where(single, 2.0 * half, half)
        weight[:, 2 * end + 1] = np.where(single, 0.0, half)
        offset += np.where(there, 0.5 * grid.length[chosen], 0.0)
    return index, weight, offset, present


def _with_concave_corners(edges: Edges, around: Ints, size: Ints) -> Edges:
    """Put right the edges where one leaf of four is larger."""
    # The middle of a large leaf stands in for its sides at the edges that hang on it. Where it is
    # met by small leaves on two adjacent sides, both sides do so, and a quarter of a small leaf's
    # area is counted twice, at the corner between them. The corner's weight is less by that
    # quarter, and its gradients are those of the remaining area, (g - ¼ Σ g_hanging) / (1 - ¼ m)
    # for m large leaves: constant stresses then balance.
    large = (size > size.min(axis=0)) & (size.min(axis=0) > 0)
    count = large.sum(axis=0)
    diagonal = (large[0] & large[3]) | (large[1] & large[2])
    concave = (count == 1) | ((count == 2) & diagonal)
    if not concave.any():
        return edges
    some = np.flatnonzero(concave)
    large, rest = large[:, some], 1.0 - 0.25 * count[some]
    order, share = np.arange(len(count)), np.ones(len(count))
    order[some], share[some] = len(count) + np.arange(len(some)), rest
    changed = []
    for number, gradient in enumerate(edges.gradients):
        index = np.tile(some[:, None], (1, 5))
        weight = np.zeros(index.shape)
        weight[:, 4] = 1.0 / rest
        for quadrant in range(4):
            first, second = divmod(quadrant, 2)
            at = np.flatnonzero(large[quadrant])
            beside = (1 - first, second) if number == 0 else (first, 1 - second)
            small = around[2 * beside[0] + beside[1], some[at]]
            index[at, quadrant] = edges.of_leaf[small, first, second]
            weight[at, quadrant] = -0.25 / rest[at]
        constant = gradient.constant.copy()
        constant[some] = (weight * gradient.constant[index]).sum(axis=1)
        right = sum_rows(gradient.matrix, index, weight)
        matrix = sp.csr_array(sp.vstack([gradient.matrix, right], format="csr")[order])
        changed.append(replace(gradient, matrix=matrix, constant=constant))
    return replace(edges, gradients=(changed[0], changed[1]), weight=edges.weight * share)


def sum_rows(matrix: sp.csr_array, index: Ints, weight: Floats) -> sp.csr_array:
    """Return a matrix of weighted sums of rows of another: `index`, shape (n, terms)."""
    # An index may be any number where its weight is zero.
    some = weight != 0.0
    start = np.append(0, np.cumsum(some.sum(axis=1))).astype(np.int32)
    shape = (len(index), matrix.shape[0])
    rows = sp.csr_array((weight[some], index[some].astype(np.int32), start), shape=shape)
    return sp.csr_array(rows @ matrix)
