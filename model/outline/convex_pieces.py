"""Convex pieces of a square: cut by straight lines, made whole again, and split into triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import pairwise
from math import atan2, hypot

from kaju.model.scene.curves import Point

from .true_shapes import AIR, Law

Corners = list[Point]  # corners of a polygon, counter-clockwise
HalfPlane = tuple[float, float, float]
"""a, b, c: all points with a x + b y <= c; (a, b) has length 1."""

ON_LINE = 1e-9  # points this near to a line (in edges of the first agents) lie on it
NEAR = 3e-9  # points nearer than this (in edges of the first leaves) are one
LEAST_AREA = 1e-4  # pieces of less area (in leaves) may be slivers


def area_of(corners: Sequence[Point]) -> float:
    """Return the area of a polygon, negative if it runs clockwise."""
    x0, y0 = corners[0]
    total = 0.0
    for (x1, y1), (x2, y2) in pairwise(corners[1:]):
        total += (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    return 0.5 * total


def parted(corners: Corners, plane: HalfPlane) -> tuple[Corners | None, Corners | None]:
    """Return the parts of a convex polygon within a half-plane and beyond; None has no area."""
    a, b, c = plane
    away = [a * x + b * y - c for x, y in corners]
    away = [0.0 if -ON_LINE < d < ON_LINE else d for d in away]
    if max(away) <= 0.0:
        return corners, None
    if min(away) >= 0.0:
        return None, corners
    kept: Corners = []
    beyond: Corners = []
    q, there = corners[0], away[0]
    for k in range(len(corners) - 1, -1, -1):
        # from the last corner back, each with the one that follows it
        p, here = corners[k], away[k]
        if here * there < 0.0:
            t = here / (here - there)
            # along an axis the other coordinate stays exactly what it was
            x = p[0] if p[0] == q[0] else p[0] + t * (q[0] - p[0])
            y = p[1] if p[1] == q[1] else p[1] + t * (q[1] - p[1])
            kept.append((x, y))
            beyond.append((x, y))
        if here <= 0.0:
            kept.append(p)
        if here >= 0.0:
            beyond.append(p)
        q, there = p, here
    return kept[::-1], beyond[::-1]


def sides_of(corners: Corners) -> list[HalfPlane]:
    """Return the half-planes of a convex polygon."""
    planes = []
    for (x0, y0), (x1, y1) in pairwise([*corners, corners[0]]):
        length = hypot(x1 - x0, y1 - y0)
        a, b = (y1 - y0) / length, (x0 - x1) / length
        planes.append((a, b, a * x0 + b * y0))
    return planes


def split(pieces: list[Corners], parts: list[Corners]) -> tuple[list[Corners], list[Corners]]:
    """Return what of convex pieces lies within parts, and beyond them all."""
    inside, left = [], pieces
    for part in parts:
        beyond: list[Corners] = []
        for piece in left:
            if piece == part:
                inside.append(piece)
                continue
            rest: Corners | None = piece
            outside: list[Corners] = []
            for line in sides_of(part):
                if rest is None:
                    break
                rest, other = parted(rest, line)
                outside += [] if other is None else [other]
            beyond += [piece] if rest is None else outside
            inside += [] if rest is None else [rest]
        left = beyond
    return inside, left


def rings_of(parts: list[list[Corners]], square: Corners) -> list[list[Corners]]:
    """Return closed lines round what a leaf holds of each law, without ends of cuts on its sides.

    Lines of two laws have the same corners where they run side by side.
    """
    edge = square[1][0] - square[0][0]
    if len(parts) == 1 and len(parts[0]) == 1 and area_of(parts[0][0]) > LEAST_AREA * edge**2:
        ring = parts[0][0]
        legs = zip(ring, ring[-1:] + ring[:-1], strict=True)
        round_one = [p for p, q in legs if max(abs(p[0] - q[0]), abs(p[1] - q[1])) > NEAR]
        return [_on_sides([round_one], square)]
    joints = square + [at for pieces in parts if len(parts) > 1 for piece in pieces for at in piece]
    return [_on_sides(_lines_round(pieces, joints), square) for pieces in parts]


def _lines_round(pieces: list[Corners], joints: list[Point]) -> list[Corners]:
    """Return closed lines round pieces, or round each of them where they enclose a hole."""
    points, rings = outlines_of(pieces, joints, NEAR)
    if any(area_of([points[k] for k in ring]) < 0.0 for ring in rings):
        rings = [ring for piece in pieces for ring in outlines_of([piece], points, NEAR)[1]]
    return [[points[k] for k in ring] for ring in rings]


def _on_sides(rings: list[Corners], square: Corners) -> list[Corners]:
    """Return closed lines, corners near the sides moved onto them, those within a side left out."""
    (x0, y0), _, (x1, y1), _ = square
    found = []
    for ring in rings:
        at = [
            (
                x0 if abs(x - x0) <= NEAR else x1 if abs(x - x1) <= NEAR else x,
                y0 if abs(y - y0) <= NEAR else y1 if abs(y - y1) <= NEAR else y,
            )
            for x, y in ring
        ]
        kept = [
            q
            for p, q, r in zip(at[-1:] + at[:-1], at, at[1:] + at[:1], strict=True)
            if not (p[0] == q[0] == r[0] and q[0] in (x0, x1))
            and not (p[1] == q[1] == r[1] and q[1] in (y0, y1))
        ]
        if len(kept) > 2:
            found.append(kept)
    return found


def outlines_of(
    pieces: Iterable[Corners], beside: list[Point], near: float
) -> tuple[list[Point], list[list[int]]]:
    """Return points, and closed lines through them round convex pieces that touch.

    Points nearer than `near` are one; sides are split where points lie on them, those `beside` too.
    """
    points: list[Point] = []

    def number(point: Point) -> int:
        for k, (x, y) in enumerate(points):
            if abs(point[0] - x) <= near and abs(point[1] - y) <= near:
                return k
        points.append(point)
        return len(points) - 1

    for point in beside:
        number(point)
    rings = [[number(point) for point in piece] for piece in pieces]
    sides: Counter[tuple[int, int]] = Counter()
    for ring in rings:
        for k, first in enumerate(ring):
            last = ring[k - len(ring) + 1]
            run = _points_along(points, first, last, near)
            for side in pairwise(run):
                back = (side[1], side[0])
                if sides[back]:
                    sides[back] -= 1
                else:
                    sides[side] += 1
    return points, _chained(points, sides.elements())


def _points_along(points: list[Point], first: int, last: int, near: float) -> list[int]:
    """Return the points on the straight line between two of them, in order."""
    (x0, y0), (x1, y1) = points[first], points[last]
    dx, dy = x1 - x0, y1 - y0
    length = (dx * dx + dy * dy) ** 0.5
    if length == 0.0:
        return [first]
    between = []
    for k, (x, y) in enumerate(points):
        if k != first and k != last and abs((x - x0) * dy - (y - y0) * dx) <= near * length:
            along = ((x - x0) * dx + (y - y0) * dy) / length
            if 0.0 < along < length:
                between.append((along, k))
    return [first, *(k for _, k in sorted(between)), last]


def _chained(points: list[Point], sides: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return closed lines of directed sides; where two meet in a point, each turns sharply left."""
    onward: dict[int, list[int]] = {}
    for first, last in sorted(sides):
        onward.setdefault(first, []).append(last)

    def turn(before: int, here: int, after: int) -> float:
        (x0, y0), (x1, y1), (x2, y2) = points[before], points[here], points[after]
        (ax, ay), (bx, by) = (x1 - x0, y1 - y0), (x2 - x1, y2 - y1)
        return atan2(ax * by - ay * bx, ax * bx + ay * by)

    rings = []
    while onward:
        ring = [next(iter(onward))]
        while True:
            here = ring[-1]
            ends = onward[here]
            if len(ends) == 1 or len(ring) == 1:
                following = ends.pop()
            else:
                following = max(ends, key=partial(turn, ring[-2], here))
                ends.remove(following)
            if not ends:
                del onward[here]
            if following == ring[0]:
                break
            ring.append(following)
        rings.append(ring)
    return rings


def painted(
    square: Corners,
    law: Law,
    layers: list[tuple[Law, list[Corners] | bool, bool]],
    stiffer: bool,
) -> dict[Law, list[Corners]]:
    """Return the polygons of each law in a square that regions cover one after the other.

    A layer is a region's law, what it covers (all, nothing, triangles), and whether the law taken
    near its outline is one no softer (or no stiffer) than both.
    """
    pieces = [(law, square)]
    for over, covers, mixed in layers:
        if isinstance(covers, bool):
            pieces = [(over, square)] if covers else pieces
            continue
        after = []
        for before, piece in pieces:
            inside, outside = split([piece], covers)
            either = before.with_other(over, stiffer) if mixed else None
            within = either if stiffer and either else over
            beyond = either if not stiffer and either and before != AIR else before
            after += [(within, part) for part in inside] + [(beyond, part) for part in outside]
        pieces = after
    found: dict[Law, list[Corners]] = {}
    for of, piece in pieces:
        if of != AIR:
            found.setdefault(of, []).append(piece)
    return dict(zip(found, rings_of(list(found.values()), square), strict=True))
