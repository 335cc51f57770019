"""Triangles between the points of many squares at once, with given lines among their sides."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene.curves import cross

from .true_shapes import AT_ONCE

NEAR = 3e-9  # points nearer than this (in edges of the first agents) are one, or on a line
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


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
    corners = np.where(turn > 0.0, three[which], three[which][:, ::-1])
    return row[kept], corners[kept]


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
