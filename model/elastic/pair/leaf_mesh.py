"""What agents share: corners, edges, edges whose halves follow a whole one, and the border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.pair.elements import CORNERS, EDGES
from kaju.model.elastic.pair.leaves import LeafCells


@dataclass(frozen=True, eq=False)
class LeafMesh:
    """Corners and edges of square agents of 2:1; lengths in units of the quadtree.

    Elements of other kinds join by vertices and edges appended to `place` and `ends`: a field's
    unknowns are numbered by these alone.
    """

    leaves: LeafCells
    corner: Ints  # Vertices at the corners of each agent, in the order of CORNERS; shape (n, 4)
    edge: Ints  # Its edges, in the order of EDGES; shape (n, 4)
    place: Floats  # Of the vertices; shape (vertices, 2)
    ends: Ints  # Vertices at the ends of the edges; shape (edges, 2)
    axis: Ints  # 0 for edges along x, 1 for those along y
    # Whole edges with smaller agents on one side, the vertex in their middle, and their halves
    whole: Ints
    middle: Ints
    halves: Ints  # Shape (2, wholes)
    # Edges with nothing beyond, what agent they belong to, and which of its edges they are
    border: Ints
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

    @property
    def length(self) -> Floats:
        """Lengths of the edges."""
        return np.asarray(
            np.abs(self.place[self.ends[:, 1]] - self.place[self.ends[:, 0]]).sum(axis=1)
        )

    def along(self) -> tuple[Ints, Ints]:
        """Return the vertices where border edges begin and end, with the body on the left."""
        ends = self.ends[self.border]
        back = np.isin(self.side, (1, 2))
        return np.where(back, ends[:, 1], ends[:, 0]), np.where(back, ends[:, 0], ends[:, 1])

    def parts(self) -> Ints:
        """Return to which part of the body each agent belongs: agents joined by edges."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        n = len(self.leaves)
        edge = self.edge.ravel()
        owner = np.repeat(np.arange(n), 4)
        follows = np.arange(self.edges)
        follows[self.halves] = self.whole
        links = coo_array((np.ones(len(edge)), (owner, n + follows[edge])), (n + self.edges,) * 2)
        return np.asarray(connected_components(links, directed=False)[1][:n], dtype=np.int64)


def mesh_of(leaves: LeafCells) -> LeafMesh:
    """Return the mesh of the agents of a plane body."""
    row = int(leaves.upper.max()) + 1
    lower = leaves.lower[:, None] + CORNERS.astype(np.int64) * leaves.size[:, None, None]
    key, corner = np.unique(lower[..., 0] * row + lower[..., 1], return_inverse=True)
    corner = corner.reshape(-1, 4)
    place = np.stack(np.divmod(key, row), axis=1)
    corner, place = _split(corner, place)
    many = len(place)
    start, end = corner[:, EDGES[:, 0]], corner[:, EDGES[:, 1]]
    number, first, edge = np.unique(start * many + end, return_index=True, return_inverse=True)
    edge = edge.reshape(-1, 4)
    ends = np.stack(np.divmod(number, many), axis=1)
    # A vertex in the middle of an edge is a corner of the smaller agents on one side.
    twice = place[ends].sum(axis=1)
    middle_key = (twice[:, 0] // 2) * row + twice[:, 1] // 2
    at = np.minimum(np.searchsorted(key, middle_key), len(key) - 1)
    whole = np.flatnonzero((twice % 2 == 0).all(axis=1) & (key[at] == middle_key))
    middle = at[whole]
    halves = np.stack(
        [
            np.searchsorted(number, ends[whole, 0] * many + middle),
            np.searchsorted(number, middle * many + ends[whole, 1]),
        ]
    )
    beside = np.bincount(edge.ravel(), minlength=len(ends))
    beside[whole] = beside[halves] = 2
    border = np.flatnonzero(beside == 1)
    owner, side = np.divmod(first[border], 4)
    return LeafMesh(
        leaves, corner, edge, place.astype(np.float64), ends, first % 4 // 2, whole, middle,
        halves, border, owner, side,
    )  # fmt: skip


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
