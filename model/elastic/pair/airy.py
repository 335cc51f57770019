"""The opinion that balances: a stress that hands on exactly what arrives.

First agents, as rigid blocks, hand on forces and couples by their edges: the least squares of
the tractions that balance all loads. Airy's function then makes of this stress the one of least
complementary energy. It has no traction on free edges: along a run of these phi is a linear
function; along a roller the slope across is constant. Round a hole that bears forces of unknown
size phi takes several values: beyond a cut from the hole to the right, vertices have copies, which
differ by a linear function. All these linear functions are unknowns that no agent has.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of
from kaju.model.elastic.pair.border import Sides
from kaju.model.elastic.pair.elements import (
    EDGE_OF_SIDE,
    EDGES,
    airy_of_tractions,
    edge_tractions,
    gauss,
    on_sides,
    without_plane,
)
from kaju.model.elastic.pair.leaves import (
    Entries,
    PlaneMesh,
    backwards,
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
    """Unknowns of phi: of vertices, copies and edges, three for each cut, then those of runs."""

    def __init__(self, mesh: PlaneMesh, sides: Sides, cell: int) -> None:
        self.mesh, self.sides, self.cell = mesh, sides, cell
        loops = loops_of(*mesh.along())
        self.row, count = np.concatenate(loops), np.array([len(one) for one in loops])
        self.begins, self.loop = np.cumsum(count) - count, np.repeat(np.arange(len(count)), count)
        self.before = np.arange(len(self.row)) - 1
        self.before[self.begins] += count
        self.start, self.end = (one[self.row] for one in mesh.along())
        # Along which edges phi is linear, phi_x is even, phi_y is even: where tractions are none.
        given = sides.given[self.row]
        self.linear = np.stack([given.all(axis=1), given[:, 1], given[:, 0]])
        self.closed = np.logical_and.reduceat(self.linear, self.begins, axis=1).T
        a, b = mesh.place[self.start], mesh.place[self.end]
        turn = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        self.hole = np.add.reduceat(turn, self.begins) < 0  # clockwise
        self.part = mesh.part[mesh.owner[self.row]]
        self._cut(a, b)
        self.points = len(self.base)
        self.jump = 3 * self.points + mesh.edges
        self.place = mesh.place[self.base] / cell
        self.size = self.jump + 3 * len(self.cuts)
        self.runs: list[tuple[Ints, Flags]] = []
        for on in self.linear:
            number, early = self._numbered(on)
            self.runs.append((self.size + number, early))
            self.size += int(number[on].max(initial=-1)) + 1

    def _numbered(self, on: Flags) -> tuple[Ints, Flags]:
        """Return the number of the run of every edge, and which run on from their loop's end."""
        opens = on & ~on[self.before]
        opens[self.begins[np.logical_and.reduceat(on, self.begins)]] = True
        number = np.cumsum(opens) - 1
        early = on & (number < (number + ~opens)[self.begins][self.loop])
        return number + early * np.add.reduceat(opens, self.begins, dtype=int)[self.loop], early

    def _cut(self, a: Ints, b: Ints) -> None:
        """Cut the body to the right of every hole that something holds: `cuts` are their loops.

        Beyond a cut agents see copies of the vertices, where phi has jumped: `corner` are the
        vertices or copies at their corners; `base` is the vertex that each is a copy of, and
        `beyond` tells how often it has jumped at each cut.
        """
        mesh, corner = self.mesh, self.mesh.corner
        lower, upper, high = mesh.leaves.lower, mesh.leaves.upper, mesh.place[corner][..., 1]
        self.cuts = np.flatnonzero(self.hole & ~self.closed.all(axis=1))
        sheet = np.zeros((*corner.shape, len(self.cuts)), dtype=np.int64)
        for cut, number in enumerate(self.cuts.tolist()):
            ends = np.stack([a, b])[:, self.loop == number]
            far = ends[..., 0].max()
            height = ends[:, (ends[..., 0] == far).all(axis=0), 1].min(axis=0).min() + 0.5
            # An agent on the cut sees what lies below it with the jump.
            on = (lower[:, 1] < height) & (height < upper[:, 1]) & (lower[:, 0] >= far)
            sheet[..., cut] = on[:, None] & (high < height)
        some = np.isin(corner, corner[sheet.any(axis=2)])
        rows, at = np.unique(
            np.column_stack([corner[some], sheet[some]]), axis=0, return_inverse=True
        )
        # The first of the rows of a vertex is the vertex itself.
        first = np.searchsorted(rows[:, 0], rows[:, 0])
        copies = np.flatnonzero(first < np.arange(len(rows)))
        own = rows[:, 0].copy()
        own[copies] = mesh.vertices + np.arange(len(copies))
        self.corner = corner.copy()
        self.corner[some] = own[at.ravel()]
        self.base = np.append(np.arange(mesh.vertices), rows[copies, 0])
        jumped = (rows - rows[first])[copies, 1:]
        self.beyond = np.concatenate([np.zeros((mesh.vertices, len(self.cuts)), int), jumped])

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

    def way(self) -> tuple[sp.csr_array, Ints]:
        """Return what all unknowns are by the free ones, and which these are."""
        fixed = np.zeros(self.size, dtype=np.bool_)
        copies = np.arange(self.mesh.vertices, self.points)
        follow: Entries = [(3 * copies + k, 3 * self.base[copies] + k, 1.0) for k in range(3)]
        follow += self._jumps(copies, self.beyond[copies])
        follow += self._hanging() + self._border(fixed) + self._shut(fixed)
        way, follows = followed(follow, self.size)
        free = np.flatnonzero(~(follows | fixed))
        return sp.csr_array(way[:, free]), free

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
        """Say what tractions along the border are none, run by run of its edges."""
        mesh, row, start, end = self.mesh, self.row, self.start, self.end
        fixed[3 * self.points + mesh.border[row[self.linear.any(axis=0)]]] = True
        # How often the sheet has changed before each edge: within an edge both ends are seen on
        # one, which may be another one along the next edge.
        back = backwards(mesh.side[row]).astype(np.int64)
        ends = on_sides(2)[mesh.side[row, None], np.stack([back, 1 - back], axis=1)]
        seen = self.beyond[self.corner[mesh.owner[row, None], ends]]
        passed = seen[:, 0] - seen[:, 1]
        before = np.cumsum(passed, axis=0) - passed
        before -= before[self.begins][self.loop]
        around = np.add.reduceat(passed, self.begins)[self.loop]
        # Linear functions count from the middles of their runs.
        free = np.flatnonzero(self.linear[0])
        run = np.unique(self.runs[0][0][free], return_inverse=True)[1]
        weight = mesh.length[mesh.border[row[free]]]
        middle, long = np.zeros((2, len(row))), np.zeros(len(row))
        long[free] = np.bincount(run, weight)[run]
        for k, x in enumerate(0.5 * (self.place[start] + self.place[end])[free].T):
            middle[k, free] = np.bincount(run, weight * x)[run] / long[free]
        entries, master = Entries(), np.arange(3 * self.points).reshape(-1, 3)
        for k, by in LINEAR:
            on, (unknown, early) = self.linear[k], self.runs[by]
            # The first vertex of every edge, and the last one of a run.
            last = self.before[on[self.before] & ~on]
            edge = np.concatenate([np.flatnonzero(on), last])
            vertex = np.concatenate([start[on], end[last]])
            times = (before + early[:, None] * around)[edge]
            times[len(edge) - len(last) :] += passed[last]
            arm = self.place[vertex, by - 1] - middle[by - 1, edge] if by > k else 1.0
            entries.append((3 * vertex + k, unknown[edge], arm))
            entries += self._jumps(vertex, times, [(k, by)])
            if k == by:
                master[vertex, k] = unknown[edge]
        # A linear function has no stress: one vanishes in every part, along its longest free run,
        # or at a vertex.
        order = np.lexsort((-start, long, self.part))
        chosen = order[np.append(np.diff(self.part[order]) > 0, True)]
        fixed[master[start[chosen]]] = True
        return entries

    def _shut(self, fixed: Flags) -> Entries:
        """Say that forces and couples of cuts that the border leaves no room for are none."""
        shut, part, entries = self.closed[self.cuts], self.part[self.begins], Entries()
        fixed[self.jump : self.jump + shut.size] = shut.ravel()
        for outer, k in np.argwhere(self.closed & ~self.hole[:, None]).tolist():
            left = np.flatnonzero((part[self.cuts] == part[outer]) & ~shut[:, k])
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
    # Agents are rigid blocks: `works` are the works of tractions of their sides, forces and first
    # moments, on their motions. `hands` are such tractions of what edges hand on: a force, and the
    # first moment of its component across.
    side, axis, sign = np.arange(4), np.arange(4) // 2, np.array([-1.0, 1.0, -1.0, 1.0])
    works, hands = np.zeros((3, 4, 2, 2)), np.zeros((4, 3, 2, 2))
    works[0, :, 0, 0] = works[1, :, 0, 1] = 1.0
    works[2, side, 0, 1 - axis] = 0.5 * sign * [1.0, 1.0, -1.0, -1.0]
    works[2, side, 1, axis] = [-1.0, -1.0, 1.0, 1.0]
    hands[:, 0, 0, 0] = hands[:, 1, 0, 1] = hands[side, 2, 1, axis] = sign
    # A row of `matrix` is a force on an agent, or its couple over its edge.
    n, number = len(mesh.leaves), np.arange(3 * mesh.edges).reshape(-1, 3)
    own = mesh.edge[:, EDGE_OF_SIDE]
    row, column = np.arange(3 * n).reshape(n, 3, 1, 1), number[own][:, None]
    share = np.einsum("rsij,seij->rse", works, hands)
    at, values = np.broadcast_arrays(row, column, share)[:2], np.broadcast_to(share, (n, 3, 4, 3))
    matrix = sp.csr_array((values.ravel(), tuple(x.ravel() for x in at)), (3 * n, number.size))
    # Unknown is what edges hand on but where the traction is given; halves follow the whole edge.
    free = np.ones((mesh.edges, 3), dtype=np.bool_)
    free[mesh.border, :2] = ~sides.given
    free[mesh.border, 2] = ~sides.given[np.arange(len(mesh.border)), mesh.side // 2]
    whole, across, follow = number[mesh.whole], 1 - mesh.axis[mesh.whole], Entries()
    for half, lean in zip(mesh.halves, (-1.5, 1.5), strict=True):
        follow += [(number[half, k], whole[:, k], (0.5, 0.5, 0.25)[k]) for k in range(3)]
        follow.append((number[half, across], whole[:, 2], lean))
    every, follows = followed(follow, number.size)
    chosen = np.flatnonzero(free.ravel() & ~follows)
    # The least squares, in which first moments weigh as tractions of the same size.
    weight = np.tile([1.0, 1.0, 1.0 / 12.0], mesh.edges)[chosen]
    balance = sp.csr_array(matrix @ every[:, chosen])
    wanted = np.einsum("rsij,nsij->nr", works, -load)
    wanted[:, :2] -= body
    normal = sp.csc_array(balance @ sp.diags_array(weight) @ balance.T)
    factors = factors_of(normal)
    found = factors.solve(wanted.ravel())
    found = found + factors.solve(wanted.ravel() - normal @ found)
    flow = (every[:, chosen] @ (weight * (balance.T @ found))).reshape(-1, 3)
    traction = load + np.einsum("nse,seij->nsij", flow[own], hands)
    # A body force is met by a stress that grows along each axis: half of it at either end.
    traction[:, side, 0, axis] += 0.5 * body[:, axis]
    return np.asarray(size[:, None] * np.einsum("ijkl,njkl->ni", airy_of_tractions(), traction))
