"""What a square holds where several outlines come through it, as triangles."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.scene.curves import cross

from .true_shapes import snapped

NEAR = 3e-9  # points nearer than this (in edges of the first leaves) are one, or on a line
MOST_POINTS = 40  # in a square; with more it is halved first
WHOLE = 1e-9  # share of a square by which triangles may miss to fill it
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def crossed(
    lower: Floats, size: float, lines: Floats, numbers_at: Callable[[Floats], Ints]
) -> tuple[Floats, Ints] | None:
    """Return triangles, (n, 3, 2), and the number of what each holds; None where these are vague.

    `lines` are ends of straight lines, (m, 2, 2), beyond which `numbers_at` points may differ.
    """
    corners = lower + size * SQUARE
    points = _apart(np.concatenate([corners, lines.reshape(-1, 2), _crossings(lines)]), corners)
    if len(points) > MOST_POINTS:
        return None
    triangles, sides = _triangles(points, _parts(points, lines))
    number = numbers_at(points[triangles].mean(axis=1))
    # once more by those lines and points alone that part what differs
    beside: dict[tuple[int, int], set[int]] = {}
    for three, own in zip(triangles.tolist(), number.tolist(), strict=True):
        for a, b in combinations(three, 2):
            beside.setdefault((a, b), set()).add(own)
    parting = np.array([side for side in sides if len(beside.get(side, ())) > 1], dtype=np.int64)
    kept, ends = np.unique(np.append(np.arange(4), parting), return_inverse=True)
    points = points[kept]
    pairs = ends[4:].reshape(-1, 2).tolist()
    triangles, _ = _triangles(points, [(a, b) for a, b in pairs])
    at = points[triangles]
    area = np.asarray(0.5 * cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]))
    at[area < 0.0] = at[area < 0.0, ::-1]
    if abs(np.abs(area).sum() - size**2) > WHOLE * size**2:
        return None
    return at, numbers_at(at.mean(axis=1))


def _crossings(lines: Floats) -> Floats:
    """Return where lines cross."""
    i, j = np.triu_indices(len(lines), 1)
    (a, b), (c, d) = lines[i].swapaxes(0, 1), lines[j].swapaxes(0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = (cross(c - a, run) / cross(b - a, d - c) for run in (d - c, b - a))
    on = (t > 0.0) & (t < 1.0) & (s > 0.0) & (s < 1.0)
    return np.asarray(a[on] + t[on, None] * (b - a)[on])


def _apart(points: Floats, corners: Floats) -> Floats:
    """Return points, those near to the sides of a square moved onto them, and of near ones one."""
    for end in corners[[0, 2]]:
        points = np.where(np.abs(points - end) <= NEAR, end, points)
    points = snapped(points)
    near = (np.abs(points[:, None] - points) <= NEAR).all(axis=2)
    return np.asarray(points[np.unique(near.argmax(axis=1))])


def _parts(points: Floats, lines: Floats) -> list[tuple[int, int]]:
    """Return the points at both ends of the parts of lines between points."""
    found: set[tuple[int, int]] = set()
    for start, end in lines:
        run = end - start
        long = float(np.hypot(*run))
        along = (points - start) @ run / long
        on = np.abs(cross(run, points - start)) <= 2.0 * NEAR * long
        on &= (along > -2.0 * NEAR) & (along < long + 2.0 * NEAR)
        order = np.flatnonzero(on)[np.argsort(along[on])].tolist()
        found |= {(min(a, b), max(a, b)) for a, b in pairwise(order)}
    return sorted(found)


def _triangles(points: Floats, sides: list[tuple[int, int]]) -> tuple[Ints, list[tuple[int, int]]]:
    """Return triangles with given sides, and all others as short as may be, and all sides."""
    count = len(points)
    i, j = np.triu_indices(count, 1)
    run = points[j] - points[i]
    long = np.hypot(*run.T)
    # of all points how far they are from lines between two
    away = points - points[i, None]
    off = cross(run[:, None], away) / long[:, None]
    off[np.abs(off) <= NEAR] = 0.0
    along = np.einsum("mkd,md->mk", away, run) / long[:, None]
    passes = ((off == 0.0) & (along > NEAR) & (along < long[:, None] - NEAR)).any(axis=1)
    cuts = off[:, i] * off[:, j] < 0.0
    cuts &= cuts.T
    given = np.zeros((count, count), dtype=np.bool_)
    given[tuple(np.array(sides, dtype=np.int64).reshape(-1, 2).T)] = True
    asked = given[i, j]
    blocked, joined = passes & ~asked, np.zeros((count, count), dtype=np.bool_)
    for one in np.lexsort((long, ~asked)).tolist():
        if not blocked[one]:
            joined[i[one], j[one]] = True
            blocked |= cuts[one]
    three = np.array(list(combinations(range(count), 3)))
    a, b, c = three.T
    three = three[joined[a, b] & joined[b, c] & joined[a, c]]
    # those that hold no other point
    sheet = np.zeros((count, count), dtype=np.int64)
    sheet[i, j] = np.arange(len(i))
    a, b, c = three.T
    ab, bc, ca = off[sheet[a, b]], off[sheet[b, c]], -off[sheet[a, c]]
    turn = np.sign(np.take_along_axis(ab, c[:, None], 1))
    within = (ab * turn > 0.0) & (bc * turn > 0.0) & (ca * turn > 0.0)
    three = three[~within.any(axis=1) & (turn[:, 0] != 0.0)]
    return three, list(zip(*(np.nonzero(joined)[k].tolist() for k in (0, 1)), strict=True))
