"""The edges between the faces of leaves of several sizes, and the shear strain they carry.

An edge has a shear strain like any other edge of the staggered grid: the normal
displacements on its four sides, each taken from the smaller of the leaves there (or from
the middle of a leaf that reaches round the edge), over the distances between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.model.elastic.moduli import REENTRANT_WEIGHT
from kaju.model.elastic.staggered import Pair
from kaju.model.scene.kinds import AIR, DISPLACED, RIGID

from . import tree_kernels
from .leaves import Flags, Index, morton
from .rows import sum_rows

if TYPE_CHECKING:
    from .composite import Composite

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gradient:
    """∂u_a/∂b at the edges of a pair of axes: ``matrix @ u + constant``.

    Attributes
    ----------
    matrix : sparse array, shape (edges, faces)
    constant : array, shape (edges,)
        From displaced walls.
    valid : bool array, shape (edges,)
        Whether there is a face, or a wall, on both sides.
    one_sided : array, shape (edges,)
        1; 2 at a wall, where the face is only half the distance away.
    wall : int array, shape (edges,)
        Side of the array on which the wall lies, 2·dimension inside, -1 without a wall.
    pull : array, shape (edges,)
        Derivative by the wall's displacement.
    jump : bool array, shape (edges,)
        Whether the material changes along b, so that ∂u_a/∂b differs on both sides.
    """

    matrix: sp.csr_array
    constant: Floats
    valid: Flags
    one_sided: Floats
    wall: Index
    pull: Floats
    jump: Flags


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges along one axis (in two dimensions: the corners), between a pair of axes.

    Attributes
    ----------
    gradients : pair of Gradient
        ∂u_a/∂b and ∂u_b/∂a for the pair (a, b).
    modulus : array, shape (edges,)
        Shear modulus, zero at free surfaces.
    weight : array, shape (edges,)
        Volume that each edge stands for.
    of_leaf : int array, shape (leaves, 2, 2)
        Edge at the lower or upper end of a leaf along a and along b.
    """

    gradients: tuple[Gradient, Gradient]
    modulus: Floats
    weight: Floats
    of_leaf: Index


def lay_edges(grid: Composite, pair: Pair) -> Edges:
    """Return the edges between a pair of axes; `grid` has its faces laid."""
    leaves, n = grid.leaves, len(grid.leaves)
    corner = [_corner(grid, pair, ends) for ends in product((0, 1), repeat=2)]
    point = np.concatenate(corner)
    along = [a for a in range(grid.dimension) if a not in pair]
    if along:
        around = np.stack([leaves.find(q) for q in _quadrants(point, pair)])
        reach = np.where(around >= 0, leaves.size[around], 0).max(axis=0)
        point[:, along[0]] -= point[:, along[0]] % reach
    first, inverse = tree_kernels.number(morton(point))
    point = point[first]
    reach = reach[first] if along else np.full(len(point), grid.ground.cell)
    around = _leaves_around(grid, point, pair, inverse)
    kinds = _kinds_around(grid, point, pair, around)
    modulus = edge_modulus(kinds, grid.ground.moduli.shear)
    grads, spans = [], []
    far = _second_half(grid, point, pair, reach)
    for a, b in (pair, pair[::-1]):
        turn = [0, 1, 2, 3] if a == pair[0] else [0, 2, 1, 3]
        quads, kind = around[turn], kinds[turn]
        beyond = None if far is None else far[turn]
        gradient, span = _gradient(grid, a, b, point, quads, beyond, kind, modulus > 0)
        grads.append(gradient)
        spans.append(span)
    weight = spans[0] * spans[1] * reach / grid.ground.cell
    of_leaf = np.ascontiguousarray(np.moveaxis(inverse.reshape(2, 2, n), 2, 0))
    edges = Edges((grads[0], grads[1]), modulus, weight, of_leaf)
    size = np.where(around >= 0, leaves.size[around], 0)
    return _with_concave_corners(edges, around, np.where(kinds == kinds[0], size, 0))


def _corner(grid: Composite, pair: Pair, ends: tuple[int, ...]) -> Index:
    point = grid.leaves.lower.copy()
    for axis, end in zip(pair, ends, strict=True):
        point[:, axis] += end * grid.leaves.size
    return point


