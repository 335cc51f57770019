"""Shapes in space, asked point by point; their edges belong to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats

from .curves import Point, conic, elliptic, line, polygonal
from .pictures import embedded

Points = NDArray[np.float64]
"""Points (m), shape (n, dimension)."""

TOUCH = 1e-9
"""Of a box's edge: shapes that reach no further into it only touch it."""
_CLOSE = 1e-11  # of a coordinate: a point this near to the edge is on the edge


class Shape(Protocol):
    """A part of space."""

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m), each of shape (dimension,)."""

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""


class OutlinedShape(Shape, Protocol):
    """A part of the plane whose outline is known."""

    def outline(self) -> list[Floats]:
        """Return closed lines (m) that do not meet, every second one round a hole; see `curves`."""


class SolidShape(Shape, Protocol):
    """A part of space that boxes can be held against."""

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside, below 0 within; `reach` is far enough."""

    def relation(self, low: Points, high: Points) -> tuple[Flags, Flags]:
        """Tell which boxes surely lie inside, and which surely have no inner point in common."""


@dataclass(frozen=True)
class Box:
    """All points between two corners."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner (m)."""
        return np.asarray(self.lower), np.asarray(self.upper)

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        inside = np.ones(len(points), dtype=np.bool_)
        for low, high, column in zip(self.lower, self.upper, points.T, strict=True):
            inside &= column >= low - _CLOSE * abs(low)
            inside &= column <= high + _CLOSE * abs(high)
        return inside

    def outline(self) -> list[Floats]:
        """Return its four sides, in the plane."""
        (x0, y0), (x1, y1) = self.lower, self.upper
        return [polygonal([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])]

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside."""
        lower, upper = self.extent
        return np.asarray(np.maximum(lower - points, points - upper).max(axis=1))

    def relation(self, low: Points, high: Points) -> tuple[Flags, Flags]:
        """Tell which boxes surely lie inside, and which surely have no inner point in common."""
        lower, upper = self.extent
        touch = TOUCH * (high - low)
        inside = np.all((low >= lower - touch) & (high <= upper + touch), axis=1)
        return inside, np.any((high <= lower + touch) | (low >= upper - touch), axis=1)


@dataclass(frozen=True)
class Ball:
    """All points up to a distance from a centre: a disk in two dimensions."""

    centre: tuple[float, ...]
    radius: float

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m)."""
        centre = np.asarray(self.centre)
        return centre - self.radius, centre + self.radius

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        squared = np.zeros(len(points))
        with np.errstate(over="ignore"):  # infinitely far is far enough
            for middle, column in zip(self.centre, points.T, strict=True):
                squared += ((column - middle) / self.radius) ** 2
        return squared <= (1.0 + _CLOSE) ** 2

    def outline(self) -> list[Floats]:
        """Return its circle, in the plane."""
        x, y = self.centre
        return [elliptic((x, y), (self.radius, 0.0), (0.0, self.radius))]

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside."""
        return np.asarray(np.linalg.norm(points - np.array(self.centre), axis=1) - self.radius)

    def relation(self, low: Points, high: Points) -> tuple[Flags, Flags]:
        """Tell which boxes surely lie inside, and which surely have no inner point in common."""
        away = np.maximum(np.abs(low - self.centre), np.abs(high - self.centre))
        near = np.maximum(np.maximum(low - self.centre, self.centre - high), 0.0)
        far, near = (np.linalg.norm(one, axis=1) for one in (away, near))
        return far <= self.radius, near >= self.radius


@dataclass(frozen=True)
class Ellipse:
    """All points within an ellipse: centre, half-axes, and the angle (rad) of the first one."""

    centre: tuple[float, float]
    radii: tuple[float, float]
    angle: float

    @property
    def _axes(self) -> Points:
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return np.asarray(
            np.array([[cosine, sine], [-sine, cosine]]) * np.array(self.radii)[:, None]
        )

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m)."""
        reach = np.hypot(*self._axes)
        return np.asarray(self.centre) - reach, np.asarray(self.centre) + reach

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        along = (points - np.asarray(self.centre)) @ np.linalg.inv(self._axes)
        return np.asarray((along**2).sum(axis=1) <= (1.0 + _CLOSE) ** 2)

    def outline(self) -> list[Floats]:
        """Return its ellipse."""
        (a, b), (c, d) = self._axes.tolist()
        return [elliptic(self.centre, (a, b), (c, d))]


