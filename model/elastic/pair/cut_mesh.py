"""Squares and triangles that fill what leaves hold of a body, side to side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Floats, Ints
from kaju.model.outline.leaf_polygons import Rings, VagueError, filled
from kaju.model.outline.true_shapes import UNIT

from .cut_elements import slopes
from .leaves import LeafCells

CORNERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)], dtype=np.float64)
SIDES = np.array([(0, 2), (1, 3), (0, 1), (2, 3)])
"""Corners at the ends of a square's sides: lower, upper, left, right."""
THIRDS = np.array([(0, 1), (1, 2), (2, 0)])  # corners at the ends of a triangle's sides
ROUND = np.array([0, 2, 3, 1])  # corners of a square, counter-clockwise


@dataclass(frozen=True, eq=False)
class CutMesh:
    """Squares that are whole leaves, and triangles that fill polygons in the others.

    The unknowns of both fields sit at vertices and edges. Where a square's side is met by two
    halves, these follow the whole. A point in which parts of the body only touch is several
    vertices.
    """

    place: Floats  # of vertices, shape (n, 2)
    square: Ints  # vertices, in the order of CORNERS, shape (squares, 4)
    square_leaf: Ints
    square_law: Ints
    triangle: Ints  # vertices, counter-clockwise, shape (triangles, 3)
    triangle_leaf: Ints
    triangle_law: Ints

    @cached_property
    def _sides(self) -> tuple[Ints, Ints]:
        pairs = [self.square[:, SIDES].reshape(-1, 2)]
        pairs.append(self.triangle[:, THIRDS].reshape(-1, 2))
        both = np.sort(np.concatenate(pairs), axis=1)
        key, edge = np.unique(both[:, 0] * len(self.place) + both[:, 1], return_inverse=True)
        return key, edge

    @cached_property
    def ends(self) -> Ints:
        """Vertices of each edge, the smaller coordinate first, shape (edges, 2)."""
        return np.stack(np.divmod(self._sides[0], len(self.place)), axis=1)

    @property
    def square_edge(self) -> Ints:
        """Edges of squares, in the order of SIDES, shape (squares, 4)."""
        return self._sides[1][: 4 * len(self.square)].reshape(-1, 4)

    @property
    def triangle_edge(self) -> Ints:
        """Edges of triangles, the first between the first two vertices, shape (triangles, 3)."""
        return self._sides[1][4 * len(self.square) :].reshape(-1, 3)

    @property
    def owner(self) -> tuple[Ints, Ints]:
        """Leaf and law of an element at each edge; of the border the only one."""
        leaf, law = np.full(len(self.ends), -1), np.full(len(self.ends), -1)
        for edge, of, kind in (
            (self.square_edge, self.square_leaf, self.square_law),
            (self.triangle_edge, self.triangle_leaf, self.triangle_law),
        ):
            leaf[edge], law[edge] = of[:, None], kind[:, None]
        return leaf, law

    @cached_property
    def run(self) -> Floats:
        """From end to end of each edge."""
        return self.place[self.ends[:, 1]] - self.place[self.ends[:, 0]]

    @cached_property
    def normal(self) -> Floats:
        """Unit normals of edges; of those along an axis the other axis."""
        n = np.stack([-self.run[:, 1], self.run[:, 0]], axis=1)
        n /= np.hypot(*n.T)[:, None]
        back = (n[:, 1] < 0.0) | ((n[:, 1] == 0.0) & (n[:, 0] < 0.0))
        return np.where(back[:, None], -n, n)

    @cached_property
    def hanging(self) -> tuple[Ints, Ints, Ints]:
        """Edges of squares met by two halves, the vertex between these, and both, shape (2, n)."""
        whole = np.unique(self.square_edge)
        a, b = self.ends[whole].T
        names = named(self.place)
        order = np.argsort(names)
        middle = named(0.5 * (self.place[a] + self.place[b]))
        first, last = (np.searchsorted(names[order], middle, side) for side in ("left", "right"))
        found = []
        # a point may be several vertices: that one counts which has both halves
        for k in range(int((last - first).max(initial=0))):
            at = order[np.minimum(first + k, len(order) - 1)]
            halves = np.stack([self.edge_of(a, at), self.edge_of(at, b)])
            on = (first + k < last) & (halves >= 0).all(axis=0)
            found.append((whole[on], at[on], halves[:, on]))
        if not found:
            none = np.empty(0, dtype=np.int64)
            return none, none, np.empty((2, 0), dtype=np.int64)
        edges, middles, both = ([one[k] for one in found] for k in range(3))
        return np.concatenate(edges), np.concatenate(middles), np.concatenate(both, axis=1)

    def edge_of(self, a: Ints, b: Ints) -> Ints:
        """Return the edges between vertices, -1 for none."""
        key = np.minimum(a, b) * len(self.place) + np.maximum(a, b)
        keys = self._sides[0]
        at = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
        return np.where(keys[at] == key, at, -1)

    @cached_property
    def border(self) -> tuple[Ints, Ints]:
        """Edges beyond which there is no body, and their vertices, the body to the left."""
        count = np.bincount(self._sides[1], minlength=len(self.ends))
        whole, _, halves = self.hanging
        count[whole] = count[halves] = 2
        edge = np.flatnonzero(count == 1)
        middle = np.zeros((len(self.ends), 2))
        middle[self.square_edge] = self.place[self.square].mean(axis=1)[:, None]
        middle[self.triangle_edge] = self.place[self.triangle].mean(axis=1)[:, None]
        ends, away = self.ends[edge], middle[edge] - self.place[self.ends[edge, 0]]
        run = self.run[edge]
        right = run[:, 0] * away[:, 1] - run[:, 1] * away[:, 0] < 0.0
        return edge, np.where(right[:, None], ends[:, ::-1], ends)

    @property
    def pinned(self) -> Ints:
        """Leaves of squares with a vertex in the middle of a side that cannot follow the side.

        It is on the border, or beside one half of the side alone there is body.
        """
        edges = np.unique(self.square_edge)
        middle = named(self.place[self.ends[edges]].mean(axis=1))
        whole, vertex, _ = self.hanging
        loose = np.setdiff1d(edges[np.isin(middle, named(self.place))], whole)
        loose = np.union1d(loose, whole[np.isin(vertex, self.border[1])])
        return self.square_leaf[np.isin(self.square_edge, loose).any(axis=1)]

    @cached_property
    def parts(self) -> Ints:
        """The part of the body that each vertex belongs to: elements joined by vertices."""
        pairs = [self.square[:, [0, 0, 0]].ravel(), self.triangle[:, [0, 0]].ravel()]
        others = [self.square[:, 1:].ravel(), self.triangle[:, 1:].ravel()]
        whole, middle, _ = self.hanging
        a = np.concatenate([*pairs, self.ends[whole, 0]])
        b = np.concatenate([*others, middle])
        graph = sp.coo_array((np.ones(len(a)), (a, b)), shape=(len(self.place),) * 2)
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)

    def torn(self) -> CutMesh:
        """Return the mesh, vertices parted where only points of the body touch."""
        corner = np.concatenate([self.square.ravel(), self.triangle.ravel()])
        squares, count = len(self.square), len(corner)
        sides = [4 * np.arange(squares)[:, None, None] + SIDES]
        sides.append(4 * squares + 3 * np.arange(len(self.triangle))[:, None, None] + THIRDS)
        slot = np.concatenate([one.reshape(-1, 2) for one in sides])
        # elements round a vertex hang together by the ends of edges that they share there
        end = 2 * self._sides[1][:, None] + (corner[slot] != self.ends[self._sides[1], :1])
        whole, _, halves = self.hanging
        pairs = [(slot.ravel(), count + end.ravel())]
        for k, half in enumerate(halves):
            own = 2 * half + (self.ends[half, 0] != self.ends[whole, k])
            pairs.append((count + own, count + 2 * whole + k))
        a, b = (np.concatenate(one) for one in zip(*pairs, strict=True))
        graph = sp.coo_array((np.ones(len(a)), (a, b)), shape=(count + 2 * len(self.ends),) * 2)
        label = connected_components(graph, directed=False)[1].astype(np.int64)
        key = corner * len(label) + label[:count]
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        own_square, own_triangle = np.split(number, [4 * squares])
        return replace(
            self,
            place=self.place[corner[first]],
            square=own_square.reshape(-1, 4),
            triangle=own_triangle.reshape(-1, 3),
        )


