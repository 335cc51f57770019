"""What agents share: corners, edges, nodes that follow others, and the border."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.elements import (
    EDGE_OF_SIDE,
    edges_of,
    on_sides,
    quadratic_values,
)
from kaju.model.elastic.pair.leaves import LeafCells, corner_ends
from kaju.model.elastic.scales import ROUNDED

Entries = list[tuple[Ints, Ints, Floats | float]]
"""Rows, columns and values of a sparse matrix, part by part."""


@dataclass(eq=False)
class Mesh:
    """Corners and edges of agents of 2:1; lengths in units of the tree."""

    leaves: LeafCells
    corner: Ints  # Vertices at the corners of each agent, in the order of `corner_ends`
    edge: Ints  # Its edges, in the order of `edges_of`
    place: Ints  # Of the vertices; shape (vertices, d)
    ends: Ints  # Vertices at the ends of the edges; shape (edges, 2)
    # Sides with nothing beyond: what agent they belong to, and which of its sides they are
    owner: Ints
    side: Ints

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return len(self.place)

    @property
    def edges(self) -> int:
        """Number of edges."""
        return len(self.ends)

    @cached_property
    def node(self) -> Ints:
        """Nodes of each agent: its vertices, then its edges, which are counted behind them all."""
        return np.concatenate([self.corner, self.vertices + self.edge], axis=1)

    @property
    def on_border(self) -> Ints:
        """Nodes of each side of the border."""
        return self.node[self.owner[:, None], on_sides(self.leaves.dimension)[self.side]]

    @property
    def ties(self) -> sp.csr_array:
        """What all nodes are by those that follow no other."""
        return self._tied[0]

    def masters(self, some: Flags) -> Flags:
        """Tell which nodes any of some follow, or are; shape (nodes, columns)."""
        return np.asarray(abs(self.ties).T @ some.astype(np.float64) > 0.0)

    @property
    def follows(self) -> Flags:
        """Which nodes follow others."""
        return self._tied[1]

    @cached_property
    def hanging(self) -> tuple[Ints, Ints]:
        """Vertices in space on agents of which they are no corners, and these agents."""
        leaves, owner = self.leaves, _largest(self.leaves, self.place)
        off = (self.place - leaves.lower[owner]) % leaves.size[owner, None]
        vertex = np.flatnonzero(off.any(axis=1))
        return vertex, owner[vertex]

    @cached_property
    def _tied(self) -> tuple[sp.csr_array, Flags]:
        """What nodes of bodies in space are: on a larger agent what its quadratics are there."""
        leaves = self.leaves

        def values(points: Floats | Ints, leaf: Ints) -> Floats:
            return quadratic_values((points - leaves.lower[leaf]) / leaves.size[leaf, None])

        vertex, owner = self.hanging
        start, end = self.place[self.ends.T]
        length = (end - start).sum(axis=1)
        # The middle of the smallest edges is between two units: their own agents are as small.
        at = np.where((length == 1)[:, None], start, (start + end) // 2)
        large = _largest(leaves, at)
        short = np.flatnonzero(leaves.size[large] > length)
        own = large[short]
        bulge = values(0.5 * (start + end)[short], own)
        bulge -= 0.5 * (values(start[short], own) + values(end[short], own))
        slaves = np.concatenate([vertex, self.vertices + short])
        masters = self.node[np.concatenate([owner, own])]
        weight = np.concatenate([values(self.place[vertex], owner), bulge])
        slave, some = np.broadcast_to(slaves[:, None], weight.shape), np.abs(weight) > ROUNDED
        entries: Entries = [(slave[some], masters[some], weight[some])]
        return followed(entries, self.vertices + self.edges)

    @cached_property
    def part(self) -> Ints:
        """To which part of the body each agent belongs: agents joined by sides."""
        leaves, n = self.leaves, len(self.leaves)
        sides = range(2 * leaves.dimension)
        beside = np.stack([leaves.find(beyond(leaves, side)) for side in sides])
        other, agent = beside[beside >= 0], np.nonzero(beside >= 0)[1]
        links = sp.coo_array((np.ones(len(agent)), (agent, other)), shape=(n, n))
        return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


@dataclass(eq=False)
class PlaneMesh(Mesh):
    """The mesh of squares, of which edges are the sides."""

    # Whole edges with smaller agents on one side, the vertex in their middle, and their halves
    whole: Ints
    middle: Ints
    halves: Ints  # Shape (2, wholes)
    border: Ints  # The edges that are sides of the border

    @property
    def axis(self) -> Ints:
        """0 for edges along x, 1 for those along y."""
        start, end = self.place[self.ends.T]
        return np.asarray((end - start)[:, 1] > 0, dtype=np.int64)

    @property
    def length(self) -> Floats:
        """Lengths of the edges."""
        start, end = self.place[self.ends.T]
        return np.asarray((end - start).sum(axis=1), dtype=np.float64)

    def along(self) -> tuple[Ints, Ints]:
        """Return the vertices where border edges begin and end, with the body on the left."""
        start, end = self.ends[self.border].T
        back = backwards(self.side)
        return np.where(back, end, start), np.where(back, start, end)

    @cached_property
    def _tied(self) -> tuple[sp.csr_array, Flags]:
        n, ends = self.vertices, self.ends[self.whole]
        # The middle is the value of the whole edge's parabola there, the bulge of each half is a
        # quarter of its bulge.
        entries: Entries = [(self.middle, end, 0.5) for end in ends.T]
        entries.append((self.middle, n + self.whole, 1.0))
        entries += [(n + half, n + self.whole, 0.25) for half in self.halves]
        return followed(entries, n + self.edges)


def backwards(side: Ints) -> Flags:
    """Tell on which sides of squares one goes back along the axis, with the square on the left."""
    return np.asarray((side == 0) | (side == 3))


def mesh_of(leaves: LeafCells) -> Mesh:
    """Return the mesh of the agents of a body."""
    d, row = leaves.dimension, int(leaves.upper.max()) + 1
    digits = np.array([row**power for power in range(d)][::-1])
    lower = leaves.lower[:, None] + corner_ends(d) * leaves.size[:, None, None]
    key, corner = np.unique(lower @ digits, return_inverse=True)
    corner = corner.reshape(-1, 1 << d)
    place = key[:, None] // digits % row
    if d == 2:
        corner, place = _split(corner, place)
    many = len(place)
    start, end = np.moveaxis(corner[:, edges_of(d)], 2, 0)
    number, first, edge = np.unique(start * many + end, return_index=True, return_inverse=True)
    edge, ends = edge.reshape(start.shape), np.stack(np.divmod(number, many), axis=1)
    if d == 3:
        units = np.stack([leaves.find(beyond(leaves, side)) for side in range(6)], axis=1)
        return Mesh(leaves, corner, edge, place, ends, *np.nonzero(units < 0))
    # A vertex in the middle of an edge is a corner of the smaller agents on one side.
    twice = place[ends].sum(axis=1)
    middle_key = (twice // 2) @ digits
    at = np.minimum(np.searchsorted(key, middle_key), len(key) - 1)
    whole = np.flatnonzero((twice % 2 == 0).all(axis=1) & (key[at] == middle_key))
    middle = at[whole]
    halves = np.searchsorted(
        number, [ends[whole, 0] * many + middle, middle * many + ends[whole, 1]]
    )
    beside = np.bincount(edge.ravel(), minlength=len(ends))
    beside[whole] = beside[halves] = 2
    border = np.flatnonzero(beside == 1)
    owner, own = np.divmod(first[border], 4)
    side = EDGE_OF_SIDE[own]  # which is its own inverse
    return PlaneMesh(leaves, corner, edge, place, ends, owner, side, whole, middle, halves, border)


def beyond(leaves: LeafCells, side: int) -> Ints:
    """Return the unit cells just beyond the middles of the sides of agents."""
    axis, end = divmod(side, 2)
    unit = leaves.lower + leaves.size[:, None] // 2
    unit[:, axis] = leaves.lower[:, axis] + (leaves.size if end else -1)
    return np.asarray(unit)


def _split(corner: Ints, place: Ints) -> tuple[Ints, Ints]:
    """Give two agents that touch at a corner alone a vertex each: they are not joined there."""
    quarters = np.bincount(
        corner.ravel(), np.tile([1.0, 2.0, 4.0, 8.0], len(corner)), len(place)
    ).astype(np.int64)
    touching = np.flatnonzero((quarters == 9) | (quarters == 6))
    if not len(touching):
        return corner, place
    copy = np.arange(len(place))
    copy[touching] = len(place) + np.arange(len(touching))
    corner = corner.copy()
    corner[:, 2:] = copy[corner[:, 2:]]
    return corner, np.concatenate([place, place[touching]])


def _largest(leaves: LeafCells, points: Ints) -> Ints:
    """Return the largest agent that touches each point (units)."""
    found = np.stack([leaves.find(points - np.array(o)) for o in product((0, 1), repeat=3)])
    size = np.where(found >= 0, leaves.size[found], 0)
    return np.asarray(found[np.argmax(size, axis=0), np.arange(len(points))])


def coo(entries: Entries, shape: tuple[int, int]) -> sp.csr_array:
    """Return a sparse matrix of rows, columns and values."""
    rows, columns = (np.concatenate([one[k] for one in entries]) for k in (0, 1))
    values = np.concatenate([np.broadcast_to(one[2], len(one[0])) for one in entries])
    return sp.csr_array((values, (rows, columns)), shape=shape)


def followed(entries: Entries, size: int) -> tuple[sp.csr_array, Flags]:
    """Return what unknowns are by those that follow no other, and which follow, as entries say."""
    follows = np.zeros(size, dtype=np.bool_)
    for rows, *_ in entries:
        follows[rows] = True
    own = np.flatnonzero(~follows)
    way = coo([(own, own, 1.0), *entries], (size, size))
    while follows[way.indices].any():  # those that are followed may follow others
        way = sp.csr_array(way @ way)
    return way, follows
