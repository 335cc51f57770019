"""The agents of a body as the leaves of a quadtree or octree, and what they share.

A leaf is a square or cube, named by the integer coordinates of its lower corner and by its
edge, both counted in *units*, the smallest cells that could ever spawn. The leaves are kept
in the order of their Morton codes, so that the leaf around any point is found by bisection
(a linear octree; Gargantini 1982). Nothing is stored where there is no body. A mesh says what
agents share: corners, edges, nodes that follow others, and the border.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.scales import ROUNDED

from .elements import EDGE_OF_SIDE, corner_ends, edges_of, on_sides, quadratic_values

Entries = list[tuple[Ints, Ints, Floats | float]]
"""Rows, columns and values of a sparse matrix, part by part."""
BITS = {2: 30, 3: 20}
"""Binary digits of a coordinate in units; the code needs as many for every axis."""
_BITS = np.arange(1024)[:, None] >> np.arange(10) & 1
_SPREAD = {d: (_BITS << d * np.arange(10)).sum(axis=1) for d in BITS}
"""Numbers of ten binary digits, with room between these for those of the other axes."""


def morton(points: Ints) -> Ints:
    """Return the Morton codes of points (units, not negative), shape (n, dimension)."""
    d, found = points.shape[1], np.zeros(len(points), dtype=np.int64)
    for low in range(0, BITS[d], 10):
        digits = _SPREAD[d][points >> low & 1023]
        for axis in range(d):
            found |= digits[:, axis] << (d * low + axis)
    return found


def corners(code: Ints, dimension: int) -> Ints:
    """Return the points (units) that Morton codes stand for, shape (n, dimension)."""
    point = np.zeros((len(code), dimension), dtype=np.int64)
    for bit in range(BITS[dimension]):
        for axis in range(dimension):
            point[:, axis] |= ((code >> (dimension * bit + axis)) & 1) << bit
    return point


@dataclass(frozen=True, eq=False)
class LeafCells:
    """Agents of one body, in the order of their Morton codes."""

    lower: Ints  # Lower corners (units). Shape (n, dimension)
    size: Ints  # Edges (units), powers of two. Shape (n,)
    kind: Ints  # Material. Shape (n,)
    code: Ints  # Morton codes of the lower corners. Shape (n,)

    @classmethod
    def of(cls, lower: Ints, size: Ints, kind: Ints) -> LeafCells:
        """Return leaves sorted by their codes."""
        code = morton(lower)
        order = np.argsort(code, kind="stable")
        return cls(lower[order], size[order], kind[order], code[order])

    def __len__(self) -> int:
        return len(self.size)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.lower.shape[1])

    @property
    def upper(self) -> Ints:
        """Upper corners (units). Shape (n, dimension)."""
        return np.asarray(self.lower + self.size[:, None])

    @property
    def middle(self) -> Floats:
        """Middles (units). Shape (n, dimension)."""
        return np.asarray(self.lower + 0.5 * self.size[:, None])

    def find(self, points: Ints) -> Ints:
        """Return the leaf that holds each unit cell, -1 where there is none."""
        # Coordinates beyond the array have more digits than a code holds, or a sign.
        high = reduce(np.bitwise_or, points.T) >> BITS[self.dimension]
        code = morton(points)
        at = np.searchsorted(self.code, code, "right") - 1
        # The last leaf that begins before the cell holds it, if its codes reach so far.
        held = (high == 0) & (at >= 0) & (code - self.code[at] < self.size[at] ** self.dimension)
        return np.where(held, at, -1)

    def holding(self, points: Ints) -> Ints:
        """Return the leaves that hold any of some unit cells."""
        at = np.unique(self.find(points))
        return np.asarray(at[at >= 0])

    def split(self, chosen: Flags) -> LeafCells:
        """Return the leaves with the chosen ones replaced by their children."""
        d = self.dimension
        # Children take their parent's place in the order, x fastest; `child` counts them.
        corners = corner_ends(d)[:, ::-1]
        many = len(corners)
        count = np.where(chosen, many, 1)
        parent = np.repeat(np.arange(len(self)), count)
        child = np.arange(len(parent)) - np.repeat(np.cumsum(count) - count, count)
        new = chosen[parent]
        size = np.where(new, self.size[parent] // 2, self.size[parent])
        lower = self.lower[parent] + corners[np.where(new, child, 0)] * size[:, None]
        code = self.code[parent] + np.where(new, child * size**d, 0)
        return LeafCells(lower, size, self.kind[parent], code)

    def only(self, chosen: Flags | Ints) -> LeafCells:
        """Return some of the leaves."""
        columns = self.lower, self.size, self.kind, self.code
        return LeafCells(*(column[chosen] for column in columns))

    def parents_in(self, before: LeafCells) -> Ints:
        """Return in which of some larger leaves each lies."""
        return np.asarray(np.searchsorted(before.code, self.code, "right") - 1)

    def balanced(self) -> LeafCells:
        """Return the leaves refined until neighbours differ at most by a factor of two (2:1)."""
        # Where two materials meet at a face, the leaves on both sides have the same size: hanging
        # faces of a stiff large leaf would be held by its soft neighbours only.
        leaves, largest = self, int(self.size.max())
        offsets = np.array(list(product((-1, 0, 1), repeat=self.dimension)), dtype=np.int64)
        across = np.abs(offsets).sum(axis=1) == 1  # a face, where materials may meet
        while True:
            asking = np.flatnonzero(leaves.size <= largest)
            lower, size, kind = (a[asking] for a in (leaves.lower, leaves.size, leaves.kind))
            around = lower + offsets[:, None] * size[:, None]
            other = leaves.find(around.reshape(-1, self.dimension)).reshape(len(offsets), -1)
            unlike = across[:, None] & (leaves.kind[other] != kind)
            too_large = leaves.size[other] > np.where(unlike, size, 2 * size)
            chosen = np.zeros(len(leaves), dtype=np.bool_)
            chosen[other[(other >= 0) & too_large]] = True
            if not chosen.any():
                return leaves
            # Next only those can ask that are as small as the new ones.
            largest = int(leaves.size[chosen].max()) // 2
            leaves = leaves.split(chosen)


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

    @cached_property
    def node(self) -> Ints:
        """Nodes of each agent: its vertices, then its edges, which are counted behind them all."""
        return np.concatenate([self.corner, len(self.place) + self.edge], axis=1)

    @property
    def on_border(self) -> Ints:
        """Nodes of each side of the border."""
        return self.node[self.owner[:, None], on_sides(self.leaves.dimension)[self.side]]

    def masters(self, some: Flags) -> Flags:
        """Tell which nodes any of some follow, or are; shape (nodes, columns)."""
        return np.asarray(abs(self.tied[0]).T @ some.astype(np.float64) > 0.0)

    @cached_property
    def hanging(self) -> tuple[Ints, Ints]:
        """Vertices in space on agents of which they are no corners, and these agents."""
        leaves, owner = self.leaves, _largest(self.leaves, self.place)
        off = (self.place - leaves.lower[owner]) % leaves.size[owner, None]
        vertex = np.flatnonzero(off.any(axis=1))
        return vertex, owner[vertex]

    @cached_property
    def tied(self) -> tuple[sp.csr_array, Flags]:
        """What all nodes are by those that follow no other, and which follow others."""
        # In space a node on a larger agent is what the quadratics of this are there.
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
        slaves = np.concatenate([vertex, len(self.place) + short])
        masters = self.node[np.concatenate([owner, own])]
        weight = np.concatenate([values(self.place[vertex], owner), bulge])
        slave, some = np.broadcast_to(slaves[:, None], weight.shape), np.abs(weight) > ROUNDED
        entries: Entries = [(slave[some], masters[some], weight[some])]
        return followed(entries, len(self.place) + len(self.ends))

    @cached_property
    def first(self) -> Ints:
        """Edges of the first agents that agents descend from: their own, if not handed down."""
        return self.leaves.size

    @cached_property
    def part(self) -> Ints:
        """To which part of the body each agent belongs: agents joined by sides."""
        leaves, sides = self.leaves, range(2 * self.leaves.dimension)
        beside = np.stack([leaves.find(beyond(leaves, side)) for side in sides])
        pairs = np.column_stack([np.nonzero(beside >= 0)[1], beside[beside >= 0]])
        return joined(pairs, len(leaves))


@dataclass(eq=False)
class PlaneMesh(Mesh):
    """The mesh of squares, of which edges are the sides."""

    # Whole edges with smaller agents on one side, the vertex in their middle, and their halves
    whole: Ints
    middle: Ints
    halves: Ints  # Shape (2, wholes)
    border: Ints  # The edges that are sides of the border

    @cached_property
    def tied(self) -> tuple[sp.csr_array, Flags]:
        """What all nodes are by those that follow no other, and which follow others."""
        n, ends = len(self.place), self.ends[self.whole]
        # The middle is the value of the whole edge's parabola there, the bulge of each half is a
        # quarter of its bulge.
        entries: Entries = [(self.middle, end, 0.5) for end in ends.T]
        entries.append((self.middle, n + self.whole, 1.0))
        entries += [(n + half, n + self.whole, 0.25) for half in self.halves]
        return followed(entries, n + len(self.ends))


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


def joined(pairs: Ints, count: int) -> Ints:
    """Return the number of the group of each of so many, joined pair by pair."""
    graph = sp.coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


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
