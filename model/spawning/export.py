"""Agents of many sizes as tables and as files for other programs."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.errors import MissingExtraError, ResultFileError
from kaju.model.elasticity.staggered import axis_pairs

if TYPE_CHECKING:
    import pandas

    from .spawned_result import SpawnedResult

AXES = "xyz"


def dataframe(result: SpawnedResult) -> pandas.DataFrame:
    """Return one row per agent."""
    import pandas as pd

    d = result.lower.shape[1]
    middle = result.lower + 0.5 * result.size[:, None]
    columns: dict[str, Any] = {f"{AXES[a]} (m)": middle[:, a] for a in range(d)}
    columns["size (m)"] = result.size
    columns["level"] = result.level
    columns["spawn_step"] = result.spawn_step
    columns["cause (N)"] = result.cause
    columns["unbalanced_load (N)"] = result.unbalanced_load
    columns["error_share"] = result.error_share
    names = np.array([material.name for material in result.scene.cell_materials])
    columns["material"] = names[result.material]
    moved = result.agent_displacement
    columns |= {f"displacement_{AXES[a]} (m)": moved[:, a] for a in range(d)}
    for a, b in [(a, a) for a in range(d)] + axis_pairs(d):
        columns[f"stress_{AXES[a]}{AXES[b]} (Pa)"] = result.stress[:, a, b]
    columns["von_mises (Pa)"] = result.von_mises
    return pd.DataFrame(columns)


def write_vtk(result: SpawnedResult, path: str | Path) -> Path:
    """Write the agents as quadrilaterals or hexahedra."""
    try:
        import meshio
    except ImportError as error:
        raise MissingExtraError("to_vtk needs meshio: pip install 'kaju[vtk]'") from error

    target = Path(path)
    if target.suffix not in (".vtu", ".vtk"):
        target = target.with_name(target.name + ".vtu")
    d = result.lower.shape[1]
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    order = ring if d == 2 else [(*corner, up) for up, corner in product((0, 1), ring)]
    points = result.lower[:, None] + np.array(order) * result.size[:, None, None]
    flat, first, inverse = np.unique(
        np.round(points.reshape(-1, d) / result.size.min()),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    moved = np.zeros((len(flat), 3))
    moved[:, :d] = result.displacement_at(points.reshape(-1, d)[first])
    places = np.zeros((len(flat), 3))
    places[:, :d] = points.reshape(-1, d)[first]
    data = {
        "level": [result.level],
        "spawn_step": [result.spawn_step],
        "unbalanced_load": [result.unbalanced_load],
        "material": [result.material],
        "von_mises": [result.von_mises],
        "stress": [result.stress.reshape(-1, d * d)],
    }
    kind = "quad" if d == 2 else "hexahedron"
    cells = inverse.reshape(len(result.size), len(order))
    mesh = meshio.Mesh(places, [(kind, cells)], {"displacement": moved}, data)
    try:
        mesh.write(target)
    except OSError as error:
        raise ResultFileError(f"{target}: cannot be written: {error.strerror}") from error
    return target
