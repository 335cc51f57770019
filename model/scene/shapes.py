"""Shapes in the plane and in space, asked point by point; their edges belong to them.

Those that are `Described` are also how scenes write them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from kaju.arrays import Flags, Floats
from kaju.errors import ParameterError
from kaju.model.scene.validation import Coordinate, Described, Length, Number

from .curves import conic, elliptic, line, polygonal

Point = tuple[Coordinate, ...]


def _apart(ends: tuple[Point, Point]) -> tuple[Point, Point]:
    """Refuse ends without a length between them."""
    if ends[0] == ends[1]:
        raise ValueError("are one point; take two, or another shape")
    return ends


Ends = Annotated[tuple[Point, Point], AfterValidator(_apart)]
Points = NDArray[np.float64]
"""Points (m), shape (n, dimension)."""
Extent = tuple[Points, Points]
"""Lower and upper corner (m) of a bounding box, each of shape (dimension,)."""
Relation = tuple[Flags, Flags]
"""Which boxes surely lie inside a shape, and which surely have no inner point in common with it."""

TOUCH = 1e-9
"""Of a box's edge: shapes that reach no further into it only touch it."""


class Shape:
    """A part of the plane or of space: it knows how far points lie outside of it."""

    @property
    def extent(self) -> Extent:
        """The bounding box, or a larger one: that of the control points."""
        points = np.concatenate([arcs.reshape(-1, 3) for arcs in self.outline()])
        points = points[:, :2] / points[:, 2:]
        return points.min(axis=0), points.max(axis=0)

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside, below 0 within; `reach` is far enough.

        Never more than they do: from one point to another it changes by their distance at most.
        """
        raise NotImplementedError

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a file."""
        raise NotImplementedError

    def outline(self) -> list[Floats]:
        """Return closed lines (m) that do not meet, every second one round a hole; see `curves`."""
        raise NotImplementedError

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        rounding = 1e-11 * np.abs(self.extent).max()
        return np.asarray(self.level(points, np.inf) <= rounding)

    def relation(self, low: Points, high: Points) -> Relation:
        """Tell how boxes lie to the shape; what is not sure is neither inside nor apart."""
        half = 0.5 * np.linalg.norm(high - low, axis=1)
        level = self.level(0.5 * (low + high), np.inf)
        return level <= -half, level >= half

    def _holds_corners(self, low: Points, high: Points) -> Flags:
        """Tell which boxes lie inside with all of their corners, and so, if convex, wholly."""
        ends = product((0.0, 1.0), repeat=low.shape[1])
        levels = [self.level(low + np.array(end) * (high - low), np.inf) for end in ends]
        return np.asarray(np.max(levels, axis=0) <= TOUCH * (high - low)[:, 0])


@dataclass(frozen=True)
class Box(Shape):
    """All points between two corners."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def extent(self) -> Extent:
        """The box itself."""
        return np.asarray(self.lower), np.asarray(self.upper)

    def outline(self) -> list[Floats]:
        """Return its four sides, in the plane."""
        (x0, y0), (x1, y1) = self.lower, self.upper
        return [polygonal([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])]

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside."""
        lower, upper = self.extent
        return np.asarray(np.maximum(lower - points, points - upper).max(axis=1))

    def relation(self, low: Points, high: Points) -> Relation:
        """Tell how boxes lie to the shape."""
        lower, upper = self.extent
        touch = TOUCH * (high - low)
        apart = np.any((high <= lower + touch) | (low >= upper - touch), axis=1)
        return self._holds_corners(low, high), apart


class Ball(Described, Shape):
    """All points up to a distance from a centre: a disk in two dimensions."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    radius: Length = Field(description="the radius (m), such as 0.02")

    @property
    def extent(self) -> Extent:
        """The bounding box."""
        centre = np.asarray(self.centre)
        return centre - self.radius, centre + self.radius

    def outline(self) -> list[Floats]:
        """Return its circle, in the plane."""
        x, y = self.centre
        return [elliptic((x, y), (self.radius, 0.0), (0.0, self.radius))]

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside."""
        return np.asarray(np.linalg.norm(points - np.array(self.centre), axis=1) - self.radius)

    def relation(self, low: Points, high: Points) -> Relation:
        """Tell how boxes lie to the shape."""
        nearest = np.clip(self.centre, low, high)
        return self._holds_corners(low, high), self.level(nearest, np.inf) >= 0.0


class Ring(Described, Shape):
    """All points between two circles round a centre."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    inner: Length = Field(description="the smaller radius (m)")
    outer: Length = Field(description="the larger radius (m)")

    @model_validator(mode="after")
    def _between(self) -> Ring:
        if self.inner >= self.outer:
            raise ParameterError(f"inner: {self.inner:g} m must be below outer, {self.outer:g} m")
        return self

    @property
    def _disks(self) -> list[Ball]:
        return [Ball(centre=self.centre, radius=radius) for radius in (self.outer, self.inner)]

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside."""
        outer, inner = (disk.level(points, reach) for disk in self._disks)
        return np.maximum(outer, -inner)

    def outline(self) -> list[Floats]:
        """Return both circles, in the plane."""
        return [circle for disk in self._disks for circle in disk.outline()]


