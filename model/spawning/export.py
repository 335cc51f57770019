"""Agents of many sizes as tables and as meshes for other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.model.elasticity.export import AXES, Mesh, corner_order, fields_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .composite import Floats
    from .leaves import Index
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
    first, cells = same_points(points.reshape(-1, d), result.size.min())
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


def same_points(points: Floats, apart: float) -> tuple[Index, Index]:
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
