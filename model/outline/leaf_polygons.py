"""What square leaves hold of a body within outlines: closed polygons, each of one law.

Outlines are marched through the leaves: their straight pieces, parted at the sides of leaves, make
paths from side to side of a leaf; what lies to the left of the paths of one region is its part of
the leaf. The work grows with the number of pieces, however many corners and regions there are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial, reduce

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.leaves import LeafCells

from .crossed_leaves import SQUARE, crossed
from .true_shapes import AIR, UNIT, Law, TrueBody, holding, leaf_at, snapped

NUDGE = 2.0**-34  # less than the grid of corners: tells the sides of a line that leaves meet along
MOST_CORNERS = 10  # of one polygon; leaves with more, or with holes, are halved first
ROUNDING = 1e-8  # share of a leaf below which a piece is left out, or filled
NOTHING = 1e-13  # share of a leaf below which a piece is rounding


@dataclass(frozen=True, eq=False)
class Rings:
    """Closed polygons, counter-clockwise, of corners that follow one another."""

    place: Ints  # leaf, or whatever holds it, shape (n,)
    law: Ints
    count: Ints  # corners
    points: Floats  # of all, shape (sum of counts, 2)

    @property
    def row(self) -> Ints:
        """The polygon of each corner."""
        return np.repeat(np.arange(len(self.count)), self.count)

    @property
    def following(self) -> Ints:
        """The corner after each."""
        end = np.cumsum(self.count)
        at = np.arange(1, len(self.points) + 1)
        last = end[self.count > 0] - 1
        at[last] = (end - self.count)[self.count > 0]
        return at

    @property
    def area(self) -> Floats:
        """Area of each, negative where it runs clockwise."""
        first = self.points[np.repeat(np.cumsum(self.count) - self.count, self.count)]
        a, b = self.points - first, self.points[self.following] - first
        twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        return np.asarray(0.5 * np.bincount(self.row, twice, len(self.count)), dtype=np.float64)

    def only(self, kept: Flags) -> Rings:
        """Return some of the polygons."""
        corners = np.repeat(kept, self.count)
        return Rings(self.place[kept], self.law[kept], self.count[kept], self.points[corners])

    def with_law(self, place: Ints, law: Ints) -> Rings:
        """Return the polygons with other places and laws."""
        return Rings(place, law, self.count, self.points)

    def without_repeats(self) -> Rings:
        """Return the polygons without corners that are the ones before."""
        same = (self.points == self.points[self.following]).all(axis=1)
        count = self.count - np.bincount(self.row[same], minlength=len(self.count))
        found = Rings(self.place, self.law, count, self.points[~same])
        return found.only(count > 2)

    @classmethod
    def joined(cls, parts: list[Rings]) -> Rings:
        """Return polygons one after the other."""
        return cls(
            *(
                np.concatenate([getattr(one, name) for one in parts])
                for name in ("place", "law", "count", "points")
            )
        )

    @classmethod
    def of(cls, place: Ints, law: Ints, polygons: Floats) -> Rings:
        """Return polygons of equally many corners, shape (n, corners, 2)."""
        count = np.full(len(polygons), polygons.shape[1])
        return cls(place, law, count, polygons.reshape(-1, 2))


def filled(rings: Rings) -> tuple[Ints, Ints]:
    """Return triangles that fill polygons: which polygon, and corners among all, shape (n, 3).

    Of all ways those are chosen of which the worst has the best shape (4 √3 area / Σ sides²).
    Triangles that all run counter-clockwise and end at the polygon's sides cannot overlap.
    """
    begin = np.cumsum(rings.count) - rings.count
    owner, found = [np.empty(0, dtype=np.int64)], [np.empty((0, 3), dtype=np.int64)]
    for n in np.unique(rings.count).tolist():
        rows = np.flatnonzero(rings.count == n)
        at = rings.points[begin[rows, None] + np.arange(n)]
        for row, corners in _split(at):
            owner.append(rows[row])
            found.append(begin[rows[row], None] + corners)
    return np.concatenate(owner), np.concatenate(found)


def _split(at: Floats) -> list[tuple[Ints, Ints]]:
    """Return the triangles of polygons with equally many corners: rows, and corners."""
    n = at.shape[1]
    best = {(i, i + 1): np.full(len(at), 2.0) for i in range(n - 1)}
    apex: dict[tuple[int, int], Ints] = {}
    square = ((at[:, :, None] - at[:, None]) ** 2).sum(axis=3)
    for span in range(2, n):
        for i in range(n - span):
            k, shapes = i + span, []
            for j in range(i + 1, k):
                (x1, y1), (x2, y2) = (at[:, j] - at[:, i]).T, (at[:, k] - at[:, i]).T
                sides = square[:, i, j] + square[:, j, k] + square[:, i, k]
                shape = 12.0**0.5 * (x1 * y2 - x2 * y1) / np.maximum(sides, 1e-300)
                # corners at one place, where a polygon touches itself, part it there
                same = (
                    (square[:, i, j] == 0.0) | (square[:, j, k] == 0.0) | (square[:, i, k] == 0.0)
                )
                shape = np.where(same, 2.0, shape)
                shapes.append(np.minimum(shape, np.minimum(best[i, j], best[j, k])))
            every = np.array(shapes)
            apex[i, k] = i + 1 + every.argmax(axis=0)
            best[i, k] = every.max(axis=0)
    out, chords = [], [(0, n - 1, np.arange(len(at)))]
    while chords:
        i, k, rows = chords.pop()
        if k - i < 2:
            continue
        for j in np.unique(apex[i, k][rows]).tolist():
            mine = rows[apex[i, k][rows] == j]
            out.append((mine, np.tile([i, j, k], (len(mine), 1))))
            chords += [(i, j, mine), (j, k, mine)]
    return out


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Straight pieces of outlines, in the order of their lines, each within one leaf."""

    start: Floats
    end: Floats
    line: Ints  # which closed line
    leaf: Ints  # -1 outside of the array, or along a side that two leaves share

    def at(self, rows: Ints) -> _Pieces:
        """Return some of the pieces."""
        return _Pieces(self.start[rows], self.end[rows], self.line[rows], self.leaf[rows])


