"""Cells as meshes: which of their corners are one point, and VTK files of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ResultFileError, needing, require
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
    corners: Sequence[Floats],
    apart: float,
    values: Mapping[str, NDArray[Any]],
    moved_at: Callable[[Floats], Floats],
) -> Path:
    """Write polygons, squares or cubes to a VTK file, ``.vtu`` unless the name ends in ``.vtk``.

    `corners`: one array (n, k, dimension) for each number k of corners (m), those of squares and
    cubes in the order of `corner_order`, those closer than `apart` the same; `values`: of all of
    them one after another; `moved_at`: displacements (m) at points (m).
    """
    with needing("to_vtk needs meshlane: pip install 'kaju[vtk]'"):
        import meshlane

    target, d = Path(path), corners[0].shape[2]
    told = f"to_vtk: writes .vtu and .vtk, got {target.name}; a .glb mesh comes from kaju.animate"
    require(not target.suffix[1:].isalpha() or target.suffix in (".vtu", ".vtk"), told)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    every = np.concatenate([part.reshape(-1, d) for part in corners])
    first, point = same_points(every, apart)
    parts = np.split(point, np.cumsum([part[..., 0].size for part in corners])[:-1])
    plain = "quad" if [part.shape[1] for part in corners] == [4] else "polygon"
    kind = "hexahedron" if d == 3 else plain
    blocks = [(kind, of.reshape(c.shape[:2])) for of, c in zip(parts, corners, strict=True)]
    ends = np.cumsum([len(part) for part in corners])[:-1]
    parted = {name: np.split(of, ends) for name, of in values.items()}
    flat = [(0, 0), (0, 3 - d)]
    moved = {"displacement": np.pad(moved_at(every[first]), flat)}
    with atomic_file(target, ResultFileError) as scratch:  # a good file stays if the disk is full
        meshlane.Mesh(np.pad(every[first], flat), blocks, moved, parted).write(scratch)
    return target
