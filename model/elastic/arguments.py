"""Numbers that are asked for: what they are by default, and what rules they keep."""

from __future__ import annotations

import re
from math import isfinite

import numpy as np

from kaju.errors import ParameterError

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
            text = f"{tolerance:g}%" if number and tolerance > 0.0 else str(tolerance)
            percent = re.fullmatch(r"(\d*\.?\d+) ?%", text)
            meant = f"; {percent[1]} % are {float(percent[1]) / 100:g}" if percent else ""
            raise ParameterError(
                f"tolerance: must be a number from {least:g} to 1, got {tolerance!r}{meant}"
            )
    whole = {"resolution": resolution, "stage": stage, "most_agents": most_agents}
    for name, value in whole.items():
        integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
        if value is not None and not (integer and value >= 1):
            raise ParameterError(f"{name}: must be a whole number, 1 or more, got {value!r}")
