"""What changes along a run, drawn as curves: one panel for every unit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from .comparison import COLOURS
from .style import FAINT, INK, LINE, caption, label_axis, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kaju.model.result import Curves

_ACROSS = 2  # panels side by side
_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


class HasCurves(Protocol):
    """An answer that changes along something."""

    def curves(self) -> Sequence[Curves]:
        """Return what changes, a panel each."""


def plot_curves(result: HasCurves, ax: Axes | None = None, *, panel: int = 0) -> Axes | Figure:
    """Draw all curves of a result, or one panel of them on axes that are given."""
    every = result.curves()
    if ax is not None:
        return draw_curves(ax, every[panel])
    figure, panels = panels_for(every)
    for drawn, curves in zip(panels, every, strict=True):
        draw_curves(drawn, curves)
    return figure


def panels_for(every: Sequence[Curves]) -> tuple[Figure, list[Axes]]:
    """Return a new figure, and axes in it for each of some curves."""
    rows, across = -(-len(every) // _ACROSS), min(_ACROSS, len(every))
    figure = new_figure((4.9 * across, 3.6 * rows))
    panels = figure.subplots(rows, across, squeeze=False).ravel().tolist()
    for empty in panels[len(every) :]:
        empty.set_axis_off()
    return figure, panels[: len(every)]


def draw_curves(ax: Axes, curves: Curves) -> Axes:
    """Draw the lines of one panel, with units and, if there are several, their names."""
    single = len(curves.lines) == 1
    for number, (name, values) in enumerate(curves.lines.items()):
        colour = INK if single else COLOURS[number % len(COLOURS)]
        dash = _DASHES[number % len(_DASHES)]
        ax.plot(curves.at, values, lw=1.4, color=colour, ls=dash, label=name)
    label_axis(
        ax.xaxis, curves.along, [float(curves.at.min()), float(curves.at.max())], curves.along_unit
    )
    called = next(iter(curves.lines)) if single else curves.title.lower()
    if curves.logarithmic:
        ax.set_yscale("log")
        ax.set_ylabel(f"{called} ({curves.unit})" if curves.unit else called, fontsize=9)
        ax.tick_params(labelsize=8)
    else:
        every = np.concatenate(list(curves.lines.values()))
        label_axis(ax.yaxis, called, [float(every.min()), float(every.max())], curves.unit)
        ax.axhline(0.0, color=FAINT, lw=0.6, zorder=0)
    ax.grid(color=LINE, lw=0.4)
    for spine in ax.spines.values():
        spine.set_color(LINE)
    if not single:
        ax.legend(fontsize=8, frameon=False, loc="best")
    caption(ax, curves.title, [])
    return ax
