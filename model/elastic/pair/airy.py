"""The opinion that balances: a stress that hands on exactly what arrives.

First agents, as rigid blocks, hand on forces and couples by their edges: the least squares of
the tractions that balance all loads. Airy's function then makes of this stress the one of least
complementary energy. It has no traction on free edges: there phi and its slopes are those of a
linear function, one for each stretch of free edges; along a roller the slope across is constant.
Round a hole that bears forces of unknown size phi takes several values: beyond a cut from the hole
to the right, vertices have copies, which differ by a linear function with three unknowns.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of
from kaju.model.elastic.pair.border import Sides
from kaju.model.elastic.pair.elements import (
    EDGES,
    airy_of_tractions,
    forms,
    on_sides,
    without_plane,
)
from kaju.model.elastic.pair.leaf_mesh import (
    Entries,
    PlaneMesh,
    backwards,
    coo,
    followed,
    on_cubic,
)
from kaju.model.elastic.pair.levels import Blocks

LINEAR = [(0, 0), (0, 1), (0, 2), (1, 1), (2, 2)]
"""Which of phi, phi_x, phi_y a linear function enters by its value, its slope along x, along y."""


def compliance(law: Floats) -> Floats:
    """Return the compliances of like and unlike normal stresses, and of shear; shape (3, n)."""
    stretch, lateral, shear = law
    area = (stretch - lateral) * (stretch + lateral)
    return np.stack([stretch / area, -lateral / area, 1.0 / shear])


def loops_of(mesh: PlaneMesh) -> list[Ints]:
    """Return the rows of the border's edges in the order of a walk, loop by loop."""
    start, end = mesh.along()
    following = np.full(mesh.vertices, -1)
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


def _closed(given: Flags) -> Flags:
    """Tell which of phi, phi_x and phi_y are given all round a loop by its edges' tractions."""
    along_x, along_y = (bool(given[:, axis].all()) for axis in (0, 1))
    return np.array([along_x and along_y, along_y, along_x])