def named(points: Floats) -> np.ndarray:
    """Return points as numbers that sort by x, then y."""
    return points[..., 0] + 1j * points[..., 1]


class _OnLines:
    """Vertices on the lines of one axis, in order."""

    def __init__(self, points: Floats, axis: int):
        self.axis = axis
        self.names = np.unique(named(points[:, [axis, 1 - axis]]))

    def between(self, start: Floats, end: Floats) -> tuple[Ints, Ints]:
        """Return the first vertex strictly between points along the axis' lines, and how many."""
        a, b = start[:, 1 - self.axis], end[:, 1 - self.axis]
        line = start[:, self.axis]
        first = np.searchsorted(self.names, line + 1j * np.minimum(a, b), "right")
        last = np.searchsorted(self.names, line + 1j * np.maximum(a, b), "left")
        return first, np.maximum(last - first, 0)


def squares_to_cut(whole: Ints, rings: Rings, leaves: LeafCells) -> Ints:
    """Return whole leaves with vertices on their sides that no square can have there."""
    leaf = np.flatnonzero(whole >= 0)
    corner = (leaves.lower[leaf, None] + CORNERS * leaves.size[leaf, None, None]) * UNIT
    points = np.concatenate([corner.reshape(-1, 2), rings.points])
    bad = np.zeros(len(leaf), dtype=np.bool_)
    for k, (a, b) in enumerate(SIDES):
        lines = _OnLines(points, 1 if k < 2 else 0)
        start, end = corner[:, a], corner[:, b]
        first, count = lines.between(start, end)
        at = lines.names[np.minimum(first, len(lines.names) - 1)].imag
        middle = 0.5 * (start + end)[:, 1 - lines.axis]
        bad |= (count > 1) | ((count == 1) & (at != middle))
    return leaf[bad]


