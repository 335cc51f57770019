"""The composite staggered grid: faces and edges of leaves of several sizes.

As on equal cells the unknowns are the normal displacements of faces. Where a large leaf meets small
ones (hanging faces), the small ones' faces are the unknowns, and the displacement of the large
leaf's side is their mean. The shear strain of an edge takes the normal displacements on its four
sides, each from the smaller of the leaves there (or from the middle of a leaf that reaches round
the edge), over the distances between them. All this is exact for linear displacements: rigid
motions have no strain, and the stiffness matrix is symmetric with forces in balance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints, moved
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.equal.problem import ACTIVE, FIXED
from kaju.model.elastic.equal.staggered import Pair, axis_pairs, modulus_between
from kaju.model.elastic.moduli import Moduli, moduli_at
from kaju.model.elastic.pair.leaves import LeafCells, morton
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene.cell_types import AIR, DISPLACED, FOUNDATION, RIGID, ROLLER


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


class CompositeGrid:
    """Faces, edges and strains of leaves; lengths in the scene's cells."""

    length: Floats  # Edge of each leaf. Shape (leaves,)
    beside: Ints  # Neighbour on each side, -1 for none. Shape (leaves, 2·dimension)
    # The leaf's own face on each side, -1 where it has hanging faces. Shape as `beside`
    master: Ints
    # Leaves and sides with hanging faces, and the small neighbours, in the order of `corner_ends`
    hanging: tuple[Ints, Ints, Ints]
    mean: sp.csr_array  # Displacement of the leaves' sides. Shape (leaves · 2·dimension, faces)
    axis: Ints  # Normal of every face. Shape (faces,)
    place: Floats  # Middle (units). Shape (faces, dimension)
    area: Floats
    state: NDArray[np.int8]  # ACTIVE or FIXED
    value: Floats  # The displacement given
    spring: Floats  # The foundation's stiffness
    support: Ints  # Side of the array that holds it (2·dimension: rigid cells inside; -1: none)
    edges: dict[Pair, Edges]

    def __init__(self, ground: PosedBody, leaves: LeafCells) -> None:
        self.ground, self.leaves = ground, leaves
        self.dimension = leaves.dimension
        self.length = leaves.size / ground.cell
        self._lay_faces()
        self._hold_faces()
        self.edges = {pair: lay_edges(self, pair) for pair in axis_pairs(self.dimension)}

    @cached_property
    def slopes(self) -> tuple[sp.csr_array, dict[Pair, int]]:
        """The rows of `mean`, then of every pair's two gradients; where each pair starts."""
        blocks, start, end = [self.mean], {}, self.mean.shape[0]
        for pair, edges in self.edges.items():
            start[pair] = end
            blocks += [gradient.matrix for gradient in edges.gradients]
            end += 2 * len(edges.modulus)
        return sp.csr_array(sp.vstack(blocks, format="csr")), start

    @cached_property
    def law(self) -> Moduli:
        """The moduli of every leaf."""
        return moduli_at(self.ground.moduli, self.leaves.kind)

    @property
    def upper(self) -> Ints:
        """Whether a face is at the upper (1) or lower (0) side of its owner."""
        return np.asarray(self._side % 2)

    @property
    def size(self) -> int:
        """Number of faces."""
        return len(self.axis)

    def _lay_faces(self) -> None:
        leaves, d = self.leaves, self.dimension
        # Beside small leaves the first of them is found.
        beside = [leaves.find(self._past(side)) for side in range(2 * d)]
        self.beside = np.stack(beside, axis=1)
        self._number_faces()
        self.mean = self._mean_of_faces()
        self.axis = self._side // 2
        self.area = self.length[self.owner] ** (d - 1)
        self.place = leaves.lower[self.owner] + 0.5 * leaves.size[self.owner, None]
        outward = np.where(self._side % 2, 0.5, -0.5)
        self.place[np.arange(self.size), self.axis] += outward * leaves.size[self.owner]

    def _number_faces(self) -> None:
        """Give every face a number, leaf by leaf."""
        # The smaller of two leaves owns the face between them, of equal ones the lower.
        other, size = self.beside, self.leaves.size
        there = other >= 0
        alike, upper = there & (size[other] == size[:, None]), np.arange(other.shape[1]) % 2 == 1
        own = ~((there & (size[other] < size[:, None])) | (alike & ~upper))
        self.owner, self._side = np.nonzero(own)
        self.master = np.full(own.shape, -1)
        self.master[own] = np.arange(len(self.owner))
        leaf, side = np.nonzero(alike & upper)
        self.master[other[leaf, side], side - 1] = self.master[leaf, side]

    def _mean_of_faces(self) -> sp.csr_array:
        """Return sides' displacements by those of faces: the own one, or a mean of hanging ones."""
        self.hanging = self._smaller_beside()
        _, side, fine = self.hanging
        # One entry in the row of a side with an own face, `many` in that of one with hanging faces.
        whole, many = self.master.ravel() >= 0, fine.shape[1]
        start = np.append(0, np.cumsum(np.where(whole, 1, many)))
        face, weight = np.empty(start[-1], dtype=np.int64), np.ones(start[-1])
        face[start[:-1][whole]] = self.master.ravel()[whole]
        at = start[:-1][~whole, None] + np.arange(many)
        face[at], weight[at] = self.master[fine, side[:, None] ^ 1], 1.0 / many
        shape = (len(whole), len(self.owner))
        return sp.csr_array((weight, face.astype(np.int32), start.astype(np.int32)), shape=shape)

    def _smaller_beside(self) -> tuple[Ints, Ints, Ints]:
        """Return leaves and sides with hanging faces, and the small neighbours as `corner_ends`."""
        leaf, side = np.nonzero(self.master < 0)
        d, each, size = self.dimension, np.arange(len(leaf)), self.leaves.size[leaf]
        lower = self.leaves.lower[leaf]
        # The unit cells beyond the side that its 2^(d-1) parts begin with.
        lower[each, side // 2] += np.where(side % 2, size, -1)
        across = np.array([[k for k in range(d) if k != axis] for axis in range(d)])[side // 2]
        fine = np.empty((len(leaf), 1 << (d - 1)), dtype=np.int64)
        for part, end in enumerate(corner_ends(d - 1)):
            point = lower.copy()
            np.add.at(point, (each[:, None], across), end * (size // 2)[:, None])
            fine[:, part] = self.leaves.find(point)
        return leaf, side, fine

    def _past(self, side: int) -> Ints:
        """Return the unit cell beyond the lower corner of a side of every leaf."""
        axis, upper = divmod(side, 2)
        return moved(self.leaves.lower, axis, self.leaves.size if upper else -1)

    @cached_property
    def kinds(self) -> Ints:
        """Cell type beyond every side, a material or a boundary. Shape as `beside`."""
        found = self.leaves.kind[self.beside].astype(np.int64)
        for side, beside in enumerate(self.beside.T):
            bare = np.flatnonzero(beside < 0)
            found[bare, side] = self.ground.kinds_at(self._past(side)[bare])
        return found

    @cached_property
    def outer(self) -> Flags:
        """Which sides are those of the array. Shape as `beside`."""
        met = [self.leaves.lower == 0, self.leaves.upper >= self.ground.extent]
        return np.stack(met, axis=2).reshape(self.beside.shape)

    def _hold_faces(self) -> None:
        own, sides = (self.owner, self._side), range(2 * self.dimension)
        kind = np.where(self.beside[own] < 0, self.kinds[own], AIR)
        held, founded = np.isin(kind, (RIGID, DISPLACED, ROLLER)), kind == FOUNDATION
        self.state = np.where(held, FIXED, ACTIVE).astype(np.int8)
        given = np.array([self.ground.given(side)[side // 2] for side in sides])
        self.value = np.where(np.isin(kind, (DISPLACED, ROLLER)), given[self._side], 0.0)
        stiffness = np.array([self.ground.foundation(side) for side in sides])
        self.spring = np.where(founded, stiffness[self._side] * self.area, 0.0)
        support = np.where(self.outer[own], self._side, len(sides))
        self.support = np.where(held | founded, support, -1)

    def outside(self, point: Ints, side: int) -> Flags:
        """Tell which unit cells lie beyond a side of the array."""
        axis, upper = divmod(side, 2)
        end = self.ground.extent[axis]
        return np.asarray(point[:, axis] >= end if upper else point[:, axis] < 0)


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
    # Returns the lower end of every edge, its length, the leaves round its first and second half
    # ((a-, b-), (a-, b+), (a+, b-), (a+, b+); -1 for none), and every leaf's edges by its ends
    # along a and b.
    (n, d), size = leaves.lower.shape, leaves.size
    # Of four equal leaves round an edge only the last one lays it.
    before, below = beside[:, 2 * a], beside[:, 2 * b]
    others = np.stack([np.where(before >= 0, beside[before, 2 * b], -1), before, below])
    last = np.flatnonzero(np.all((others >= 0) & (size[others] == size), axis=0))
    others = others[:, last]
    laid: Flags = np.ones((n, 4), dtype=np.bool_)
    corners = np.array([3, 2, 1])
    laid[others, corners[:, None]] = False
    leaf, end = np.nonzero(laid)
    upper, right = end >> 1, end & 1
    point = leaves.lower[leaf]
    point[:, a] += upper * size[leaf]
    point[:, b] += right * size[leaf]
    code, first, number = np.unique(morton(point), return_index=True, return_inverse=True)
    leaf, end, point, upper, right = (x[first] for x in (leaf, end, point, upper, right))
    east, north = beside[leaf, 2 * a + upper], beside[leaf, 2 * b + right]
    across = np.where(east >= 0, beside[east, 2 * b + right], -1)
    round_it = np.stack([leaf, east, north, across])
    plain = np.all((round_it >= 0) & (size[round_it] == size[leaf]), axis=0)
    around = np.empty((4, len(leaf)), dtype=np.int64)
    # From an edge at its upper end a leaf is on the lower side: its quadrant is 3 - end.
    for ahead, other in zip((3, 1, 2, 0), round_it, strict=True):
        around[end ^ ahead, np.arange(len(leaf))] = other
    irregular = np.flatnonzero(~plain)
    around[:, irregular] = _look_round(leaves, point[irregular], a, b)
    far, reach = around, size[leaf]
    sizes = np.where(around[:, irregular] >= 0, size[around[:, irregular]], 0)
    reach[irregular] = sizes.max(axis=0)
    if d == 3:
        along, several = 3 - a - b, np.zeros(len(leaf), dtype=np.bool_)
        # The second half of an edge may have smaller leaves round it, or some where there was none.
        several[irregular] = sizes.min(axis=0) < reach[irregular]
        # An edge that begins in the middle of a longer one is part of that.
        offset = point[:, along] % reach
        part = np.flatnonzero(offset)
        point[part, along] -= offset[part]
        code[part] = morton(point[part])
        _, first, longer = np.unique(code, return_index=True, return_inverse=True)
        point, reach, around, number = point[first], reach[first], around[:, first], longer[number]
        part, halved = np.flatnonzero(offset[first]), np.flatnonzero(several[first])
        around[:, part] = _look_round(leaves, point[part], a, b)
        middle, far = point[halved], around.copy()
        middle[:, along] += reach[halved] // 2
        far[:, halved] = _look_round(leaves, middle, a, b)
    of_leaf = np.empty((n, 4), dtype=np.int64)
    of_leaf[laid] = number
    of_leaf[others, corners[:, None]] = of_leaf[last, 0]
    return point, reach, around, far, of_leaf.reshape(n, 2, 2)


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
    """Return the terms of u_a on both sides of edges along b."""
    # These are rows of `mean` with their weights, the distance of both sides, and whether there is
    # a leaf on each: the smaller of two, or one that reaches round the edge, whose middle has the
    # mean displacement of its two sides.
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
    """Correct the edges where one leaf of four is larger."""
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
