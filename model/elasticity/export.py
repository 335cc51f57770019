"""Elastic results as tables, labelled arrays and files for other programs."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.errors import MissingExtraError, ResultFileError

from .problem import Floats
from .staggered import axis_pairs

if TYPE_CHECKING:
    import xarray

    from .elastic_result import ElasticResult

AXES = "xyz"


class Mesh(NamedTuple):
    """Agents as VTK knows them.

    Attributes
    ----------
    points : array, shape (points, dimension)
        Corners (m).
    cells : int array, shape (agents, 4 or 8)
        The corners of each, in VTK's order.
    displacement : array, shape (points, dimension)
        Of the corners (m).
    data : dict of str to array
        Values of the agents.
    """

    points: Floats
    cells: NDArray[np.int64]
    displacement: Floats
    data: dict[str, NDArray[Any]]


def columns(result: ElasticResult) -> dict[str, NDArray[Any]]:
    """Return one row per cell of the body."""
    body = result.body
    place = np.argwhere(body) + np.asarray(result.origin)
    d = result.problem.dimension
    found = {f"cell_{AXES[a]}": place[:, a] for a in range(d)}
    centres = result.cell_size * (place + 0.5)
    found |= {f"{AXES[a]} (m)": centres[:, a] for a in range(d)}
    names = np.array([material.name for material in result.grid.cell_materials])
    found["material"] = names[result.problem.kinds[result.problem.inner][body]]
    return found | fields_of(
        result.cell_displacement[body],
        result.strain[body],
        result.stress[body],
        result.von_mises[body],
    )


def fields_of(
    moved: Floats, strain: Floats, stress: Floats, von_mises: Floats
) -> dict[str, NDArray[Any]]:
    """Return the columns of the fields of agents, one row each."""
    d = moved.shape[1]
    found = {f"displacement_{AXES[a]} (m)": moved[:, a] for a in range(d)}
    for name, unit, tensor in (("strain", "", strain), ("stress", " (Pa)", stress)):
        for a, b in [(a, a) for a in range(d)] + axis_pairs(d):
            found[f"{name}_{AXES[a]}{AXES[b]}{unit}"] = tensor[:, a, b]
    return found | {"von_mises (Pa)": von_mises}


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


def mesh(result: ElasticResult) -> Mesh:
    """Return the cells of the body as quadrilaterals or hexahedra."""
    place, d = np.argwhere(result.body), result.problem.dimension
    nodes = [n + 1 for n in result.problem.shape]
    corners = np.stack(
        [np.ravel_multi_index(tuple((place + step).T), nodes) for step in corner_order(d)], axis=1
    )
    used, cells = np.unique(corners, return_inverse=True)
    index = np.stack(np.unravel_index(used, nodes), axis=1)
    body = result.body
    return Mesh(
        result.cell_size * (index + np.asarray(result.origin)),
        cells.reshape(corners.shape),
        result.corner_displacement.reshape(-1, d)[used],
        {
            "von_mises": result.von_mises[body],
            "stress": result.stress[body].reshape(-1, d * d),
            "strain": result.strain[body].reshape(-1, d * d),
            "material": result.problem.kinds[result.problem.inner][body],
        },
    )


def write_mesh(found: Mesh, path: str | Path) -> Path:
    """Write agents as an unstructured grid; see `SolidResult.to_vtk`."""
    try:
        import meshio
    except ImportError as error:
        raise MissingExtraError("to_vtk needs meshio: pip install 'kaju[vtk]'") from error

    target = Path(path)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    flat = [(0, 3 - found.points.shape[1])]
    points, moved = (np.pad(a, [(0, 0), *flat]) for a in (found.points, found.displacement))
    kind = "quad" if found.cells.shape[1] == 4 else "hexahedron"
    values = {name: [column] for name, column in found.data.items()}
    written = meshio.Mesh(points, [(kind, found.cells)], {"displacement": moved}, values)
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
