"""Regions with true outlines: what a square holds of the body at least, and at most."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.scene.curves import Point, cross, crossings, parted, parted_at

from .arc_triangles import ArcFrames, TouchError, angle, halved, in_triangles, keep_apart
from .convex_pieces import ON_LINE, Corners, HalfPlane, Parts, area_of, rings_of, sides_of, split
from .convex_pieces import parted as parted_by
from .laws import AIR, UNIT, Law
from .square_leaves import SquareLeaves

Held = dict[Law, list[Corners]]  # convex pieces that a leaf holds of each law
AT_ONCE = 1_000_000  # pairs of squares and lines that are compared in one go
FLAT = 1e-15  # pockets of less area (in first agents) come of rounding
SMOOTH = 1e-9  # arcs that meet at a smaller angle go on in one direction


class StraightShape:
    """A polygon: its convex hull without its pockets, which are polygons again."""

    def __init__(self, corners: Corners):
        if area_of(corners) < 0.0:
            corners = corners[::-1]
        ring = list(range(len(corners)))
        hull = _hull(corners)
        self.corners = corners
        self._hull = [corners[k] for k in hull]
        self.pockets: list[StraightShape] = []
        for first, last in zip(hull, [*hull[1:], hull[0] + len(ring)], strict=True):
            if last - first > 1:
                pocket = [corners[k % len(ring)] for k in range(first, last + 1)]
                # rounding leaves a hull of two corners, which would be its own pocket for ever
                if abs(area_of(pocket)) > FLAT and len(_hull(pocket)) > 2:
                    self.pockets.append(StraightShape(pocket))
        # where pockets are many, only squares that touch their boxes are asked
        self._low = np.array([np.min(pocket.corners, axis=0) for pocket in self.pockets])
        self._high = np.array([np.max(pocket.corners, axis=0) for pocket in self.pockets])

    def parts(self, squares: list[Corners]) -> list[Parts]:
        """Return convex parts of squares, each with the lines that bound it."""
        found: list[Parts] = [[] for _ in squares]
        for k, planes in _relevant(self._hull, squares):
            hull: Corners | None = squares[k]
            for plane in planes:
                hull = parted_by(hull, plane)[0] if hull else None
            found[k] = [] if hull is None else [(hull, planes)]
        at = np.array([k for k, parts in enumerate(found) if parts], dtype=np.int64)
        if not self.pockets or not len(at):
            return found
        left = {k: [found[k][0][0]] for k in at.tolist()}
        corners = np.array([squares[k] for k in at])
        for pocket, low, high in zip(self.pockets, self._low, self._high, strict=True):
            beside = (low < corners[:, 2]).all(axis=1) & (high > corners[:, 0]).all(axis=1)
            asked = at[beside].tolist()
            for k, parts in zip(asked, pocket.parts([squares[k] for k in asked]), strict=True):
                left[k] = split(left[k], parts)[1]
        return [[(piece, None) for piece in left.get(k, ())] for k in range(len(squares))]


class ArcShape:
    """What a closed line of arcs holds, between two polygons that touch it in the arcs' ends.

    One of them takes the chord of each arc, the other one its end tangents; which is the outer
    one depends on where the arc bends. Straight lines are both.
    """

    def __init__(self, arcs: Floats, extent: Point):
        parts = []
        points = arcs[:, :, :2] / arcs[:, :, 2:]
        ends = zip(points.min(axis=1), points.max(axis=1), ArcFrames(arcs).turn, strict=True)
        for arc, (low, high, turn) in zip(arcs, ends, strict=True):
            # where an arc meets the sides of the array both polygons do so too
            split = [arc]
            for axis, side in ((a, s) for a in (0, 1) for s in (0.0, float(extent[a]))):
                if turn != 0.0 and low[axis] < side < high[axis]:
                    split = [part for one in split for part in _parted_on(one, axis, side)]
            parts += split
        self.arcs = in_triangles(np.array(parts))
        start = ArcFrames(self.arcs).start
        if area_of([(x, y) for x, y in start.tolist()]) < 0.0:
            self.arcs = self.arcs[::-1, ::-1]
        self._draw()

    def refine(self, leaves: SquareLeaves) -> Floats:
        """Halve arcs until none is longer than its leaves; return boxes of those halved."""
        boxes = [np.empty((0, 2, 2))]
        while True:
            frames = ArcFrames(self.arcs)
            size = np.full(len(self.arcs), np.inf)
            for points in (frames.start, frames.tip, frames.end):
                leaf = leaves.at(points)
                here = np.where(leaf >= 0, leaves.size[leaf] * leaves.unit, np.inf)
                size = np.minimum(size, here)
            long = (frames.turn != 0.0) & (frames.length > size)
            if not long.any():
                break
            around = np.stack([frames.start, frames.tip, frames.end])[:, long]
            boxes.append(np.stack([around.min(axis=0), around.max(axis=0)], axis=1))
            self.arcs = halved(self.arcs, long)
        if len(boxes) > 1:
            self._draw()
        return np.concatenate(boxes)

    def part_along(self, direction: Point) -> None:
        """Part arcs where they run along a direction."""
        frames = ArcFrames(self.arcs)
        sides = np.sign([cross(at, np.array(direction)) for at in (frames.first, frames.last)])
        turning = (sides[0] * sides[1] < 0.0) & (frames.turn != 0.0)
        parts = []
        for arc, side, turns in zip(self.arcs, sides[0], turning, strict=True):
            low, high = 0.0, 1.0
            for _ in range(60 if turns else 0):
                middle = 0.5 * (low + high)
                tangent = ArcFrames(parted(arc[None], middle)[1:]).first[0]
                if cross(tangent, np.array(direction)) * side > 0.0:
                    low = middle
                else:
                    high = middle
            parts += parted_at(arc, np.array([low]))
        self.arcs = np.array(parts)
        self._draw()

    def _draw(self) -> None:
        """Draw both polygons."""
        frames = ArcFrames(self.arcs)
        # corners on tangents, and between lines that go on, are none
        smooth = np.abs(angle(np.roll(frames.last, 1, axis=0), frames.first)) < SMOOTH
        self._polygons = []
        for sign in (1.0, -1.0):
            bent = sign * frames.turn > 0.0
            on_tangent = smooth & bent & np.roll(bent, 1)
            on_tangent |= smooth & (frames.turn == 0.0) & (np.roll(frames.turn, 1) == 0.0)
            at = np.stack([frames.start, frames.tip], axis=1)
            kept = np.stack([~on_tangent, bent], axis=1)
            self._polygons.append(StraightShape([(x, y) for x, y in at[kept].tolist()]))

    def border(self, outer: bool) -> Floats:
        """Return the sides of the polygon, counter-clockwise. Shape (n, 2, 2)."""
        at = np.array(self._polygons[0 if outer else 1].corners)
        return np.stack([at, np.roll(at, -1, axis=0)], axis=1)

    def parts(self, squares: list[Corners], outer: bool) -> list[Parts]:
        """Return convex parts of squares, each with the lines that bound it."""
        return self._polygons[0 if outer else 1].parts(squares)


def _parted_on(arc: Floats, axis: int, side: float) -> list[Floats]:
    """Return the parts of an arc on both sides of a line, with ends that lie on it."""
    parts = parted_at(arc, crossings(arc, axis, side))
    for one, following in pairwise(parts):
        for at in (one[3], following[0]):
            at[axis] = side * at[2]
    return parts


def _hull(corners: Corners) -> list[int]:
    """Return which corners lie on the convex hull, counter-clockwise, the smallest number first."""
    order = sorted(range(len(corners)), key=lambda k: corners[k])
    chain: list[int] = []
    for half in (order, order[::-1]):
        start = len(chain)
        for k in half:
            while len(chain) - start >= 2:
                (x0, y0), (x1, y1), (x2, y2) = (corners[c] for c in (chain[-2], chain[-1], k))
                if (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0) > 0.0:
                    break
                chain.pop()
            chain.append(k)
        chain.pop()
    least = chain.index(min(chain))
    return chain[least:] + chain[:least]


def _relevant(hull: Corners, squares: list[Corners]) -> Iterator[tuple[int, list[HalfPlane]]]:
    """Yield squares that hold some of a convex polygon, and its half-planes that cut them there.

    Convex polygons without a common point are parted by a side of one of them.
    """
    planes = sides_of(hull)
    at = np.array(planes)
    least = np.stack([np.maximum(at[:, :2], 0.0), np.minimum(at[:, :2], 0.0)])  # by corner, axis
    most, least = (np.column_stack([*ends, at[:, 2]]) for ends in (least[::-1], least))
    ends = np.stack([hull, [*hull[1:], hull[0]]])
    first, last = ends.min(axis=0), ends.max(axis=0)
    block = max(AT_ONCE // len(planes), 1)
    for start in range(0, len(squares), block):
        corners = np.array(squares[start : start + block])
        low, high = corners[:, 0], corners[:, 2]
        reach = np.column_stack([low, high, np.full(len(low), -1.0)])
        left = (reach @ least.T < -ON_LINE).all(axis=1)
        left &= (high - first.min(axis=0) > ON_LINE).all(axis=1)
        left &= (last.max(axis=0) - low > ON_LINE).all(axis=1)
        meets = np.repeat(left[:, None], len(planes), axis=1)
        for axis in (0, 1):
            meets &= high[:, axis, None] > first[:, axis] - ON_LINE
            meets &= low[:, axis, None] < last[:, axis] + ON_LINE
        k, line = np.nonzero(meets)
        cutting = (reach[k] * most[line]).sum(axis=1) > ON_LINE
        cut: list[list[HalfPlane]] = [[] for _ in corners]
        for row, plane in zip(k[cutting].tolist(), line[cutting].tolist(), strict=True):
            cut[row].append(planes[plane])
        yield from ((start + row, cut[row]) for row in np.flatnonzero(left).tolist())


@dataclass(frozen=True)
class TrueRegion:
    """A shape, and what it is filled with."""

    shape: TrueShape
    law: Law

    @property
    def solid(self) -> bool:
        """Whether it is filled, not cut out."""
        return self.law != AIR


@dataclass(frozen=True)
class TrueBody:
    """A box of one law, or of air, and regions that cover it one after the other.

    Of one law it is a shape again: a ring is a disk in air with a disk of air in it.
    """

    law: Law
    regions: tuple[TrueRegion, ...]

    @property
    def solid(self) -> bool:
        """Whether the box is filled where no region covers it."""
        return self.law != AIR

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The laws of its materials."""
        laws = dict.fromkeys([self.law, *(region.law for region in self.regions)])
        return tuple(law for law in laws if law != AIR)

    @property
    def arcs(self) -> Floats:
        """The arcs of all regions, shape (n, 4, 3)."""
        return np.concatenate([region.shape.arcs for region in self.regions])

    def refine(self, leaves: SquareLeaves) -> Floats:
        """Halve arcs until none is longer than its leaves; return boxes of those halved."""
        boxes = [region.shape.refine(leaves) for region in self.regions]
        return np.concatenate([np.empty((0, 2, 2)), *boxes])

    def part_along(self, direction: Point) -> None:
        """Part arcs where they run along a direction."""
        for region in self.regions:
            region.shape.part_along(direction)

    def border(self, outer: bool) -> Floats:
        """Return the sides of regions that do not meet, the body to the left. Shape (n, 2, 2)."""
        sides = []
        for region in self.regions:
            side = region.shape.border(outer == region.solid)
            sides.append(side if region.solid else side[::-1, ::-1])
        return np.concatenate(sides)

    def parts(self, squares: list[Corners], outer: bool) -> list[Parts]:
        """Return convex parts of squares."""
        return [[(piece, None) for piece in held] for held in self._pieces(squares, outer)]

    def held(self, squares: list[Corners], outer: bool) -> list[Held]:
        """Return what squares hold of each law.

        That is no less and no softer than the body (outer), or no more and no stiffer. Where an
        outline's two polygons leave it open which of two materials there is, one bound takes a law
        that is no softer than both, the other one a law that is no stiffer.
        """
        if len(self.laws) == 1:
            return [{self.laws[0]: at} if at else {} for at in self._pieces(squares, outer)]
        painted = [[(self.law, square)] for square in squares]
        for region in self.regions:
            core, reach = (region.shape.parts(squares, polygon) for polygon in (False, True))
            for k in range(len(squares)):
                if reach[k]:
                    painted[k] = list(_covered(painted[k], region.law, core[k], reach[k], outer))
        found: list[Held] = []
        for pieces in painted:
            of: Held = {}
            for law, piece in pieces:
                of.setdefault(law, []).append(piece)
            of.pop(AIR, None)
            found.append(of)
        return found

    def _pieces(self, squares: list[Corners], outer: bool) -> list[list[Corners]]:
        """Return convex pieces of squares in a body of one law."""
        held = [[square] if self.solid else [] for square in squares]
        for region in self.regions:
            asked = [k for k, at in enumerate(squares) if not (region.solid and held[k] == [at])]
            found = region.shape.parts([squares[k] for k in asked], outer == region.solid)
            for k, parts in zip(asked, found, strict=True):
                if parts and parts[0][0] == squares[k]:
                    held[k] = [squares[k]] if region.solid else []
                elif parts:
                    held[k] = split(held[k], parts)[1]
                    held[k] = held[k] + [part for part, _ in parts if region.solid]
        return held


