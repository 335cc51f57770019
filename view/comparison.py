"""Answers side by side along lines: profiles, and ratios to the reference.

The reference is drawn as a line in ink, whatever is judged by it in colours with markers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from kaju.errors import ParameterError
from kaju.model.compare import Comparison, near_line
from kaju.model.pair import Pair

from .style import (
    FAINT,
    INK,
    label_axis,
    new_axes,
    new_figure,
)
from .units import quantity as with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .section import Floats

COLOURS = ("#c8963e", "#b2340b", "#0b5394", "#4d8b57", "#8a5aa8")
MARKERS = ("s", "D", "o", "^", "v")
MOST_PANELS = len(COLOURS)

Comparisons = Mapping[str, Comparison]
"""Comparisons with one reference, by what is judged."""


class Line(NamedTuple):
    """A line through the body: what it is called, and its two ends (m)."""

    title: str
    start: Sequence[float]
    end: Sequence[float]


def plot_profiles(
    comparisons: Comparisons,
    lines: Sequence[Line],
    quantity: str,
    component: str,
    *,
    believed: str = "reference",
    per: float | None = None,
    symbol: str = "",
) -> Figure:
    """Draw a component along lines, one panel a line.

    Parameters
    ----------
    comparisons : mapping of str to Comparison
        What is judged, by name; all with the same reference.
    lines : sequence of Line
        Where.
    quantity, component : str
        Such as "stress" and "yy", or "displacement" and "y".
    believed : str
        What the reference is called.
    per : float, optional
        Values are drawn as shares of this.
    symbol : str
        How the axis is labelled.
    """
    check_count(comparisons)
    figure = new_figure((4.1 * len(lines) + 0.5, 3.9))
    for ax, line in zip(figure.subplots(1, len(lines), squeeze=False)[0], lines, strict=True):
        plot_profile(ax, comparisons, line, (quantity, component), per, symbol)
    legend_below(figure, comparisons, believed)
    return figure


def plot_profile(
    ax: Axes,
    comparisons: Comparisons,
    line: Line,
    what: tuple[str, str],
    per: float | None,
    symbol: str,
) -> None:
    """Draw a component along one line, as it is or as a share of `per`."""
    first = next(iter(comparisons.values()))
    profile = first.along(line.start, line.end, 401)
    shown = pair_of(profile, *what)
    ax.plot(profile.distance, shown.reference / (per or 1.0), color=INK, linewidth=1.6)
    drawn = [shown.reference]
    for number, comparison in enumerate(comparisons.values()):
        distance, pair = at_cells(comparison, line, what)
        drawn.append(pair.values)
        ax.plot(distance, pair.values / (per or 1.0), **look_of(number))
    frame_of(ax, line, float(profile.distance.max()))
    if per is None:
        label_axis(ax.yaxis, symbol, np.concatenate(drawn).tolist(), shown.unit)
    else:
        ax.set_ylabel(symbol, fontsize=9)


def plot_ratio(
    comparisons: Comparisons,
    line: Line,
    quantity: str,
    component: str,
    *,
    believed: str = "reference",
    symbol: str = "",
    ax: Axes | None = None,
) -> Axes:
    """Draw values over those of the reference along a line; 1 is agreement."""
    check_count(comparisons)
    ax = new_axes(ax, (4.6, 3.9))
    ax.axhline(1.0, color=INK, linewidth=1.6)
    for number, comparison in enumerate(comparisons.values()):
        distance, pair = at_cells(comparison, line, (quantity, component))
        ax.plot(distance, pair.ratio, **look_of(number))
    frame_of(ax, line, float(np.linalg.norm(np.subtract(line.end, line.start))))
    ax.set_ylabel(f"{symbol} over that of {believed}", fontsize=9)
    return ax


def plot_stress_ratio(
    comparisons: Comparisons,
    line: Line,
    component: str,
    pressure: float,
    *,
    believed: str = "reference",
    symbol: str = "σ",
) -> Figure:
    """Draw stress as a share of a pressure (Pa), and over that of the reference."""
    check_count(comparisons)
    figure = new_figure((8.8, 3.9))
    left, right = figure.subplots(1, 2)
    plot_profile(left, comparisons, line, ("stress", component), -pressure, f"−{symbol} / $p$")
    plot_ratio(comparisons, line, "stress", component, believed=believed, symbol=symbol, ax=right)
    left.set_title(f"Share of the pressure p = {with_unit(pressure, 'Pa')}", **TITLE)
    right.set_title(f"Share of the stress of {believed}", **TITLE)
    legend_below(figure, comparisons, believed)
    return figure


TITLE: Any = {"loc": "left", "fontsize": 10, "fontweight": "bold", "color": INK}


def check_count(comparisons: Comparisons) -> None:
    """Refuse more answers than there are colours."""
    if not 1 <= len(comparisons) <= MOST_PANELS:
        raise ParameterError(
            f"comparisons: between 1 and {MOST_PANELS} can be drawn, got {len(comparisons)}"
        )


def pair_of(of: Any, quantity: str, component: str) -> Pair:
    """Return a component of a comparison or a profile."""
    pair: Pair | None = of.displacement if quantity == "displacement" else of.stress
    if pair is None:
        raise ParameterError(f"quantity: there is no {quantity!r} to compare")
    return pair.component(component)


def at_cells(comparison: Comparison, line: Line, what: tuple[str, str]) -> tuple[Floats, Pair]:
    """Return a component at those points of a comparison that lie on a line."""
    start = np.asarray(line.start, dtype=np.float64)
    span = np.asarray(line.end, dtype=np.float64) - start
    length = float(np.linalg.norm(span))
    on_line = near_line(comparison.points, start, span / length, length)
    pair = pair_of(comparison, *what)
    row = [int(np.argmin(np.abs(comparison.points - p).sum(axis=1))) for p in on_line]
    chosen = Pair(pair.name, pair.unit, pair.values[row], pair.reference[row])
    return (on_line - start) @ (span / length), chosen


def look_of(number: int) -> dict[str, Any]:
    """Return how what is judged is drawn, by its number."""
    return {
        "color": COLOURS[number],
        "marker": MARKERS[number],
        "markersize": 4.0,
        "linewidth": 0.9,
        "markerfacecolor": "white",
        "markeredgewidth": 1.0,
    }


def frame_of(ax: Axes, line: Line, length: float) -> None:
    """Label the axis along a line, and keep the frame light."""
    label_axis(ax.xaxis, line.title, [0.0, length], "m")
    ax.tick_params(labelsize=8, color=FAINT)
    ax.grid(True, color="#ececec", linewidth=0.6)
    ax.axhline(0.0, color="#b5b5b5", linewidth=0.6)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def legend_below(figure: Figure, comparisons: Comparisons, believed: str) -> None:
    """Say what the lines are, below the figure."""
    handles = [Line2D([], [], color=INK, linewidth=1.6, label=believed)]
    handles += [Line2D([], [], label=name, **look_of(n)) for n, name in enumerate(comparisons)]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=8,
        frameon=False,
    )