@dataclass(frozen=True)
class RoundedBox:
    """All points up to a distance from a box, or from a straight line between two points."""

    core: tuple[Point, ...]
    """Corners counter-clockwise, four or two."""
    radius: float

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m)."""
        core = np.asarray(self.core)
        return core.min(axis=0) - self.radius, core.max(axis=0) + self.radius

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        inside = Polygon(self.core).contains(points) if len(self.core) > 2 else False
        for start, end in Polygon(self.core)._edges():
            along = np.clip(
                (points - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1
            )
            away = np.hypot(*(points - start - along[:, None] * (end - start)).T)
            inside |= away <= self.radius * (1.0 + _CLOSE)
        return np.asarray(inside)

    def outline(self) -> list[Floats]:
        """Return straight lines and parts of circles between them."""
        arcs = []
        ring = [np.asarray(corner) for corner in self.core]
        ways = [self.radius * (q - p) / np.hypot(*(q - p)) for p, q in pairwise([*ring, ring[0]])]
        for k, at in enumerate(ring):
            (a, b), (c, d) = ways[k - 1], ways[k]
            turns = [np.array([b, -a]), np.array([d, -c])]
            if len(ring) == 2:  # half a circle, in two quarters
                turns.insert(1, ways[k - 1])
            arcs += [conic(at + p, at + p + q, at + q, np.sqrt(0.5)) for p, q in pairwise(turns)]
            arcs.append(line(at + turns[-1], ring[k - len(ring) + 1] + turns[-1]))
        return [np.array(arcs)]


@dataclass(frozen=True)
class Ring:
    """All points between two circles round a centre."""

    centre: tuple[float, ...]
    inner: float
    outer: float

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m)."""
        return Ball(self.centre, self.outer).extent

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        away = np.linalg.norm(points - np.asarray(self.centre), axis=1)
        low, high = self.inner * (1.0 - _CLOSE), self.outer * (1.0 + _CLOSE)
        return np.asarray((away >= low) & (away <= high))

    def outline(self) -> list[Floats]:
        """Return both circles, in the plane."""
        return [*Ball(self.centre, self.outer).outline(), *Ball(self.centre, self.inner).outline()]


@dataclass(frozen=True)
class Polygon:
    """The inside of a closed line through corners (even-odd rule)."""

    corners: tuple[tuple[float, ...], ...]

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m)."""
        corners = np.asarray(self.corners)
        return corners.min(axis=0), corners.max(axis=0)

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        lower, upper = self.extent
        close = _CLOSE * float((upper - lower).max())
        x, y = points.T
        odd = np.zeros(len(points), dtype=np.bool_)
        edge = np.zeros(len(points), dtype=np.bool_)
        for start, end in self._edges():
            along = end - start
            length = np.hypot(along[0], along[1])
            # twice the area of the triangle with the edge: its sign tells the side
            area = along[0] * (y - start[1]) - along[1] * (x - start[0])
            reach = along[0] * (x - start[0]) + along[1] * (y - start[1])
            within = (reach >= -close * length) & (reach <= (length + close) * length)
            edge |= within & (np.abs(area) <= close * length)
            crosses = (start[1] > y) != (end[1] > y)
            odd ^= crosses & ((area > 0.0) == (along[1] > 0.0))
        return odd | edge

    def outline(self) -> list[Floats]:
        """Return its sides."""
        return [polygonal((x, y) for x, y in self.corners)]

    def _edges(self) -> Iterator[tuple[Points, Points]]:
        for start, end in pairwise([*self.corners, self.corners[0]]):
            if start != end:
                yield np.asarray(start), np.asarray(end)


@dataclass(frozen=True, eq=False)
class Mask:
    """The dark pixels of a picture that is stretched over a box."""

    box: Box
    dark: Flags
    """First index along x from the left, second along y from the bottom."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mask):
            return NotImplemented
        return self.box == other.box and np.array_equal(self.dark, other.dark)

    __hash__ = None  # type: ignore[assignment]

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a file."""
        return embedded(np.where(self.dark.T[::-1], 0, 255).astype(np.uint8))

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the picture's box (m)."""
        return self.box.extent

    def contains(self, points: Points) -> Flags:
        """Tell which points lie on dark pixels."""
        lower, upper = self.extent
        inside = self.box.contains(points)
        pixels = np.asarray(self.dark.shape)
        where = np.floor((points[inside] - lower) / (upper - lower) * pixels + _CLOSE)
        column, row = np.clip(where, 0, pixels - 1).astype(np.int64).T
        inside[inside] = self.dark[column, row]
        return inside
