"""Which points of the varied quantities are run.

Grids take every combination of the values given. The other methods draw points of the unit cube
and read them through the distributions: Latin hypercubes (McKay, Beckman & Conover 1979) and
scrambled Sobol sequences (Owen 1998).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError

Vary = Mapping[str, Any]
Method = str | Sequence[Mapping[str, Any]]

GRID, LISTED = "grid", "list"
SAMPLED = ("sobol", "lhs")
MOST_POINTS = 10_000_000


@dataclass(frozen=True)
class SweepPoints:
    """The points of a sweep, by column."""

    columns: Mapping[str, Sequence[Any]]  # of each varied quantity, one value per point
    method: str  # how they were chosen

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getitem__(self, number: int) -> dict[str, Any]:
        return {key: plain(column[number]) for key, column in self.columns.items()}


def points_of(vary: Vary, method: Method, samples: int | None, seed: int) -> SweepPoints:
    """Return the points that `sweep` is asked for."""
    if not isinstance(method, str):
        return _given(vary, method)
    if method not in (GRID, LISTED, *SAMPLED):
        known = (GRID, LISTED, *SAMPLED)
        raise ParameterError(
            f"method: {', '.join(map(repr, known))}, or a list of points, "
            f"got {method!r}{suggestion(method, known)}"
        )
    if not isinstance(vary, Mapping) or not vary:
        raise ParameterError("vary: at least one quantity is needed, as {'rule.threshold': [...]}")
    if method in SAMPLED:
        return _sampled(vary, method, samples, seed)
    if samples is not None:
        raise ParameterError(
            f"samples: a {method} has as many points as its values make; leave samples away"
        )
    values = {key: _values(key, given) for key, given in vary.items()}
    if method == LISTED:
        lengths = {key: len(column) for key, column in values.items()}
        if len(set(lengths.values())) > 1:
            raise ParameterError(
                f"vary: the values of a list go together one by one; got {lengths} of them"
            )
        return SweepPoints(values, LISTED)
    shape = tuple(map(len, values.values()))
    if math.prod(shape) > MOST_POINTS:
        raise ParameterError(
            f"vary: {math.prod(shape):,} combinations are more than {MOST_POINTS:,}; take fewer "
            "values, or draw samples (method='sobol', samples=1024)"
        )
    places = np.unravel_index(np.arange(math.prod(shape)), shape)
    columns = {
        key: [column[place] for place in along]
        for (key, column), along in zip(values.items(), places, strict=True)
    }
    return SweepPoints(columns, GRID)


def _given(vary: Vary, points: Sequence[Mapping[str, Any]]) -> SweepPoints:
    if vary:
        raise ParameterError("vary: points that are given say themselves what they vary; pass {}")
    if not points or not all(isinstance(point, Mapping) and point for point in points):
        raise ParameterError("method: points are mappings such as {'rule.threshold': 0.01}")
    keys = list(points[0])
    for number, point in enumerate(points):
        if set(point) != set(keys):
            raise ParameterError(f"method: point {number} varies {sorted(point)}, not {keys}")
    return SweepPoints({key: [point[key] for point in points] for key in keys}, LISTED)


def _values(key: str, given: Any) -> Sequence[Any]:
    if hasattr(given, "ppf"):
        raise ParameterError(
            f"vary: {key!r} is a distribution, of which a grid or list cannot be made; "
            "take method='sobol' or 'lhs', with samples="
        )
    if isinstance(given, (str, bytes)) or not isinstance(given, (Sequence, np.ndarray, range)):
        raise ParameterError(
            f"vary: {key!r} needs a list of values or a scipy.stats distribution, got {given!r}"
        )
    if len(given) == 0:
        raise ParameterError(f"vary: {key!r} has no values")
    return list(given)


def _sampled(vary: Vary, method: str, samples: int | None, seed: int) -> SweepPoints:
    if samples is None or isinstance(samples, bool) or int(samples) != samples or samples < 1:
        raise ParameterError(
            f"samples: {method} needs the number of points, 1 or more; got {samples!r}"
        )
    if method != "lhs" and samples & (samples - 1):
        below = 1 << (samples.bit_length() - 1)
        raise ParameterError(
            f"samples: Sobol points are balanced only in powers of two; take {below} or "
            f"{2 * below} instead of {samples}, or method='lhs'"
        )
    from scipy.stats import qmc

    engine = qmc.Sobol if method == "sobol" else qmc.LatinHypercube
    unit = engine(len(vary), seed=seed).random(samples)
    unit = np.clip(np.asarray(unit, dtype=np.float64), 0.0, np.nextafter(1.0, 0.0))
    columns: dict[str, Sequence[Any]] = {}
    for (key, given), column in zip(vary.items(), unit.T, strict=True):
        if hasattr(given, "ppf"):
            columns[key] = given.ppf(column)
            if not np.isfinite(columns[key]).all():
                raise ParameterError(f"vary: the distribution of {key!r} gave infinite values")
        else:
            values = _values(key, given)
            columns[key] = [values[int(place)] for place in column * len(values)]
    return SweepPoints(columns, method)


def plain(value: Any) -> Any:
    """Return a value without NumPy's types, as scenes and files take it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.item() if isinstance(value, np.generic) else value


def key_path(key: str) -> str:
    """Return ``loads[0].force[1]`` as ``loads.0.force.1``."""
    return re.sub(r"\[(\d+)\]", r".\1", key)
