"""The faces of leaves of several sizes.

Unknown is, as on equal cells, the normal displacement of every face. Where a large leaf
meets small ones, the small ones' faces are the unknowns and the large leaf's side moves by
their mean. The edges between the faces are laid in `edges`. All this is exact for
displacements that vary linearly, so shifts and turns of the whole body strain nothing, and
the energy's gradient is a symmetric matrix whose forces balance.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.problem import ACTIVE, FIXED
from kaju.model.elastic.staggered import Pair, axis_pairs
from kaju.model.scene.kinds import DISPLACED, FOUNDATION, RIGID, ROLLER

from .edges import Edges, lay_edges
from .ground import Ground
from .leaves import Leaves


class Composite:
    """Faces, edges and strains of leaves; lengths in the scene's cells."""

    length: Floats  # Edge of each leaf. Shape (leaves,)
    beside: Ints  # A leaf on each side, -1 for none. Shape (leaves, 2·dimension)
    # The leaf's own face on each side, -1 where smaller ones take its place. Shape as `beside`
    master: Ints
    mean: sp.csr_array  # Displacement of the leaves' sides. Shape (leaves · 2·dimension, faces)
    axis: Ints  # Normal of every face. Shape (faces,)
    place: Floats  # Middle (units). Shape (faces, dimension)
    area: Floats
    state: NDArray[np.int8]  # ACTIVE or FIXED
    value: Floats  # The displacement given
    spring: Floats  # The foundation's stiffness
    support: Ints  # Side of the array that holds it (2·dimension: rigid cells inside; -1: none)
    edges: dict[Pair, Edges]

    def __init__(self, ground: Ground, leaves: Leaves) -> None:
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
        """Give faces their numbers leaf by leaf: the smaller leaf has one, of two the lower."""
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
        """Return the sides' displacements by those of faces, smaller ones counting alike."""
        d, many = self.dimension, 1 << (self.dimension - 1)
        whole = self.master.ravel() >= 0
        start = np.append(0, np.cumsum(np.where(whole, 1, many)))
        face, weight = np.empty(start[-1], dtype=np.int64), np.ones(start[-1])
        face[start[:-1][whole]] = self.master.ravel()[whole]
        leaf, side = np.nonzero(self.master < 0)
        at = start[:-1][~whole]
        for part in range(many):
            point = self.leaves.lower[leaf]
            for axis in range(d):
                # The digits of a part tell in which halves it lies along the other axes.
                digit = part >> (axis - (axis > side // 2)).astype(np.int64) & 1
                step = np.where(side % 2, self.leaves.size[leaf], -1)
                half = digit * self.leaves.size[leaf] // 2
                point[:, axis] += np.where(side // 2 == axis, step, half)
            face[at + part] = self.master[self.leaves.find(point), side ^ 1]
            weight[at + part] = 1.0 / many
        shape = (len(whole), len(self.owner))
        return sp.csr_array((weight, face.astype(np.int32), start.astype(np.int32)), shape=shape)

    def _past(self, side: int) -> Ints:
        """Return the unit cell beyond the lower corner of a side of every leaf."""
        axis, upper = divmod(side, 2)
        point = self.leaves.lower.copy()
        point[:, axis] += self.leaves.size if upper else -1
        return point

    def beyond(self, side: int, leaf: Ints) -> Ints:
        """Return unit cells beyond a side of leaves."""
        return self._past(side)[leaf]

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
            moved = np.isin(kind, (DISPLACED, ROLLER))
            self.value[bare[moved]] = self.ground.given(side)[side // 2]
            bed = bare[kind == FOUNDATION]
            self.spring[bed] = self.ground.bed(side) * self.area[bed]
            some = held | (kind == FOUNDATION)
            self.support[bare[some]] = np.where(outside[some], side, 2 * d)

    def outside(self, point: Ints, side: int) -> Flags:
        """Tell which unit cells lie beyond a side of the array."""
        axis, upper = divmod(side, 2)
        end = self.ground.scene.lattice.shape[axis] * self.ground.cell
        return np.asarray(point[:, axis] >= end if upper else point[:, axis] < 0)