def with_squares(rings: Rings, chosen: Ints, whole: Ints, leaves: LeafCells) -> Rings:
    """Return polygons, and those of some whole leaves."""
    at = (leaves.lower[chosen, None] + CORNERS[ROUND] * leaves.size[chosen, None, None]) * UNIT
    return Rings.joined([rings, Rings.of(chosen, whole[chosen], at)])


def mesh_of(whole: Ints, rings: Rings, leaves: LeafCells) -> CutMesh:
    """Return squares for whole leaves, and triangles for polygons, side to side."""
    leaf = np.flatnonzero(whole >= 0)
    corner = (leaves.lower[leaf, None] + CORNERS * leaves.size[leaf, None, None]) * UNIT
    rings = _with_vertices(rings, np.concatenate([corner.reshape(-1, 2), rings.points]), leaves)
    of, triangles = filled(rings)
    at = rings.points[triangles]
    three = (at != np.roll(at, -1, axis=1)).any(axis=2).all(axis=1)
    of, triangles, at = of[three], triangles[three], at[three]
    bad = np.unique(rings.place[of[slopes(at)[1] <= 0.0]])
    if len(bad):  # polygons that cut themselves by rounding
        raise VagueError(leaves.code[bad])
    points = np.concatenate([corner.reshape(-1, 2), rings.points])
    _, first, number = np.unique(named(points), return_index=True, return_inverse=True)
    return CutMesh(
        points[first],
        number[: 4 * len(leaf)].reshape(-1, 4),
        leaf,
        whole[leaf],
        number[4 * len(leaf) + triangles],
        rings.place[of],
        rings.law[of],
    ).torn()


def _with_vertices(rings: Rings, points: Floats, leaves: LeafCells) -> Rings:
    """Return polygons with the vertices of others that lie on the sides of their leaves."""
    start, end, row = rings.points, rings.points[rings.following], rings.row
    low, high = (one[rings.place][row] * UNIT for one in (leaves.lower, leaves.upper))
    count = np.zeros(len(start), dtype=np.int64)
    first, along = count.copy(), count.copy()
    lines = [_OnLines(points, axis) for axis in (0, 1)]
    for axis in (0, 1):
        on = (start[:, axis] == end[:, axis]) & (
            (start[:, axis] == low[:, axis]) | (start[:, axis] == high[:, axis])
        )
        first[on], count[on] = lines[axis].between(start[on], end[on])
        along[on] = axis
    k = np.arange((count + 1).sum()) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    at = np.repeat(np.arange(len(start)), count + 1)
    out = start[at].copy()
    for axis in (0, 1):
        new = np.flatnonzero((k > 0) & (along[at] == axis))
        of = at[new]
        up = end[of, 1 - axis] > start[of, 1 - axis]
        n = np.where(up, first[of] + k[new] - 1, first[of] + count[of] - k[new])
        out[new, 1 - axis] = lines[axis].names[n].imag
    size = np.bincount(row, count + 1, len(rings.count)).astype(np.int64)
    return Rings(rings.place, rings.law, size, out)
