"""Cells as meshes: which of their corners are one point, and VTK files of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ResultFileError, needing
from kaju.files import atomic_file


def corner_order(dimension: int) -> Floats:
    """Return the corners of a unit cell in VTK's order: round the bottom, then round the top."""
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if dimension == 2:
        return np.array(ring, dtype=np.float64)
    return np.array([(*corner, level) for level, corner in product((0, 1), ring)], np.float64)


CUBE_FACES = np.array(
    [[0, 4, 7, 3], [1, 2, 6, 5], [0, 1, 5, 4], [3, 7, 6, 2], [0, 3, 2, 1], [4, 5, 6, 7]]
)
"""Corners of a cube's faces by `corner_order`, outwards, in the order -x, +x, -y, +y, -z, +z."""


def same_points(points: Floats, apart: float | Floats) -> tuple[Ints, Ints]:
    """Return which points (m) to keep of those less than `apart` apart, and which each is."""
    place = np.rint(points / apart).astype(np.int64)
    place -= place.min(axis=0)
    key = np.ravel_multi_index(tuple(place.T), tuple(place.max(axis=0) + 1))
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse


def write_vtk(
    path: str | Path,
    corners: Floats,
    apart: float,
    values: Mapping[str, NDArray[Any]],
    moved_at: Callable[[Floats], Floats] | None = None,
) -> Path:
    """Write squares or cubes to a VTK file, ``.vtu`` unless the name ends in ``.vtk``.

    `corners`, shape (n, 4 or 8, dimension), are in the order of `corner_order` (m), those closer
    than `apart` the same; `moved_at` tells displacements (m) at points (m), to be written for them.
    """
    d = corners.shape[2]
    first, cells = same_points(corners.reshape(-1, d), apart)
    points = corners.reshape(-1, d)[first]
    blocks = [("quad" if d == 2 else "hexahedron", cells.reshape(corners.shape[:2]))]
    moved = None if moved_at is None else moved_at(points)
    return _write(path, points, blocks, moved, {name: [of] for name, of in values.items()})


def write_polygons(
    path: str | Path,
    polygons: Sequence[Floats],
    apart: float,
    values: Mapping[str, NDArray[Any]],
    moved: Floats,
) -> Path:
    """Write polygons in the plane, and how their corners moved (m), to a VTK file."""
    corners = np.concatenate(polygons)
    first, point = same_points(corners, apart)
    count = np.array([len(polygon) for polygon in polygons])
    start = np.cumsum(count) - count
    alike = [np.flatnonzero(count == number) for number in np.unique(count)]
    blocks = [("polygon", point[start[rows, None] + np.arange(count[rows[0]])]) for rows in alike]
    parted = {name: [of[rows] for rows in alike] for name, of in values.items()}
    return _write(path, corners[first], blocks, moved[first], parted)


def _write(
    path: str | Path,
    points: Floats,
    blocks: Sequence[tuple[str, Ints]],
    moved: Floats | None,
    values: Mapping[str, list[NDArray[Any]]],
) -> Path:
    """Write cells of some kinds, one block a kind."""
    with needing("to_vtk needs meshlane: pip install 'kaju[vtk]'"):
        import meshlane

    target = Path(path)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    flat = [(0, 0), (0, 3 - points.shape[1])]
    of_points = {} if moved is None else {"displacement": np.pad(moved, flat)}
    with atomic_file(target, ResultFileError) as scratch:  # a good file stays if the disk is full
        meshlane.Mesh(np.pad(points, flat), blocks, of_points, values).write(scratch)
    return target
