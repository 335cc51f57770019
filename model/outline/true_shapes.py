"""Regions with true outlines: what a square holds of the body at least, and at most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaju.arrays import Floats

from .convex_pieces import ON_LINE, Corners, HalfPlane, Point, area_of, within, without
from .square_leaves import SquareLeaves

WIDEST = np.pi / 8.0
"""Largest angle between two corners of a circle's polygon."""


class StraightShape:
    """A polygon: its convex hull without its pockets, which are polygons again."""

    def __init__(self, corners: Corners):
        if area_of(corners) < 0.0:
            corners = corners[::-1]
        ring = list(range(len(corners)))
        hull = _hull(corners)
        self.corners = corners
        self.planes = _sides([corners[k] for k in hull])
        self.pockets: list[StraightShape] = []
        for first, last in zip(hull, [*hull[1:], hull[0] + len(ring)], strict=True):
            if last - first > 1:
                pocket = [corners[k % len(ring)] for k in range(first, last + 1)]
                if abs(area_of(pocket)) > 0.0:
                    self.pockets.append(StraightShape(pocket))

    def refine(self, leaves: SquareLeaves) -> None:
        """Straight lines stay as they are."""

    def border(self, outer: bool) -> Floats:
        """Return the closed polygon, shape (n + 1, 2), counter-clockwise."""
        return np.array([*self.corners, self.corners[0]])

    def parts(self, square: Corners, outer: bool) -> list[tuple[Corners, list[HalfPlane]]]:
        """Return convex parts of a square, each with the lines that bound it."""
        planes = _relevant(self.planes, square)
        hull = within(square, planes) if planes is not None else None
        if hull is None:
            return []
        if not self.pockets:
            return [(hull, planes or [])]
        left = [hull]
        for pocket in self.pockets:
            for _, lines in pocket.parts(square, outer):
                left = without(left, lines)
        return [(piece, [tuple(row) for row in _sides(piece).tolist()]) for piece in left]


class RoundShape:
    """A disk, between a polygon on the circle and one of tangents, which touch in its corners."""

    pockets: tuple[StraightShape, ...] = ()

    def __init__(self, centre: Point, radius: float, extent: Point):
        self.centre, self.radius, self.extent = centre, radius, extent
        self.angles = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
        # where the circle meets the sides of the array both polygons do so too
        met = [0.0]
        for axis in (0, 1):
            for side in (0.0, extent[axis]):
                cosine = (side - centre[axis]) / radius
                if abs(cosine) < 1.0:
                    turn = float(np.arccos(cosine)) if axis == 0 else float(np.arcsin(cosine))
                    met += [turn, -turn] if axis == 0 else [turn, np.pi - turn]
        self.fixed = np.unique(np.mod(met, 2.0 * np.pi))
        self.fixed = self.fixed[np.diff(self.fixed, prepend=-1.0) > 1e-9]

    def refine(self, leaves: SquareLeaves) -> None:
        """Take corners as far apart as the leaves are large."""
        angles = []
        for start, end in zip(
            self.fixed, [*self.fixed[1:], self.fixed[0] + 2 * np.pi], strict=True
        ):
            fine = np.arange(start, end, 0.25 * leaves.size.min() * leaves.unit / self.radius)
            fine = fine if len(fine) < 20000 else np.linspace(start, end, 20000)
            middle = np.array(self.centre) + self.radius * np.stack([np.cos(fine), np.sin(fine)], 1)
            leaf = leaves.at(middle)
            step = np.where(leaf >= 0, leaves.size[leaf] * leaves.unit / self.radius, WIDEST)
            grown = np.concatenate(
                [[0.0], np.cumsum(np.diff(fine, append=end) / np.minimum(step, WIDEST))]
            )
            count = max(1, int(np.ceil(grown[-1] - 1e-9)))
            angles.append(np.interp(np.arange(count) / count * grown[-1], grown, [*fine, end]))
        self.angles = np.concatenate(angles)
        away = np.stack([np.cos(self.angles), np.sin(self.angles)], 1)
        self._on = np.array(self.centre) + self.radius * away
        tangents = np.column_stack([away, away @ np.array(self.centre) + self.radius])
        last = np.roll(self._on, -1, axis=0)
        across = np.stack([last[:, 1] - self._on[:, 1], self._on[:, 0] - last[:, 0]], 1)
        across /= np.linalg.norm(across, axis=1)[:, None]
        chords = np.column_stack([across, (across * self._on).sum(axis=1)])
        self._planes = {True: tangents, False: chords}

    def border(self, outer: bool) -> Floats:
        """Return the closed polygon, shape (n + 1, 2), counter-clockwise."""
        if not outer:
            return np.concatenate([self._on, self._on[:1]])
        width = np.diff(self.angles, append=self.angles[0] + 2.0 * np.pi)
        middle = self.angles + 0.5 * width
        reach = (self.radius / np.cos(0.5 * width))[:, None]
        at = np.array(self.centre) + reach * np.stack([np.cos(middle), np.sin(middle)], 1)
        return np.concatenate([at, at[:1]])

    def parts(self, square: Corners, outer: bool) -> list[tuple[Corners, list[HalfPlane]]]:
        """Return the part of a square within the polygon, with the lines that bound it."""
        (x0, y0), (x1, y1) = square[0], square[2]
        cx, cy = self.centre
        nearest = np.hypot(max(x0 - cx, 0.0, cx - x1), max(y0 - cy, 0.0, cy - y1))
        if nearest > 1.1 * self.radius:
            return []
        planes = _relevant(self._planes[outer], square)
        piece = within(square, planes) if planes is not None else None
        return [] if piece is None else [(piece, planes or [])]


TrueShape = StraightShape | RoundShape


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


def _sides(corners: Corners) -> Floats:
    """Return the half-planes of a convex polygon."""
    at = np.asarray(corners)
    run = np.roll(at, -1, axis=0) - at
    across = np.stack([run[:, 1], -run[:, 0]], 1)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return np.column_stack([across, (across * at).sum(axis=1)])


def _relevant(planes: Floats, square: Corners) -> list[HalfPlane] | None:
    """Return the half-planes that cut a square; None if one leaves nothing of it."""
    planes = np.asarray(planes)
    away = planes[:, :2] @ np.asarray(square).T - planes[:, 2:]
    if (away.min(axis=1) >= -ON_LINE).any():
        return None
    return [tuple(row) for row in planes[away.max(axis=1) > ON_LINE].tolist()]


@dataclass(frozen=True)
class TrueRegion:
    """A shape, and whether it is filled or cut out."""

    shape: TrueShape
    solid: bool


@dataclass(frozen=True)
class TrueBody:
    """A box of material or of air, and regions that cover it one after the other."""

    solid: bool
    regions: tuple[TrueRegion, ...]

    def pieces(self, square: Corners, outer: bool) -> list[Corners]:
        """Return convex pieces of a square: no less than the body (outer), or no more."""
        pieces = [square] if self.solid else []
        for region in self.regions:
            if region.solid and pieces == [square]:
                continue
            for piece, lines in region.shape.parts(square, outer == region.solid):
                if piece == square:
                    pieces = [square] if region.solid else []
                    break
                pieces = without(pieces, lines)
                if region.solid:
                    pieces.append(piece)
        return pieces
