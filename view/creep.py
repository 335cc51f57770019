"""What creeps, over time: the body, the network or the curves as they were at a time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial, wraps
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.errors import ParameterError

from .charts import plot_curves
from .deformed import magnification_for, moving_cells, plot_tiles_deformed
from .films import IN_TIME, Film
from .network_plots import plot_network
from .section import section_of
from .style import INK
from .units import quantity

if TYPE_CHECKING:
    from kaju.model.rheology.creep_result import BodyTimeResult, TimeResult
    from kaju.model.rheology.creeping_network import NetworkCreepResult

Cut = Mapping[str, float]


def plot_body_at(
    course: BodyTimeResult,
    ax: Axes | None = None,
    *,
    record: int = -1,
    magnification: float | None = None,
    largest: float | None = None,
    cut: Cut | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed body at one of the times asked for, the last unless given."""
    record = _checked(course, record)
    section = section_of(course.grid, course.static.focus, cut, crop)
    moved_at = partial(course.displacement_at, record=record)
    tiles = moving_cells(course.static, section, moved_at)
    stage, share = course.static.stage, float(course.factors[record] != 0.0)
    picture = plot_tiles_deformed(section, tiles, magnification, ax, stage, share, largest)
    farthest = f"largest displacement {quantity(course.max_displacement(record), 'm')}"
    return picture.finish(
        "Deformed body", [f"{_moment(course, record)}; {farthest}", picture.magnified]
    )


@wraps(plot_network)
def plot_network_at(
    course: NetworkCreepResult, ax: Axes | None = None, *, record: int = -1, **options: Any
) -> Axes:
    """Draw the network at one of the times asked for, the last unless given."""
    record = _checked(course, record)
    ax = plot_network(course.to_network_result(), ax, record=record, **options)
    notes = ax.texts[-1]
    notes.set_text(f"{_moment(course, record)}\n{notes.get_text()}")
    ax.set_title(ax.get_title(loc="left"), loc="left", fontsize=11, fontweight="bold", pad=38.0)
    return ax


def _scale(course: BodyTimeResult, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the magnification and the end of the colours, by the time of the largest move."""
    section = section_of(course.grid, course.static.focus, options.get("cut"), options.get("crop"))
    peak = int(np.argmax(course.largest_displacement()))
    tiles = moving_cells(course.static, section, partial(course.displacement_at, record=peak))
    return {"magnification": magnification_for(section, tiles), "largest": tiles.largest}


def plot_curves_at(
    course: TimeResult, ax: Axes | None = None, *, panel: int = 0, record: int | None = None
) -> Axes | Figure:
    """Draw all curves of what creeps, with a dot at one of the times if that is asked for."""
    drawn = plot_curves(course, ax, panel=panel)
    if record is None:
        return drawn
    every = course.curves() if isinstance(drawn, Figure) else course.curves()[panel:]
    panels = drawn.axes if isinstance(drawn, Figure) else [drawn]
    for each, curves in zip(panels, every, strict=False):
        now = float(curves.at[_checked(course, record)])
        reached = [float(values[record]) for values in curves.lines.values()]
        each.axvline(now, color="#9a9a9a", lw=0.8, zorder=1)
        each.plot([now] * len(reached), reached, "o", ms=4, color=INK, zorder=5)
    return drawn


def _records(course: TimeResult) -> range:
    return range(len(course.times))


BODY = Film("deformed", "record", _records, _scale, fps=IN_TIME)
"""The body at all times asked for."""
NETWORK = Film("deformed", "record", _records, fps=IN_TIME)
CURVES = Film("curves", "record", _records, fps=IN_TIME)
"""The curves, and a dot that runs along them."""


def _moment(course: TimeResult, record: int) -> str:
    return f"time {course.times[record]:.4g} s; history at {course.factors[record]:.3g}"


def _checked(course: TimeResult, record: int) -> int:
    count = len(course.times)
    if not -count <= record < count:
        raise ParameterError(f"record: this result has the times 0 to {count - 1}, got {record}")
    return record % count
