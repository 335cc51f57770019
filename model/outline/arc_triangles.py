"""Arcs without inflection within triangles: of their ends, and where their end tangents meet."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene.curves import cross, parted

CLOSE = 1e-7
"""Lines nearer than this (edges of the first agents) touch, and arcs that turn by less are lines:
they leave these by an eighth of that and of their length."""


class TouchError(Exception):
    """Outlines cross or touch."""


class ArcFrames:
    """Ends of arcs, tangents there, and the triangles that hold them."""

    def __init__(self, arcs: Floats):
        points = arcs[:, :, :2] / arcs[:, :, 2:]
        self.start, self.end = points[:, 0], points[:, 3]
        chord = self.end - self.start
        self.length = np.hypot(*chord.T)
        legs = np.diff(points, axis=1)
        long = np.hypot(legs[..., 0], legs[..., 1])
        none = long < 1e-9 * long.max(axis=1)[:, None]  # handles may have no length
        for k, beside in ((1, 0), (1, 2), (0, 1), (2, 1)):
            legs[none[:, k], k] = legs[none[:, k], beside]
            none[:, k] &= none[:, beside]
        legs /= np.hypot(legs[..., 0], legs[..., 1])[..., None]
        self.first, self.last = legs[:, 0], legs[:, 2]
        turns = angle(legs[:, :-1], legs[:, 1:])
        self.turn = turns.sum(axis=1)
        self.twisted = (turns.min(axis=1) < -CLOSE) & (turns.max(axis=1) > CLOSE)
        self.turn[(np.abs(self.turn) < CLOSE) & ~self.twisted] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            along = cross(chord, self.last) / cross(self.first, self.last)
            tip = self.start + along[:, None] * self.first
        self.tip = np.where(self.turn[:, None] != 0.0, tip, 0.5 * (self.start + self.end))
        """Where the end tangents meet."""
        self.triangles = np.stack([self.start, self.tip, self.end], axis=1)


def angle(one: Floats, other: Floats) -> Floats:
    """Return the angle from one direction to another, counter-clockwise."""
    return np.asarray(np.arctan2(cross(one, other), (one * other).sum(axis=-1)))


def halved(arcs: Floats, chosen: Flags) -> Floats:
    """Return the arcs in order, the chosen ones in two."""
    out = np.repeat(arcs, 1 + chosen, axis=0)
    at = np.flatnonzero(chosen) + np.arange(chosen.sum())
    out[np.stack([at, at + 1], axis=1).ravel()] = parted(arcs[chosen], 0.5)
    return out


def in_triangles(arcs: Floats) -> Floats:
    """Return the arcs of a closed line, halved until their triangles have corners in common only.

    Raises
    ------
    TouchError
        If the line crosses or touches itself.
    """
    while True:
        frames = ArcFrames(arcs)
        # Arcs turn by no more than 22.5°.
        wide = (np.abs(frames.turn) > np.pi / 8.0) | frames.twisted
        corner = angle(frames.last, np.roll(frames.first, -1, axis=0))
        turn = np.abs(frames.turn)
        left = np.pi - np.abs(corner) - turn - np.roll(turn, -1)
        narrow = left < 1e-9
        if (narrow & (turn + np.roll(turn, -1) == 0.0)).any():
            raise TouchError
        wide |= (narrow | np.roll(narrow, 1)) & (turn > 0.0)
        if not wide.any():
            first, second = overlapping(frames.triangles, frames.triangles, CLOSE)
            apart = (second - first) % len(arcs)
            kept = (first < second) & (apart > 1) & (apart < len(arcs) - 1)
            first, second = first[kept], second[kept]
            if not len(first):
                return arcs
            if (turn[first] + turn[second] == 0.0).any():
                raise TouchError
            wide[np.concatenate([first, second])] = True
            wide &= turn > 0.0
        if frames.length[wide].min() < CLOSE:
            raise TouchError
        arcs = halved(arcs, wide)


def keep_apart(one: Floats, other: Floats) -> bool:
    """Tell whether the arcs of two lines neither cross nor touch."""
    a, b = (ArcFrames(arcs).triangles for arcs in kept_apart([one, other]))
    return not len(overlapping(a, b, CLOSE)[0])


def kept_apart(lines: list[Floats]) -> list[Floats]:
    """Return arcs of lines, halved until triangles of two lines overlap only where these meet."""
    while len(lines) > 1:
        owner = np.repeat(np.arange(len(lines)), [len(arcs) for arcs in lines])
        frames = ArcFrames(np.concatenate(lines))
        first, second = overlapping(frames.triangles, frames.triangles, 0.0)
        other = (owner[first] != owner[second]) & ~_shared(frames, owner, first, second)
        wide = np.zeros(len(owner), dtype=np.bool_)
        wide[first[other]] = True
        # In edges of the first agents: shorter ones are not halved to keep apart.
        wide &= (frames.turn != 0.0) & (frames.length > 1e-3)
        if not wide.any():
            break
        lines = [halved(arcs, wide[owner == k]) for k, arcs in enumerate(lines)]
    return lines


def _shared(frames: ArcFrames, owner: Ints, first: Ints, second: Ints) -> Flags:
    """Tell which pairs of arcs meet as arcs of one line do, since lines have one of them alike."""
    one, other = frames.triangles[first], frames.triangles[second]
    apart = [np.abs(one - at).max(axis=(1, 2)) for at in (other, other[:, ::-1])]  # either way
    alike = (np.minimum(*apart) < CLOSE) & (owner[first] != owner[second])
    # An arc and a line that has its like, as one number: pairs come in both orders.
    arc_and_line = first * (owner[-1] + 1) + owner[second]
    back = second * (owner[-1] + 1) + owner[first]
    return np.isin(arc_and_line, arc_and_line[alike]) | np.isin(back, arc_and_line[alike])


def overlapping(a: Floats, b: Floats, margin: float) -> tuple[Ints, Ints]:
    """Return pairs of triangles, shape (n, 3, 2), that overlap or are nearer than a margin."""
    from scipy.spatial import cKDTree

    middle = [at.mean(axis=1) for at in (a, b)]
    reach = [
        np.hypot(*(at - m[:, None]).transpose(2, 0, 1)).max(axis=1)
        for at, m in zip((a, b), middle, strict=True)
    ]
    trees = [cKDTree(m) for m in middle]
    found = trees[0].query_ball_tree(trees[1], reach[0].max() + reach[1].max() + abs(margin))
    first = np.repeat(np.arange(len(found)), [len(row) for row in found])
    second = np.array([k for row in found for k in row], dtype=np.int64)
    close = np.hypot(*(middle[0][first] - middle[1][second]).T)
    kept = close <= reach[0][first] + reach[1][second] + abs(margin)
    first, second = first[kept], second[kept]
    p, q = a[first], b[second]
    overlap = np.ones(len(first), dtype=np.bool_)
    for at in (p, q):
        for run in (at[:, 2] - at[:, 0], at[:, 1] - at[:, 0], at[:, 2] - at[:, 1]):
            for axis in (run, np.stack([-run[:, 1], run[:, 0]], axis=1)):  # lines that separate
                size = np.hypot(*axis.T)
                x, y = np.einsum("nkd,nd->nk", p, axis), np.einsum("nkd,nd->nk", q, axis)
                gap = np.maximum(y.min(axis=1) - x.max(axis=1), x.min(axis=1) - y.max(axis=1))
                overlap &= (gap <= margin * size) | (size == 0.0)
    return first[overlap], second[overlap]
