"""What creeps, over time: curves, the body or network as it stood, and films of both."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.errors import ParameterError
from kaju.model.results.result import Curves
from kaju.view.films import Film

from .body_plots import draw_forces, finish
from .comparison import COLOURS
from .deformed import draw_deformation, moving_cells
from .network_plots import Colour, Stand, plot_network
from .section import section_of
from .style import FAINT, INK, LINE, caption, label_axis, new_axes, new_figure
from .units import quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from kaju.model.rheology.creep_result import BodyCourse, TimeResult
    from kaju.model.rheology.network import NetworkCreepResult


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


Cut = Mapping[str, float]


def plot_body_at(
    course: BodyCourse,
    ax: Axes | None = None,
    *,
    record: int = -1,
    magnification: float | None = None,
    cut: Cut | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed body at one of the times asked for, the last unless given."""
    record = _checked(course, record)
    section = section_of(course.grid, course.static.focus, cut, crop)
    moved_at = partial(course.displacement_at, record=record)
    tiles = moving_cells(course.static, section, moved_at)
    ax = new_axes(ax)
    entries, told = draw_deformation(ax, section, tiles, magnification)
    if course.factors[record]:
        draw_forces(ax, section, course.static.stage)
    largest = f"largest displacement {quantity(tiles.largest, 'm')}"
    notes = [f"{_moment(course, record)}; {largest}", told]
    finish(ax, section, "Deformed body", notes, entries)
    return ax


@wraps(plot_network)
def plot_network_at(
    course: NetworkCreepResult, ax: Axes | None = None, *, record: int = -1, **options: Any
) -> Axes:
    """Draw the network at one of the times asked for, the last unless given."""
    record = _checked(course, record)
    ax = plot_network(course.to_network_result(), ax, record=record, **options)
    told = ax.texts[-1]
    told.set_text(f"{_moment(course, record)}\n{told.get_text()}")
    ax.set_title(ax.get_title(loc="left"), loc="left", fontsize=11, fontweight="bold", pad=38.0)
    return ax


def network_over_time(
    course: NetworkCreepResult, colour: Colour = "tension", magnification: float | None = None
) -> Film:
    """Return the network as it stood at the times asked for."""
    stand = Stand(course.to_network_result(), None, colour, magnification)

    def words(record: int) -> str:
        return "\n".join([_moment(course, record), "; ".join(stand.words(record))])

    return stand.reel(words)


def curves_over_time(course: TimeResult) -> Film:
    """Return the curves as they grow, a dot at where they have come to."""
    every = course.curves()
    figure, panels = panels_for(every)
    for ax, curves in zip(panels, every, strict=True):
        draw_curves(ax, curves)
    panels[0].texts[-1].remove()
    notes = caption(panels[0], every[0].title, [_moment(course, 0)])

    def draw(number: int) -> list[Artist]:
        artists: list[Artist] = []
        for ax, curves in zip(panels, every, strict=True):
            now = float(curves.at[number])
            artists.append(ax.axvline(now, color="#9a9a9a", lw=0.8, zorder=1))
            reached = [float(values[number]) for values in curves.lines.values()]
            artists += ax.plot([now] * len(reached), reached, "o", ms=4, color=INK, zorder=5)
        return artists

    def words(number: int) -> str:
        return _moment(course, number)

    return Film(figure, len(course.times) - 1, draw, notes, words)


def _moment(course: TimeResult, record: int) -> str:
    return f"time {course.times[record]:.4g} s; history at {course.factors[record]:.3g}"


def _checked(course: TimeResult, record: int) -> int:
    count = len(course.times)
    if not -count <= record < count:
        raise ParameterError(f"record: this result has the times 0 to {count - 1}, got {record}")
    return record % count
