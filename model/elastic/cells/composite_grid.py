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

from kaju.arrays import Flags, Floats, Ints, moved
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.cells.cell_edges import Edges, lay_edges
from kaju.model.elastic.cells.leaf_cells import LeafCells
from kaju.model.elastic.moduli import Moduli, moduli_at
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.problem import ACTIVE, FIXED
from kaju.model.elastic.staggered import Pair, axis_pairs
from kaju.model.scene.cell_types import AIR, DISPLACED, FOUNDATION, RIGID, ROLLER


class CompositeGrid:
    """Faces, edges and strains of leaves; lengths in the scene's cells."""

    length: Floats  # Edge of each leaf. Shape (leaves,)
    beside: Ints  # A leaf on each side, -1 for none. Shape (leaves, 2·dimension)
    # The leaf's own face on each side, -1 where smaller ones take its place. Shape as `beside`
    master: Ints
    # Leaves and sides with smaller ones before them, and these, in the order of `corner_ends`
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
        self.hanging = self._smaller_beside()
        _, side, fine = self.hanging
        whole, many = self.master.ravel() >= 0, fine.shape[1]
        start = np.append(0, np.cumsum(np.where(whole, 1, many)))
        face, weight = np.empty(start[-1], dtype=np.int64), np.ones(start[-1])
        face[start[:-1][whole]] = self.master.ravel()[whole]
        at = start[:-1][~whole, None] + np.arange(many)
        face[at], weight[at] = self.master[fine, side[:, None] ^ 1], 1.0 / many
        shape = (len(whole), len(self.owner))
        return sp.csr_array((weight, face.astype(np.int32), start.astype(np.int32)), shape=shape)

    def _smaller_beside(self) -> tuple[Ints, Ints, Ints]:
        """Return leaves with smaller ones before a side, the side, and these as `corner_ends`."""
        leaf, side = np.nonzero(self.master < 0)
        d, each, size = self.dimension, np.arange(len(leaf)), self.leaves.size[leaf]
        lower = self.leaves.lower[leaf]
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
        """What lies beyond every side: a material, or what is there instead. Shape as `beside`."""
        found = self.leaves.kind[self.beside].astype(np.int64)
        for side, beside in enumerate(self.beside.T):
            bare = np.flatnonzero(beside < 0)
            found[bare, side] = self.ground.kinds_at(self._past(side)[bare])
        return found

    @cached_property
    def outer(self) -> Flags:
        """Which sides are those of the array. Shape as `beside`."""
        ends = np.asarray(self.ground.scene.lattice.shape) * self.ground.cell
        met = [self.leaves.lower == 0, self.leaves.upper >= ends]
        return np.stack(met, axis=2).reshape(self.beside.shape)

    def _hold_faces(self) -> None:
        own, sides = (self.owner, self._side), range(2 * self.dimension)
        kind = np.where(self.beside[own] < 0, self.kinds[own], AIR)
        held, bedded = np.isin(kind, (RIGID, DISPLACED, ROLLER)), kind == FOUNDATION
        self.state = np.where(held, FIXED, ACTIVE).astype(np.int8)
        given = np.array([self.ground.given(side)[side // 2] for side in sides])
        self.value = np.where(np.isin(kind, (DISPLACED, ROLLER)), given[self._side], 0.0)
        bed = np.array([self.ground.bed(side) for side in sides])
        self.spring = np.where(bedded, bed[self._side] * self.area, 0.0)
        support = np.where(self.outer[own], self._side, len(sides))
        self.support = np.where(held | bedded, support, -1)

    def outside(self, point: Ints, side: int) -> Flags:
        """Tell which unit cells lie beyond a side of the array."""
        axis, upper = divmod(side, 2)
        end = self.ground.scene.lattice.shape[axis] * self.ground.cell
        return np.asarray(point[:, axis] >= end if upper else point[:, axis] < 0)
