"""What creeps, over time: the body or network as it was at a time, and films."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial, wraps
from typing import TYPE_CHECKING, Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes

from kaju.errors import ParameterError

from .charts import draw_curves, panels_for
from .deformed import moving_cells, plot_tiles_deformed
from .films import Film
from .network_plots import Colour, NetworkPicture, plot_network
from .section import section_of
from .style import INK, caption
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
    cut: Cut | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed body at one of the times asked for, the last unless given."""
    record = _checked(course, record)
    section = section_of(course.grid, course.static.focus, cut, crop)
    moved_at = partial(course.displacement_at, record=record)
    tiles = moving_cells(course.static, section, moved_at)
    stage, loaded = course.static.stage, bool(course.factors[record])
    picture = plot_tiles_deformed(section, tiles, magnification, ax, stage, loaded)
    largest = f"largest displacement {quantity(tiles.largest, 'm')}"
    return picture.finish(
        "Deformed body", [f"{_moment(course, record)}; {largest}", picture.magnified]
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


def network_over_time(
    course: NetworkCreepResult, colour: Colour = "tension", magnification: float | None = None
) -> Film:
    """Return the network as it stood at the times asked for."""
    picture = NetworkPicture(course.to_network_result(), None, colour, magnification)
    picture.draw_rest()

    def text(record: int) -> str:
        return "\n".join([_moment(course, record), "; ".join(picture.notes(record))])

    return picture.film(text)


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

    last = len(course.times) - 1
    return Film(figure, last, draw, notes, lambda number: _moment(course, number))


def _moment(course: TimeResult, record: int) -> str:
    return f"time {course.times[record]:.4g} s; history at {course.factors[record]:.3g}"


def _checked(course: TimeResult, record: int) -> int:
    count = len(course.times)
    if not -count <= record < count:
        raise ParameterError(f"record: this result has the times 0 to {count - 1}, got {record}")
    return record % count
