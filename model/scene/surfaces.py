"""Closed surfaces of triangles: read from STL files by trimesh, and what lies within."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneFileError, needing
from kaju.files import file_to_read

from .level_sets import EMBEDDED_ARRAY, checked, embedded_array, read_embedded
from .shapes import TOUCH, Extent, Points, Relation, Shape

_AT_ONCE = 500_000
"""Pairs of box and triangle held at a time."""


def surface_from(text: str, key: str, scale: float, offset: tuple[float, ...]) -> ClosedSurface:
    """Return the surface in a file, or in a text that a scene carries with it, then moved (m)."""
    if text.startswith(EMBEDDED_ARRAY):
        corners = checked(read_embedded(text, key), key, 3)
        if corners.shape[1:] != (3, 3):
            raise SceneFileError(f"{key}: holds no triangles; write the scene again from its file")
        return ClosedSurface(corners * scale + offset)
    corners, ambiguous = _one_body(_read(text, key), key, scale)
    return ClosedSurface(corners * scale + offset, ambiguous)


def _read(path: str, key: str) -> Any:
    """Return the welded mesh in an STL file; its corners may differ by rounding."""
    with needing(f"{key}: an STL file needs trimesh: pip install 'kaju[cad]'"):
        import trimesh
    file_to_read(path, SceneFileError, key=key)
    try:
        with Path(path).open("rb") as file:
            mesh = trimesh.load_mesh(file, file_type="stl", process=False)
        corners = np.asarray(mesh.triangles, dtype=np.float64)
    except Exception:  # broken files fail in many ways
        corners = np.empty((0, 3, 3))
    if not len(corners):
        raise SceneFileError(f"{key}: holds no triangles of an STL file; write it anew")
    if not np.isfinite(corners).all():
        raise SceneFileError(f"{key}: holds numbers that are not finite; write it anew")
    points = corners.reshape(-1, 3)
    size = np.ptp(points, axis=0).max()
    near = np.round((points - points.min(axis=0)) / (size or 1.0), 6)  # STL files hold 7 digits
    _, first, number = np.unique(near, axis=0, return_index=True, return_inverse=True)
    faces = number.reshape(-1, 3)
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)  # they bound nothing
    return trimesh.Trimesh(points[first], faces[~flat], process=False)


def _one_body(mesh: Any, key: str, scale: float) -> tuple[Floats, bool]:
    """Return the triangles of all shells, outwards round the body, and whether that is guessed.

    Shells that cross are one body. A shell wholly within another is a cavity; it is a guess if the
    file has it look outwards, too, as a part that sits within another does.
    """
    import trimesh

    edges, count = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    if (count % 2).any():
        x, y, z = scale * mesh.vertices[edges[count % 2 > 0][0, 0]]
        raise SceneFileError(
            f"{key}: is not closed: the edge at ({x:.4g}, {y:.4g}, {z:.4g}) m belongs to one "
            "triangle or three, not two; repair the surface in the program that wrote the file"
        )
    given = mesh.faces.copy()
    mend: Any = trimesh.repair.fix_winding  # untyped
    mend(mesh)
    parts = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(given)))
    shells, outwards = [], []
    for part in parts:
        corners, written = (np.asarray(mesh.vertices[faces[part]]) for faces in (mesh.faces, given))
        middle = corners.mean(axis=(0, 1))
        turned = np.linalg.det(corners - middle).sum() < 0.0
        shells.append(corners[:, ::-1] if turned else corners)
        outwards.append(bool(np.linalg.det(written - middle).sum() > 0.0))
    bodies = [ClosedSurface(shell) for shell in shells]
    found, ambiguous = [], False
    for one, shell in enumerate(shells):
        depth = sum(
            bool(other.contains(shell.reshape(-1, 3)).all())
            and not bodies[one].contains(other.corners.reshape(-1, 3)).any()
            for k, other in enumerate(bodies)
            if k != one
        )
        ambiguous |= depth % 2 == 1 and outwards[one]
        found.append(shell[:, ::-1] if depth % 2 else shell)
    return np.concatenate(found), ambiguous


@dataclass(frozen=True, eq=False)
class ClosedSurface(Shape):
    """Where closed surfaces of triangles wind round: their winding number is above 0."""

    corners: Floats
    """Of every triangle (m), counter-clockwise from outside, shape (n, 3, 3)."""
    ambiguous: bool = False
    """Whether a shell within another was taken for a cavity by guess."""

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a file."""
        return embedded_array(self.corners)

    @cached_property
    def extent(self) -> Extent:
        """The bounding box."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)

    def flat_sides(self) -> Iterator[tuple[int, float]]:
        """Yield the axis and place (m) of planes that are 5 % or more of what is seen along it."""
        wide = np.ptp(self.extent, axis=0)
        tiny = 1e-6 * wide.max()  # STL files hold 7 digits
        area = 0.5 * np.abs(np.cross(*(self.corners[:, 1:] - self.corners[:, :1]).swapaxes(0, 1)))
        for axis, size in enumerate(wide):
            flat = np.ptp(self.corners[:, :, axis], axis=1) <= tiny
            at, plane = np.unique(np.rint(self.corners[flat, 0, axis] / tiny), return_inverse=True)
            seen = np.bincount(plane, weights=area[flat, axis], minlength=len(at))
            yield from ((axis, float(x * tiny)) for x in at[seen > 0.05 * wide.prod() / size])

    def contains(self, points: Points) -> Flags:
        """Tell which points lie inside: more triangles above them face up than down."""
        places, line = np.unique(points[:, 0] + 1j * points[:, 1], return_inverse=True)
        lines = np.stack([places.real, places.imag], axis=1)
        crossed, height, sense = self._crossings(lines)
        # Crossings and points are sorted together, line by line and downwards: crossings of a
        # point's line that come before it lie above it.
        both = np.concatenate([crossed, line])
        place = np.lexsort((-np.concatenate([height, points[:, 2]]), both))
        sofar = np.empty(len(place), dtype=np.int64)
        sofar[place] = np.cumsum(np.concatenate([sense, np.zeros(len(line), np.int64)])[place])
        # What lines before it add up to; a line that is crossed in full adds 0 but for rounding.
        whole = np.bincount(crossed, weights=sense, minlength=len(lines)).astype(np.int64)
        before = np.cumsum(whole) - whole
        return np.asarray(sofar[len(crossed) :] - before[line] > 0)

    def _crossings(self, lines: Points) -> tuple[Ints, Floats, Ints]:
        """Return which upright lines (x, y; sorted by x) triangles cross, how high, facing where.

        1: up, -1: down.
        """
        found: list[tuple[Ints, Floats, Ints]] = []
        x = self.corners[:, :, 0]
        first = np.searchsorted(lines[:, 0], x.min(axis=1), side="left")
        last = np.searchsorted(lines[:, 0], x.max(axis=1), side="right")
        normal = np.cross(*(self.corners[:, 1:] - self.corners[:, :1]).swapaxes(0, 1))
        # a triangle that is seen as less than that from above crosses no upright line
        upright = np.abs(normal[:, 2]) <= 1e-12 * np.linalg.norm(normal, axis=1)
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
            facing = np.where(up[:, 2] > 0.0, 1, -1)
            found.append((line[odd], corner[odd, 0, 2] - rise, facing))
        line, height, facing = (np.concatenate(part) for part in zip(*found, strict=True))
        return line, height, facing

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
        with needing("surface: true outlines need trimesh: pip install 'kaju[cad]'"):
            from trimesh import triangles
        closest: Any = triangles.closest_point  # untyped
        square = np.full(len(points), reach**2)
        for point, triangle in self._near(points - reach, points + reach):
            away = points[point] - closest(self.corners[triangle], points[point])
            np.minimum.at(square, point, (away * away).sum(axis=1))
        return np.asarray(np.where(self.contains(points), -1.0, 1.0) * np.sqrt(square))

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
            if len(box) * len(triangle) > 1024 and len(box) > 1:
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
