"""Regions with true outlines, each between two polygons: one holds it, one it holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, reduce
from itertools import combinations
from math import inf
from typing import Any, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints, nearest
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.scene.curves import Point, cross, crossings, flattened, parted_at, real_roots
from kaju.model.scene.lattice import area_of

from . import arc_triangles
from .arc_triangles import CLOSE, ArcFrames, TouchError, angle, halved, kept_apart

TINY = 1e-9  # angles, and shares of a leaf, a shape or all forces, that are rounding if less
NEAR = 3e-9  # points nearer than this (in edges of the first agents) are one, or on a line
GRID = 2.0**32  # corners of polygons are whole multiples of 1 / GRID edges of the first agents
DEPTH = 16  # how often a first agent can be halved
UNIT = 2.0**-DEPTH  # in which agents are counted, in edges of the first ones
SHARE = 0.7
"""Of a leaf its arcs may be long. With 1 a ring takes 1.4 times as long to 0.01, with 0.25 1.6."""


def first_leaves(shape: tuple[int, int]) -> LeafCells:
    """Return the first agents of an array: so many along x and y."""
    lower = np.stack([grid.ravel() for grid in np.indices(shape, dtype=np.int64)], 1) << DEPTH
    nothing = np.zeros(len(lower), dtype=np.int64)
    return LeafCells.of(lower, nothing + (1 << DEPTH), nothing)


def covering(leaves: LeafCells, shape: tuple[int, int]) -> LeafCells:
    """Return leaves that cover the array: some given ones, and others where these leave room."""
    every = first_leaves(shape)
    while (larger := every.size[at := every.find(leaves.lower)] > leaves.size).any():
        chosen = np.isin(np.arange(len(every)), at[larger])
        every = every.split(chosen)
    return every


def leaf_at(leaves: LeafCells, points: Floats) -> Ints:
    """Return the agent that holds each point (in edges of the first agents), -1 for none."""
    return leaves.find(np.floor(points / UNIT).astype(np.int64))


def snapped(points: Floats) -> Floats:
    """Return points on the grid that all corners lie on, so that equal ones are exactly equal."""
    return np.asarray(np.rint(points * GRID) / GRID)


def inside(box: Floats, points: Floats, margin: float = CLOSE) -> Flags:
    """Tell which points lie in a box that is wider by a margin."""
    return np.asarray(((points >= box[0] - margin) & (points <= box[1] + margin)).all(axis=-1))


def on_border(box: Floats, points: Floats) -> Flags:
    """Tell which points lie on the border of a box."""
    return inside(box, points) & ~inside(box, points, -CLOSE)


def pieces_of(line: Floats, edges: Floats) -> tuple[Ints, Flags]:
    """Return which straight piece of a line each edge is, -1 for none, and which go along it."""
    found, ahead = np.full(len(edges), -1), np.zeros(len(edges), dtype=np.bool_)
    if len(line):
        _, near = nearest(line[:, 0], edges)
        for end in (1, 0):
            one, off = near[:, 1 - end], edges[:, [1 - end, end]]
            on = (np.abs(line[near[:, 1 - end]] - off) < CLOSE).all(axis=(1, 2))
            found[on], ahead[on] = one[on], end == 1
    return found, ahead


class Law(NamedTuple):
    """Moduli in the plane. What has both no larger stores no more energy of any strain."""

    bulk: float  # half the sum of both normal stresses over the sum of their strains
    shear: float

    @property
    def stiffness(self) -> Floats:
        """Stress (xx, yy, xy) of a strain (xx, yy, 2 xy)."""
        along, across = self.bulk + self.shear, self.bulk - self.shear
        return np.array([[along, across, 0.0], [across, along, 0.0], [0.0, 0.0, self.shear]])

    @property
    def compliance(self) -> Floats:
        """Strain (xx, yy, 2 xy) of a stress (xx, yy, xy)."""
        return np.asarray(np.linalg.inv(self.stiffness), dtype=np.float64)

    def with_other(self, other: Law, stiffer: bool) -> Law:
        """Return the softest law that is no softer than both, or the stiffest no stiffer."""
        choose = max if stiffer else min
        return Law(choose(self.bulk, other.bulk), choose(self.shear, other.shear))


AIR, RIGID = Law(0.0, 0.0), Law(inf, inf)
NOTHING = AIR, RIGID  # neither is body; along the outline of what is rigid nothing moves


class ClosedLine:
    """What a closed line of arcs holds, between two polygons that touch it in the arcs' ends.

    One of them takes the chord of each arc, the other one its end tangents; which is the outer
    one depends on where the arc bends. Straight lines are both.
    """

    def __init__(self, arcs: Floats, extent: Point):
        self.arcs, self.boxes = arcs, list[Floats]()
        # where arcs meet the sides of the array both polygons do so too
        self._part(np.array([[0.0, 0.0], extent]))
        self.arcs = arc_triangles.in_triangles(self.arcs)
        if area_of(ArcFrames(self.arcs).start) < 0.0:
            self.arcs = self.arcs[::-1, ::-1]

    def refine(self, leaves: LeafCells) -> None:
        """Halve arcs until none is longer than a share of its leaves."""
        while True:
            frames = ArcFrames(self.arcs)
            size = np.full(len(self.arcs), np.inf)
            for points in (frames.start, frames.tip, frames.end):
                leaf = leaf_at(leaves, points)
                size = np.minimum(size, np.where(leaf >= 0, leaves.size[leaf] * UNIT, np.inf))
            long = (frames.turn != 0.0) & (frames.length > SHARE * size)
            if not long.any():
                return
            self.arcs = halved(self.arcs, long)

    def part(self, box: Floats) -> Floats:
        """Part its arcs where they run along an axis, and at a box: where both polygons meet."""
        self.boxes.append(box)
        for axis in (0, 1):
            self.arcs = self.parted_along((float(axis), float(1 - axis)))
        self._part(box)
        start = ArcFrames(self.arcs).start
        return snapped(start[on_border(box, start)])

    def _part(self, box: Floats) -> None:
        """Part its arcs at the lines of a box, if they do not run along these but for rounding."""
        for axis, level in ((a, level) for a in (0, 1) for level in box[:, a].tolist()):
            at, parts = self.arcs[..., axis] / self.arcs[..., 2], list[Floats]()
            through = (at.min(axis=1) < level - CLOSE) & (at.max(axis=1) > level + CLOSE)
            for arc, cut in zip(self.arcs, through, strict=True):
                parts += parted_at(arc, crossings(arc, axis, level)) if cut else [arc]
            self.arcs = np.array(parts)

    def parted_along(self, direction: Point) -> Floats:
        """Return its arcs, parted where they run along a direction."""
        parts: list[Any] = []
        along = np.array(direction)
        # From control points to the polynomial's coefficients, that of the last power first.
        powers = np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]])
        for arc, turn in zip(self.arcs, ArcFrames(self.arcs).turn, strict=True):
            # How far the arc is off a line along the direction is off / weight.
            off, weight = powers @ cross(arc[:, :2], along), powers @ arc[:, 2]
            rise, less = np.polymul(np.polyder(off), weight), np.polymul(off, np.polyder(weight))
            level = real_roots(np.polysub(rise, less))
            parts += parted_at(arc, level) if turn else [arc]
        return np.array(parts)

    def touches(self, shape: tuple[int, int], axis: int, upper: int) -> bool:
        """Tell whether an arc touches a side of an array from within, without crossing it."""
        inward, side = 1 - 2 * upper, upper * shape[axis]
        # Arcs lie within the hulls of their control points.
        if (inward * (self.arcs[..., axis] / self.arcs[..., 2] - side)).min() > CLOSE:
            return False
        frames = ArcFrames(self.parted_along((float(axis == 1), float(axis == 0))))
        at = np.stack([frames.start, frames.end], axis=1)
        depth = inward * (at[..., axis] - side)
        level = np.abs(np.stack([frames.first, frames.last], axis=1)[..., axis]) < CLOSE**0.5
        within = (at[..., 1 - axis] >= 0.0) & (at[..., 1 - axis] <= shape[1 - axis])
        on = (level & within & (np.abs(depth) < CLOSE)).any(axis=1)
        return bool((on & (frames.turn != 0.0) & (depth.max(axis=1) > CLOSE)).any())

    def beside(self, shape: tuple[int, int]) -> Floats:
        """Return areas between arcs in an array and the inner and outer polygon, (2, n)."""
        frames, many = ArcFrames(self.arcs), 64
        there = ((frames.tip > 0.0) & (frames.tip < shape)).all(axis=1)
        at = flattened(self.arcs, many).reshape(-1, many, 2) - frames.start[:, None]
        at = np.concatenate([at, (frames.end - frames.start)[:, None]], axis=1)
        # of the area beside a parabola so many chords leave that share
        chord = 0.5 * cross(at[:, :-1], at[:, 1:]).sum(axis=1) / (1.0 - many**-2.0)
        tip = 0.5 * cross(frames.tip - frames.start, frames.end - frames.start) - chord
        left = frames.turn > 0.0
        both = np.where(left, chord, -tip), np.where(left, tip, -chord)
        return np.where(there, both, 0.0)

    @property
    def middle(self) -> Floats:
        """The middle of the area that it holds."""
        start = flattened(self.arcs, 64)
        end = np.roll(start, -1, axis=0)
        twice = cross(start - start[0], end - start[0])
        return np.asarray(start[0] + twice @ (start + end - 2.0 * start[0]) / (3.0 * twice.sum()))

    def ring(self, outer: bool) -> Floats:
        """Return the corners of the outer or inner polygon, counter-clockwise. Shape (n, 2)."""
        frames = ArcFrames(self.arcs)
        # corners on tangents, and between lines that go on, are none
        smooth = np.abs(angle(np.roll(frames.last, 1, axis=0), frames.first)) < TINY
        bent = (1.0 if outer else -1.0) * frames.turn > 0.0
        on_tangent = smooth & bent & np.roll(bent, 1)
        on_tangent |= smooth & (frames.turn == 0.0) & (np.roll(frames.turn, 1) == 0.0)
        for box in self.boxes:
            on_tangent &= ~on_border(box, frames.start)
        at = np.stack([frames.start, frames.tip], axis=1)
        kept = np.stack([~on_tangent, bent], axis=1)
        corners = snapped(at[kept])
        return np.asarray(corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)])


@dataclass(frozen=True, eq=False)
class TrueRegion:
    """What is within an odd number of closed lines that keep apart, and what it is filled with."""

    lines: tuple[ClosedLine, ...]
    inward: tuple[bool, ...]  # of each line, whether the region ends within it
    law: Law

    @classmethod
    def within(cls, arcs: list[Floats], extent: Point, law: Law) -> TrueRegion:
        """Return the region of closed lines; raises TouchError where two of them meet."""
        lines = [ClosedLine(one, extent) for one in arcs]
        for one, other in combinations(lines, 2):
            if not arc_triangles.keep_apart(one.arcs, other.arcs):
                raise TouchError
        rings = [ArcFrames(one.arcs).start for one in lines]
        size = np.array([area_of(ring) for ring in rings])
        inside = holding([[ring] for ring in rings], np.array([ring[0] for ring in rings]))
        depth = (inside & (size[:, None] > size)).sum(axis=0)
        return cls(tuple(lines), tuple((depth % 2 == 1).tolist()), law)

    @property
    def solid(self) -> bool:
        """Whether it is body, not cut out."""
        return self.law not in NOTHING

    @property
    def arcs(self) -> Floats:
        """The arcs of all lines, shape (n, 4, 3)."""
        return np.concatenate([line.arcs for line in self.lines])

    def rings(self, outer: bool) -> list[Floats]:
        """Return the corners of the outer or inner polygon, what it holds to the left."""
        return [
            line.ring(outer != inward)[:: -1 if inward else 1]
            for line, inward in zip(self.lines, self.inward, strict=True)
        ]

    def crossing(self, axis: int, level: float) -> Iterator[tuple[Floats, Floats]]:
        """Yield where its outline meets a side across an axis, and a way along it from there."""
        frames = ArcFrames(self.arcs)  # arcs end where they meet sides of the array
        points, ways = [frames.start, frames.end], [frames.first, -frames.last]
        for at, way in zip(np.concatenate(points), np.concatenate(ways), strict=True):
            if abs(at[axis] - level) < CLOSE:
                yield np.round(at, 9) + 0.0, way

    def part_of(self, other: TrueRegion) -> float:
        """Return 1 if it holds all of another region, 0 if nothing, and else a share between."""
        frames, others = ArcFrames(self.arcs), ArcFrames(other.arcs)
        if len(arc_triangles.overlapping(frames.triangles, others.triangles, CLOSE)[0]):
            return 0.5
        own, its = ([ArcFrames(line.arcs).start for line in one.lines] for one in (self, other))
        if holding([its], np.array([line[0] for line in own])).any():
            return 0.5
        return float(holding([own], np.array([line[0] for line in its])).mean())


def holding(rings: list[list[Floats]], points: Floats) -> Flags:
    """Tell which regions hold which points, shape (regions, points): how often a ray meets them."""
    out = np.zeros((len(rings), len(points)), dtype=np.int64)
    if not (ring := [(k, one) for k, lines in enumerate(rings) for one in lines]):
        return out > 0
    start = np.concatenate([one for _, one in ring])
    end = np.concatenate([np.roll(one, -1, axis=0) for _, one in ring])
    region = np.repeat([k for k, _ in ring], [len(one) for _, one in ring])
    # Of points in the order of y those that lie level with a line follow one another.
    order = np.argsort(points[:, 1])
    ends = np.searchsorted(points[order, 1], np.sort([start[:, 1], end[:, 1]], axis=0))
    count = ends[1] - ends[0]
    line = np.repeat(np.arange(len(start)), count)
    point = order[np.arange(len(line)) - np.repeat(np.cumsum(count) - ends[1], count)]
    (x0, y0), (x1, y1), (x, y) = start[line].T, end[line].T, points[point].T
    crosses = x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x
    np.add.at(out, (region[line[crosses]], point[crosses]), 1)
    return out % 2 > 0


@dataclass(frozen=True, eq=False)
class TrueBody:
    """A box of one law, or of air, and regions that cover it one after the other."""

    law: Law
    regions: tuple[TrueRegion, ...]
    marks: list[Floats] = field(default_factory=list)  # points that are corners of triangles

    def __post_init__(self) -> None:
        lines = [line for region in self.regions for line in region.lines]
        for line, arcs in zip(lines, kept_apart([line.arcs for line in lines]), strict=True):
            line.arcs = arcs

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The laws of its materials."""
        laws = dict.fromkeys([self.law, *(region.law for region in self.regions)])
        return tuple(law for law in laws if law not in NOTHING)

    def extreme(self, stiffer: bool) -> Law:
        """Return the softest law no softer than any of the body's, or the stiffest no stiffer."""
        return reduce(lambda one, other: one.with_other(other, stiffer), self.laws)

    def refine(self, leaves: LeafCells) -> None:
        """Halve arcs until none is longer than a share of its leaves."""
        for region in self.regions:
            for line in region.lines:
                line.refine(leaves)

    def softer(self, number: int) -> bool:
        """Tell whether a region is no stiffer than all that it may cover."""
        return self._beside(number, self._laws_below[number], stiffer=False)

    def mixed(self, number: int) -> bool:
        """Tell whether a region is neither no stiffer nor no softer than all it may cover."""
        below = self._laws_below[number]
        return not any(self._beside(number, below, stiffer) for stiffer in (True, False))

    def _beside(self, number: int, below: set[Law], stiffer: bool) -> bool:
        law = self.regions[number].law
        return all(law == law.with_other(other, stiffer) for other in below)

    @cached_property
    def _laws_below(self) -> list[set[Law]]:
        """The laws that each region may cover: of those that hold it the last one's, and later."""
        found = []
        for number, region in enumerate(self.regions):
            below = {self.law, *(one.law for one in self.regions[:number])}
            if not any(self._beside(number, below, stiffer) for stiffer in (True, False)):
                below = {self.law}
                for earlier in self.regions[:number]:
                    if part := earlier.part_of(region):
                        below = {earlier.law} | (below if part < 1.0 else set())
            found.append(below)
        return found

    def corners(self, which: int | None = None) -> tuple[Floats, Floats]:
        """Return where arcs end, of all regions or one, and angles: below 0 body is round them."""
        places, kinks = [np.empty((0, 2))], [np.empty(0)]
        for region in self.regions if which is None else [self.regions[which]]:
            for line, inward in zip(region.lines, region.inward, strict=True):
                frames = ArcFrames(line.arcs)
                kink = angle(frames.last, np.roll(frames.first, -1, axis=0))
                kink = -kink if inward == region.solid else kink
                # two materials may meet at a corner of what is filled
                meet = region.solid and len(self.laws) > 1
                places.append(frames.end)
                kinks.append(-np.abs(kink) if meet else kink)
        return np.concatenate(places), np.concatenate(kinks)

    def without_limit(
        self, least: float, extent: tuple[int, int], which: int | None = None, most: float = np.pi
    ) -> Floats:
        """Return corners within the array at which stress has no limit, (n, 2), by their angle."""
        at, kink = self.corners(which)
        return at[((at > 0.0) & (at < extent)).all(axis=1) & (-kink > least) & (-kink <= most)]


KINK = np.radians(20.0)  # angle from which on agents at a corner are looked at one by one
SLIGHT = np.radians(0.5)  # angle that is none: of drawings, and by rounding
