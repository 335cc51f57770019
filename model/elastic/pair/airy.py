"""The opinion that balances: a stress that hands on exactly what arrives.

First agents, as rigid blocks, hand on forces and couples by their edges: the least squares of
the tractions that balance all loads. Airy's function then makes of this stress the one of least
complementary energy. It has no traction on free edges: there phi and its slopes are those of a
linear function, one for each stretch of free edges; along a roller the slope across is constant.
Round a hole that bears forces of unknown size phi takes several values: beyond a cut from the hole
to the right, vertices have copies, which differ by a linear function with three unknowns.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of
from kaju.model.elastic.pair.border import Sides
from kaju.model.elastic.pair.elements import (
    EDGES,
    airy_of_tractions,
    edge_tractions,
    gauss,
    on_sides,
    without_plane,
)
from kaju.model.elastic.pair.leaf_mesh import (
    Entries,
    PlaneMesh,
    backwards,
    coo,
    followed,
)
from kaju.model.elastic.pair.levels import Blocks, summed

LINEAR = [(0, 0), (0, 1), (0, 2), (1, 1), (2, 2)]
"""Which of phi, phi_x, phi_y a linear function enters by its value, its slope along x, along y."""


def loops_of(start: Ints, end: Ints) -> list[Ints]:
    """Return the rows of the border's edges in the order of a walk, loop by loop."""
    following = np.full(max(start.max(), end.max()) + 1, -1)
    following[start] = np.arange(len(start))
    step, left = following[end].tolist(), [True] * len(start)
    loops = []
    for first in range(len(start)):
        loop = []
        while left[first]:
            left[first] = False
            loop.append(first)
            first = step[first]
        if loop:
            loops.append(np.array(loop))
    return loops