def _leaves_around(grid: Composite, point: Index, pair: Pair, edge: Index) -> Index:
    """Return the leaves round the beginning of every edge, -1 for none."""
    leaves, n = grid.leaves, len(grid.leaves)
    around = np.full((4, len(point)), -1)
    along = [a for a in range(grid.dimension) if a not in pair]
    for quadrant in range(4):
        # The leaf before an edge has it at its upper end.
        of_leaf = edge[(3 - quadrant) * n : (4 - quadrant) * n]
        here = np.arange(n)
        if along:
            offset = point[of_leaf, along[0]] - leaves.lower[:, along[0]]
            here = np.flatnonzero((offset >= 0) & (offset < leaves.size))
        around[quadrant, of_leaf[here]] = here
    for row, cells in zip(around, _quadrants(point, pair), strict=True):
        rest = np.flatnonzero(row < 0)
        row[rest] = leaves.find(cells[rest])
    return around


def _second_half(grid: Composite, point: Index, pair: Pair, reach: Index) -> Index | None:
    """Return the leaves round the second half of every edge, where small ones change."""
    if grid.dimension == 2:
        return None
    middle = point.copy()
    middle[:, 3 - pair[0] - pair[1]] += reach // 2
    return np.stack([grid.leaves.find(q) for q in _quadrants(middle, pair)])


def _kinds_around(grid: Composite, point: Index, pair: Pair, around: Index) -> Index:
    kinds = np.where(around >= 0, grid.leaves.kind[around], AIR)
    for row, quadrant in enumerate(_quadrants(point, pair)):
        bare = around[row] < 0
        kinds[row, bare] = grid.ground.kinds_at(quadrant[bare])
    return kinds


def edge_modulus(kinds: Index, shear: Floats) -> Floats:
    """Return the shear modulus of edges by the kinds of the four cells round them.

    It is the harmonic mean of theirs; see `staggered.edge_modulus`.

    Parameters
    ----------
    kinds : int array, shape (4, ...)
    shear : array, shape (materials,)
    """
    rigid = (kinds == RIGID) | (kinds == DISPLACED)
    body = kinds >= 0
    compliance = np.where(body, 1.0 / shear[np.maximum(kinds, 0)], 0.0)
    total = compliance.sum(axis=0)
    count = (body | rigid).sum(axis=0)
    corner = (body.sum(axis=0) == 3) & ((kinds == AIR).sum(axis=0) == 1)
    safe = np.where(total > 0, total, 1.0)
    modulus = np.where((count == 4) & (total > 0), 4.0 / safe, 0.0)
    return np.where(corner, REENTRANT_WEIGHT * 3.0 / safe, modulus)


def _gradient(
    grid: Composite,
    a: int,
    b: int,
    point: Index,
    quads: Index,
    far: Index | None,
    kinds: Index,
    stiff: Flags,
) -> tuple[Gradient, Floats]:
    """Return ∂u_a/∂b and the distance between its two ends.

    `quads` are the leaves (a-, b-), (a-, b+), (a+, b-), (a+, b+) of the edge.
    """
    count = len(point)
    halves = [None if far is None else far[[end, 2 + end]] for end in (0, 1)]
    sides = [_sample(grid, a, quads[[end, 2 + end]], halves[end]) for end in (0, 1)]
    offset = np.stack([side.offset for side in sides])
    # A wall lies as far beyond the edge as the face that it holds lies before it.
    both = sides[0].present & sides[1].present
    span = np.where(both, 1.0, 2.0) * offset.sum(axis=0)
    span = np.where(span > 0, span, 1.0)
    constant, pull = np.zeros(count), np.zeros(count)
    wall = np.full(count, -1, dtype=np.int64)
    for end in (0, 1):
        sign = 2.0 * end - 1.0
        bare = np.flatnonzero(~sides[end].present & stiff & sides[1 - end].present)
        pull[bare] = sign / span[bare]
        outside = grid.outside(_toward(point[bare], b, end), 2 * b + end)
        wall[bare] = np.where(outside, 2 * b + end, 2 * grid.dimension)
        moved = outside & np.any(kinds[[end, 2 + end]][:, bare] == DISPLACED, axis=0)
        constant[bare[moved]] += pull[bare[moved]] * grid.ground.given(2 * b + end)[a]
    index = np.concatenate([sample.side for sample in sides], axis=1)
    weight = np.concatenate([-sides[0].weight, sides[1].weight], axis=1) / span[:, None]
    matrix = sum_rows(grid.mean, index, weight)
    one_sided = np.where(both, 1.0, 2.0)
    # Leaves that touch only at their corners have no slope between them.
    joined = ((quads[0] >= 0) & (quads[1] >= 0)) | ((quads[2] >= 0) & (quads[3] >= 0))
    body = np.all(kinds >= 0, axis=0)
    jump = body & ((kinds[0] != kinds[1]) | (kinds[2] != kinds[3]))
    valid = (both & joined) | (wall >= 0)
    return Gradient(matrix, constant, valid, one_sided, wall, pull, jump), span


