"""The points of a sweep, and its runs: a point becomes a scene, that a result, that a row.

Grids take every combination of the values given. The other methods draw points of the unit cube
and read them through the distributions: Latin hypercubes (McKay, Beckman & Conover 1979) and
scrambled Sobol sequences (Owen 1998).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from inspect import signature
from itertools import product
from typing import Any

import numpy as np

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError
from kaju.model.network import SpringNetwork
from kaju.model.network import solve as solve_network
from kaju.model.scene import Scene
from kaju.model.transfer.load_model import LoadModel
from kaju.progress import without_progress

from .solving import solve

Row = dict[str, Any]
Measure = str | Callable[[Any], Any] | Sequence[str] | None

RUN, ERROR = "run", "error"
_OPTION = "run."
_NOT_REPEATABLE = ("seconds", "kaju_version")
"""Figures of a summary that say nothing about the point."""

Vary = Mapping[str, Any]

GRID, LISTED = "grid", "list"
SAMPLED = ("sobol", "lhs")
MOST_POINTS = 1_000_000


@dataclass(frozen=True)
class SweepRun:
    """What is done at every point."""

    subject: Scene | Callable[..., Any]  # changed by the point's keys, or called with them by name
    run: Callable[..., Any]  # takes the subject, and the keys that begin with "run." as options
    measure: Measure  # what of the result goes into the row
    seed: int  # from which the runs' own seeds are made

    def row(self, number: int, point: Mapping[str, Any]) -> Row:
        """Return the row of one point; one that fails has its error in it."""
        row = {RUN: number, **{key: _cell(value) for key, value in point.items()}}
        try:
            figures = self.figures(number, point)
            taken = figures.keys() & {ERROR, *row}
            if taken:
                raise ParameterError(
                    f"measure: {taken.pop()!r} is another column's name; return it by a new one"
                )
        except Exception as error:  # whatever a run dies of belongs into its row
            return row | {ERROR: f"{type(error).__name__}: {error}"}
        return row | figures | {ERROR: ""}

    def figures(self, number: int, point: Mapping[str, Any]) -> Row:
        """Return what is measured at one point, with a seed independent of all others'."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(number,))
        seed = int(sequence.generate_state(1)[0])
        options = {k.removeprefix(_OPTION): v for k, v in point.items() if k.startswith(_OPTION)}
        with without_progress():
            result = _called(self.run, (self.subject_at(point, seed),), options, seed)
            if hasattr(result, "step") and hasattr(result, "run"):
                result = result.run()  # a model's class, or a part of its call, makes a model
        return _measured(result, self.measure)

    def subject_at(self, point: Mapping[str, Any], seed: int) -> Any:
        """Return the subject at a point."""
        changes = {key: value for key, value in point.items() if not key.startswith(_OPTION)}
        if not isinstance(self.subject, Scene):
            return _called(self.subject, (), changes, seed)
        return self.subject.with_overrides({key_path(k): v for k, v in changes.items()})


def by_its_kind(subject: Any, rng: int | None = None) -> Any:
    """Run models and prescribed scenes, solve other scenes and networks; all else is an answer."""
    if isinstance(subject, Scene):
        if subject.rule.kind == "prescribed":
            return LoadModel(subject, rng=rng).run()
        return solve(subject)
    if isinstance(subject, SpringNetwork):
        return solve_network(subject)
    return subject.run() if hasattr(subject, "step") and hasattr(subject, "run") else subject


def _called(
    function: Callable[..., Any], arguments: tuple[Any, ...], options: Mapping[str, Any], seed: int
) -> Any:
    takes = signature(function).parameters
    chance = {"rng": seed} if "rng" in takes and "rng" not in options else {}
    return function(*arguments, **options, **chance)


def _measured(result: Any, measure: Measure) -> Row:
    """Return what the measure takes of a result, by column."""
    if measure is None:
        return _everything(result)
    if isinstance(measure, str):
        measure = (measure,)
    if callable(measure):
        value = measure(result)
        name = getattr(measure, "__name__", "measure").replace("<lambda>", "measure")
        found: Mapping[str, Any] = value if isinstance(value, Mapping) else {name: value}
    else:
        table = _table(result)
        found = {name: _found(result, table, name) for name in measure}
    return {str(name): _figure(str(name), value) for name, value in found.items()}


