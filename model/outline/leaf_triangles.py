"""What square leaves hold of a body within outlines: triangles, each of one law.

Outlines are marched through the leaves, and parted at their sides. Triangles between the corners of
a leaf and the ends of what is in it have these parts among their sides, so that each is of one law.
"""

from __future__ import annotations

from functools import reduce
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.scene.curves import cross

from .true_shapes import GRID, NEAR, NOTHING, TINY, UNIT, Law, TrueBody, holding, leaf_at, snapped

ROUNDING = 1e-8  # share of a leaf below which what is of a law is left out, or filled
AT_ONCE = 1_000_000  # numbers, of 8 MB
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


class Filled(NamedTuple):
    """Triangles in leaves, side to side."""

    leaf: Ints
    law: Ints
    corners: Floats  # shape (n, 3, 2)

    def shares(self, leaves: LeafCells) -> Floats:
        """Return what each law has of leaves, shape (leaves, laws + 1), the last one air."""
        found = np.zeros((len(leaves), int(self.law.max(initial=-1)) + 2))
        a, b, c = self.corners.swapaxes(0, 1)
        area = 0.5 * cross(b - a, c - a)
        np.add.at(found, (self.leaf, self.law), area / (leaves.size[self.leaf] * UNIT) ** 2)
        return found

    def between(self) -> tuple[Ints, Floats]:
        """Return the sides within leaves at which two laws meet: leaf and ends, (n, 2, 2)."""
        ends = np.stack([self.corners, np.roll(self.corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        leaf, law, name = np.repeat(self.leaf, 3), np.repeat(self.law, 3), np.sort(named(ends))
        order = np.lexsort((name[:, 1], name[:, 0], leaf))
        leaf, law, name, ends = leaf[order], law[order], name[order], ends[order]
        both = (name[1:] == name[:-1]).all(axis=1) & (leaf[1:] == leaf[:-1])
        parts = np.flatnonzero(both & (law[1:] != law[:-1]))
        return leaf[parts], ends[parts]


def named(points: Floats) -> np.ndarray:
    """Return points as numbers that sort by x, then y."""
    return points[..., 0] + 1j * points[..., 1]


def _filled(
    leaves: LeafCells, some: Ints, of: Ints, lines: Floats, more: dict[int, Floats], marks: Floats
) -> Filled:
    """Return triangles of no law yet between corners of leaves, ends of lines, and more points.

    Lines within them are sides; points on their sides, and marks there, are corners on both sides.
    """
    ends = np.concatenate([lines.reshape(-1, 2), *more.values()])
    owner = np.array([*of, *more], dtype=np.int64)
    whose = np.repeat(owner, [2] * len(of) + [len(one) for one in more.values()])
    ends_of: tuple[Any, Any] = leaves.lower * UNIT, leaves.upper * UNIT
    low, high = ends_of
    corners = low[some, None] + SQUARE * (high - low)[some, None]
    leaf, points = [np.repeat(some, 4)], [corners.reshape(-1, 2)]
    # Those that come first stay, where others are near: on both sides of a side the same.
    for known in (points[0], ends, marks):
        rows, places = _on_sides(low[some], high[some], known)
        leaf, points = [*leaf, some[rows]], [*points, places]
    whose, places = np.concatenate([*leaf, whose]), np.concatenate([*points, ends])
    order = np.argsort(whose, kind="stable")
    whose, places = whose[order], places[order]
    whose, places = unified(whose, places, low[whose], high[whose])
    # With more points a leaf is halved first.
    few = np.bincount(whose, minlength=len(leaves))[whose] <= 24
    whose, places = whose[few], places[few]
    order = np.argsort(of, kind="stable")
    three = triangles(whose, places, of[order], lines[order])
    return Filled(whose[three[:, 0]], np.full(len(three), -1), places[three])


def _on_sides(low: Floats, high: Floats, points: Floats) -> tuple[Ints, Floats]:
    """Return the squares and places where points lie on their sides, but for their corners."""
    rows, found = [], []
    for axis in (0, 1):
        # Those of each line across the axis follow one another along it.
        lines = np.unique(named(np.roll(points, axis, axis=1)))
        (x0, y0), (x1, y1) = np.roll(low, axis, axis=1).T, np.roll(high, axis, axis=1).T
        for x in (x0, x1):
            first = np.searchsorted(lines, x + 1j * y0, "right")
            many = np.maximum(np.searchsorted(lines, x + 1j * y1) - first, 0)
            at = lines[np.arange(many.sum()) - np.repeat(np.cumsum(many) - many - first, many)]
            rows.append(np.repeat(np.arange(len(low)), many))
            found.append(np.roll(np.column_stack([at.real, at.imag]), axis, axis=1))
    return np.concatenate(rows), np.concatenate(found)


def _crossings(lines: Floats) -> Floats:
    """Return where lines cross."""
    i, j = np.triu_indices(len(lines), 1)
    (a, b), (c, d) = lines[i].swapaxes(0, 1), lines[j].swapaxes(0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = (cross(c - a, run) / cross(b - a, d - c) for run in (d - c, b - a))
    on = (t > 0.0) & (t < 1.0) & (s > 0.0) & (s < 1.0)
    # lines that meet at an end, hardly turned, cross at it, wherever rounding puts the place
    for p, q, one, other in ((a, b, c, d), (c, d, a, b)):
        off = np.abs(cross(np.stack([one, other]) - p, q - p)).min(axis=0)
        on &= off > 2.0 / GRID * np.hypot(*(q - p).T)
    return snapped(a[on] + t[on, None] * (b - a)[on])


def parted_lines(
    start: Floats, end: Floats, axis: int, spacing: float, chosen: Flags
) -> tuple[Floats, Floats, Ints]:
    """Return lines parted where they cross others a spacing apart, and which each was."""
    low, high = np.minimum(start, end)[:, axis], np.maximum(start, end)[:, axis]
    first = np.floor(low / spacing).astype(np.int64) + 1
    last = np.ceil(high / spacing).astype(np.int64) - 1
    count = np.where(chosen, np.maximum(last - first + 1, 0), 0)
    row = np.repeat(np.arange(len(count)), count + 1)
    if not count.any():
        return start, end, row
    k = np.arange(len(row)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    run = (end - start)[row]
    up = run[:, axis] > 0.0
    # the line at which the k-th part ends
    at = np.where(up, first[row] + k, last[row] - k) * spacing
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (at - start[row, axis]) / run[:, axis]
        parted = snapped(start[row] + t[:, None] * run)
    parted[:, axis] = at
    ends = np.where((k < count[row])[:, None], parted, end[row])
    return np.where((k > 0)[:, None], np.roll(ends, 1, axis=0), start[row]), ends, row


def _marched(rings: list[Floats], leaves: LeafCells) -> tuple[Floats, Ints, Ints]:
    """Return the parts of closed lines within leaves, (n, 2, 2), of which line, and of which leaf.

    -1 is outside of the array, or along a side that two leaves share.
    """
    start = np.concatenate([np.empty((0, 2)), *rings])
    end = np.concatenate([np.empty((0, 2)), *(np.roll(ring, -1, axis=0) for ring in rings)])
    line = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    leaf, chosen, spacing = np.full(len(line), -1), np.ones(len(line), dtype=np.bool_), 1.0
    while chosen.any():
        for axis in (0, 1):
            start, end, row = parted_lines(start, end, axis, spacing, chosen)
            line, chosen, leaf = line[row], chosen[row], leaf[row]
        run, middle = end - start, 0.5 * (start + end)
        straight = (run == 0.0).any(axis=1)
        # Less than the grid of corners: it tells the sides of a line that leaves meet along.
        left = 0.25 / GRID * np.sign(np.stack([-run[:, 1], run[:, 0]], axis=1)) * straight[:, None]
        own, other = leaf_at(leaves, middle + left), leaf_at(leaves, middle - left)
        leaf = np.where(chosen, np.where(own != other, -1, own), leaf)
        # as long as leaves on either side are smaller it may run along a side in part
        size = [np.where(one >= 0, leaves.size[one] * UNIT, np.inf) for one in (own, other)]
        chosen &= np.minimum(*size) < spacing
        spacing *= 0.5
    kept = (start != end).any(axis=1)
    return np.stack([start, end], axis=1)[kept], line[kept], leaf[kept]


class VagueError(Exception):
    """Leaves, by their codes, that have to be halved before it is known what they hold."""

    def __init__(self, codes: Ints):
        super().__init__(codes)
        self.codes = codes


def leaf_triangles(
    body: TrueBody, leaves: LeafCells, held: Flags, most: bool
) -> tuple[list[Law], Filled, list[Floats]]:
    """Return the laws, and the triangles of what leaves hold.

    What they hold is no less and no softer than the body (`most`), or no more and no stiffer.
    Last, the straight parts of the outline of each region, shape (n, 2, 2). Only leaves that are
    `held` count, others may hold what they like.

    Raises
    ------
    VagueError
        Where leaves hold too much to tell.
    """
    rings = [one.rings(most != body.softer(k)) for k, one in enumerate(body.regions)]
    parts, line, leaf = _marched([ring for one in rings for ring in one], leaves)
    region = np.repeat(np.arange(len(rings)), [len(one) for one in rings])[line]
    cut = np.zeros((len(rings), len(leaves)), dtype=np.bool_)
    cut[region[leaf >= 0], leaf[leaf >= 0]] = True
    laws, marks = [*body.laws], np.array(body.marks).reshape(-1, 2)

    size = leaves.size * UNIT
    holds = holding(rings, leaves.lower * UNIT + 0.5 * size[:, None])
    whole = np.where(cut.any(axis=0), -1, _laws_at(body, laws, holds, cut, most))
    several, own = cut.sum(axis=0) > 1, (leaf >= 0) & held[leaf]

    def told(found: Filled) -> Filled:
        """Give triangles their laws; slivers of a law are left out of the stress."""
        inside = holding(rings, found.corners.mean(axis=1))
        law = _laws_at(body, laws, inside, cut[:, found.leaf], most)
        found = found._replace(law=np.where(whole[found.leaf] < 0, law, whole[found.leaf]))
        sliver = (found.shares(leaves) <= ROUNDING) & ~several[:, None] & (not most)
        return found._replace(law=np.where(sliver[found.leaf, found.law], -1, found.law))

    of, lines = leaf[own], parts[own]
    crossing = {k: _crossings(lines[of == k]) for k in np.flatnonzero(several & held).tolist()}
    parted = np.isin(np.arange(len(leaves)), of)
    some = held & (parted | (whole >= 0))
    found = told(_filled(leaves, np.flatnonzero(some), of, lines, crossing, marks))
    share = found.shares(leaves)
    # What all but fills a leaf fills it.
    full = (share > 1.0 - ROUNDING).any(axis=1)
    whole[full] = np.append(np.arange(share.shape[1] - 1), -1)[share[full].argmax(axis=1)]
    vague = some & ~full & (np.abs(share.sum(axis=1) - 1.0) > TINY)
    count, (of, lines) = len(of), found.between()
    # Without what is left out, and without lines that part no laws, they are filled anew.
    anew = vague.any() or (parted & full).any() or len(of) != count
    parted &= ~full
    while anew:
        if (large := vague & (leaves.size > 1)).any():
            raise VagueError(leaves.code[large])
        # Leaves that cannot be halved hold the stiffest or the softest of all that is there.
        for k in np.flatnonzero(vague).tolist():
            there = [body.law, *(body.regions[j].law for j in np.flatnonzero((cut | holds)[:, k]))]
            whole[k] = _number(laws, reduce(lambda a, b: a.with_other(b, most), there))
        parted &= ~vague
        of, lines = of[parted[of]], lines[parted[of]]
        some = held & (parted | (whole >= 0))
        found = told(_filled(leaves, np.flatnonzero(some), of, lines, {}, marks))
        vague = some & (np.abs(found.shares(leaves).sum(axis=1) - 1.0) > TINY)
        anew = vague.any()
    solid = found.law >= 0
    found = Filled(found.leaf[solid], found.law[solid], found.corners[solid])
    return laws, found, [parts[region == k] for k in range(len(rings))]


def _laws_at(body: TrueBody, laws: list[Law], held: Flags, cut: Flags, most: bool) -> Ints:
    """Return numbers of laws, -1 for air, where regions hold places, in leaves that they cut.

    Near an outline of a law neither stiffer nor softer than that below it is one of both kinds.
    """
    found = np.full(held.shape[1], _number(laws, body.law))
    for k, region in enumerate(body.regions):
        below, law = found, _number(laws, region.law)
        found = np.where(held[k], law, below)
        near = cut[k] & (held[k] == most) & (below >= 0)
        for one in np.unique(below[near]).tolist() if body.mixed(k) else ():
            either = _number(laws, laws[law].with_other(laws[one], most))
            found[near & (below == one)] = either
    return found


def _number(laws: list[Law], law: Law) -> int:
    """Return the number of a law in a list, which it is added to; -1 for what is no body."""
    if law in NOTHING:
        return -1
    if law not in laws:
        laws.append(law)
    return laws.index(law)


# Triangles between the points of many squares at once, with given lines among their sides.


def grouped(of: Ints, whose: Ints) -> list[tuple[Ints, Ints, Flags]]:
    """Return squares with equally many points: rows of these, and of the lines, where there are.

    `of` and `whose` are the squares of points and of lines, which are in the order of these.
    """
    square, first, count = np.unique(of, return_index=True, return_counts=True)
    begin, end = (np.searchsorted(whose, square, side) for side in ("left", "right"))
    found = []
    for n in np.unique(count).tolist():
        rows = np.flatnonzero(count == n)
        step = max(8 * AT_ONCE // n**4, 1)  # pairs of sides that may cross, of a byte each
        for some in (rows[k : k + step] for k in range(0, len(rows), step)):
            many = end[some] - begin[some]
            k = np.arange(many.max())
            there = k < many[:, None]
            line = np.where(there, begin[some, None] + k, 0)
            found.append((first[some, None] + np.arange(n), line, there))
    return found


def triangles(of: Ints, points: Floats, whose: Ints, lines: Floats) -> Ints:
    """Return the corners of triangles among points, counter-clockwise, shape (n, 3).

    Of lines what lies between points are sides; all other sides are as short as may be.
    """
    found = [np.empty((0, 3), dtype=np.int64)]
    for point, line, there in grouped(of, whose):
        row, three = _between(points[point], lines[line], there)
        found.append(point[row[:, None], three])
    return np.concatenate(found)


def _between(at: Floats, lines: Floats, there: Flags) -> tuple[Ints, Ints]:
    """Return squares and corners of triangles between their points, shape (squares, n, 2)."""
    squares, n = at.shape[:2]
    i, j = np.triu_indices(n, 1)
    run = at[:, j] - at[:, i]
    long = np.hypot(run[..., 0], run[..., 1])
    # of all points how far they are from lines between two: square, pair, point
    away = at[:, None] - at[:, i, None]
    off = cross(run[:, :, None], away) / long[..., None]
    off[np.abs(off) <= NEAR] = 0.0
    along = np.einsum("smkd,smd->smk", away, run) / long[..., None]
    passes = ((off == 0.0) & (along > NEAR) & (along < long[..., None] - NEAR)).any(axis=2)
    cuts = off[:, :, i] * off[:, :, j] < 0.0
    cuts &= cuts.swapaxes(1, 2)
    # of all lines which points they go through: square, line, point
    course, away = lines[:, :, 1] - lines[:, :, 0], at[:, None] - lines[:, :, None, 0]
    length = np.hypot(course[..., 0], course[..., 1])[..., None]
    along = np.einsum("slkd,sld->slk", away, course) / length
    on = np.abs(cross(course[:, :, None], away)) <= 2.0 * NEAR * length
    on &= (along > -2.0 * NEAR) & (along < length + 2.0 * NEAR) & there[..., None]
    asked = (on[:, :, i] & on[:, :, j]).any(axis=1) & ~passes
    joined, each = np.zeros_like(passes), np.arange(squares)
    for one in np.lexsort((long, ~asked)).T:
        free = ~passes[each, one]
        joined[each, one] = free
        passes |= cuts[each, one] & free[:, None]
    pair = np.zeros((n, n), dtype=np.int64)
    pair[i, j] = np.arange(len(i))
    three = np.array(list(combinations(range(n), 3)))
    a, b, c = three.T
    row, which = np.nonzero(joined[:, pair[a, b]] & joined[:, pair[b, c]] & joined[:, pair[a, c]])
    # those that hold no other point
    a, b, c = three[which].T
    ab, bc, ca = off[row, pair[a, b]], off[row, pair[b, c]], -off[row, pair[a, c]]
    turn = np.sign(np.take_along_axis(ab, c[:, None], 1))
    within = (ab * turn > 0.0) & (bc * turn > 0.0) & (ca * turn > 0.0)
    kept = ~within.any(axis=1) & (turn[:, 0] != 0.0)
    return row[kept], np.where(turn > 0.0, three[which], three[which][:, ::-1])[kept]


def unified(of: Ints, points: Floats, low: Floats, high: Floats) -> tuple[Ints, Floats]:
    """Return points of squares, those near to their sides moved onto them, and of near ones one."""
    for end in (low, high):
        points = np.where(np.abs(points - end) <= NEAR, end, points)
    kept = np.ones(len(points), dtype=np.bool_)
    for point, _, _ in grouped(of, of[:0]):
        at = points[point]
        near = (np.abs(at[:, :, None] - at[:, None]) <= NEAR).all(axis=3)
        kept[point] = near.argmax(axis=2) == np.arange(point.shape[1])
    return of[kept], points[kept]
