"""Pictures of sweeps: what each quantity does by itself, and a map over two of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.arrays import Floats
from kaju.errors import ParameterError, ResultError

from . import style
from .style import FAINT, FORCE, INK, LINE, SEQUENTIAL, caption, colour_bar, figure_of

if TYPE_CHECKING:
    import pandas


def plot_effects(table: pandas.DataFrame, measure: str) -> Figure:
    """Draw a measure against each varied quantity: every run, and the means, in a common scale.

    `table`: what `kaju.sweep` returned; `measure`: a column of numbers.
    """
    keys, good = _varied(table), _worked(table, measure)
    figure = style.new_figure((max(4.6, 2.9 * len(keys)), 3.6))
    panels = figure.subplots(1, len(keys), sharey=True, squeeze=False)[0]
    value = good[measure].to_numpy(dtype=np.float64)
    for ax, key in zip(panels, keys, strict=True):
        place, names = _places(good[key])
        ax.plot(place, value, ls="", marker="o", ms=3, mec="none", color=FAINT, alpha=0.45)
        ax.plot(*_means(place, value), marker="o", ms=4, lw=1.6, color=FORCE)
        _axis(ax, "x", key, place, names)
        ax.grid(color=LINE, lw=0.4)
        ax.tick_params(labelsize=8, color=FAINT)
    panels[0].set_ylabel(measure, fontsize=9)
    failed = len(table) - len(good)
    notes = f"{len(good)} runs; grey: each, red: their means"
    caption(panels[0], "Main effects", [notes + (f"; {failed} failed" if failed else "")])
    return figure


def plot_sweep_map(
    table: pandas.DataFrame,
    measure: str,
    x: str | None = None,
    y: str | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a measure over two of the varied quantities; failed runs are crosses.

    Of `spectral_radius` it is the map of stability: the line is where it is 1. `table`: what
    `kaju.sweep` returned; `measure`: a column of numbers; `x`, `y`: the quantities, the first two
    unless given.
    """
    keys = _varied(table)
    x, y = x or keys[0], y or next((key for key in keys if key != (x or keys[0])), "")
    if {x, y} - set(keys) or x == y:
        raise ParameterError(f"x, y: two of the varied quantities ({', '.join(keys)}) are needed")
    good = _worked(table, measure)
    bad = table[table["error"] != ""]
    ax = style.new_axes(ax, (6.4, 4.8))
    places = [_places(table[key]) for key in (x, y)]
    where = np.column_stack([place for place, _ in places])
    rows = table["error"].to_numpy() == ""
    value = good[measure].to_numpy(dtype=np.float64)
    across, along = where[rows].T
    size = float(np.clip(2e4 / len(where), 12.0, 400.0))
    drawn = ax.scatter(across, along, c=value, s=size, cmap=SEQUENTIAL, marker="s")
    ax.scatter(where[~rows, 0], where[~rows, 1], c=FORCE, s=24, marker="x", lw=1.2)
    for axis, key, (place, names) in zip("xy", (x, y), places, strict=True):
        _axis(ax, axis, key, place, names)
    stable = measure == "spectral_radius" and value.min() < 1.0 < value.max()
    if stable and len(value) > 3 and not any(names for _, names in places):
        look: Any = {"levels": [1.0], "colors": INK, "linewidths": 1.4}
        ax.tricontour(across, along, value, **look)
    colour_bar(ax, drawn, measure)
    ax.tick_params(labelsize=8, color=FAINT)
    notes = [f"{len(good)} runs" + (f"; crosses: {len(bad)} that failed" if len(bad) else "")]
    if stable:
        notes.append("line: radius 1; where it is larger, loads that are added up grow")
    caption(ax, f"{measure} over {x} and {y}", notes)
    return figure_of(ax)


def _varied(table: pandas.DataFrame) -> list[str]:
    about = table.attrs.get("sweep")
    if about is None:
        raise ResultError("table: is not of a sweep; take what kaju.sweep or load_sweep returned")
    return list(about["varied"])


def _worked(table: pandas.DataFrame, measure: str) -> pandas.DataFrame:
    if measure not in table:
        raise ResultError(
            f"measure: the table has no column {measure!r}: {', '.join(map(str, table))}"
        )
    good = table[table["error"] == ""]
    if good.empty or good[measure].dtype.kind not in "iufb":
        raise ResultError(f"measure: {measure!r} is no number of any run")
    return good


def _places(column: Any) -> tuple[Floats, list[str]]:
    """Return where values lie on an axis; names of the places if they are no numbers."""
    if column.dtype.kind in "iuf":
        return column.to_numpy(dtype=np.float64), []
    names, place = np.unique(column.astype(str).to_numpy(dtype=object), return_inverse=True)
    return place.astype(np.float64), [str(name) for name in names]


def _means(place: Floats, value: Floats) -> tuple[Floats, Floats]:
    levels, at = np.unique(place, return_inverse=True)
    if len(levels) > 12:  # bins of equally many runs
        at = np.argsort(np.argsort(place, kind="stable")) * 12 // len(place)
    count = np.bincount(at)
    return np.bincount(at, place) / count, np.bincount(at, value) / count


def _axis(ax: Axes, which: str, key: str, place: Floats, names: list[str]) -> None:
    axis = ax.xaxis if which == "x" else ax.yaxis
    axis.set_label_text(key, fontsize=9)
    if names:
        axis.set_ticks(list(range(len(names))), names)
    elif _in_ratios(place):
        (ax.set_xscale if which == "x" else ax.set_yscale)("log")


def _in_ratios(place: Floats) -> bool:
    """Tell whether values lie over decades, and evenly so: as many in the lowest as in the last."""
    low, high = float(place.min()), float(place.max())
    if not 0.0 < 30.0 * low <= high:
        return False
    middle = 0.5 * (low + high), np.sqrt(low * high)  # of even differences, of even ratios
    return bool(np.median(place) < np.sqrt(middle[0] * middle[1]))