def _covered(
    painted: list[tuple[Law, Corners]], law: Law, core: Parts, reach: Parts, stiffer: bool
) -> Iterator[tuple[Law, Corners]]:
    """Yield pieces and their laws after a region of another law that covers some of them."""
    for before, piece in painted:
        either = before.with_other(law, stiffer)
        inside, outside = split([piece], core if either == before else reach)
        band: list[Corners] = []  # between what the region covers at least and at most
        if either not in (before, law):
            inside, band = split(inside, core)
        yield from ((law, part) for part in inside)
        yield from ((either, part) for part in band)
        yield from ((before, part) for part in outside)


@dataclass(frozen=True, eq=False)
class CutLeaf:
    """What a leaf holds that is not all of it."""

    square: Corners
    held: Held

    @cached_property
    def rings(self) -> list[list[Corners]]:
        """Closed lines round what it holds of each law."""
        return rings_of(list(self.held.values()), self.square)


class HeldLeaves(NamedTuple):
    """What leaves hold of a body."""

    laws: list[Law]  # the body's, and those between two of them
    whole: Ints  # the law that fills each leaf, -1 of the others
    cut: dict[int, CutLeaf]  # the others, but for those that hold nothing

    def only(self, kept: Ints) -> HeldLeaves:
        """Return what some of the leaves hold."""
        number = np.full(len(self.whole), -1)
        number[kept] = np.arange(len(kept))
        cut = {int(number[k]): leaf for k, leaf in self.cut.items() if number[k] >= 0}
        return HeldLeaves(self.laws, self.whole[kept], cut)


