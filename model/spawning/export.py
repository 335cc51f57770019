"""Agents of many sizes as tables and as meshes for other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.model.elasticity.export import AXES, Mesh, corner_order, fields_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .spawned_result import SpawnedResult


def columns(result: SpawnedResult) -> dict[str, NDArray[Any]]:
    """Return one row per agent."""
    names = np.array([material.name for material in result.scene.cell_materials])
    found = {f"{AXES[a]} (m)": column for a, column in enumerate(result.middle.T)}
    found |= {
        "size (m)": result.size,
        "level": result.level,
        "spawn_step": result.spawn_step,
        "cause (N)": result.cause,
        "unbalanced_load (N)": result.unbalanced_load,
        "error_share": result.error_share,
        "material": names[result.material],
    }
    moved = result.agent_displacement
    return found | fields_of(moved, result.strain, result.stress, result.von_mises)


def mesh(result: SpawnedResult) -> Mesh:
    """Return the agents as quadrilaterals or hexahedra, with the corners that they share."""
    d = result.lower.shape[1]
    points = result.lower[:, None] + np.array(corner_order(d)) * result.size[:, None, None]
    place = np.rint(points.reshape(-1, d) / result.size.min())
    _, first, cells = np.unique(place, axis=0, return_index=True, return_inverse=True)
    corners = points.reshape(-1, d)[first]
    data = {
        "level": result.level,
        "spawn_step": result.spawn_step,
        "unbalanced_load": result.unbalanced_load,
        "material": result.material,
        "von_mises": result.von_mises,
        "stress": result.stress.reshape(-1, d * d),
        "strain": result.strain.reshape(-1, d * d),
    }
    return Mesh(corners, cells.reshape(points.shape[:2]), result.displacement_at(corners), data)