class Airy:
    """Unknowns of phi: of vertices, copies and edges, then three for each cut."""

    def __init__(self, mesh: PlaneMesh, sides: Sides, cell: int) -> None:
        self.mesh, self.sides, self.cell = mesh, sides, cell
        start, end = mesh.along()
        # 3 where tractions are none, 1 (along x) or 2 along rollers and beds, 0 where all is held.
        given, axis = sides.given, mesh.axis[mesh.border]
        self.kind = np.where(given.all(axis=1), 3, np.where(given.any(axis=1), 1 + axis, 0))
        self.loops = []
        for loop in loops_of(start, end):
            change = np.flatnonzero(self.kind[loop] != self.kind[np.roll(loop, 1)])
            self.loops.append(np.roll(loop, -change[0]) if len(change) else loop)
        # Which of phi, phi_x and phi_y the tractions give all round each loop.
        by_x, by_y = np.array([given[loop].all(axis=0) for loop in self.loops]).T
        self.closed = np.stack([by_x & by_y, by_y, by_x], axis=1)
        a, b = mesh.place[start], mesh.place[end]
        turn = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        self.hole = np.array([turn[loop].sum() < 0 for loop in self.loops])  # clockwise
        self.loop_part = mesh.part[mesh.owner[[loop[0] for loop in self.loops]]]
        self._cut(a, b)
        self.points = len(self.base)
        self.jump = 3 * self.points + mesh.edges
        self.size = self.jump + 3 * len(self.cuts)
        self.place = mesh.place[self.base] / cell

    def _cut(self, a: Ints, b: Ints) -> None:
        """Cut the body to the right of every hole that something holds: `cuts` are their loops.

        Beyond a cut agents see copies of the vertices, where phi has jumped: `corner` are the
        vertices or copies at their corners; `base` is the vertex that each is a copy of, and
        `beyond` tells which cuts each lies beyond.
        """
        mesh = self.mesh
        place, corner, lower, upper = mesh.place, mesh.corner, mesh.leaves.lower, mesh.leaves.upper
        self.cuts = np.flatnonzero(self.hole & ~self.closed.all(axis=1))
        base = np.arange(mesh.vertices)
        beyond = np.zeros((len(base), len(self.cuts)), dtype=np.int64)
        for cut, number in enumerate(self.cuts.tolist()):
            low, high = a[self.loops[number]], b[self.loops[number]]
            right = low[:, 0] == max(low[:, 0].max(), high[:, 0].max())
            right &= low[:, 0] == high[:, 0]
            height = min(low[right, 1].min(), high[right, 1].min()) + 0.5
            # An agent on the cut sees what lies below it with the jump.
            on = (lower[:, 1] < height) & (height < upper[:, 1]) & (lower[:, 0] >= low[right][0, 0])
            below = on[:, None] & (place[mesh.corner][..., 1] < height)
            own = np.unique(corner[below])
            # A vertex that no other agent sees would stand alone; copies follow their vertices.
            own = own[np.isin(own, corner[~below]) | (own >= mesh.vertices)]
            table = np.arange(len(base))
            table[own] = len(base) + np.arange(len(own))
            corner = np.where(below, table[corner], corner)
            base = np.append(base, base[own])
            beyond = np.concatenate([beyond, beyond[own]])
            beyond[len(table) :, cut] += 1
        self.corner, self.base, self.beyond = corner, base, beyond

    def blocks(self, matrices: list[tuple[Ints | slice, Floats]], size: Floats) -> Blocks:
        """Return the compliance of the agents and of the beds."""
        corner = (3 * self.corner[:, :, None] + np.arange(3)).reshape(-1, 12)
        dof = np.concatenate([corner, 3 * self.points + self.mesh.edge], axis=1)
        one, h = np.ones_like(size), size
        scale = np.stack([*[one, h, h] * 4, *[h] * 4], axis=1)
        beds, rows = None, bed_rows(self.mesh, self.sides, size)
        if len(rows):
            owner = self.mesh.owner[self.sides.beds]
            rows = rows * scale[owner, None]
            beds = summed(np.einsum("bpi,bpj->bij", rows, rows), dof[owner], self.size)
        return Blocks(dof, matrices, size**-2.0, scale, self.size, beds, without_plane)

    def seen(self, rows: Ints, end: int | Ints) -> Ints:
        """Return the vertices or copies at the ends of border edges, as their agents see them."""
        corner = on_sides(2)[self.mesh.side[rows], end]
        return np.asarray(self.corner[self.mesh.owner[rows], corner])

    def way(self) -> tuple[sp.csr_array, Ints, sp.csr_array | None]:
        """Return what all unknowns are by the free ones, which these are, and how they turn."""
        fixed = np.zeros(self.size, dtype=np.bool_)
        copies = np.arange(self.mesh.vertices, self.points)
        follow: Entries = [(3 * copies + k, 3 * self.base[copies] + k, 1.0) for k in range(3)]
        follow += self._jumps(copies, self.beyond[copies])
        follow += self._hanging() + self._border(fixed) + self._shut(fixed)
        way, follows = followed(follow, self.size)
        # A linear function has no stress: phi and its slopes vanish in every part, along the
        # longest stretch of free edges, or somewhere.
        first, middle, long, part = self._stretches
        order = np.lexsort((long, part))
        for one in first[order[np.append(np.diff(part[order]) > 0, True)]].tolist():
            for k in range(3):
                terms = way[[3 * one + k]].indices
                fixed[terms[(terms < 3 * self.points) & (terms % 3 == k)]] = True
        free = np.flatnonzero(~(follows | fixed))
        number = np.full(self.size, -1)
        number[free] = np.arange(len(free))
        way = sp.csr_array(way[:, free])
        # Let linear functions along free stretches turn about their middles, not their ends: of
        # the columns where phi begins so much is added to those of its slopes.
        some = np.flatnonzero((long > 0.0) & (number[3 * first] >= 0))
        if not len(some):
            return way, free, None
        first, arm = first[some], self.place[first[some]] - middle[some]
        turn = sp.csr_array((len(free), len(free)))
        for k in (1, 2):
            at = number[3 * first], np.arange(len(some)), arm[:, k - 1]
            turn = turn + coo([at], (len(free), len(some))) @ way[3 * first + k]
        return sp.csr_array(way + way @ turn), free, turn

    def _jumps(self, point: Ints, times: Ints, terms: list[tuple[int, int]] = LINEAR) -> Entries:
        """Add the linear functions of cuts, each so many times, to phi at vertices or copies."""
        row, cut = np.nonzero(times)
        own, entries = point[row], Entries()
        for k, by in terms:
            value = times[row, cut] * (self.place[own, by - 1] if by > k else 1.0)
            entries.append((3 * own + k, self.jump + 3 * cut + by, value))
        return entries

    def _hanging(self) -> Entries:
        """Let the middles of whole edges, and the bulges of their halves, follow these."""
        mesh, corner = self.mesh, self.corner
        owner, number = np.zeros(mesh.edges, dtype=np.int64), np.zeros(mesh.edges, dtype=np.int64)
        owner[mesh.edge.ravel()] = np.repeat(np.arange(len(mesh.edge)), 4)
        number[mesh.edge.ravel()] = np.tile(np.arange(4), len(mesh.edge))

        def seen(edge: Ints, end: int) -> Ints:
            return np.asarray(corner[owner[edge], EDGES[number[edge], end]])

        # Ends and middle as the agent of the whole edge sees them: between it and that of a half
        # the sheet changes by as much in the middle as at the end of both.
        half, middle, axis = mesh.halves[0], mesh.middle, mesh.axis[mesh.whole]
        start, last = seen(mesh.whole, 0), seen(mesh.whole, 1)
        times = self.beyond[seen(half, 1)] + self.beyond[start] - self.beyond[seen(half, 0)]
        length, bulge = mesh.length[mesh.whole] / self.cell, 3 * self.points + mesh.whole
        along, across = 1 + axis, 2 - axis
        entries = self._jumps(middle, -times)
        # Along the edge phi is Hermite's cubic, its slope across that of the ends but for the
        # bulge.
        for end, sign in ((3 * start, 1.0), (3 * last, -1.0)):
            entries += [
                (3 * middle, end, 0.5),
                (3 * middle, end + along, sign * length / 8.0),
                (3 * middle + along, end, -sign * 1.5 / length),
                (3 * middle + along, end + along, -0.25),
                (3 * middle + across, end + across, 0.5),
            ]
        entries.append((3 * middle + across, bulge, 1.0))
        return entries + [(3 * self.points + one, bulge, 0.25) for one in mesh.halves]

    def _border(self, fixed: Flags) -> Entries:
        """Say what tractions along the border are none, walking along its loops."""
        mesh, row = self.mesh, np.concatenate(self.loops)
        loop = np.repeat(np.arange(len(self.loops)), [len(one) for one in self.loops])
        kind, (start, end) = self.kind[row], mesh.along()
        opens = (np.diff(loop, prepend=-1) > 0) | (np.diff(kind, prepend=-1) != 0)
        stretch, begins = np.cumsum(opens) - 1, start[row[opens]]
        fixed[3 * self.points + mesh.border[row[kind > 0]]] = True
        # Vertices of a stretch but the first follow it; those beyond cuts less the jumps. Within an
        # edge both ends are seen on one sheet; between edges the sheet may change.
        own, first = end[row], begins[stretch]
        back = backwards(mesh.side[row]).astype(np.int64)
        passed = self.beyond[self.seen(row, back)] - self.beyond[self.seen(row, 1 - back)]
        total = np.cumsum(passed, axis=0)
        total -= (total - passed)[opens][stretch]
        # What is given all along a loop closes by itself, since the loads balance: its first vertex
        # does not follow itself.
        last = start[[one[0] for one in self.loops]][loop] == own
        entries: Entries = []
        for k, by in LINEAR:
            on = (kind == 3) | ((kind == 3 - k) & (k == by) & (k > 0))
            on &= ~(last & self.closed[loop, k])
            arm = (self.place[own] - self.place[first])[on, by - 1] if by > k else 1.0
            entries.append((3 * own[on] + k, 3 * first[on] + by, arm))
            entries += self._jumps(own[on], total[on], [(k, by)])
        # Of each stretch its first vertex, its middle, its length if it is free, and its part.
        count = np.bincount(stretch)
        middle = np.stack([np.bincount(stretch, x) / count for x in self.place[own].T], axis=1)
        long = np.bincount(stretch, np.where(kind == 3, mesh.length[mesh.border[row]], 0.0))
        self._stretches = begins, middle, long, self.loop_part[loop[opens]]
        return entries

    def _shut(self, fixed: Flags) -> Entries:
        """Say that forces and couples of cuts that the border leaves no room for are none."""
        shut, entries = self.closed[self.cuts], Entries()
        fixed[self.jump :] = shut.ravel()
        for outer, k in np.argwhere(self.closed & ~self.hole[:, None]).tolist():
            left = np.flatnonzero(
                (self.loop_part[self.cuts] == self.loop_part[outer]) & ~shut[:, k]
            )
            # All together they are none: the last is less than none by the others.
            row = self.jump + 3 * left + k
            fixed[row[-1:]] = len(left) == 1
            entries.append((np.repeat(row[-1:], max(len(row) - 1, 0)), row[:-1], -1.0))
        return entries