def _toward(point: Index, axis: int, end: int) -> Index:
    moved = point.copy()
    moved[:, axis] += end - 1
    return moved


class Sample(NamedTuple):
    """u_a on one side of edges: whether there is any, how far off, and sides to add up."""

    present: Flags
    offset: Floats
    side: Index
    weight: Floats


def _sample(grid: Composite, a: int, quads: Index, far: Index | None) -> Sample:
    low, high = quads
    size = grid.leaves.size
    same = (low >= 0) & (low == high)
    take_low = (low >= 0) & ((high < 0) | (size[low] <= size[high]))
    chosen = np.where(take_low, low, high)
    present = chosen >= 0
    d2 = 2 * grid.dimension
    side = 2 * a + take_low
    # The middle of a leaf that reaches round the edge moves by the mean of its two sides.
    first = np.where(same, low * d2 + 2 * a, chosen * d2 + side)
    second = np.where(same, low * d2 + 2 * a + 1, first)
    if far is not None:
        second = np.where(same, second, np.where(take_low, far[0], far[1]) * d2 + side)
    halved = same | (far is not None)
    weight = np.stack([np.where(halved, 0.5, 1.0), np.where(halved, 0.5, 0.0)], axis=1)
    offset = np.where(present, 0.5 * grid.length[chosen], 0.0)
    return Sample(present, offset, np.stack([first, second], axis=1), weight * present[:, None])


def _with_concave_corners(edges: Edges, around: Index, size: Index) -> Edges:
    """Put right the edges where one leaf of four is larger.

    The middle of a large leaf stands in for its sides at the edges that hang on it. Where it
    is met by small leaves on two adjacent sides, both sides do so, and a quarter of a small
    leaf's area is counted twice, at the corner between them. The corner's weight is less by
    that quarter, and its gradients are those of the remaining area,
    (g - ¼ Σ g_hanging) / (1 - ¼ m) for m large leaves: constant stresses then balance.
    """
    large = (size > size.min(axis=0)) & (size.min(axis=0) > 0)
    count = large.sum(axis=0)
    diagonal = (large[0] & large[3]) | (large[1] & large[2])
    concave = (count == 1) | ((count == 2) & diagonal)
    if not concave.any():
        return edges
    large &= concave
    rest = 1.0 - 0.25 * np.where(concave, count, 0)
    changed = []
    for number, gradient in enumerate(edges.gradients):
        index = np.tile(np.arange(len(rest))[:, None], (1, 5))
        weight = np.zeros(index.shape)
        weight[:, 4] = 1.0 / rest
        for quadrant in range(4):
            first, second = divmod(quadrant, 2)
            at = np.flatnonzero(large[quadrant])
            beside = (1 - first, second) if number == 0 else (first, 1 - second)
            small = around[2 * beside[0] + beside[1], at]
            index[at, quadrant] = edges.of_leaf[small, first, second]
            weight[at, quadrant] = -0.25 / rest[at]
        constant = (weight * gradient.constant[index]).sum(axis=1)
        matrix = sum_rows(gradient.matrix, index, weight)
        changed.append(replace(gradient, matrix=matrix, constant=constant))
    return replace(edges, gradients=(changed[0], changed[1]), weight=edges.weight * rest)


def _quadrants(point: Index, pair: Pair) -> list[Index]:
    """Return the unit cells round edges: (a-, b-), (a-, b+), (a+, b-), (a+, b+)."""
    around = []
    for ends in product((-1, 0), repeat=2):
        quadrant = point.copy()
        for axis, end in zip(pair, ends, strict=True):
            quadrant[:, axis] += end
        around.append(quadrant)
    return around
