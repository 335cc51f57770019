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
from numpy.typing import NDArray

from kaju.model.elastic.moduli import REENTRANT_WEIGHT
from kaju.model.elastic.staggered import Pair
from kaju.model.scene.kinds import AIR, DISPLACED, RIGID

from . import face_kernels
from .leaves import Flags, Index
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
    leaves, tree = grid.leaves, (grid.leaves.code, grid.leaves.lower, grid.leaves.size)
    point, reach, around, far, of_leaf = face_kernels.edges(*tree, grid.beside, *pair)
    kinds = _kinds_around(grid, point, pair, around)
    modulus = edge_modulus(kinds, grid.ground.moduli.shear)
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


def _kinds_around(grid: Composite, point: Index, pair: Pair, around: Index) -> Index:
    kinds = np.where(around >= 0, grid.leaves.kind[around], AIR)
    for row, ends in enumerate(product((-1, 0), repeat=2)):
        bare = np.flatnonzero(around[row] < 0)
        cell = point[bare]
        cell[:, pair] += ends
        kinds[row, bare] = grid.ground.kinds_at(cell)
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
    far: Index,
    kinds: Index,
    stiff: Flags,
) -> tuple[Gradient, Floats]:
    """Return ∂u_a/∂b and the distance between its two ends.

    `quads` are the leaves (a-, b-), (a-, b+), (a+, b-), (a+, b+) of the edge, `far` those of its
    second half.
    """
    count = len(point)
    index, weight, offset, present = face_kernels.sides_of_edges(
        quads, far, grid.leaves.size, grid.length, a, 2 * grid.dimension
    )
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
        outside = grid.outside(_toward(point[bare], b, end), 2 * b + end)
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


def _toward(point: Index, axis: int, end: int) -> Index:
    moved = point.copy()
    moved[:, axis] += end - 1
    return moved


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
