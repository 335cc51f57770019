"""Elastic results as tables, labelled arrays and files for other programs."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.errors import MissingExtraError, ResultFileError

from .staggered import axis_pairs

if TYPE_CHECKING:
    import pandas
    import xarray

    from .elastic_result import ElasticResult

AXES = "xyz"


def dataframe(result: ElasticResult) -> pandas.DataFrame:
    """Return one row per cell of the body."""
    import pandas as pd

    body = result.body
    place = np.argwhere(body) + np.asarray(result.origin)
    d = result.problem.dimension
    columns: dict[str, Any] = {f"cell_{AXES[a]}": place[:, a] for a in range(d)}
    centres = result.cell_size * (place + 0.5)
    columns |= {f"{AXES[a]} (m)": centres[:, a] for a in range(d)}
    names = np.array([material.name for material in result.grid.cell_materials])
    columns["material"] = names[result.problem.kinds[result.problem.inner][body]]
    moved = result.cell_displacement[body]
    columns |= {f"displacement_{AXES[a]} (m)": moved[:, a] for a in range(d)}
    for name, unit, tensor in (("strain", "", result.strain), ("stress", " (Pa)", result.stress)):
        inside = tensor[body]
        for a, b in [(a, a) for a in range(d)] + axis_pairs(d):
            columns[f"{name}_{AXES[a]}{AXES[b]}{unit}"] = inside[:, a, b]
    columns["von_mises (Pa)"] = result.von_mises[body]
    return pd.DataFrame(columns)


def dataset(result: ElasticResult) -> xarray.Dataset:
    """Return cells, faces and corners as labelled arrays."""
    try:
        import xarray
    except ImportError as error:
        raise MissingExtraError("to_xarray needs xarray: pip install 'kaju[fields]'") from error

    d, shape, h = result.problem.dimension, result.problem.shape, result.cell_size
    coordinates: dict[str, Any] = {"component": list(AXES[:d]), "component_2": list(AXES[:d])}
    for axis, count in enumerate(shape):
        steps = result.origin[axis] + np.arange(count + 1)
        metres = {"units": "m"}
        coordinates[AXES[axis]] = (AXES[axis], h * (steps[:-1] + 0.5), metres)
        coordinates[f"{AXES[axis]}_face"] = (f"{AXES[axis]}_face", h * steps, metres)
    cells = tuple(AXES[:d])
    corners = tuple(f"{axis}_face" for axis in AXES[:d])
    tensor = (*cells, "component", "component_2")
    variables: dict[str, Any] = {
        "displacement": ((*cells, "component"), result.cell_displacement, {"units": "m"}),
        "corner_displacement": (
            (*corners, "component"),
            result.corner_displacement,
            {"units": "m"},
        ),
        "strain": (tensor, result.strain, {"units": "1"}),
        "stress": (tensor, result.stress, {"units": "Pa"}),
        "von_mises": (cells, result.von_mises, {"units": "Pa"}),
        "body": (cells, result.body),
    }
    for axis, values in enumerate(result.face_displacement):
        names = tuple(f"{AXES[a]}_face" if a == axis else AXES[a] for a in range(d))
        variables[f"face_displacement_{AXES[axis]}"] = (names, values, {"units": "m"})
    for (a, b), values in result.edge_shear.items():
        names = tuple(f"{AXES[i]}_face" if i in (a, b) else AXES[i] for i in range(d))
        variables[f"edge_shear_{AXES[a]}{AXES[b]}"] = (names, values, {"units": "Pa"})
    plain = {
        name: value
        for name, value in result.summary().items()
        if isinstance(value, (int, float, str))
    }
    return xarray.Dataset(variables, coordinates, plain)


def write_vtk(result: ElasticResult, path: str | Path) -> Path:
    """Write the cells of the body as quadrilaterals or hexahedra."""
    try:
        import meshio
    except ImportError as error:
        raise MissingExtraError("to_vtk needs meshio: pip install 'kaju[vtk]'") from error

    target = Path(path)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    place, d = np.argwhere(result.body), result.problem.dimension
    nodes = [n + 1 for n in result.problem.shape]
    corners = np.stack(
        [np.ravel_multi_index(tuple((place + step).T), nodes) for step in _corner_order(d)], axis=1
    )
    used, cells = np.unique(corners, return_inverse=True)
    index = np.stack(np.unravel_index(used, nodes), axis=1)
    points = np.zeros((len(used), 3))
    points[:, :d] = result.cell_size * (index + np.asarray(result.origin))
    moved = np.zeros((len(used), 3))
    moved[:, :d] = result.corner_displacement.reshape(-1, d)[used]
    body = result.body
    data = {
        "von_mises": [result.von_mises[body]],
        "stress": [result.stress[body].reshape(-1, d * d)],
        "strain": [result.strain[body].reshape(-1, d * d)],
        "material": [result.problem.kinds[result.problem.inner][body]],
    }
    kind = "quad" if d == 2 else "hexahedron"
    mesh = meshio.Mesh(
        points, [(kind, cells.reshape(corners.shape))], {"displacement": moved}, data
    )
    try:
        mesh.write(target)
    except OSError as error:
        raise ResultFileError(f"{target}: cannot be written: {error.strerror}") from error
    return target


def _corner_order(dimension: int) -> list[tuple[int, ...]]:
    """Return the corners of a cell in VTK's order: round the bottom, then round the top."""
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if dimension == 2:
        return list(ring)
    return [(*corner, level) for level, corner in product((0, 1), ring)]
