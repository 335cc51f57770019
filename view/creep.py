"""What creeps, over time: curves, the body or network as it stood, and films of both."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial, wraps
from typing import TYPE_CHECKING, Any

from kaju.errors import ParameterError

from .body import finish
from .curves import draw_curves, panels_for
from .deformed import draw_deformation, moving_cells
from .forces import draw_forces
from .network_plots import Colour, Stand, plot_network
from .reels import TWO_LINES, Reel
from .section import section_of
from .style import INK, caption, figure_of, new_axes
from .units import quantity

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from kaju.model.creep.network_result import NetworkCreepResult
    from kaju.model.creep.state import BodyCourse, Course

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
) -> Reel:
    """Return the network as it stood at the times asked for."""
    stand = Stand(course.to_network_result(), None, colour, magnification)
    stand.draw_rest()
    first = stand.draw_springs(0)
    stand.bar(first[0])
    for artist in first:
        artist.set_visible(False)
    notes = stand.finish(TWO_LINES)

    def words(record: int) -> str:
        return "\n".join([_moment(course, record), "; ".join(stand.words(record))])

    return Reel(figure_of(stand.ax), len(course.times) - 1, stand.draw_springs, notes, words)


def curves_over_time(course: Course) -> Reel:
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

    return Reel(figure, len(course.times) - 1, draw, notes, words)


def _moment(course: Course, record: int) -> str:
    return f"time {course.times[record]:.4g} s; history at {course.factors[record]:.3g}"


def _checked(course: Course, record: int) -> int:
    count = len(course.times)
    if not -count <= record < count:
        raise ParameterError(f"record: this result has the times 0 to {count - 1}, got {record}")
    return record % count
