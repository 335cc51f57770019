"""Elastic answers as tables, labelled arrays and files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import MissingExtraError
from kaju.model.elastic.equal.staggered import axis_pairs
from kaju.model.elastic.goals.quantities import AXES
from kaju.model.elastic.pair.cut_agents import CutAgents
from kaju.model.results.mesh import corner_order, write_polygons, write_vtk

if TYPE_CHECKING:
    import xarray

    from .elastic_result import ElasticResult


def columns(result: ElasticResult) -> dict[str, NDArray[Any]]:
    """Return one row per agent."""
    names = np.array([material.name for material in result.grid.cell_materials])
    found = {f"{AXES[a]} (m)": column for a, column in enumerate(result.middle.T)}
    found |= {
        "size (m)": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "cause (J)": result.cause,
        "material": names[result.material],
    }
    d = len(result.lower.T)
    found |= {f"displacement_{AXES[a]} (m)": result.displacement[:, a] for a in range(d)}
    for name, unit, tensor in (("strain", "", result.strain), ("stress", " (Pa)", result.stress)):
        for a, b in [(a, a) for a in range(d)] + axis_pairs(d):
            found[f"{name}_{AXES[a]}{AXES[b]}{unit}"] = tensor[:, a, b]
    return found | {"von_mises (Pa)": result.von_mises}


def dataset(result: ElasticResult, resolution: int | None) -> xarray.Dataset:
    """Return cells and corners as labelled arrays."""
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
    plain = {
        name: value
        for name, value in result.summary().items()
        if isinstance(value, (int, float, str))
    }
    return xarray.Dataset(variables, coordinates, plain)


def write_mesh(result: ElasticResult, path: str | Path) -> Path:
    """Write agents as quadrilaterals or hexahedra; see `ElasticResult.to_vtk`."""
    d = result.lower.shape[1]
    if isinstance(result.found, CutAgents):
        return _write_pieces(result, result.found, path)
    values = {
        "size": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "material": result.material,
        "von_mises": result.von_mises,
        "stress": result.stress.reshape(-1, d * d),
        "strain": result.strain.reshape(-1, d * d),
    }
    corners = result.lower[:, None] + corner_order(d) * result.size[:, None, None]
    return write_vtk(path, corners, result.size.min(), values, result.displacement_at)


def _write_pieces(result: ElasticResult, found: CutAgents, path: str | Path) -> Path:
    """Write what agents within outlines hold as polygons."""
    agent, polygons = found.pieces()
    moved = found.scales.displacement * found.displacement_at(np.concatenate(polygons))
    values = {
        "von_mises": result.von_mises[agent],
        "stress": result.stress[agent].reshape(-1, 4),
        "material": result.material[agent],
        "agent": agent,
    }
    return write_polygons(path, polygons, 1e-8 * found.scales.length, values, moved)
