"""Elastic answers as tables, labelled arrays and files for other programs."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import MissingExtraError, ResultFileError

from .problem import Floats
from .staggered import axis_pairs

if TYPE_CHECKING:
    import xarray

    from .elastic_result import ElasticResult

AXES = "xyz"


def columns(result: ElasticResult) -> dict[str, NDArray[Any]]:
    """Return one row per agent."""
    names = np.array([material.name for material in result.grid.cell_materials])
    found = {f"{AXES[a]} (m)": column for a, column in enumerate(result.middle.T)}
    found |= {
        "size (m)": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "cause (N)": result.cause,
        "material": names[result.material],
    }
    d = len(result.lower.T)
    found |= {f"displacement_{AXES[a]} (m)": result.displacement[:, a] for a in range(d)}
    for name, unit, tensor in (("strain", "", result.strain), ("stress", " (Pa)", result.stress)):
        for a, b in [(a, a) for a in range(d)] + axis_pairs(d):
            found[f"{name}_{AXES[a]}{AXES[b]}{unit}"] = tensor[:, a, b]
    return found | {"von_mises (Pa)": result.von_mises}


def dataset(result: ElasticResult, resolution: int | None) -> xarray.Dataset:
    """Return cells, faces and corners as labelled arrays."""
    try:
        import xarray
    except ImportError as error:
        raise MissingExtraError("to_xarray needs xarray: pip install 'kaju[fields]'") from error

    found = result.cells(resolution)
    d, shape, h = found.dimension, found.shape, found.cell_size
    coordinates: dict[str, Any] = {"component": list(AXES[:d]), "component_2": list(AXES[:d])}
    for axis, count in enumerate(shape):
        steps = found.origin[axis] + np.arange(count + 1)
        metres = {"units": "m"}
        coordinates[AXES[axis]] = (AXES[axis], h * (steps[:-1] + 0.5), metres)
        coordinates[f"{AXES[axis]}_face"] = (f"{AXES[axis]}_face", h * steps, metres)
    cells = tuple(AXES[:d])
    corners = tuple(f"{axis}_face" for axis in AXES[:d])
    tensor = (*cells, "component", "component_2")
    moved = found.corner_displacement
    variables: dict[str, Any] = {
        "displacement": ((*cells, "component"), found.displacement, {"units": "m"}),
        "corner_displacement": ((*corners, "component"), moved, {"units": "m"}),
        "strain": (tensor, found.strain, {"units": "1"}),
        "stress": (tensor, found.stress, {"units": "Pa"}),
        "von_mises": (cells, found.von_mises, {"units": "Pa"}),
        "body": (cells, found.body),
    }
    for axis, values in enumerate(found.face_displacement):
        names = tuple(f"{AXES[a]}_face" if a == axis else AXES[a] for a in range(d))
        variables[f"face_displacement_{AXES[axis]}"] = (names, values, {"units": "m"})
    for (a, b), values in found.edge_shear.items():
        names = tuple(f"{AXES[i]}_face" if i in (a, b) else AXES[i] for i in range(d))
        variables[f"edge_shear_{AXES[a]}{AXES[b]}"] = (names, values, {"units": "Pa"})
    plain = {
        name: value
        for name, value in result.summary().items()
        if isinstance(value, (int, float, str))
    }
    return xarray.Dataset(variables, coordinates, plain)


def write_mesh(result: ElasticResult, path: str | Path) -> Path:
    """Write agents as quadrilaterals or hexahedra; see `ElasticResult.to_vtk`."""
    try:
        import meshio
    except ImportError as error:
        raise MissingExtraError("to_vtk needs meshio: pip install 'kaju[vtk]'") from error

    target = Path(path)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    d = result.lower.shape[1]
    corners = result.lower[:, None] + np.array(corner_order(d)) * result.size[:, None, None]
    first, cells = same_points(corners.reshape(-1, d), result.size.min())
    points = corners.reshape(-1, d)[first]
    flat = [(0, 0), (0, 3 - d)]
    moved = np.pad(result.displacement_at(points), flat)
    values = {
        "size": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "material": result.material,
        "von_mises": result.von_mises,
        "stress": result.stress.reshape(-1, d * d),
        "strain": result.strain.reshape(-1, d * d),
    }
    written = meshio.Mesh(
        np.pad(points, flat),
        [("quad" if d == 2 else "hexahedron", cells.reshape(corners.shape[:2]))],
        {"displacement": moved},
        {name: [column] for name, column in values.items()},
    )
    try:
        written.write(target)
    except OSError as error:
        raise ResultFileError(f"{target}: cannot be written: {error.strerror}") from error
    return target


def corner_order(dimension: int) -> list[tuple[int, ...]]:
    """Return the corners of a cell in VTK's order: round the bottom, then round the top."""
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if dimension == 2:
        return list(ring)
    return [(*corner, level) for level, corner in product((0, 1), ring)]


def same_points(points: Floats, apart: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which points to keep of those that are the same, and which of these each is.

    Parameters
    ----------
    points : array, shape (n, dimension)
        Not below 0.
    apart : float
        The distance of points that differ.
    """
    place = np.rint(points / apart).astype(np.int64)
    key = np.ravel_multi_index(tuple(place.T), tuple(place.max(axis=0) + 1))
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse
