"""Arrays by what they hold, for annotations, and how they are shown."""

from dataclasses import fields
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ResultError, brief

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


def without_rows(of: Any) -> str:
    """Return how a dataclass is written, with the shapes of its arrays instead of their rows."""
    held = {field.name: getattr(of, field.name) for field in fields(of)}
    arrays = {name: f"array{v.shape}" for name, v in held.items() if isinstance(v, np.ndarray)}
    told = ", ".join(f"{name}={arrays.get(name) or brief(v)}" for name, v in held.items())
    return f"{type(of).__name__}({told})"


def points_in(given: Any, dimension: int) -> Floats:
    """Return points (m) as an array of shape (n, dimension); refuse what is none."""
    try:
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != dimension or not np.isfinite(points).all():
        told = f"such as [({', '.join('xyz'[:dimension])})], got {brief(given)}"
        raise ResultError(f"points: must be numbers (m) of shape (n, {dimension}), {told}")
    return points


def nearest(places: Floats, points: Floats) -> tuple[Floats, Ints]:
    """Return how far the nearest of some places is from each point, and its row."""
    from scipy.spatial import cKDTree  # which takes long to load

    distance, row = cKDTree(places).query(points)
    return np.asarray(distance), np.asarray(row)


def spread(values: NDArray[Any], places: Flags, fill: float = 0.0) -> NDArray[Any]:
    """Return an array with values at some places, in their order, and a `fill` elsewhere."""
    field = np.full((*places.shape, *values.shape[1:]), fill)
    field[places] = values
    return field


def first_largest(values: Floats) -> int:
    """Return the first index whose value equals the largest one, but for rounding."""
    # Another processor rounds them in another order.
    near = values >= values.max() - 1e-9 * np.abs(values).max()
    return int(near.argmax() if near.any() else values.argmax())  # inf or NaN


def moved(points: Ints, axis: int, by: int | Ints | Flags) -> Ints:
    """Return points by their indices, shape (n, dimension), moved along an axis."""
    points = points.copy()
    points[:, axis] += by
    return points


def rigid_motions(places: Floats, axis: Ints) -> Floats:
    """Return what displacements along an axis each are in rigid motions: shifts, then turns."""
    d = places.shape[1]
    shifts = np.eye(d)[axis]
    turns = [
        np.where(axis == a, -places[:, b], np.where(axis == b, places[:, a], 0.0))
        for a, b in combinations(range(d), 2)
    ]
    return np.column_stack([shifts, *turns])
