"""Load transfer for other programs: all cells of the body, agents or not, as a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaju.errors import MissingExtraError, ResultError, ResultFileError
from kaju.model.elastic.export import corner_order, same_points

if TYPE_CHECKING:
    from .transfer_result import TransferResult

MOST_CELLS = 5_000_000
"""Larger bodies are not written cell by cell."""


def write_mesh(result: TransferResult, path: str | Path) -> Path:
    """Write the body as quadrilaterals or hexahedra; see `TransferResult.to_vtk`."""
    try:
        import meshio
    except ImportError as error:
        raise MissingExtraError("to_vtk needs meshio: pip install 'kaju[vtk]'") from error

    scene, stage = result.scene, result.last
    lattice = scene.lattice
    if not lattice.boxes or lattice.size > MOST_CELLS:
        raise ResultError(
            f"to_vtk: writes squares and cubes, up to {MOST_CELLS:.0e} of them, got "
            f"{lattice.size} {lattice.kind}s; kaju.plot and to_dataframe take any body"
        )
    target = Path(path)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    d, kinds = lattice.dimension, scene.rasterise()
    cells = np.argwhere(kinds >= 0)
    place = np.ravel_multi_index(tuple(stage.cells.T), lattice.shape)
    row = np.searchsorted(np.ravel_multi_index(tuple(cells.T), lattice.shape), place)
    columns = {
        "spawn_step": stage.spawn_step,
        "load_taken": stage.taken.sum(axis=1),
        "load_kept": stage.kept.sum(axis=1),
        "von_mises": result.von_mises,
        "stress": result.stress.reshape(-1, d * d),
        "strain": result.strain.reshape(-1, d * d),
    }
    values = {"material": [kinds[kinds >= 0]]}
    for name, column in columns.items():
        full = np.zeros((len(cells), *column.shape[1:]), dtype=column.dtype)
        full[row] = column
        values[name] = [full]
    middles = lattice.centres(cells)
    values["displacement"] = [np.pad(result.displacement_at(middles), ((0, 0), (0, 3 - d)))]
    corners = (cells[:, None] + np.array(corner_order(d))) * lattice.cell_size
    first, numbers = same_points(corners.reshape(-1, d), lattice.cell_size)
    written = meshio.Mesh(
        np.pad(corners.reshape(-1, d)[first], ((0, 0), (0, 3 - d))),
        [("quad" if d == 2 else "hexahedron", numbers.reshape(corners.shape[:2]))],
        cell_data=values,
    )
    try:
        written.write(target)
    except OSError as error:
        raise ResultFileError(f"{target}: cannot be written: {error.strerror}") from error
    return target
