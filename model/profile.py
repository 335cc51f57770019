"""What a result says along a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.errors import ResultError

from .result import BodyResult, body_cells

if TYPE_CHECKING:
    import pandas
    from numpy.typing import NDArray

AXES = "xyz"


def along_line(
    result: BodyResult, start: Sequence[float], end: Sequence[float], count: int
) -> pandas.DataFrame:
    """Return displacement and stress along a line; see `BodyResult.profile`."""
    import pandas as pd

    first, way, length = line_of(start, end, result.scene.lattice.dimension, "profile")
    points = first + np.linspace(0.0, length, count)[:, None] * way
    points = points[body_cells(result.grid, points)[1]]
    if not len(points):
        raise ResultError(f"profile: no point from {list(start)} to {list(end)} lies in the body")
    names = AXES[: len(first)]
    columns: dict[str, Any] = {"distance (m)": (points - first) @ way}
    columns |= {f"{name} (m)": points[:, a] for a, name in enumerate(names)}
    moved, stress = result.displacement_at(points), result.stress_at(points)
    columns |= {f"displacement_{name} (m)": moved[:, a] for a, name in enumerate(names)}
    for a, first_name in enumerate(names):
        for b, second_name in enumerate(names[a:], start=a):
            columns[f"stress_{first_name}{second_name} (Pa)"] = stress[:, a, b]
    return pd.DataFrame(columns)


def line_of(
    start: Sequence[float], end: Sequence[float], dimension: int, caller: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the first point (m), the unit vector and the length (m) of a line.

    Raises
    ------
    ResultError
        If the ends are the same, or of another dimension.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(last - first)) if first.shape == last.shape else 0.0
    if first.shape != (dimension,) or not length > 0.0:
        raise ResultError(
            f"{caller}: two different points of {dimension} numbers are needed, "
            f"got {list(start)} and {list(end)}"
        )
    return first, (last - first) / length, length
