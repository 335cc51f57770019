"""Shapes in space, asked point by point; their edges belong to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags

Points = NDArray[np.float64]
"""Points (m), shape (n, dimension)."""

_CLOSE = 1e-11  # of a coordinate: a point this near to the edge is on the edge


class Shape(Protocol):
    """A part of space."""

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m), each of shape (dimension,)."""

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""


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