class CutLeaves:
    """What leaves hold of a body; those that did not change are not cut again."""

    def __init__(self, body: TrueBody):
        self.body = body
        none = np.empty(0, dtype=np.int64)
        self._leaves = SquareLeaves(none, none, none, (0, 0))
        self._held = (HeldLeaves(list(body.laws), none, {}),) * 2

    def refined(self, leaves: SquareLeaves) -> tuple[HeldLeaves, HeldLeaves]:
        """Return what leaves hold at most and at least, or no softer and no stiffer than it is."""
        before = self._unchanged(leaves, self.body.refine(leaves))
        fresh = np.flatnonzero(before < 0)
        squares, found = leaves.squares(fresh), []
        for old, outer in zip(self._held, (True, False), strict=True):
            whole = np.append(old.whole, -1)[before]
            kept = np.flatnonzero((before >= 0) & (whole < 0))
            pairs = zip(kept.tolist(), before[kept].tolist(), strict=True)
            cut = {k: old.cut[at] for k, at in pairs if at in old.cut}
            of = self.body.held(squares, outer)
            for k, square, held in zip(fresh.tolist(), squares, of, strict=True):
                old.laws.extend(law for law in held if law not in old.laws)
                if list(held.values()) == [[square]]:
                    whole[k] = old.laws.index(next(iter(held)))
                elif held:
                    cut[k] = CutLeaf(square, held)
            found.append(HeldLeaves(old.laws, whole, cut))
        self._leaves, self._held = leaves, (found[0], found[1])
        return self._held

    def _unchanged(self, leaves: SquareLeaves, boxes: Floats) -> Ints:
        """Return the earlier leaf that holds the same as each, or fills it; -1 for none."""
        old = self._leaves
        if not len(old):
            return np.full(len(leaves), -1)
        outer, inner = (held.whole for held in self._held)
        cut = (outer != inner) | (outer < 0)  # the others stay so
        low, size = old.lower()[cut], old.size[cut, None] * old.unit
        changed = np.zeros(len(low), dtype=np.bool_)
        for first, last in boxes:
            changed |= ((low <= last) & (low + size >= first)).all(axis=1)
        valid = np.zeros(len(old), dtype=np.int64)  # 0 for leaves of any size, -1 for none
        valid[cut] = np.where(changed, -1, old.size[cut])
        at = old.at(leaves.lower())
        return np.where((valid[at] == 0) | (valid[at] == leaves.size), at, -1)