class Airy:
    """Unknowns of phi: of vertices, copies and edges, then three for each cut."""

    def __init__(self, mesh: PlaneMesh, sides: Sides, cell: int) -> None:
        self.mesh, self.sides, self.cell = mesh, sides, cell
        self.loops = loops_of(mesh)
        self._cut()
        self.points = mesh.vertices + len(self.base)
        self.jump = 3 * self.points + mesh.edges
        self.size = self.jump + 3 * len(self.closed)
        self.place = np.concatenate([mesh.place, np.zeros((len(self.base), 2))]) / cell
        for copy, base in enumerate(self.base.tolist(), mesh.vertices):
            self.place[copy] = self.place[base]

    def _cut(self) -> None:
        """Cut the body to the right of every hole that something holds.

        Beyond a cut agents see copies of the vertices, where phi has jumped: `corner` are the
        vertices or copies at their corners, `base` and `beyond` say what vertex, or earlier copy,
        each copy is of, and beyond which cut it lies; `closed` which of a cut's forces along x and
        y, and couple, are none, and `cut_part` in what part of the body it is.
        """
        mesh, given = self.mesh, self.sides.given
        start, end = mesh.along()
        place, corner, lower, upper = mesh.place, mesh.corner, mesh.leaves.lower, mesh.leaves.upper
        base, beyond = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        closed: list[Flags] = []
        parts, count = [], mesh.vertices
        for loop in self.loops:
            if not self._is_hole(loop) or given[loop].all():
                continue
            a, b = place[start[loop]], place[end[loop]]
            right = a[:, 0] == max(a[:, 0].max(), b[:, 0].max())
            right &= a[:, 0] == b[:, 0]
            height = min(a[right, 1].min(), b[right, 1].min()) + 0.5
            # An agent on the cut sees what lies below it with the jump.
            on = (lower[:, 1] < height) & (height < upper[:, 1]) & (lower[:, 0] >= a[right][0, 0])
            below = on[:, None] & (place[mesh.corner][..., 1] < height)
            own = np.unique(corner[below])
            # A vertex that no other agent sees would stand alone; copies follow their vertices.
            own = own[np.isin(own, corner[~below]) | (own >= mesh.vertices)]
            table = np.arange(count)
            table[own] = count + np.arange(len(own))
            corner = np.where(below, table[corner], corner)
            base.append(own)
            beyond.append(np.full(len(own), len(closed)))
            closed.append(_closed(given[loop]))
            parts.append(mesh.part[mesh.owner[loop[0]]])
            count += len(own)
        self.corner, self.closed = corner, np.array(closed, dtype=np.bool_).reshape(-1, 3)
        self.base, self.beyond = np.concatenate(base), np.concatenate(beyond)
        self.cut_part = np.array(parts, dtype=np.int64)

    def _is_hole(self, loop: Ints) -> bool:
        """Tell whether a loop of the border goes round a hole: clockwise."""
        start, end = self.mesh.along()
        a, b = self.mesh.place[start[loop]], self.mesh.place[end[loop]]
        return bool(np.sum(a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]) < 0)

    def blocks(self, laws: list[tuple[Ints | slice, Floats]], size: Floats) -> Blocks:
        """Return the compliance of the agents and of the beds."""
        corner = (3 * self.corner[:, :, None] + np.arange(3)).reshape(-1, 12)
        dof = np.concatenate([corner, 3 * self.points + self.mesh.edge], axis=1)
        one, h = np.ones_like(size), size
        scale = np.stack([*[one, h, h] * 4, *[h] * 4], axis=1)
        matrices = [
            (agents, np.einsum("kij,k->ij", forms(True), compliance(own[:, None])[:, 0]))
            for agents, own in laws
        ]
        return Blocks(dof, matrices, size**-2.0, scale, self.size, self._beds(), without_plane)

    def _beds(self) -> sp.csr_array | None:
        beds = self.sides.beds
        if not len(beds):
            return None
        rows = self.bed_rows(beds)
        length = self.mesh.length[self.mesh.border[beds]] / self.cell
        even = (length / self.sides.bed[beds])[:, None, None]
        blocks, count = even * np.array([[1 / 3, 1 / 6], [1 / 6, 1 / 3]]), len(beds)
        mass = sp.bsr_array((blocks, np.arange(count), np.arange(count + 1)))
        return sp.csr_array(rows.T @ mass @ rows)

    def bed_rows(self, beds: Ints) -> sp.csr_array:
        """Return the tractions across beds at both ends of edges by phi: its second derivative."""
        mesh = self.mesh
        start, end = (self.seen(beds, at) for at in (0, 1))
        length = mesh.length[mesh.border[beds]] / self.cell
        slope = 2 - mesh.side[beds] // 2
        columns = np.stack([3 * start, 3 * start + slope, 3 * end, 3 * end + slope], axis=1)
        low = np.stack([-6 / length**2, -4 / length, 6 / length**2, -2 / length], axis=1)
        high = np.stack([6 / length**2, 2 / length, -6 / length**2, 4 / length], axis=1)
        values = np.stack([low, high], axis=1).ravel()
        at = np.repeat(np.arange(2 * len(beds)), 4), np.repeat(columns, 2, axis=0).ravel()
        return sp.csr_array((values, at), shape=(2 * len(beds), self.size))

    def seen(self, rows: Ints, end: int) -> Ints:
        """Return the vertices or copies at the ends of border edges, as their agents see them."""
        corner = on_sides(2)[self.mesh.side[rows], end]
        return np.asarray(self.corner[self.mesh.owner[rows], corner])

    def way(self) -> tuple[sp.csr_array, Ints, sp.csr_array]:
        """Return what all unknowns are by the free ones, which these are, and how they turn."""
        self._follow: Entries = []
        fixed = np.zeros(self.size, dtype=np.bool_)
        self._hang()
        copies = self.mesh.vertices + np.arange(len(self.base))
        for k in range(3):
            self._follow.append((3 * copies + k, 3 * self.base + k, 1.0))
        self._jump(copies, self.beyond, 1.0)
        self._stretches: list[tuple[int, Ints]] = []
        begun: dict[int, tuple[float, int]] = {}
        for loop in self.loops:
            count, part = len(self._stretches), int(self.mesh.part[self.mesh.owner[loop[0]]])
            begun[part] = max(begun.get(part, (-1.0, 0)), (-0.5, self._walk(loop, fixed)))
            for first, ends in self._stretches[count:]:
                long = float(np.ptp(self.place[ends], axis=0).sum())
                begun[part] = max(begun[part], (long, first))
        self._close(fixed)
        way, follows = followed(self._follow, self.size)
        # A linear function has no stress: phi and its slopes vanish in every part, along the
        # longest stretch of free edges, or somewhere.
        for _, first in begun.values():
            for k in range(3):
                terms = way[[3 * first + k]].indices
                fixed[terms[(terms < 3 * self.points) & (terms % 3 == k)]] = True
        free = np.flatnonzero(~(follows | fixed))
        return self._centred(sp.csr_array(way[:, free]), free)

    def _centred(self, way: sp.csr_array, free: Ints) -> tuple[sp.csr_array, Ints, sp.csr_array]:
        """Let linear functions along free stretches turn about their middles, not their ends."""
        # Of the columns where phi begins so much is added to those of its slopes.
        number = np.full(self.size, -1)
        number[free] = np.arange(len(free))
        rows, columns, values = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], []
        values.append(np.zeros(0))
        for first, ends in self._stretches:
            if number[3 * first] >= 0:
                arm = self.place[first] - self.place[ends].mean(axis=0)
                for k in (1, 2):
                    slope = way[[3 * first + k]]
                    columns.append(slope.indices.astype(np.int64))
                    rows.append(np.full(slope.nnz, number[3 * first]))
                    values.append(arm[k - 1] * slope.data)
        at = np.concatenate(rows), np.concatenate(columns)
        turn = sp.csr_array((np.concatenate(values), at), shape=(len(free),) * 2)
        return sp.csr_array(way + way @ turn), free, turn

    def _jump(
        self, point: Ints, cut: Ints | int, times: float, terms: list[tuple[int, int]] = LINEAR
    ) -> None:
        """Add so many times the linear functions of cuts to phi at vertices or copies."""
        for k, by in terms:
            value = times * (self.place[point, by - 1] if by > k else 1.0)
            column = np.broadcast_to(self.jump + 3 * np.asarray(cut) + by, point.shape)
            self._follow.append((3 * point + k, column, value))

    def _chain(self, vertex: int) -> list[int]:
        """Return the cuts that a copy lies beyond."""
        found = []
        while vertex >= self.mesh.vertices:
            found.append(int(self.beyond[vertex - self.mesh.vertices]))
            vertex = int(self.base[vertex - self.mesh.vertices])
        return found

    def _hang(self) -> None:
        """Let the middles of whole edges, and the bulges of their halves, follow these."""
        mesh, follow, corner = self.mesh, self._follow, self.corner
        owner, number = np.zeros(mesh.edges, dtype=np.int64), np.zeros(mesh.edges, dtype=np.int64)
        owner[mesh.edge.ravel()] = np.repeat(np.arange(len(mesh.edge)), 4)
        number[mesh.edge.ravel()] = np.tile(np.arange(4), len(mesh.edge))

        def seen(edge: Ints, end: int) -> Ints:
            return np.asarray(corner[owner[edge], EDGES[number[edge], end]])

        # Ends and middle as they are seen from one sheet: that of the smaller agents, or, where
        # a cut runs between these, that of the whole edge and of the half that sees its end.
        first, second = mesh.halves
        middle, axis = mesh.middle, mesh.axis[mesh.whole]
        view = seen(first, 1)
        torn = view != seen(second, 0)
        start = np.where(torn, seen(mesh.whole, 0), seen(first, 0))
        end = np.where(torn, seen(mesh.whole, 1), seen(second, 1))
        view = np.where(torn & (seen(first, 0) != start), seen(second, 0), view)
        length = mesh.length[mesh.whole] / self.cell
        bulge = 3 * self.points + mesh.whole
        follow += on_cubic(middle, start, 1.0, axis, length)
        follow += on_cubic(middle, end, -1.0, axis, length)
        follow.append((3 * middle + 2 - axis, bulge, 1.0))
        follow += [(3 * self.points + half, bulge, 0.25) for half in mesh.halves]
        for own, copy in zip(middle, view.tolist(), strict=True):
            for cut in self._chain(copy):
                self._jump(own[None], cut, -1.0)

    def _walk(self, loop: Ints, fixed: Flags) -> int:
        """Say what tractions along a loop of the border are none; return where it began."""
        mesh, given = self.mesh, self.sides.given[loop]
        axis = mesh.axis[mesh.border[loop]]
        kind = np.where(given.all(axis=1), 3, np.where(given.any(axis=1), 1 + axis, 0))
        # The walk begins behind a held stretch, or a roller: at its end phi itself is free again.
        change = np.flatnonzero(kind != np.roll(kind, 1))
        turn = int(change[np.argmin(np.roll(kind, 1)[change])]) if len(change) else 0
        # What is given all along the loop closes by itself, since the loads balance.
        closed = _closed(given).tolist()
        loop, kind = np.roll(loop, -turn), np.roll(kind, -turn)
        start, end = mesh.along()
        back = backwards(mesh.side[loop])
        seen = [np.where(back, self.seen(loop, 1 - e), self.seen(loop, e)) for e in (0, 1)]
        vertex = start[loop]
        breaks = [0, *(np.flatnonzero(np.diff(kind)) + 1).tolist(), len(loop)]
        last = vertex[0]
        for low, high in pairwise(breaks):
            if kind[low] == 0:
                continue
            rows = np.arange(low, high)
            fixed[3 * self.points + mesh.border[loop[rows]]] = True
            # Vertices of the stretch but the first follow it; those beyond cuts less the jumps.
            first = vertex[low]
            if kind[low] == 3:
                self._stretches.append((int(first), end[loop[rows]]))
            terms = {3: LINEAR, 1: [(2, 2)], 2: [(1, 1)]}[int(kind[low])]
            for k, by in terms:
                own = end[loop[rows]]
                # The walk's first vertex, met again in the end, follows where this closes no ring.
                own = own[own != last] if closed[k] else own
                value = (self.place[own] - self.place[first])[:, by - 1] if by > k else 1.0
                self._follow.append((3 * own + k, np.full(len(own), 3 * first + by), value))
            self._over_cuts(terms, rows, seen, end[loop], last, closed)
        return int(last)

    def _over_cuts(
        self,
        terms: list[tuple[int, int]],
        rows: Ints,
        seen: list[Ints],
        end: Ints,
        last: int,
        closed: list[bool],
    ) -> None:
        """Take the jumps off where a stretch of the border crosses cuts."""
        passed: dict[int, int] = {}
        for row in rows.tolist() if len(self.base) else ():
            # Within an edge both ends are seen on one sheet; between edges the sheet may change.
            for cut in self._chain(int(seen[0][row])):
                passed[cut] = passed.get(cut, 0) + 1
            for cut in self._chain(int(seen[1][row])):
                passed[cut] = passed.get(cut, 0) - 1
            own = end[[row]]
            open_ = [one for one in terms if not (own[0] == last and closed[one[0]])]
            for cut, times in passed.items():
                if times:
                    self._jump(own, cut, times, open_)

    def _close(self, fixed: Flags) -> None:
        """Say that forces and couples of cuts that the border leaves no room for are none."""
        for cut, closed in enumerate(self.closed):
            fixed[self.jump + 3 * cut + np.flatnonzero(closed)] = True
        for loop in self.loops if len(self.closed) else ():
            if self._is_hole(loop):
                continue
            own = np.flatnonzero(self.cut_part == self.mesh.part[self.mesh.owner[loop[0]]])
            for k, none in enumerate(_closed(self.sides.given[loop]).tolist()):
                left = own[~self.closed[own, k]]
                if none and len(left):
                    row = self.jump + 3 * left[-1:] + k
                    fixed[row] = len(left) == 1
                    for other in left[:-1]:
                        self._follow.append((row, self.jump + 3 * other[None] + k, -1.0))


