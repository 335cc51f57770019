"""Shapes in space for true outlines: which boxes they fill for certain, and how far points are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from kaju.arrays import Flags, Floats

from .shapes import TOUCH, Box, Points

_ENDS = np.array(list(product((0.0, 1.0), repeat=3)))


@dataclass(frozen=True)
class Cylinder:
    """All points up to a radius from a straight line, between flat ends."""

    ends: tuple[tuple[float, ...], tuple[float, ...]]
    radius: float

    @property
    def _axis(self) -> tuple[Points, Points, float]:
        start, end = np.array(self.ends)
        length = float(np.linalg.norm(end - start))
        return start, (end - start) / length, length

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the bounding box (m)."""
        reach = self.radius * np.sqrt(np.maximum(1.0 - self._axis[1] ** 2, 0.0))
        ends = np.array(self.ends)
        return ends.min(axis=0) - reach, ends.max(axis=0) + reach

    def _places(self, points: Points) -> tuple[Floats, Points]:
        """Return how far along the axis points lie, and the way from it to them."""
        start, along, _ = self._axis
        far = (points - start) @ along
        return far, points - start - far[:, None] * along

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        return np.asarray(self.level(points, 0.0) <= TOUCH * self.radius)

    def level(self, points: Points, reach: float) -> Floats:
        """Return about how far (m) points lie outside."""
        far, away = self._places(points)
        beyond = np.maximum(-far, far - self._axis[2])
        return np.asarray(np.maximum(beyond, np.linalg.norm(away, axis=1) - self.radius))

    def relation(self, low: Points, high: Points) -> tuple[Flags, Flags]:
        """Tell which boxes surely lie inside, and which surely have no inner point in common."""
        _, along, length = self._axis
        inside = np.ones(len(low), dtype=np.bool_)
        touch = TOUCH * (high - low)[:, 0]
        for end in _ENDS:  # it is convex
            far, away = self._places(low + end * (high - low))
            flat = (far >= -touch) & (far <= length + touch)
            inside &= flat & (np.linalg.norm(away, axis=1) <= self.radius)
        far, away = self._places(0.5 * (low + high))
        half, reach = 0.5 * (high - low), np.linalg.norm(away, axis=1)
        out = away / np.where(reach > 0.0, reach, 1.0)[:, None]
        beyond = np.maximum(-far, far - length) - half @ np.abs(along)
        round_it = reach - self.radius - np.einsum("ni,ni->n", half, np.abs(out))
        return inside, (beyond >= -touch) | (round_it >= 0.0)


@dataclass(frozen=True, eq=False)
class SampledSolid:
    """Where samples, trilinear between them, are not below a level; nothing beyond their box."""

    box: Box
    values: Floats
    """Indexed [x, y, z], those on the sides of the box included."""
    at_least: float

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SampledSolid):
            return NotImplemented
        ours, theirs = ((one.box, one.at_least) for one in (self, other))
        return ours == theirs and np.array_equal(self.values, other.values)

    __hash__ = None  # type: ignore[assignment]

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a file."""
        from .level_sets import embedded_array

        return embedded_array(self.values)

    @property
    def extent(self) -> tuple[Points, Points]:
        """Lower and upper corner of the samples' box (m)."""
        return self.box.extent

    @property
    def _step(self) -> Points:
        lower, upper = self.extent
        return np.asarray((upper - lower) / (np.array(self.values.shape) - 1))

    def _sampled(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Return by how much samples are below the level, at places told in steps."""
        found: Floats = np.zeros(np.broadcast_shapes(x.shape, y.shape, z.shape))
        first = [
            np.clip(np.floor(place).astype(np.int64), 0, n - 2)
            for place, n in zip((x, y, z), self.values.shape, strict=True)
        ]
        part = [p - f for p, f in zip((x, y, z), first, strict=True)]
        for end in product((0, 1), repeat=3):
            weight = [p if e else 1.0 - p for p, e in zip(part, end, strict=True)]
            value = self.values[tuple(f + e for f, e in zip(first, end, strict=True))]
            found += weight[0] * weight[1] * weight[2] * (self.at_least - value)
        return found

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside or on the edge."""
        inside = self.box.contains(points)
        inside[inside] = self._level(points[inside]) <= 0.0
        return inside

    def _level(self, points: Points) -> Floats:
        lower, upper = self.extent
        place = (np.clip(points, lower, upper) - lower) / self._step
        return self._sampled(*place.T)

    def level(self, points: Points, reach: float) -> Floats:
        """Return how much lower than the level the samples are, at least what is beyond the box."""
        return np.asarray(np.maximum(self._level(points), self.box.level(points, reach)))

    def relation(self, low: Points, high: Points) -> tuple[Flags, Flags]:
        """Tell which boxes surely lie inside, and which surely have no inner point in common."""
        # Between samples, and where a box ends, a trilinear function is largest at corners.
        inside, apart = self.box.relation(low, high)
        some = np.flatnonzero(~apart)
        if len(some):
            lower, upper = self.extent
            ends = [np.clip(one[some], lower, upper) - lower for one in (low, high)]
            a, b = (one / self._step for one in ends)
            many = int(np.ceil((b - a).max())) + 1
            places: list[Floats] = []
            for axis in range(3):
                nodes: Floats = np.floor(a[:, axis, None]) + np.arange(many + 1.0)
                places.append(np.clip(nodes, a[:, axis, None], b[:, axis, None]))
            x, y, z = places
            found = self._sampled(x[:, :, None, None], y[:, None, :, None], z[:, None, None, :])
            found = found.reshape(len(some), -1)
            inside[some] &= found.max(axis=1) <= 0.0
            apart[some] = found.min(axis=1) > 0.0
        return inside, apart