TrueShape = ArcShape | TrueBody


def nested(lines: list[Floats], extent: Point) -> TrueShape:
    """Return the shape within closed lines that do not meet: every second one is a hole."""
    shapes = [ArcShape(arcs, extent) for arcs in lines]
    if len(shapes) == 1:
        return shapes[0]
    for one, other in combinations(shapes, 2):
        if not keep_apart(one.arcs, other.arcs):
            raise TouchError
    rings = [one.border(False)[:, 0] for one in shapes]
    size = [area_of([(x, y) for x, y in ring.tolist()]) for ring in rings]
    depth = [
        sum(size[k] > size[one] and _holds(rings[k], rings[one][0]) for k in range(len(rings)))
        for one in range(len(rings))
    ]
    order = np.argsort(depth, kind="stable")
    regions = [TrueRegion(shapes[k], AIR if depth[k] % 2 else UNIT) for k in order]
    return TrueBody(AIR, tuple(regions))


def _holds(ring: Floats, point: Floats) -> bool:
    """Tell whether a point lies within a polygon (even-odd rule)."""
    x, y = (ring - point).T
    u, v = np.roll(x, -1), np.roll(y, -1)
    crosses = (y > 0.0) != (v > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return bool((crosses & (x - y * (u - x) / (v - y) > 0.0)).sum() % 2)
