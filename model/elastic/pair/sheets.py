"""What Airy's function phi of a body is along its border, and beyond cuts.

Along a run of free edges phi is a linear function, and what known tractions add up to: that at the
end of an edge follows from that at its start. Along a roller the slope across is a constant
likewise. Round a hole that bears forces phi takes several values: beyond a cut from the hole to the
right, vertices have copies, which differ by a linear function. It is known if all tractions round
the hole are; else it is three unknowns that no square or triangle has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints

from .leaves import Entries, followed

LINEAR = [(0, 0), (0, 1), (0, 2), (1, 1), (2, 2)]
"""Which of phi, phi_x, phi_y a linear function enters by its value, its slope along x, along y."""


def loops_of(start: Ints, end: Ints) -> list[Ints]:
    """Return the rows of the border's edges in the order of a walk, loops from first vertices."""
    order, ends = np.argsort(start), end.tolist()
    row = dict(zip(start[order].tolist(), order.tolist(), strict=True))
    loops = []
    while row:
        loop, vertex = [], next(iter(row))
        while vertex in row:
            loop.append(row.pop(vertex))
            vertex = ends[loop[-1]]
        loops.append(np.array(loop))
    return loops


@dataclass(frozen=True, eq=False)
class Rim:
    """Edges of the border, walked with the body on the left."""

    owner: Ints  # The square or triangle that each is a side of; shape (m,)
    ends: Ints  # Which of its corners each goes from and to; shape (m, 2)
    edge: Ints
    given: Flags  # Components of the traction that are known; shape (m, 2)
    # By how much these make phi grow beyond a linear function, and its slopes; shape (m, 3)
    growth: Floats
    bulge: Floats  # And by how much the slope across is off a linear one in the middle; shape (m,)
    pivot: Floats  # The point about which they bear no couple, NaN if there is none; shape (m, 2)


