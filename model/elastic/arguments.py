"""Numbers that are asked for: what they are by default, and what rules they keep."""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.scene import Scene

SMALLEST_TOLERANCE, TOLERANCE = 1e-6, 1e-2
"""Of an answer; equal cells solve their equations to `SMALLEST` and more."""
SMALLEST = 1e-13


def check_numbers(
    tolerance: float | None,
    resolution: int | None,
    stage: int | None = None,
    most_agents: int | None = None,
    least: float = SMALLEST_TOLERANCE,
) -> None:
    """Refuse numbers that break a rule."""
    if tolerance is not None:
        number = isinstance(tolerance, (int, float, np.number)) and not isinstance(tolerance, bool)
        if not (number and isfinite(tolerance) and least <= tolerance < 1.0):
            raise ParameterError(
                f"tolerance: must be a number from {least:g} to 1, got {tolerance!r}"
            )
    whole = {"resolution": resolution, "stage": stage, "most_agents": most_agents}
    for name, value in whole.items():
        integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
        if value is not None and not (integer and value >= 1):
            raise ParameterError(f"{name}: must be a whole number from 1 upwards, got {value!r}")


def checked_stiffness(scene: Scene, stiffness: ArrayLike) -> Floats:
    """Return a field of relative stiffness, one number above 0 for every cell of the scene."""
    try:
        field = np.asarray(stiffness, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"stiffness: must be numbers, got {stiffness!r:.80}") from error
    shape = scene.lattice.shape
    if field.shape != shape:
        raise ParameterError(
            f"stiffness: one number a cell is needed, an array of shape {shape} indexed from "
            f"left and bottom, got shape {field.shape}"
        )
    stiffest = max(material.youngs_modulus for material in scene.cell_materials)
    with np.errstate(over="ignore"):
        wrong = (scene.rasterise() >= 0) & ~(np.isfinite(field * stiffest) & (field > 0.0))
    if wrong.any():
        cell = tuple(np.argwhere(wrong)[0].tolist())
        raise ParameterError(
            f"stiffness: must be above 0 where there is material, and finite, also times Young's "
            f"modulus, got {field[cell]} at cell {cell}; take a small share of the material's own, "
            "such as 1e-6, for what is nearly air"
        )
    return field
