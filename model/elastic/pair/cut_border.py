"""Where bodies within outlines end: supports and loads there, and what of φ they make known.

Tractions add up along the border to φ and its slopes, but for a linear function on each free part
of it. Round a hole that bears a force or a couple φ grows by a linear function, which is known:
beyond a ray from the hole it jumps by that. A hole is never held, for supports are sides of the
array.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from kaju.arrays import Flags, Floats, Ints
from kaju.model.outline.posed_outlines import SIDES, OutlineProblem, UnlikeError
from kaju.model.outline.true_shapes import SMOOTH, nearest_of

from .airy import loops_of
from .cut_mesh import CutMesh, joined
from .leaves import Entries, coo

ALONG = 1e-8  # edges whose ends are this near to corners of an outline's polygon are on it
BALANCED = 1e-9
"""Of the sum of all forces: by so much the loads of a part that nothing holds may not balance."""


@dataclass(frozen=True, eq=False)
class Border:
    """Edges beyond which there is no body, and what is known there."""

    edge: Ints
    ends: Ints  # vertices, the body to the left, shape (n, 2)
    at: Floats  # where these are, shape (n, 2, 2)
    traction: Floats  # shape (n, 2)
    held: Flags  # components of the displacement, shape (n, 2)
    side: Ints  # number of the array's side, -1 on an outline
    outline: Ints  # region whose outline it lies on, -1 for none

    @property
    def run(self) -> Floats:
        """From end to end of each edge."""
        return self.at[:, 1] - self.at[:, 0]

    @property
    def outward(self) -> Floats:
        """Outward normals, times the lengths of edges."""
        return np.stack([self.run[:, 1], -self.run[:, 0]], axis=1)

    @property
    def given(self) -> Floats:
        """Forces of the tractions on edges."""
        return np.asarray(self.traction * np.hypot(*self.run.T)[:, None])

    @classmethod
    def of(cls, mesh: CutMesh, problem: OutlineProblem, along: list[Floats]) -> Border:
        """Return the border of a mesh under the loads and supports of a problem."""
        edge, ends = mesh.border
        at = mesh.place[ends]
        run = at[:, 1] - at[:, 0]
        length = np.hypot(*run.T)
        traction, held = np.zeros((len(edge), 2)), np.zeros((len(edge), 2), dtype=np.bool_)
        side = np.full(len(edge), -1)
        for number, (name, (axis, upper)) in enumerate(SIDES.items()):
            on = (at[:, :, axis] == (problem.shape[axis] if upper else 0.0)).all(axis=1)
            side[on] = number
            held[np.ix_(on, problem.held.get(name, ()))] = True
            if name in problem.forces:
                if not on.any():
                    raise UnlikeError(f"{name} has no body to be loaded")
                traction[on] = problem.tractions[name] + problem.forces[name] / length[on].sum()
        outline = _outline_of(at, side < 0, along)
        outward = np.stack([run[:, 1], -run[:, 0]], axis=1) / length[:, None]
        for one in problem.outlines:
            on = outline == one.region
            if one.facing is not None:
                on &= outward @ one.facing < -SMOOTH
            traction[on] = outward[on] @ one.stress
        traction[held] = 0.0
        return cls(edge, ends, at, traction, held, side, outline)

    def forces(self, mesh: CutMesh) -> Floats:
        """Return the work of the tractions on the unknowns of a displacement."""
        out = np.zeros((len(mesh.place) + len(mesh.ends), 2))
        for k in (0, 1):
            np.add.at(out, self.ends[:, k], 0.5 * self.given)
        out[len(mesh.place) + self.edge] += self.given * (2.0 / 3.0)
        return out


def _outline_of(at: Floats, inner: Flags, along: list[Floats]) -> Ints:
    """Return the region on whose outline edges lie, by the straight pieces of each; -1 for none."""
    lines = np.concatenate([np.empty((0, 2, 2)), *along])
    region = np.repeat(np.arange(len(along)), [len(one) for one in along])
    outline = np.full(len(at), -1)
    if not len(lines):
        return outline
    away, near = map(np.asarray, cKDTree(lines[:, 0]).query(at))
    on = inner & (away < ALONG).all(axis=1)
    outline[on] = region[near[on, 0]]
    # others lie along the sides of leaves, or stand for slivers that were left out
    rest = np.flatnonzero(inner & (outline < 0))
    outline[rest] = region[nearest_of(at[rest].mean(axis=1), lines)[1]]
    return outline


@dataclass(frozen=True)
class Ray:
    """A ray to the right, beyond which φ is another one: it has grown by a linear function."""

    start: Floats
    base: Floats
    growth: Floats  # value and slopes at the base, by which φ grows counter-clockwise

    def passed(self, start: Floats, end: Floats) -> Ints:
        """Return how often (1, 0, -1) ways between points cross the ray upwards."""
        (x0, y0), (x1, y1) = np.moveaxis(start, -1, 0), np.moveaxis(end, -1, 0)
        up = (y1 > self.start[1]).astype(np.int64) - (y0 > self.start[1])
        height = np.where(up == 0, 1.0, y1 - y0)
        x = x0 + (self.start[1] - y0) / height * (x1 - x0)
        return np.where(x > self.start[0], up, 0)

    def times(self, way: Floats) -> Ints:
        """Return how often a way through points, (n, 2), has crossed the ray up to each."""
        return np.append(0, np.cumsum(self.passed(way[:-1], way[1:])))

    def at(self, points: Floats) -> Floats:
        """Return by how much φ and its slopes grow at points, shape (n, 3)."""
        value, slope = self.growth[0], self.growth[1:]
        own = np.broadcast_to(self.growth, (*points.shape[:-1], 3)).copy()
        own[..., 0] = value + (points - self.base) @ slope
        return own


class Known:
    """φ and its slopes along the border, but for a linear function on each free part.

    A support that slips leaves one constant: the slope across its side.
    """

    def __init__(self, mesh: CutMesh, border: Border, weight: Floats):
        self.mesh, self.border = mesh, border
        nodes = len(mesh.place)
        self.count = 3 * nodes + len(mesh.ends)
        self.value, self.fixed = np.zeros(self.count), np.zeros(self.count, dtype=np.bool_)
        self.rays: list[Ray] = []
        none = np.empty(0, dtype=np.int64)
        self._columns: Entries = [(none, none, 1.0)]
        kind = border.held.sum(axis=1)  # 0 free, 1 slips, 2 held
        # tractions that φ makes good: those asked for less those of what bears the weight
        ends = border.given[:, None] + border.at * weight * border.outward[:, None]
        turn = np.stack([-ends[..., 1], ends[..., 0]], axis=2)
        self._step = turn.mean(axis=1)  # of the slopes
        self._bulge = -(turn[:, 1] - turn[:, 0]) / 8.0
        self._size = float(np.abs(self._step).sum()) or 1.0
        arcs = self._arcs(kind)
        free = [arc for arc in arcs if kind[arc[0]] == 0]
        self._walk(free)
        self._join(free, [arc for arc in arcs if kind[arc[0]] == 1])

    def _arcs(self, kind: Ints) -> list[Ints]:
        """Return the rows of free edges, or of those held along one side, in order."""
        arcs: list[Ints] = []
        sort = np.where(kind == 0, -1, 3 * self.border.side + kind)
        for loop in loops_of(*self.border.ends.T):
            change = np.flatnonzero(sort[loop] != sort[np.roll(loop, 1)])
            loop = np.roll(loop, -change[0]) if len(change) else loop
            arcs += np.split(loop, change[1:] - change[0] if len(change) else [])
        return arcs

    def _walk(self, arcs: list[Ints]) -> None:
        """Add tractions up along free parts of the border: first round holes, which cast rays."""
        border, mesh = self.border, self.mesh
        walks = []
        for arc in arcs:
            vertices = np.append(border.ends[arc, 0], border.ends[arc[-1], 1])
            at = mesh.place[vertices]
            slope = np.concatenate([np.zeros((1, 2)), np.cumsum(self._step[arc], axis=0)])
            mean = 0.5 * (slope[1:] + slope[:-1]) + self._bulge[arc] * (2.0 / 3.0)
            phi = np.concatenate([[0.0], np.cumsum((mean * border.run[arc]).sum(axis=1))])
            walks.append((arc, vertices, np.column_stack([phi, slope])))
            closed = vertices[0] == vertices[-1]
            x, y = (at[:-1] - at[0]).T
            hole = closed and float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0
            if hole and np.abs(walks[-1][2][-1]).max() > 1e-11 * self._size:
                self.rays.append(Ray(_beside(at, mesh.place), at[0], -walks[-1][2][-1]))
        nodes = len(mesh.place)
        for arc, vertices, field in walks:
            at = mesh.place[vertices]
            for ray in self.rays:
                field = field - ray.times(at)[:, None] * ray.at(at)
            if vertices[0] == vertices[-1] and np.abs(field[-1]).max() > BALANCED * self._size:
                raise UnlikeError("a part of the body that bears loads hangs on nothing")
            unknown = 3 * vertices[::-1, None] + [0, 1, 2]
            self.value[unknown], self.fixed[unknown] = field[::-1], True
            edge = border.edge[arc]
            self.value[3 * nodes + edge] = (self._bulge[arc] * mesh.normal[edge]).sum(axis=1)
            self.fixed[3 * nodes + edge] = True

    def _join(self, free: list[Ints], slips: list[Ints]) -> None:
        """Say which constants of the parts of the border are unknown, and what is known of them."""
        # three of each free one, the value and slopes of a linear function, then one of each slip
        border, mesh, part = self.border, self.mesh, self.mesh.parts
        owner = np.full((len(mesh.place), 3), -1)
        groups = [np.unique(border.ends[arc]) for arc in free]
        for k, vertices in enumerate(groups):
            owner[vertices] = own = 3 * k + np.arange(3)
            x, y = (mesh.place[vertices] - mesh.place[vertices].mean(axis=0)).T
            one = np.ones(len(vertices), dtype=np.int64)
            for row, column, value in ((0, 0, 1.0), (0, 1, x), (0, 2, y), (1, 1, 1.0), (2, 2, 1.0)):
                self._columns.append((3 * vertices + row, one * own[column], value))
        width = 3 * len(free) + len(slips)
        ties, known = [], []
        for k, arc in enumerate(slips, 3 * len(free)):
            slope = 1 + int(np.flatnonzero(border.held[arc[0]])[0])
            vertices = np.append(border.ends[arc, 0], border.ends[arc[-1], 1])
            place, off = mesh.place[vertices], np.zeros(len(vertices))
            for ray in self.rays:
                off -= ray.times(place) * ray.growth[slope]
            tied = owner[vertices, slope] >= 0
            ties += [(k, one) for one in owner[vertices[tied], slope].tolist()]
            known += (self.value[3 * vertices + slope] - off)[tied].tolist()
            own = vertices[~tied]
            self.value[3 * own + slope] = off[~tied]
            self._columns.append((3 * own + slope, np.full(len(own), k), 1.0))
            self.fixed[3 * own + slope] = self.fixed[3 * len(mesh.place) + border.edge[arc]] = True
        # constants that are tied are one, but for what is known
        both = np.array(ties, dtype=np.int64).reshape(-1, 2)
        apart = np.eye(width)[both[:, 0]] - np.eye(width)[both[:, 1]]
        some = np.linalg.lstsq(apart, np.array(known), rcond=None)[0] if ties else np.zeros(width)
        if ties and np.abs(apart @ some - known).max() > BALANCED * self._size:
            raise UnlikeError("a part of the body that bears loads could move")
        group = joined(both, width)
        given = np.zeros(width, dtype=np.bool_)
        # a linear function on each part of the body bears no stress: somewhere, rather on its
        # longest free border, φ and its slopes are none
        long = np.array([*(len(one) for one in groups), 0])
        for number in range(int(part.max()) + 1):
            inner = np.flatnonzero(part == number)
            rank = long[owner[inner, 0] // 3] + 0.5 * (owner[inner] < 0).all(axis=1)
            at = int(inner[rank.argmax()])
            for k, column in enumerate(owner[at].tolist()):
                if column < 0:
                    self.fixed[3 * at + k] = True
                else:
                    given |= group == group[column]
        rest, group = np.unique(np.where(given, -1, group), return_inverse=True)
        every = coo(self._columns, (self.count, width))
        merged = np.arange(len(rest)) == group[:, None]
        self.value = self.value + every @ some
        self.free = sp.csr_array(every @ sp.csr_array(merged[:, rest >= 0].astype(np.float64)))


def _beside(ring: Floats, places: Floats) -> Floats:
    """Return a point within a hole, at a height that no vertex has, that sees its border once."""
    low, high = ring[:, 1].min(), ring[:, 1].max()
    heights = np.unique(np.clip(places[:, 1], low, high))
    k = int(np.diff(heights).argmax())
    y = 0.5 * (heights[k] + heights[k + 1])
    (x0, y0), (x1, y1) = ring[:-1].T, ring[1:].T
    on = (y0 > y) != (y1 > y)
    x = np.sort(x0[on] + (y - y0[on]) / (y1[on] - y0[on]) * (x1[on] - x0[on]))
    return np.array([0.5 * (x[-1] + x[-2]), y])
