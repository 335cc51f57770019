"""Elastic answers as tables, labelled arrays and files for other programs."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import needing
from kaju.model.elastic.goals.quantities import AXES
from kaju.model.elastic.pair.cut_agents import CutAgents
from kaju.model.results.mesh import corner_order, write_vtk

if TYPE_CHECKING:
    import xarray

    from .elastic_result import ElasticResult


def columns(result: ElasticResult) -> dict[str, NDArray[Any]]:
    """Return one row per agent."""
    names = np.array([material.name for material in result.grid.cell_materials])
    axes = list(enumerate(AXES[: result.lower.shape[1]]))
    found: dict[str, NDArray[Any]] = {f"{axis} (m)": result.middle[:, a] for a, axis in axes}
    found |= {
        "size (m)": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "material": names[result.material],
    }
    found |= {f"displacement_{axis} (m)": result.displacement[:, a] for a, axis in axes}
    for name, unit, tensor in (("strain", "", result.strain), ("stress", " (Pa)", result.stress)):
        for (a, one), (b, other) in [*zip(axes, axes, strict=True), *combinations(axes, 2)]:
            found[f"{name}_{one}{other}{unit}"] = tensor[:, a, b]
    return found | {"von_mises (Pa)": result.von_mises}


def dataset(result: ElasticResult, resolution: int | None) -> xarray.Dataset:
    """Return cells and corners as labelled arrays."""
    with needing("to_xarray needs xarray: pip install 'kaju[fields]'"):
        import xarray

    found = result.cells(resolution)
    axes, components = tuple(AXES[: found.dimension]), ("component", "component_2")
    corners = tuple(f"{axis}_face" for axis in axes)
    places: dict[str, Any] = {key: list(axes) for key in components}
    for axis, first, count in zip(axes, found.origin, found.shape, strict=True):
        face = found.cell_size * (first + np.arange(count + 1))
        middle = face[:-1] + 0.5 * found.cell_size
        for name, at in ((axis, middle), (f"{axis}_face", face)):
            places[name] = (name, at, {"units": "m"})
    values: dict[str, Any] = {"body": (axes, found.body)}
    units = {"displacement": "m", "strain": "1", "stress": "Pa", "von_mises": "Pa"}
    for name, unit in units.items():
        value = getattr(found, name)
        values[name] = ((*axes, *components)[: value.ndim], value, {"units": unit})
    moved = found.corner_displacement
    values["corner_displacement"] = ((*corners, "component"), moved, {"units": "m"})
    told = {k: v for k, v in result.summary().items() if isinstance(v, int | float | str)}
    return xarray.Dataset(values, places, told)


def write_mesh(result: ElasticResult, path: str | Path) -> Path:
    """Write agents as quadrilaterals or hexahedra, those within outlines as polygons."""
    found, d = result.found, result.lower.shape[1]
    values = {
        "size": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "material": result.material,
        "von_mises": result.von_mises,
        "stress": result.stress.reshape(-1, d * d),
        "strain": result.strain.reshape(-1, d * d),
    }
    if isinstance(found, CutAgents):
        agent, polygons = found.pieces()
        count = np.array([len(polygon) for polygon in polygons])
        rows = [np.flatnonzero(count == number) for number in np.unique(count)]
        agent = agent[np.concatenate(rows)]
        values = {name: value[agent] for name, value in values.items()} | {"agent": agent}
        alike = [np.array([polygons[row] for row in of]) for of in rows]
        near = 1e-8 * found.scales.length
        return write_vtk(path, alike, near, values, result.displacement_near)
    corners = result.lower[:, None] + corner_order(d) * result.size[:, None, None]
    return write_vtk(path, [corners], result.size.min(), values, result.displacement_at)