def first_stress(mesh: PlaneMesh, sides: Sides, size: Floats) -> Floats:
    """Return phi of each agent, shape (n, 16), of a stress that balances the loads."""
    # Unknown are force and couple of each edge, but of halves, which follow the whole edge, and
    # where the traction is given. A row of `matrix` is a force on an agent, or its couple over h.
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
    free = ~follows
    border, normal = number[mesh.border], mesh.side // 2
    free[border[:, :2]] &= ~sides.given
    free[border[:, 2]] &= ~sides.given[np.arange(len(border)), normal]
    way = sp.csr_array(every[:, np.flatnonzero(free)])
    # Couples weigh as tractions of the same size.
    weight = np.tile([1.0, 1.0, 1.0 / 12.0], edges)[free]
    balance = sp.csr_array(matrix @ way)
    wanted = -_resultants(sides)
    normal_matrix = sp.csc_array(balance @ sp.diags_array(weight) @ balance.T)
    factors = factors_of(normal_matrix)
    found = factors.solve(wanted)
    found = found + factors.solve(wanted - normal_matrix @ found)
    flow = (way @ (weight * (balance.T @ found))).reshape(-1, 3)
    traction = sides.load.copy()
    for side in range(4):
        axis, sign = side // 2, 2.0 * (side % 2) - 1.0
        traction[:, side, 0] += sign * flow[own[:, side], :2]
        traction[:, side, 1, axis] += sign * flow[own[:, side], 2]
        # A body force is met by a stress that grows along each axis: half of it at either end.
        traction[:, side, 0, axis] += 0.5 * sides.body[:, axis]
    return np.asarray(size[:, None] * np.einsum("ijkl,njkl->ni", airy_of_tractions(), traction))


def _resultants(sides: Sides) -> Floats:
    """Return the loads' forces on each agent, and their couples about its middle over its edge."""
    force, moment = sides.load[:, :, 0], sides.load[:, :, 1]
    total = force.sum(axis=1) + sides.body
    couple = 0.5 * (force[:, 1, 1] - force[:, 0, 1]) - 0.5 * (force[:, 3, 0] - force[:, 2, 0])
    couple = couple + moment[:, 2, 1] + moment[:, 3, 1] - moment[:, 0, 0] - moment[:, 1, 0]
    return np.concatenate([total, couple[:, None]], axis=1).ravel()