class Ellipse(Described, Shape):
    """All points within an ellipse, whose first half-axis is turned from the x axis by an angle."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    radii: tuple[Length, Length] = Field(description="both half-axes (m), such as [0.03, 0.01]")
    angle: Number = Field(default=0.0, description="from the x axis to the first one (degrees)")

    @property
    def _axes(self) -> Points:
        cosine, sine = np.cos(np.deg2rad(self.angle)), np.sin(np.deg2rad(self.angle))
        turned = np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(turned * np.array(self.radii)[:, None])

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside: as if of a circle of the smaller radius."""
        along = (points - np.asarray(self.centre)) @ np.linalg.inv(self._axes)
        return np.asarray((np.linalg.norm(along, axis=1) - 1.0) * min(self.radii))

    def outline(self) -> list[Floats]:
        """Return its ellipse."""
        (x, y), ((a, b), (c, d)) = self.centre, self._axes.tolist()
        return [elliptic((x, y), (a, b), (c, d))]


class Widened(Described, Shape):
    """All points of the plane up to a radius from a polygon, or from a straight line."""

    radius: Length

    @property
    def core(self) -> tuple[Point, ...]:
        """The polygon's corners, counter-clockwise, or the line's two ends."""
        raise NotImplementedError

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside."""
        return Polygon(self.core).level(points, reach) - self.radius

    def outline(self) -> list[Floats]:
        """Return straight lines and parts of circles between them."""
        arcs = []
        ring = [np.asarray(corner) for corner in self.core]
        along = [self.radius * (q - p) / np.hypot(*(q - p)) for p, q in pairwise([*ring, ring[0]])]
        for k, at in enumerate(ring):
            # The arc round a corner goes from the normal of one edge to that of the next.
            (a, b), (c, d) = along[k - 1], along[k]
            normals = [np.array([b, -a]), np.array([d, -c])]
            if len(ring) == 2:  # half a circle, in two quarters
                normals.insert(1, along[k - 1])
            arcs += [conic(at + p, at + p + q, at + q, np.sqrt(0.5)) for p, q in pairwise(normals)]
            arcs.append(line(at + normals[-1], ring[k - len(ring) + 1] + normals[-1]))
        return [np.array(arcs)]


class Slot(Widened):
    """All points of the plane up to a radius from a straight line."""

    ends: Ends = Field(description="where its rounded ends have their middles (m)")
    radius: Length = Field(description="half of its width (m), such as 0.01")

    @property
    def core(self) -> tuple[Point, ...]:
        """The line."""
        return self.ends


class RoundedBox(Widened):
    """A box in the plane whose corners are parts of circles."""

    box: tuple[Point, Point] = Field(description="the lower and the upper corner (m)")
    radius: Length = Field(description="the radius of its corners (m), such as 0.01")

    @property
    def core(self) -> tuple[Point, ...]:
        """The middles of the circles."""
        (x0, y0), (x1, y1) = self.box
        r = self.radius
        return (x0 + r, y0 + r), (x1 - r, y0 + r), (x1 - r, y1 - r), (x0 + r, y1 - r)


class Cylinder(Described, Shape):
    """All points up to a radius from a straight line in space, between flat ends."""

    ends: Ends = Field(description="the middles of both ends (m)")
    radius: Length = Field(description="the radius (m), such as 0.02")

    @property
    def extent(self) -> Extent:
        """The bounding box."""
        start, end = ends = np.array(self.ends)
        along = (end - start) / np.linalg.norm(end - start)
        reach = self.radius * np.sqrt(np.maximum(1.0 - along**2, 0.0))
        return ends.min(axis=0) - reach, ends.max(axis=0) + reach

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside."""
        start, end = np.array(self.ends)
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        far = (points - start) @ along
        away = np.linalg.norm(points - start - far[:, None] * along, axis=1)
        return np.asarray(np.maximum(np.maximum(-far, far - length), away - self.radius))


@dataclass(frozen=True)
class Polygon(Shape):
    """The inside of a closed line through corners (even-odd rule)."""

    corners: tuple[tuple[float, ...], ...]

    @property
    def extent(self) -> Extent:
        """The bounding box."""
        corners = np.asarray(self.corners)
        return corners.min(axis=0), corners.max(axis=0)

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside."""
        x, y = points.T
        odd, nearest = np.zeros(len(points), dtype=np.bool_), np.full(len(points), np.inf)
        corners = np.array([*self.corners, self.corners[0]])
        for start, end in pairwise(corners):
            if np.array_equal(start, end):
                continue
            along, away = end - start, points - start
            part = np.clip(away @ along / (along @ along), 0.0, 1.0)
            nearest = np.minimum(nearest, np.hypot(*(away - part[:, None] * along).T))
            # twice the area of the triangle with the edge: its sign tells the side
            area = along[0] * (y - start[1]) - along[1] * (x - start[0])
            crosses = (start[1] > y) != (end[1] > y)
            odd ^= crosses & ((area > 0.0) == (along[1] > 0.0))
        return np.where(odd, -nearest, nearest)

    def outline(self) -> list[Floats]:
        """Return its sides."""
        return [polygonal((x, y) for x, y in self.corners)]