def _table(result: Any) -> Mapping[str, Any]:
    if isinstance(result, Mapping):
        return result
    if callable(getattr(result, "summary", None)):
        return dict(result.summary())
    if is_dataclass(result):
        return vars(result)
    return {}


def _everything(result: Any) -> Row:
    """Return all single figures of a result that are the same at every repetition."""
    if _is_figure(plain(result)):
        return {"value": plain(result)}
    figures = {
        key: plain(value) for key, value in _table(result).items() if key not in _NOT_REPEATABLE
    }
    figures = {key: value for key, value in figures.items() if _is_figure(value)}
    if not figures:
        raise ParameterError(
            f"measure: a {type(result).__name__} has no figures of its own; "
            "say what to measure by a function of it"
        )
    return figures


def _found(result: Any, table: Mapping[str, Any], name: str) -> Any:
    """Return ``reaction.bottom[1]`` of a summary, or ``last.ledger.taken`` of the result."""
    found: Any = table if key_path(name).split(".")[0] in table else result
    for key in key_path(name).split("."):
        try:
            if isinstance(found, Mapping):
                found = found[key]
            elif key.isdecimal():
                found = found[int(key)]
            else:
                found = getattr(found, key)
        except (KeyError, IndexError, TypeError, AttributeError):
            known = ", ".join(key for key, value in table.items() if _is_figure(plain(value)))
            raise ParameterError(
                f"measure: the result has no {name!r}; its summary has {known}"
            ) from None
    return found


def _is_figure(value: Any) -> bool:
    return value is None or isinstance(value, (bool, int, float, str))


def _figure(name: str, value: Any) -> Any:
    value = plain(value)
    if value is None:
        return math.nan
    if not _is_figure(value):
        raise ParameterError(
            f"measure: {name!r} must be one number, text or truth value, got {type(value).__name__}"
        )
    return value


def _cell(value: Any) -> Any:
    """Return a varied value as a cell of a table holds it: lists and tables as text."""
    return value if _is_figure(value) else json.dumps(value, default=str)


# Which points are run.


def points_of(vary: Vary, method: str, samples: int | None, seed: int) -> list[dict[str, Any]]:
    """Return the points that `sweep` is asked for."""
    known = (GRID, LISTED, *SAMPLED)
    if method not in known:
        raise ParameterError(
            f"method: must be one of {', '.join(map(repr, known))}, got {method!r}"
            f"{suggestion(str(method), known)}"
        )
    if not isinstance(vary, Mapping) or not vary:
        raise ParameterError("vary: at least one quantity is needed, as {'rule.threshold': [...]}")
    if method in SAMPLED:
        columns = _sampled(vary, method, samples, seed)
    elif samples is None:
        columns = [_values(key, given) for key, given in vary.items()]
    else:
        raise ParameterError(
            f"samples: a {method} has as many points as its values make; leave samples away"
        )
    lengths = dict(zip(vary, map(len, columns), strict=True))
    if method == LISTED and len({*lengths.values()}) > 1:
        raise ParameterError(
            f"vary: the values of a list go together one by one; got {lengths} of them"
        )
    if method == GRID and math.prod(lengths.values()) > MOST_POINTS:
        raise ParameterError(
            f"vary: {math.prod(lengths.values()):,} combinations are more than {MOST_POINTS:,}; "
            "take fewer values, or draw samples (method='sobol', samples=1024)"
        )
    rows = product(*columns) if method == GRID else zip(*columns, strict=True)
    return [dict(zip(vary, map(plain, row), strict=True)) for row in rows]


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


def _sampled(vary: Vary, method: str, samples: int | None, seed: int) -> list[Sequence[Any]]:
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
    columns: list[Sequence[Any]] = []
    for (key, given), column in zip(vary.items(), unit.T, strict=True):
        if hasattr(given, "ppf"):
            columns.append(given.ppf(column))
            if not np.isfinite(columns[-1]).all():
                raise ParameterError(f"vary: the distribution of {key!r} gave infinite values")
        else:
            values = _values(key, given)
            columns.append([values[int(place)] for place in column * len(values)])
    return columns


def plain(value: Any) -> Any:
    """Return a value without NumPy's types, as scenes and files take it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.item() if isinstance(value, np.generic) else value


def key_path(key: str) -> str:
    """Return ``loads[0].force[1]`` as ``loads.0.force.1``."""
    return re.sub(r"\[(\d+)\]", r".\1", key)
