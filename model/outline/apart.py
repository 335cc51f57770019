"""Whether outlines keep apart, and whether a polygon's own sides do."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np

from kaju.arrays import Floats

from .true_shapes import RoundShape, StraightShape, TrueShape

_CLOSE = 1e-7
"""Outlines nearer than this (in edges of the first agents) touch."""


def apart(one: TrueShape, other: TrueShape) -> bool:
    """Tell whether two outlines neither cross nor touch."""
    if isinstance(one, RoundShape):
        if isinstance(other, StraightShape):
            return _circle_apart(one, other)
        away = float(np.hypot(*np.subtract(one.centre, other.centre)))
        within = abs(one.radius - other.radius) - away
        return away > one.radius + other.radius + _CLOSE or within > _CLOSE
    if isinstance(other, RoundShape):
        return _circle_apart(other, one)
    return not any(
        _meet(start, end, *other_side) for start, end in _sides(one) for other_side in _sides(other)
    )


def simple(corners: list[tuple[float, float]]) -> bool:
    """Tell whether the sides of a polygon meet in its corners only."""
    ring = np.array([*corners, corners[0]])
    sides = list(pairwise(ring))
    scale = np.ptp(ring, axis=0).max()
    for (i, first), (k, second) in combinations(enumerate(sides), 2):
        if k - i in (1, len(sides) - 1):
            continue
        if _meet(*(end / scale for end in (*first, *second))):
            return False
    return True


def _sides(shape: StraightShape) -> list[tuple[Floats, Floats]]:
    ring = shape.border(True)
    return list(pairwise(ring))


def _circle_apart(circle: RoundShape, polygon: StraightShape) -> bool:
    centre = np.array(circle.centre)
    for start, end in _sides(polygon):
        run = end - start
        t = np.clip((centre - start) @ run / (run @ run), 0.0, 1.0)
        nearest = np.hypot(*(start + t * run - centre))
        farthest = max(np.hypot(*(start - centre)), np.hypot(*(end - centre)))
        if nearest <= circle.radius + _CLOSE and farthest >= circle.radius - _CLOSE:
            return False
    return True


def _meet(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Tell whether two straight lines between points cross or touch."""
    if _crossing(a, b, c, d):
        return True
    ends = [(c, a, b), (d, a, b), (a, c, d), (b, c, d)]
    for point, start, end in ends:
        run = end - start
        t = np.clip((point - start) @ run / (run @ run), 0.0, 1.0)
        if np.hypot(*(start + t * run - point)) <= _CLOSE:
            return True
    return False


def _crossing(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    def side(p: Floats, q: Floats, r: Floats) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0
