"""Closed surfaces of triangles: read from STL files, and what lies within."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneFileError
from kaju.files import file_to_read

from .level_sets import EMBEDDED_ARRAY, embedded_array, read_embedded
from .shapes import TOUCH, Extent, Points, Relation, ShapeOfArrays

_HEAD = 84
"""Bytes of a binary STL file before its triangles, of 50 bytes each."""
_TRIANGLE = np.dtype([("numbers", "<f4", (4, 3)), ("colour", "<u2")])
_NUMBER = rb"\s+([-+0-9.eE]+)"
_CORNER = re.compile(rb"vertex" + 3 * _NUMBER)
_UPRIGHT = 1e-12
"""Of its area: a triangle that is seen as less from above crosses no upright line."""
_AT_ONCE, _TOGETHER = 500_000, 1024
"""Pairs of box and triangle held at a time, and pairs that are not divided any further."""


def surface_from(text: str, key: str, scale: float) -> ClosedSurface:
    """Return the surface in a file, or in a text that a scene carries with it."""
    if text.startswith(EMBEDDED_ARRAY):
        corners = read_embedded(text, key)
    else:
        file_to_read(text, SceneFileError, key=key)
        corners = _corners(Path(text).read_bytes())
    if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not len(corners):
        raise SceneFileError(f"{key}: holds no triangles of an STL file; write it anew")
    if not np.isfinite(corners).all():
        raise SceneFileError(f"{key}: holds numbers that are not finite; write it anew")
    found = ClosedSurface(np.asarray(corners, dtype=np.float64) * scale)
    found.check_closed(key)
    return found


def _corners(data: bytes) -> Floats:
    """Return the corners of the triangles, binary or in words, shape (n, 3, 3)."""
    count = int.from_bytes(data[80:_HEAD], "little")
    if len(data) == _HEAD + _TRIANGLE.itemsize * count:
        numbers = np.frombuffer(data, _TRIANGLE, count, _HEAD)["numbers"]
        return np.asarray(numbers[:, 1:], dtype=np.float64)
    found = _CORNER.findall(data)
    try:
        return np.array(found, dtype=np.float64)[: len(found) // 3 * 3].reshape(-1, 3, 3)
    except ValueError:
        return np.empty((0, 3, 3))


@dataclass(frozen=True, eq=False)
class ClosedSurface(ShapeOfArrays):
    """The inside of a closed surface of triangles, by the even-odd rule."""

    corners: Floats
    """Of every triangle (m), shape (n, 3, 3)."""

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a file."""
        return embedded_array(self.corners)

    def check_closed(self, key: str) -> None:
        """Refuse a surface with an edge that does not join two triangles, one each way."""
        places, number = np.unique(self.corners.reshape(-1, 3), axis=0, return_inverse=True)
        corner = number.reshape(-1, 3)
        edges = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]])
        edges = edges[edges[:, 0] != edges[:, 1]]  # triangles without area bound nothing
        there, back = (np.sort(a * len(places) + b) for a, b in (edges.T, edges[:, ::-1].T))
        if not np.array_equal(there, back):
            lonely = np.setxor1d(there, back)
            which = "is not closed"
            if len(lonely):
                x, y, z = places[lonely[0] // len(places)]
                which += f": an edge at ({x:.4g}, {y:.4g}, {z:.4g}) m bounds one triangle, or two "
                which += "that look to different sides"
            raise SceneFileError(f"{key}: {which}; mend it where it was made")

    @cached_property
    def extent(self) -> Extent:
        """The bounding box."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside: an odd number of triangles is above them."""
        places, line = np.unique(points[:, 0] + 1j * points[:, 1], return_inverse=True)
        lines = np.stack([places.real, places.imag], axis=1)
        crossed, height = self._crossings(lines)
        # Crossings and points are sorted together, line by line and upwards: crossings of a point's
        # line that come after it lie above it.
        both = np.concatenate([crossed, line])
        place = np.lexsort((np.concatenate([height, points[:, 2]]), both))
        rank = np.empty(len(place), dtype=np.int64)
        rank[place] = np.cumsum(place < len(crossed))
        after = np.searchsorted(np.sort(crossed), line, side="right")
        return np.asarray((after - rank[len(crossed) :]) % 2 == 1)

    def _crossings(self, lines: Points) -> tuple[Ints, Floats]:
        """Return which upright lines (x, y; sorted by x) triangles cross, and how high."""
        found: list[tuple[Ints, Floats]] = []
        x = self.corners[:, :, 0]
        first = np.searchsorted(lines[:, 0], x.min(axis=1), side="left")
        last = np.searchsorted(lines[:, 0], x.max(axis=1), side="right")
        normal = np.cross(*(self.corners[:, 1:] - self.corners[:, :1]).swapaxes(0, 1))
        upright = np.abs(normal[:, 2]) <= _UPRIGHT * np.linalg.norm(normal, axis=1)
        many = np.where(upright, 0, last - first)
        for some in np.array_split(np.arange(len(many)), 1 + many.sum() // _AT_ONCE):
            triangle = np.repeat(some, many[some])
            begin = np.cumsum(many[some]) - many[some]
            line = np.arange(len(triangle)) + np.repeat(first[some] - begin, many[some])
            y = lines[line, 1]
            span = self.corners[triangle][:, :, 1]
            near = (span.min(axis=1) <= y) & (y <= span.max(axis=1))
            triangle, line = triangle[near], line[near]
            corner, at = self.corners[triangle], lines[line]
            odd = np.zeros(len(line), dtype=np.bool_)
            for a in range(3):
                odd ^= _right_of(corner[:, a], corner[:, (a + 1) % 3], at)
            away, up = (at - corner[:, 0, :2])[odd], normal[triangle[odd]]
            rise = np.einsum("ni,ni->n", up[:, :2], away) / up[:, 2]
            found.append((line[odd], corner[odd, 0, 2] - rise))
        return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])

    def relation(self, low: Points, high: Points) -> Relation:
        """Tell how boxes lie to the surface."""
        crossed = np.zeros(len(low), dtype=np.bool_)
        for box, triangle in self._near(low, high):
            half = (0.5 - TOUCH) * (high[box] - low[box])
            corner = self.corners[triangle] - 0.5 * (high[box] + low[box])[:, None]
            apart = np.zeros(len(box), dtype=np.bool_)
            sides = np.roll(corner, -1, axis=1) - corner
            axes = [np.cross(sides[:, 0], sides[:, 1])]
            axes += [np.cross(sides[:, a], np.eye(3)[b]) for a in range(3) for b in range(3)]
            for axis in axes:  # of separation
                reach = np.einsum("ni,ni->n", half, np.abs(axis))
                place = np.einsum("nci,ni->nc", corner, axis)
                apart |= (place.min(axis=1) >= reach) & (reach > 0.0)
                apart |= (place.max(axis=1) <= -reach) & (reach > 0.0)
            crossed[box[~apart]] = True
        inside = ~crossed
        inside[~crossed] = self.contains(0.5 * (low[~crossed] + high[~crossed]))
        return inside, ~inside & ~crossed

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside, below 0 within; `reach` where it is further."""
        square = np.full(len(points), reach**2)
        sides, long, normal, across = self._flat
        for point, triangle in self._near(points - reach, points + reach):
            away = points[point][:, None] - self.corners[triangle]
            height = np.einsum("ni,ni->n", normal[triangle], away[:, 0]) ** 2
            near = height < reach**2
            point, triangle, away, height = point[near], triangle[near], away[near], height[near]
            beside = np.einsum("nci,nci->nc", across[triangle], away).min(axis=1) <= 0.0
            triangle, away = triangle[beside], away[beside]
            share = np.einsum("nci,nci->nc", away, sides[triangle]) / long[triangle]
            away -= np.clip(share, 0.0, 1.0)[..., None] * sides[triangle]
            height[beside] = np.einsum("nci,nci->nc", away, away).min(axis=1)
            np.minimum.at(square, point, height)
        return np.asarray(np.where(self.contains(points), -1.0, 1.0) * np.sqrt(square))

    @cached_property
    def _flat(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Sides, squares of their lengths, unit normals, and normals of the sides, inwards."""
        sides = np.roll(self.corners, -1, axis=1) - self.corners
        long = np.einsum("nci,nci->nc", sides, sides)
        normal = np.cross(sides[:, 0], sides[:, 1])
        area = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal / np.where(area > 0.0, area, 1.0)
        return sides, np.where(long > 0.0, long, 1.0), normal, np.cross(normal[:, None], sides)

    def _near(self, low: Points, high: Points) -> Iterator[tuple[Ints, Ints]]:
        """Yield boxes, and triangles whose own boxes meet them, pair by pair."""
        least, most = self.corners.min(axis=1), self.corners.max(axis=1)
        todo = [(np.arange(len(low)), np.arange(len(least)))]
        found: list[tuple[Ints, Ints]] = []
        count = 0
        while todo:
            box, triangle = todo.pop()
            start = low[box].min(axis=0, initial=np.inf)
            end = high[box].max(axis=0, initial=-np.inf)
            meets = np.all((least[triangle] <= end) & (most[triangle] >= start), axis=1)
            triangle = triangle[meets]
            if len(box) * len(triangle) > _TOGETHER and len(box) > 1:
                axis = int(np.argmax(end - start))
                order = box[np.argsort(low[box, axis], kind="stable")]
                todo += [(half, triangle) for half in np.array_split(order, 2)]
            elif len(triangle):
                found.append((np.repeat(box, len(triangle)), np.tile(triangle, len(box))))
                count += len(found[-1][0])
            if found and (count > _AT_ONCE or not todo):
                boxes, triangles = (np.concatenate(part) for part in zip(*found, strict=True))
                meets = np.all(
                    (least[triangles] <= high[boxes]) & (most[triangles] >= low[boxes]), axis=1
                )
                yield boxes[meets], triangles[meets]
                found, count = [], 0


def _right_of(a: Points, b: Points, at: Points) -> Flags:
    """Tell whether a ray from points along x crosses sides, the same for both their triangles."""
    swap = (a[:, 1] > b[:, 1]) | ((a[:, 1] == b[:, 1]) & (a[:, 0] > b[:, 0]))
    a, b = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
    rise = b[:, 1] - a[:, 1]
    across = (a[:, 1] <= at[:, 1]) & (at[:, 1] < b[:, 1])
    turn = (b[:, 0] - a[:, 0]) * (at[:, 1] - a[:, 1]) - (at[:, 0] - a[:, 0]) * rise
    return np.asarray(across & (turn > 0.0))