def _parted(
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


def _marched(rings: list[Floats], leaves: LeafCells) -> _Pieces:
    """Return the pieces of closed lines within leaves."""
    start = np.concatenate([np.empty((0, 2)), *rings])
    end = np.concatenate([np.empty((0, 2)), *(np.roll(ring, -1, axis=0) for ring in rings)])
    line = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    leaf, chosen, spacing = np.full(len(line), -1), np.ones(len(line), dtype=np.bool_), 1.0
    while chosen.any():
        for axis in (0, 1):
            start, end, row = _parted(start, end, axis, spacing, chosen)
            line, chosen, leaf = line[row], chosen[row], leaf[row]
        run, middle = end - start, 0.5 * (start + end)
        straight = (run == 0.0).any(axis=1)
        left = NUDGE * np.sign(np.stack([-run[:, 1], run[:, 0]], axis=1)) * straight[:, None]
        own, other = leaf_at(leaves, middle + left), leaf_at(leaves, middle - left)
        leaf = np.where(chosen, np.where(own != other, -1, own), leaf)
        # as long as leaves on either side are smaller it may run along a side in part
        size = [np.where(one >= 0, leaves.size[one] * UNIT, np.inf) for one in (own, other)]
        chosen &= np.minimum(*size) < spacing
        spacing *= 0.5
    kept = (start != end).any(axis=1)
    return _begun(_Pieces(start[kept], end[kept], line[kept], leaf[kept]))


def _before(pieces: _Pieces) -> tuple[Ints, Ints, Ints]:
    """Return the first piece and the number of pieces of each one's line, and the one before it."""
    _, first, of, count = np.unique(
        pieces.line, return_index=True, return_inverse=True, return_counts=True
    )
    at = np.arange(len(pieces.line))
    return first[of], count[of], np.where(at == first[of], at + count[of] - 1, at - 1)


def _begun(pieces: _Pieces) -> _Pieces:
    """Return pieces of which each line begins where it comes to another leaf."""
    if not len(pieces.line):
        return pieces
    first, count, before = _before(pieces)
    at = np.arange(len(first))
    begins = pieces.leaf != pieces.leaf[before]
    shift = np.full(len(first), len(first))
    np.minimum.at(shift, first, np.where(begins, at - first, len(first)))
    shift = shift[first] % len(first)
    order = first + (at - first + np.where(shift < count, shift, 0)) % count
    return pieces.at(order)


def _around(points: Floats, leaf: Ints, leaves: LeafCells) -> Floats:
    """Return how far round their leaf points are, 0 to 4 from its lower left corner."""
    x, y = ((points - leaves.lower[leaf] * UNIT) / (leaves.size[leaf] * UNIT)[:, None]).T
    on = [y == 0.0, x == 1.0, y == 1.0]
    return np.asarray(np.select(on, [x, 1.0 + y, 3.0 - x], 4.0 - y) % 4.0)


def _closed(pieces: _Pieces, place: Ints, leaf_of: Ints, leaves: LeafCells) -> tuple[Rings, Ints]:
    """Return what lies to the left of pieces in places, and the places where they do not tell.

    Each path goes on along the sides of its leaf to where the next one begins.
    """
    first, _, before = _before(pieces)
    begins = pieces.leaf != pieces.leaf[before]
    whole = np.zeros(len(first), dtype=np.int64)  # pieces where a line comes to another leaf
    np.add.at(whole, first, begins)
    inner = whole[first] == 0
    vague = [place[inner]]
    path = np.cumsum(begins) - 1
    kept = (place >= 0) & ~inner
    start, end, path, at = pieces.start[kept], pieces.end[kept], path[kept], place[kept]
    number, first, path = np.unique(path, return_index=True, return_inverse=True)
    if not len(number):
        return Rings(at, at, at, start), np.concatenate(vague)
    last = np.append(first[1:], len(path)) - 1
    at, n = at[first], len(number)
    leaf = leaf_of[at]
    enters, leaves_it = _around(start[first], leaf, leaves), _around(end[last], leaf, leaves)
    # the next path that begins, round the leaf from where one ends
    order = np.lexsort((enters, at))
    key = at[order] * 8.0 + enters[order]
    found = np.searchsorted(key, at * 8.0 + leaves_it)
    beyond = np.searchsorted(key, at * 8.0 + 5.0)
    found = np.where(found < beyond, found, np.searchsorted(key, at * 8.0 - 1.0))
    after = order[found]
    vague.append(at[np.bincount(after, minlength=n)[after] > 1])
    way = (enters[after] - leaves_it) % 4.0
    corners = np.ceil(leaves_it + way).astype(np.int64) - np.floor(leaves_it).astype(np.int64) - 1
    corners = np.maximum(corners, 0)
    # number paths along their polygon
    label, rank = np.arange(n), np.zeros(n, dtype=np.int64)
    for _ in range(n):
        least = np.minimum(label, label[after])
        if (least == label).all():
            break
        label = least
    now = np.unique(label)
    for step in range(1, n):
        now = after[now]
        now = now[label[now] != now]
        if not len(now) or step > MOST_CORNERS * MOST_CORNERS:
            break
        rank[now] = step
    order = np.lexsort((rank, label))
    turn = np.empty(n, dtype=np.int64)
    turn[order] = np.arange(n)
    # of each path its pieces' starts, its end, and the corners that follow
    owner = np.concatenate([path, np.arange(n), np.repeat(np.arange(n), corners)])
    k = np.arange(corners.sum()) - np.repeat(np.cumsum(corners) - corners, corners)
    corner = (np.floor(leaves_it[owner[len(path) + n :]]).astype(np.int64) + 1 + k) % 4
    of = leaf[owner[len(path) + n :]]
    low = (leaves.lower[of] + SQUARE[corner] * leaves.size[of, None]) * UNIT
    points = np.concatenate([start, end[last], low])
    many = len(points) + 1
    within = np.concatenate([np.arange(len(path)) - first[path], np.full(n, many), many + 1 + k])
    points = points[np.lexsort((within, turn[owner]))]
    size = (np.bincount(path, minlength=n) + 1 + corners)[order]
    heads = np.unique(label[order], return_index=True)[1]
    count = np.add.reduceat(size, heads)
    rings = Rings(at[order][heads], np.zeros(len(heads), dtype=np.int64), count, points)
    return rings.without_repeats(), np.concatenate(vague)


class VagueError(Exception):
    """Leaves, by their codes, that have to be halved before it is known what they hold."""

    def __init__(self, codes: Ints):
        super().__init__(codes)
        self.codes = codes


def leaf_polygons(
    body: TrueBody, leaves: LeafCells, held: Flags, most: bool
) -> tuple[list[Law], Rings, list[Floats]]:
    """Return the laws, and the polygons of what leaves hold.

    What they hold is no less and no softer than the body (`most`), or no more and no stiffer.
    Last, the straight pieces of the outline of each region, shape (n, 2, 2). Only leaves that are
    `held` count, others may hold what they like.

    Raises
    ------
    VagueError
        Where leaves hold too much to tell.
    """
    regions = range(len(body.regions))
    lines = [one.rings(most != body.softer(k)) for k, one in enumerate(body.regions)]
    owner = np.repeat(regions, [len(one) for one in lines]).astype(np.int64)
    pieces = _marched([ring for one in lines for ring in one], leaves)
    region = owner[pieces.line]
    cut = np.zeros((len(body.regions), len(leaves)), dtype=np.bool_)
    cut[region[pieces.leaf >= 0], pieces.leaf[pieces.leaf >= 0]] = True
    middle = (leaves.lower + 0.5 * leaves.size[:, None]) * UNIT
    holds = holding(lines, middle) & ~cut
    several = cut.sum(axis=0) > 1
    laws = [*body.laws]
    # where one region cuts a leaf the law within it, and beyond
    within, beyond = (_laws_at(body, laws, one, cut, most) for one in (holds | cut, holds))
    whole = np.where(cut.any(axis=0), -1, beyond)
    place = np.where(pieces.leaf >= 0, region * len(leaves) + pieces.leaf, -1)
    of = np.tile(np.arange(len(leaves)), len(body.regions))
    rings, vague = _closed(pieces, place, of, leaves)
    alone = (pieces.leaf >= 0) & ~several[pieces.leaf]
    back = _Pieces(pieces.end, pieces.start, pieces.line, pieces.leaf)
    back = back.at(np.arange(len(pieces.line))[::-1])
    rest, _ = _closed(back, np.where(alone, place, -1)[::-1], of, leaves)
    rest = rest.only(~several[of[rest.place]] & (beyond[of[rest.place]] >= 0))
    rest = rest.with_law(of[rest.place], beyond[of[rest.place]])
    inside = rings.with_law(of[rings.place], within[of[rings.place]])
    found = [inside.only(~several[inside.place] & (inside.law >= 0)), rest]
    vague = of[vague[vague >= 0]]

    def numbers_at(points: Floats, leaf: int) -> Ints:
        """Return the numbers of laws at points of a leaf that several regions cut."""
        own = np.repeat(cut[:, [leaf]], len(points), axis=1)
        return _laws_at(body, laws, holding(lines, points), own, most)

    both = np.stack([pieces.start, pieces.end], axis=1)
    for leaf in np.flatnonzero(several & held).tolist():
        lower, size = leaves.lower[leaf] * UNIT, float(leaves.size[leaf] * UNIT)
        parts = crossed(lower, size, both[pieces.leaf == leaf], partial(numbers_at, leaf=leaf))
        if parts is None:
            vague = np.append(vague, leaf)
        else:
            some = parts[1] >= 0
            found.append(Rings.of(np.full(some.sum(), leaf), parts[1][some], parts[0][some]))
    rings = Rings.joined(found).without_repeats()
    rings = rings.only(held[rings.place])
    edge = leaves.size[rings.place] * UNIT
    rings = rings.only(rings.area > NOTHING * edge**2)
    vague = np.union1d(vague[held[vague]], rings.place[rings.count > MOST_CORNERS])
    small = leaves.size[vague] <= 1
    if (~small).any():
        raise VagueError(leaves.code[vague[~small]])
    # leaves that cannot be halved hold the stiffest or the softest of all that is there
    for leaf in vague.tolist():
        there = [body.law, *(body.regions[k].law for k in np.flatnonzero((cut | holds)[:, leaf]))]
        least = reduce(lambda one, other: one.with_other(other, most), there)
        whole[leaf] = _number(laws, least)
    rings = rings.only(~np.isin(rings.place, vague))
    # what all but fills a leaf fills it, and slivers of the others are rounding
    edge = leaves.size[rings.place] * UNIT
    full = rings.area > (1.0 - ROUNDING) * edge**2
    whole[rings.place[full]] = rings.law[full]
    kept = whole[rings.place] < 0
    if not most:
        kept &= (rings.area > ROUNDING * edge**2) | several[rings.place]
    along = [both[region == k] for k in regions]
    every_one = np.flatnonzero((whole >= 0) & held)
    squares = (leaves.lower[every_one, None] + SQUARE * leaves.size[every_one, None, None]) * UNIT
    rings = Rings.joined([rings.only(kept), Rings.of(every_one, whole[every_one], squares)])
    return laws, rings, along


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
    """Return the number of a law in a list, which it is added to; -1 for air."""
    if law == AIR:
        return -1
    if law not in laws:
        laws.append(law)
    return laws.index(law)
