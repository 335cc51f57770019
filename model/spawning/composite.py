"""The faces of leaves of several sizes.

Unknown is, as on equal cells, the normal displacement of every face. Where a large leaf
meets small ones, the small ones' faces are the unknowns and the large leaf's side moves by
their mean. The edges between the faces are laid in `edges`. All this is exact for
displacements that vary linearly, so shifts and turns of the whole body strain nothing, and
the energy's gradient is a symmetric matrix whose forces balance.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.model.elasticity.problem import ACTIVE, FIXED
from kaju.model.elasticity.staggered import Pair, axis_pairs
from kaju.model.scene.kinds import DISPLACED, FOUNDATION, RIGID, ROLLER

from .edges import Edges, lay_edges
from .ground import Ground
from .leaves import Flags, Index, Leaves

Floats = NDArray[np.float64]


class Composite:
    """Faces, edges and strains of leaves; lengths in the scene's cells.

    Attributes
    ----------
    ground : Ground
    leaves : Leaves
    length : array, shape (leaves,)
        Edge of each leaf.
    beside : int array, shape (leaves, 2·dimension)
        A leaf on each side, -1 for none.
    master : int array, shape (leaves, 2·dimension)
        The leaf's own face on each side, -1 where smaller ones take its place.
    mean : sparse array, shape (leaves · 2·dimension, faces)
        Displacement of the leaves' sides.
    axis, place, area : arrays, shape (faces,), (faces, dimension) and (faces,)
        Normal, middle (units) and area of every face.
    state, value, spring, support : arrays, shape (faces,)
        ACTIVE or FIXED, the displacement given, the foundation's stiffness, and the side of
        the array that holds the face (2·dimension: rigid cells inside; -1: none).
    edges : dict from pair of axes to Edges
    """

    def __init__(self, ground: Ground, leaves: Leaves) -> None:
        self.ground, self.leaves = ground, leaves
        self.dimension = leaves.dimension
        self.length = leaves.size / ground.cell
        self._lay_faces()
        self._hold_faces()
        self.edges: dict[Pair, Edges] = {
            pair: lay_edges(self, pair) for pair in axis_pairs(self.dimension)
        }

    @property
    def size(self) -> int:
        """Number of faces."""
        return len(self.axis)

    def _lay_faces(self) -> None:
        leaves, d = self.leaves, self.dimension
        n = len(leaves)
        self.beside = np.stack([leaves.find(self._past(side)) for side in range(2 * d)], axis=1)
        there = self.beside >= 0
        other = np.where(there, leaves.size[self.beside], np.iinfo(np.int64).max)
        own_size = leaves.size[:, None]
        upper = np.arange(2 * d) % 2 == 1
        own = (other > own_size) | ((other == own_size) & upper)
        self.master = np.full((n, 2 * d), -1, dtype=np.int64)
        side, leaf = np.nonzero(own.T)
        self.master[leaf, side] = np.arange(len(leaf))
        shared_leaf, shared_side = np.nonzero((other == own_size) & ~upper)
        opposite = self.beside[shared_leaf, shared_side]
        self.master[shared_leaf, shared_side] = self.master[opposite, shared_side + 1]
        self.axis, self.owner, self._side = side // 2, leaf, side
        self.area = self.length[leaf] ** (d - 1)
        self.place = leaves.lower[leaf] + 0.5 * leaves.size[leaf, None]
        outward = np.where(side % 2, 0.5, -0.5)
        self.place[np.arange(len(leaf)), self.axis] += outward * leaves.size[leaf]
        self.mean = self._means(other < own_size)

    def _past(self, side: int) -> Index:
        """Return the unit cell beyond the lower corner of a side of every leaf."""
        axis, upper = divmod(side, 2)
        point = self.leaves.lower.copy()
        point[:, axis] += self.leaves.size if upper else -1
        return point

    def beyond(self, side: int, leaf: Index) -> Index:
        """Return unit cells beyond a side of leaves."""
        return self._past(side)[leaf]

    def _means(self, divided: Flags) -> sp.csr_array:
        d = self.dimension
        row, column, weight = [], [], []
        leaf, side = np.nonzero(self.master >= 0)
        row.append(leaf * 2 * d + side)
        column.append(self.master[leaf, side])
        weight.append(np.ones(len(leaf)))
        for side_index in range(2 * d):
            coarse = np.flatnonzero(divided[:, side_index])
            point = self._past(side_index)[coarse]
            half = self.leaves.size[coarse, None] // 2
            along = [a for a in range(d) if a != side_index // 2]
            for steps in product((0, 1), repeat=d - 1):
                shift = np.zeros(d, dtype=np.int64)
                shift[along] = steps
                fine = self.leaves.find(point + half * shift)
                row.append(coarse * 2 * d + side_index)
                column.append(self.master[fine, side_index ^ 1])
                weight.append(np.full(len(coarse), 0.5 ** (d - 1)))
        shape = (len(self.leaves) * 2 * d, self.size)
        return sp.csr_array(
            (np.concatenate(weight), (np.concatenate(row), np.concatenate(column))), shape=shape
        )

    def _hold_faces(self) -> None:
        d = self.dimension
        self.state = np.full(self.size, ACTIVE, dtype=np.int8)
        self.value, self.spring = np.zeros(self.size), np.zeros(self.size)
        self.support = np.full(self.size, -1, dtype=np.int64)
        for side in range(2 * d):
            bare = np.flatnonzero((self._side == side) & (self.beside[self.owner, side] < 0))
            point = self._past(side)[self.owner[bare]]
            kind = self.ground.kinds_at(point)
            outside = self.outside(point, side)
            held = np.isin(kind, (RIGID, DISPLACED, ROLLER))
            self.state[bare[held]] = FIXED
            self.value[bare[kind == DISPLACED]] = self.ground.given(side)[side // 2]
            bed = bare[kind == FOUNDATION]
            self.spring[bed] = self.ground.bed(side) * self.area[bed]
            some = held | (kind == FOUNDATION)
            self.support[bare[some]] = np.where(outside[some], side, 2 * d)

    def outside(self, point: Index, side: int) -> Flags:
        """Tell which unit cells lie beyond a side of the array."""
        axis, upper = divmod(side, 2)
        end = self.ground.scene.lattice.shape[axis] * self.ground.cell
        return np.asarray(point[:, axis] >= end if upper else point[:, axis] < 0)