def bed_rows(mesh: PlaneMesh, sides: Sides, size: Floats) -> Floats:
    """Return a root of the energy of beds, at four points each, by phi of agents: (beds, 4, 16)."""
    owner, side = mesh.owner[sides.beds], mesh.side[sides.beds]
    points, weight = gauss(4, 1)
    force, moment = np.moveaxis(edge_tractions()[side, :, side // 2], 1, 0)[:, :, None]
    root = np.sqrt(weight / (size[owner] ** 3 * sides.bed[sides.beds])[:, None])
    return np.asarray(root[..., None] * (force + 12.0 * (points - 0.5) * moment))


def first_stress(mesh: PlaneMesh, sides: Sides, load: Floats, body: Floats, size: Floats) -> Floats:
    """Return phi of each agent, (n, 16), of a stress that balances loads of agents."""
    # Unknown are force and couple of each edge, but where the traction is given.
    free = np.ones((mesh.edges, 3), dtype=np.bool_)
    free[mesh.border, :2] = ~sides.given
    free[mesh.border, 2] = ~sides.given[np.arange(len(mesh.border)), mesh.side // 2]
    # The least squares of the tractions: a row of `matrix` is a force on an agent, or its couple
    # over h. Halves follow the whole edge.
    n, edges = len(mesh.leaves), mesh.edges
    number = 3 * np.arange(edges)[:, None] + np.arange(3)
    own = mesh.edge[:, on_sides(2)[:, 2] - 4]  # by side
    entries: Entries = []
    for side in range(4):
        axis, sign = side // 2, 2.0 * (side % 2) - 1.0
        turn = 1.0 if axis else -1.0
        for row, column, value in (
            (0, 0, 1.0), (1, 1, 1.0), (2, 1 - axis, -0.5 * sign * turn), (2, 2, turn),
        ):  # fmt: skip
            entries.append((3 * np.arange(n) + row, number[own[:, side], column], sign * value))
    matrix = coo(entries, (3 * n, 3 * edges))
    follow: Entries = []
    whole, across = number[mesh.whole], 1 - mesh.axis[mesh.whole]
    for half, lean in zip(mesh.halves, (-1.5, 1.5), strict=True):
        for k, share in enumerate((0.5, 0.5, 0.25)):
            follow.append((number[half, k], whole[:, k], share))
        follow.append((number[half, across], whole[:, 2], lean))
    every, follows = followed(follow, 3 * edges)
    chosen = np.flatnonzero(free.ravel() & ~follows)
    way = sp.csr_array(every[:, chosen])
    # Couples weigh as tractions of the same size.
    weight = np.tile([1.0, 1.0, 1.0 / 12.0], edges)[chosen]
    balance = sp.csr_array(matrix @ way)
    wanted = -_resultants(load, body)
    normal = sp.csc_array(balance @ sp.diags_array(weight) @ balance.T)
    factors = factors_of(normal)
    found = factors.solve(wanted)
    found = found + factors.solve(wanted - normal @ found)
    flow = (way @ (weight * (balance.T @ found))).reshape(-1, 3)
    traction = load.copy()
    for side in range(4):
        axis, sign = side // 2, 2.0 * (side % 2) - 1.0
        traction[:, side, 0] += sign * flow[own[:, side], :2]
        traction[:, side, 1, axis] += sign * flow[own[:, side], 2]
        # A body force is met by a stress that grows along each axis: half of it at either end.
        traction[:, side, 0, axis] += 0.5 * body[:, axis]
    return np.asarray(size[:, None] * np.einsum("ijkl,njkl->ni", airy_of_tractions(), traction))


def _resultants(load: Floats, body: Floats) -> Floats:
    """Return the loads' forces on each agent, and their couples about its middle over its edge."""
    force, moment = load[:, :, 0], load[:, :, 1]
    total = force.sum(axis=1) + body
    couple = 0.5 * (force[:, 1, 1] - force[:, 0, 1]) - 0.5 * (force[:, 3, 0] - force[:, 2, 0])
    couple = couple + moment[:, 2, 1] + moment[:, 3, 1] - moment[:, 0, 0] - moment[:, 1, 0]
    return np.concatenate([total, couple[:, None]], axis=1).ravel()