class Sheets:
    """Unknowns of phi: of vertices, copies, edges, cuts (three each), free runs, and one.

    Beyond cuts elements see copies of vertices, where phi has jumped: `corner` are the vertices or
    copies at their corners; `base` is the vertex that each is a copy of, and `beyond` tells how
    often it has jumped at each cut. The last unknown is the number one, by which the known enters.
    """

    def __init__(self, place: Floats, corner: Ints, edges: int, part: Ints, rim: Rim) -> None:
        self.place, self.corner, self.vertices, self.parts = place, corner, len(place), part
        start, end = (corner[rim.owner, one] for one in rim.ends.T)
        loops, free = loops_of(start, end), np.asarray(rim.given.all(axis=1))
        # Each from where its first free run begins, if it has others beside it.
        first = [int(np.argmax(free[one] & ~free[np.roll(one, 1)])) for one in loops]
        loops = [np.roll(one, -at) for one, at in zip(loops, first, strict=True)]
        self.row, count = np.concatenate(loops), np.array([len(one) for one in loops])
        self.begins, self.loop = np.cumsum(count) - count, np.repeat(np.arange(len(count)), count)
        self.last = np.cumsum(count) - 1
        self.start, self.end = start[self.row], end[self.row]
        self.rim = Rim(*(column[self.row] for column in vars(rim).values()))
        # Along which edges phi is linear, phi_x is even, phi_y is even, but for what is known.
        given = self.rim.given
        self.linear = np.stack([given.all(axis=1), given[:, 1], given[:, 0]])
        self.closed = np.logical_and.reduceat(self.linear, self.begins, axis=1).T
        self.ends = np.stack([place[self.start], place[self.end]])
        (ax, ay), (bx, by) = np.moveaxis(self.ends, 2, 1)
        self.hole = np.add.reduceat(ax * by - bx * ay, self.begins) < 0  # clockwise
        self.part = part[self.rim.owner]
        around = self._around()
        # Of the sum of all forces: a hole bears none if they are less.
        self._cut(np.abs(around).max(axis=1) > 1e-11 * self.forces)
        self.points = len(self.base)
        self.place = place[self.base]
        self.jump = 3 * self.points + edges
        self.runs = self.jump + 3 * len(self.cuts)
        # Where free runs begin: a loop does with one, if it has any.
        self.opens = self.linear[0] & ~np.append(False, self.linear[0, :-1])
        self.opens[self.begins] = self.linear[0, self.begins]
        self.one = self.runs + int(self.opens.sum())
        self.size = self.one + 1
        self._close(around)

    def _around(self) -> Floats:
        """Return what phi and its slopes grow by round loops along which they are all known."""
        growth = self.rim.growth.copy()
        # Where a slope has grown phi rises from there to the end of the loop, which is its start.
        ahead = self.ends[0, self.begins][self.loop] - self.ends[1]
        growth[:, 0] += (growth[:, 1:] * ahead).sum(axis=1)
        self.forces = float(np.abs(growth[:, 1:]).sum()) or 1.0
        return np.where(self.closed, np.add.reduceat(growth, self.begins), 0.0)

    def start_of(self, hole: Flags) -> tuple[float, float]:
        """Return a place in a hole from which a cut meets its border once, and no vertex."""
        (x0, y0), (x1, y1) = np.moveaxis(self.ends, 2, 1)
        heights = np.unique(np.clip(self.place[:, 1], y0[hole].min(), y0[hole].max()))
        k = int(np.diff(heights).argmax())
        y = 0.5 * (heights[k] + heights[k + 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            x = np.where((y0 > y) != (y1 > y), x0 + (y - y0) / (y1 - y0) * (x1 - x0), -np.inf)
        last = x[hole].max()
        return 0.5 * (last + x[x < last].max()), y

    def on_cut(self, x: float, y: float) -> Flags:
        """Tell which elements a cut crosses that goes to the right from a place."""
        each, at = np.arange(len(self.corner)), self.place[self.corner]
        low, high = (at[each, find(at[..., 1], axis=1)] for find in (np.argmin, np.argmax))
        on = (low[:, 1] < y) & (y < high[:, 1])
        run = (high - low)[on]
        on[on] = low[on, 0] + (y - low[on, 1]) / run[:, 1] * run[:, 0] > x
        return np.asarray(on)

    def _cut(self, borne: Flags) -> None:
        """Cut the body to the right of holes that are held or bear a force, the loops `cuts`."""
        corner, at = self.corner, self.place[self.corner]
        self.cuts = np.flatnonzero(self.hole & (borne | ~self.closed.all(axis=1)))
        self.base, self.beyond = np.arange(self.vertices), np.zeros((self.vertices, 0), dtype=int)
        if not len(self.cuts):
            return
        sheet = np.zeros((*corner.shape, len(self.cuts)), dtype=np.int64)
        for cut, number in enumerate(self.cuts.tolist()):
            x, y = self.start_of(self.loop == number)
            # An element of its part on the cut sees what lies below it with the jump.
            there = self.on_cut(x, y) & (self.parts == self.part[self.begins[number]])
            sheet[..., cut] = there[:, None] & (at[..., 1] < y)
        some = np.isin(corner, corner[sheet.any(axis=2)])
        rows, place = np.unique(
            np.column_stack([corner[some], sheet[some]]), axis=0, return_inverse=True
        )
        # The first of the rows of a vertex is the vertex itself.
        first = np.searchsorted(rows[:, 0], rows[:, 0])
        copies = np.flatnonzero(first < np.arange(len(rows)))
        own = rows[:, 0].copy()
        own[copies] = self.vertices + np.arange(len(copies))
        self.corner = corner.copy()
        self.corner[some] = own[place.ravel()]
        self.base = np.append(np.arange(self.vertices), rows[copies, 0])
        jumped = (rows - rows[first])[copies, 1:]
        self.beyond = np.concatenate([np.zeros((self.vertices, len(self.cuts)), int), jumped])

    def _close(self, around: Floats) -> None:
        """Find what is known of the jumps of cuts, and which follow from others."""
        # How often the sheet has changed before each edge: within an edge both ends are seen on
        # one, which may be another one along the next edge.
        seen = self.beyond[self.corner[self.rim.owner[:, None], self.rim.ends]]
        self.passed = seen[:, 0] - seen[:, 1]
        often = np.add.reduceat(self.passed, self.begins)
        # What phi grows by round closed loops is made good by the jumps of the cuts that they pass,
        # which are linear functions; at its pivot that of a pin, the couple, is 0.
        loop, k = np.nonzero(self.closed & often.any(axis=1, keepdims=True))
        pivot = self.rim.pivot[self.begins[self.cuts]]
        pin = np.flatnonzero(np.isfinite(pivot[:, 0]))
        place = np.concatenate([self.ends[0, self.begins[loop]], pivot[pin]])
        terms = np.eye(3)[np.append(k, 0 * pin)]
        terms[:, 1:] += terms[:, :1] * place
        times = np.concatenate([often[loop], np.eye(len(self.cuts))[pin]])
        table = (times[:, :, None] * terms[:, None]).reshape(len(times), self.runs - self.jump)
        table = np.column_stack([table, np.append(-around[loop, k], 0.0 * pin)])
        lead, table, rest = eliminated(table, np.abs(self.ends).max())
        row, column = np.nonzero(table[:, :-1])
        lead, one = self.jump + lead, np.full(len(lead), self.one)
        self.shut: Entries = [(lead, one, table[:, -1])]
        self.shut.append((lead[row], self.jump + column, -table[row, column]))
        rest = np.append(rest, around[~often.any(axis=1)])
        self.unbalanced = float(np.abs(rest).max(initial=0.0)) / self.forces
        """Share of all forces by which those on a part of the body do not balance."""

    def way(self, more: Entries, others: int = 0) -> tuple[sp.csr_array, Ints, Floats]:
        """Return what all unknowns are by the free ones, which these are, and what is known.

        `more` says what else follows; behind the unknowns there are `others` that it may name.
        """
        fixed, size = np.zeros(self.size + others, dtype=np.bool_), self.size + others
        copies = np.arange(self.vertices, self.points)
        follow: Entries = [(3 * copies + k, 3 * self.base[copies] + k, 1.0) for k in range(3)]
        follow += self.jumps(copies, self.beyond[copies]) + more
        way, follows = followed(follow + self._border(fixed) + self.shut, size)
        # A linear function has no stress: one vanishes in every part, at the first vertex of its
        # border, or at those that this one follows.
        first = 3 * self.start[np.unique(self.part, return_index=True)[1]]
        some = way[(first[:, None] + np.arange(3)).ravel()].tocoo()
        vertex, run = some.col < 3 * self.points, (self.runs <= some.col) & (some.col < self.one)
        fixed[some.col[run | vertex & (some.col % 3 == some.row % 3)]] = True
        fixed[self.one] = True
        free = np.flatnonzero(~(follows | fixed))
        known = way @ (np.arange(size) == self.one).astype(np.float64)
        return sp.csr_array(way[:, free]), free, known

    def jumps(self, point: Ints, times: Ints, terms: list[tuple[int, int]] = LINEAR) -> Entries:
        """Add the linear functions of cuts, each so many times, to phi at vertices or copies."""
        row, cut = np.nonzero(times)
        own, entries = point[row], Entries()
        for k, by in terms:
            value = times[row, cut] * (self.place[own, by - 1] if by > k else 1.0)
            entries.append((3 * own + k, self.jump + 3 * cut + by, value))
        return entries

    def _border(self, fixed: Flags) -> Entries:
        """Say what phi is by the tractions along the border: each edge's end follows its start."""
        bent = np.flatnonzero(self.linear.any(axis=0))
        fixed[bulge := 3 * self.points + self.rim.edge[bent]] = True
        entries, run = self._as_known(bulge, self.rim.bulge[bent]), self.ends[1] - self.ends[0]
        for k, by in LINEAR:
            on = self.linear[k].copy()
            on[self.last[self.closed[:, k]]] = False  # else a loop follows itself
            edge = np.flatnonzero(on)
            start, end = 3 * self.start[edge] + by, 3 * self.end[edge] + k
            entries.append((end, start, run[edge, by - 1] if by > k else 1.0))
            # Within an edge both ends are seen on one sheet.
            entries += self.jumps(self.end[edge], self.passed[edge], [(k, by)])
            if by == k:
                entries += self._as_known(end, self.rim.growth[edge, k])
        # Free runs count from their middles: so what is symmetric stays so.
        free, number = self.linear[0], np.cumsum(self.opens) - 1
        length, at = np.hypot(*run[free].T), self.ends.mean(axis=0)[free]
        sums = [np.bincount(number[free], length * x) for x in (1.0, *at.T)]
        first = 3 * self.start[self.opens]
        entries.append((first, self.runs + number[self.opens], 1.0))
        for by in (1, 2):
            arm = self.ends[0, self.opens, by - 1] - sums[by] / sums[0]
            entries.append((first, first + by, arm))
        return entries

    def _as_known(self, row: Ints, value: Floats) -> Entries:
        some = np.flatnonzero(value)
        return [(row[some], np.full(len(some), self.one), value[some])]


def eliminated(table: Floats, reach: float) -> tuple[Ints, Floats, Floats]:
    """Return which unknowns follow from others by linear equations, how, and what must be 0.

    The last column has the right-hand sides. Every first of three unknowns is rather one that
    follows than those beside it, which count as far as places may reach.
    """
    lead, weight = np.full(len(table), -1), np.ones(table.shape[1] - 1)
    weight[1::3] = weight[2::3] = 1.0 / reach
    while (size := np.abs(table[:, :-1] * weight) * (lead < 0)[:, None]).max(initial=0.0) > 1e-9:
        row, column = np.unravel_index(size.argmax(), size.shape)
        lead[row] = column
        table[row] /= table[row, column]
        table -= table[:, [column]] * (np.arange(len(table)) != row)[:, None] * table[row]
    table[np.arange(len(table)), lead] *= lead < 0
    return lead[lead >= 0], table[lead >= 0], table[lead < 0, -1]
