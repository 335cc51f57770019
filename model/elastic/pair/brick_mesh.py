"""Nodes of bricks on an octree: where leaves of two sizes meet, the small ones follow the large.

The displacement is without gaps: a corner or an edge of a small leaf that lies on a side or an edge
of a large one takes what the large one's functions give there.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import rigid_motions
from kaju.model.elastic.free_motion import free_motion, unheld
from kaju.model.elastic.pair import bricks
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene.cell_types import DISPLACED, FOUNDATION, RIGID, ROLLER

TINY = 1e-14  # Weights of a node's master that are below this are rounding


class Holder(NamedTuple):
    """What holds nodes along an axis: a side of the array, or -1 for cells inside it."""

    number: int
    axis: int
    nodes: Flags  # Shape (nodes,)
    leaf: Ints  # leaf, side: the leaves' sides that are held
    side: Ints
    masters: Flags  # Which masters it holds


class BrickMesh:
    """Nodes of the leaves of an octree, what holds them, and the loads on them; scaled.

    `node` are the 20 nodes of every leaf; `ties` the matrix from masters to all nodes, which leaves
    masters as they are; `open` and `given` tell of every master's components whether they are free,
    and else what they are moved by, less `shift`, which is common to all.
    """

    def __init__(self, ground: PosedBody, leaves: LeafCells) -> None:
        self.ground, self.leaves = ground, leaves
        self.edge = leaves.size / ground.cell  # In the scene's cells
        corner = leaves.lower[:, None] + bricks.CORNERS * leaves.size[:, None, None]
        key = (corner[..., 0] << 42) | (corner[..., 1] << 21) | corner[..., 2]
        _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
        self.vertex = vertex.reshape(-1, 8)
        self.place = corner.reshape(-1, 3)[first]  # Of the vertices (units)
        vertices = len(first)
        a, b = self.vertex[:, bricks.EDGES[:, 0]], self.vertex[:, bricks.EDGES[:, 1]]
        pair, edge = np.unique(a * vertices + b, return_inverse=True)
        self.ends = np.stack(np.divmod(pair, vertices), axis=1)
        self.node = np.concatenate([self.vertex, vertices + edge.reshape(-1, 12)], axis=1)
        self.nodes = vertices + len(pair)
        self._tie()
        self._support()

    def _tie(self) -> None:
        """Find the nodes that follow others, and how."""
        vertices = len(self.place)
        owner = self._largest(self.place)
        off = (self.place - self.leaves.lower[owner]) % self.leaves.size[owner, None]
        hanging = np.flatnonzero(off.any(axis=1))
        self.hanging = hanging, owner[hanging]  # Vertices on leaves that do not have them
        weights = [self._values(self.place[hanging], owner[hanging])]
        masters = [self.node[owner[hanging]]]
        # A bulge follows where the edge is shorter than those of a leaf that it lies in or on.
        start, end = self.place[self.ends[:, 0]], self.place[self.ends[:, 1]]
        middle = (start + end) // 2
        length = (end - start).sum(axis=1)
        # The middle of the smallest edges is between two units: their own leaves are as small.
        owner = self._largest(np.where((length == 1)[:, None], start, middle))
        short = np.flatnonzero(self.leaves.size[owner] > length)
        own = owner[short]
        ends = self._values(start[short], own) + self._values(end[short], own)
        half = 0.5 * (start[short] + end[short])
        weights.append(self._values(half, own) - 0.5 * ends)
        masters.append(self.node[own])
        slaves = np.concatenate([hanging, vertices + short])
        self.free = np.ones(self.nodes, dtype=np.bool_)
        self.free[slaves] = False
        keep = np.flatnonzero(self.free)
        row = np.concatenate([keep, np.repeat(slaves, bricks.NODES)])
        column = np.concatenate([keep, np.concatenate(masters).ravel()])
        weight = np.concatenate([np.ones(len(keep)), np.concatenate(weights).ravel()])
        some = np.abs(weight) > TINY
        ties = sp.csr_array((weight[some], (row[some], column[some])), shape=(self.nodes,) * 2)
        # What a node follows may follow others in its turn.
        while True:
            further = ties @ ties
            if abs(further - ties).max() < TINY:
                break
            ties = further
        self.ties = sp.csr_array(ties[:, keep])

    def _largest(self, points: Ints) -> Ints:
        """Return the largest leaf that touches each point (units)."""
        best = np.full(len(points), -1, dtype=np.int64)
        size = np.zeros(len(points), dtype=np.int64)
        for offset in product((0, -1), repeat=3):
            at = self.leaves.find(points + np.array(offset, dtype=np.int64))
            larger = (at >= 0) & (self.leaves.size[at] > size)
            best[larger], size[larger] = at[larger], self.leaves.size[at[larger]]
        return best

    def _values(self, points: Floats | Ints, leaf: Ints) -> Floats:
        """Return the functions of leaves at points (units)."""
        inside = (points - self.leaves.lower[leaf]) / self.leaves.size[leaf, None]
        return bricks.values(np.asarray(inside, dtype=np.float64))

    @cached_property
    def beside(self) -> Ints:
        """A leaf beyond the middle of each side, -1 where there is none. Shape (leaves, 6)."""
        return np.stack([self.leaves.find(self._beyond(side)) for side in range(6)], axis=1)

    def _beyond(self, side: int) -> Ints:
        """Return the unit cells just beyond the middles of the leaves' sides."""
        leaves, (axis, end) = self.leaves, divmod(side, 2)
        unit = leaves.lower + leaves.size[:, None] // 2
        unit[:, axis] = leaves.lower[:, axis] + (leaves.size if end else -1)
        return np.asarray(unit)

    @cached_property
    def sides(self) -> tuple[Ints, Ints, Ints, Ints]:
        """Sides of leaves with no leaf beyond: leaf, side, what lies there, and the array's side.

        The last is -1 where it is a cell inside the array.
        """
        leaf, side = np.nonzero(self.beside < 0)
        unit = np.empty((len(leaf), 3), dtype=np.int64)
        for one in range(6):
            own = side == one
            unit[own] = self._beyond(one)[leaf[own]]
        place = unit[np.arange(len(leaf)), side // 2]
        outer = (place < 0) | (place >= self.ground.extent[side // 2])
        return leaf, side, self.ground.kinds_at(unit), np.where(outer, side, -1)

    def _support(self) -> None:
        """Find which components of nodes are held, what they are moved by, and the beds."""
        leaf, side, kind, outer = self.sides
        bed = kind == FOUNDATION
        stiffness = np.array([self.ground.foundation(number) for number in range(6)])
        self.bed = leaf[bed], side[bed], stiffness[outer[bed]]
        holding = np.isin(kind, (RIGID, DISPLACED, ROLLER))
        pairs = sorted(set(zip(outer[holding].tolist(), kind[holding].tolist(), strict=True)))
        self.shift = self._common_shift(pairs)
        self.holders: list[Holder] = []
        total = np.zeros((self.nodes, 3))
        count = np.zeros((self.nodes, 3), dtype=np.int64)
        least, most = np.full((self.nodes, 3), np.inf), np.full((self.nodes, 3), -np.inf)
        for number, found in pairs:
            some = (outer == number) & (kind == found)
            moved = np.zeros(3) if number < 0 else self.ground.given(number) - self.shift
            for axis in range(3):
                along = some if found != ROLLER else some & (side // 2 == axis)
                if not along.any():
                    continue
                nodes = self._nodes_on(leaf[along], side[along])
                free = np.zeros(int(self.free.sum()), dtype=np.bool_)
                self.holders.append(Holder(number, axis, nodes, leaf[along], side[along], free))
                count[nodes, axis] += 1
                total[nodes, axis] += moved[axis]
                least[nodes, axis] = np.minimum(least[nodes, axis], moved[axis])
                most[nodes, axis] = np.maximum(most[nodes, axis], moved[axis])
        corners = slice(0, len(self.place))
        self.torn = bool((least < most)[corners].any())  # Whether sides that meet are moved apart
        given = total / np.maximum(count, 1)
        given[len(self.place) :] = 0.0  # Bulges: sides are moved as a whole
        # A node that follows others is held if these are.
        pattern = sp.csr_array(self.ties.T)
        pattern.data = np.ones_like(pattern.data)
        for holder in self.holders:
            holder.masters[:] = pattern @ holder.nodes.astype(np.float64) > 0.0
        self.open = np.ones((int(self.free.sum()), 3), dtype=np.bool_)
        for holder in self.holders:
            self.open[holder.masters, holder.axis] = False
        self.given = np.where(self.open, 0.0, given[self.free])

    def _common_shift(self, pairs: list[tuple[int, int]]) -> Floats:
        """Return what moves all that holds the body along an axis: it strains nothing.

        Taken out, rounding of a large shift cannot drown a small strain.
        """
        shift, scene = np.zeros(3), self.ground.scene
        moved = [
            n >= 0 and scene.side_condition(n_name).displacement is not None
            for n, _ in pairs
            for n_name in [scene.lattice.sides[n]]
        ]
        for axis in range(3):
            along = [
                (number, is_moved)
                for (number, found), is_moved in zip(pairs, moved, strict=True)
                if found != ROLLER or number // 2 == axis
            ]
            bedded = bool((self.bed[1] // 2 == axis).any())
            if along and not bedded and all(is_moved for _, is_moved in along):
                shift[axis] = self.ground.given(along[0][0])[axis]
        return shift

    @cached_property
    def at_corner(self) -> Flags:
        """Which masters are corners; the others are bulges."""
        return np.asarray(np.flatnonzero(self.free) < len(self.place))

    def _nodes_on(self, leaf: Ints, side: Ints) -> Flags:
        """Tell which nodes lie on some sides of leaves."""
        nodes = np.zeros(self.nodes, dtype=np.bool_)
        for one in np.unique(side):
            nodes[self.node[leaf[side == one]][:, bricks.on_side(one)]] = True
        return nodes

    def check_held(self) -> None:
        """Refuse a body of which a part could move without straining."""
        leaf, side = np.nonzero(self.beside >= 0)
        n = len(self.leaves)
        links = sp.coo_array((np.ones(len(leaf)), (leaf, self.beside[leaf, side])), shape=(n, n))
        parts = connected_components(links, directed=False)[1]
        bed, on, _ = self.bed
        held = [(h.leaf, h.side, np.full(len(h.leaf), h.axis)) for h in self.holders]
        leaf, side, axis = (
            np.concatenate(column) for column in zip((bed, on, on // 2), *held, strict=True)
        )
        for part in range(int(parts.max()) + 1):
            own = parts[leaf] == part
            corners, axes = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
            for one in np.unique(side[own]):
                some = own & (side == one)
                corners.append(self.vertex[leaf[some]][:, bricks.on_side(one)[:4]].ravel())
                axes.append(np.repeat(axis[some], 4))
            place = self.place[np.concatenate(corners)] / self.ground.cell
            motion = free_motion(rigid_motions(place, np.concatenate(axes)), 3)
            if motion:
                cell = self.leaves.lower[np.flatnonzero(parts == part)[0]] // self.ground.cell
                raise unheld(cell, motion, touched=bool(own.any()))

    def loads(self) -> Floats:
        """Return the forces on all nodes, shape (nodes, 3)."""
        forces = self.ground.forces(self.leaves)
        found = np.zeros((self.nodes, 3))
        inside = forces.direction < 0
        share = np.where(inside[:, None], bricks.means(), bricks.side_loads()[forces.direction, 0])
        self.add(found, forces.leaf, share[:, :, None] * forces.force[:, None])
        uneven = forces.uneven
        if uneven is not None and len(uneven.box):
            # A linear traction of the same moment; it has no force.
            slope = 12.0 * uneven.moment / self.edge[uneven.box, None, None]
            growing = bricks.side_loads()[uneven.side, 1:]
            self.add(found, uneven.box, np.einsum("nkj,nik->nji", growing, slope))
        return found

    def add(self, found: Floats, leaf: Ints, force: Floats) -> None:
        """Add forces (n, 20, 3) on the nodes of leaves."""
        node = self.node[leaf].ravel()
        for axis in range(3):
            found[:, axis] += np.bincount(node, force[:, :, axis].ravel(), self.nodes)
