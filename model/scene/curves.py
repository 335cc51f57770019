"""Closed lines of smooth curves: straight lines, parts of conic sections, Bézier curves.

All are rational cubic curves, in arrays of shape (n, 4, 3): control points (w x, w y, w), their
weights above 0.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from kaju.arrays import Floats

Point = tuple[float, float]


def line(start: Point, end: Point) -> Floats:
    """Return a straight line."""
    return cubic(start, start, end, end)


def cubic(start: Point, first: Point, second: Point, end: Point) -> Floats:
    """Return a Bézier curve."""
    return np.column_stack([[start, first, second, end], np.ones(4)])


def conic(start: Point, tip: Point, end: Point, weight: float) -> Floats:
    """Return a part of a conic section by its end tangents, which meet in the tip."""
    a, b, c = (w * np.array([*p, 1.0]) for p, w in ((start, 1.0), (tip, weight), (end, 1.0)))
    return np.stack([a, (a + 2.0 * b) / 3.0, (2.0 * b + c) / 3.0, c])


def elliptic(centre: Point, first: Point, second: Point) -> Floats:
    """Return the four quarters of an ellipse by two half-axes, from the first to the second on."""
    c, p, q = (np.array(at) for at in (centre, first, second))
    quarters = ((p, q), (q, -p), (-p, -q), (-q, p))
    return np.array([conic(c + a, c + a + b, c + b, np.sqrt(0.5)) for a, b in quarters])


def polygonal(corners: Iterable[Point]) -> Floats:
    """Return the straight lines round corners that differ."""
    ring = [(float(x), float(y)) for x, y in corners]
    ring = [corner for k, corner in enumerate(ring) if corner != ring[k - 1]]
    return np.array([line(p, q) for p, q in zip(ring, [*ring[1:], ring[0]], strict=True)])


def parted(arcs: Floats, at: Floats | float) -> Floats:
    """Return the two parts of each arc at parameters, one after the other. Shape (2 n, 4, 3)."""
    t = np.broadcast_to(np.asarray(at, dtype=np.float64), len(arcs))[:, None, None]
    rows, starts, ends = arcs, [arcs[:, 0]], [arcs[:, 3]]
    for _ in range(3):
        rows = (1.0 - t) * rows[:, :-1] + t * rows[:, 1:]
        starts.append(rows[:, 0])
        ends.append(rows[:, -1])
    both = np.stack([np.stack(starts, axis=1), np.stack(ends[::-1], axis=1)], axis=1)
    return both.reshape(-1, 4, 3)


def parted_at(arc: Floats, places: Floats) -> list[Floats]:
    """Return the parts of an arc between parameters."""
    parts, sofar = [], 0.0
    for t in np.unique(places):
        if sofar + 1e-9 < t < 1.0 - 1e-9:
            first, arc = parted(arc[None], float((t - sofar) / (1.0 - sofar)))
            parts.append(first)
            sofar = float(t)
    return [*parts, arc]


def inflections(arc: Floats) -> Floats:
    """Return parameters where a Bézier curve (of weights 1) turns the other way."""
    p = arc[:, :2]
    a, b, c = p[1] - p[0], p[2] - 2 * p[1] + p[0], p[3] - 3 * p[2] + 3 * p[1] - p[0]
    # first and second derivative are parallel there
    return real_roots(np.array([cross(b, c), cross(a, c), cross(a, b)]))


def real_roots(factors: Floats, imaginary: float = 0.0) -> Floats:
    """Return where a polynomial vanishes, its factors given from that of the highest power on."""
    # A factor that rounding hides beside others puts a root out of reach; NumPy would divide by it.
    small = np.abs(factors) < 1e-18 * np.abs(factors).max(initial=0.0)
    roots = np.roots(np.where(small, 0.0, factors))
    return np.asarray(roots[np.abs(roots.imag) <= imaginary].real)


def flattened(arcs: Floats, count: int) -> Floats:
    """Return points along arcs, `count` on each. Shape (n count, 2)."""
    t = np.arange(count)[:, None, None] / count
    rows = arcs[:, None]
    for _ in range(3):
        rows = (1.0 - t) * rows[..., :-1, :] + t * rows[..., 1:, :]
    at = rows[:, :, 0].reshape(-1, 3)
    return np.asarray(at[:, :2] / at[:, 2:])


def cross(a: Floats, b: Floats) -> Floats:
    """Return the sine of the angles between vectors, times their lengths."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def crossings(arc: Floats, axis: int, value: float) -> Floats:
    """Return parameters where an arc meets a line across an axis."""
    a, b, c, d = arc[:, axis] - value * arc[:, 2]
    factors = np.array([d - 3 * c + 3 * b - a, 3 * (c - 2 * b + a), 3 * (b - a), a])
    return real_roots(factors, imaginary=1e-7)
