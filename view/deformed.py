"""The deformed body, magnified until the eye can see it; the factor is stated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import hypot, inf, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D

from kaju.arrays import Floats, Ints, nearest
from kaju.errors import ParameterError
from kaju.model.elastic.goals.quantities import HOOP, Stress
from kaju.model.results.mesh import same_points
from kaju.model.results.result import BodyResult
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import BodyPicture
from .charts import applied_loads, from_end, moment_text
from .films import PER_SECOND, Film
from .layers import OUTLINED, Tiles, layer_of, squares_of, usual_top
from .section import Cut, Section, check_number, check_word, section_of
from .style import FAINT, SIZE, add_polygons, colour_bar
from .units import quantity, times, visible

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.rheology.creep_result import BodyTimeResult


MovedAt = Callable[["Floats"], "Floats"]
"""Displacements (m) at points (m)."""


class Joined(NamedTuple):
    """Cells that share corners, and how to find the displacement of these."""

    points: Floats  # the corners (m), each once; shape (points, dimension)
    parts: Ints  # the corners of every cell; shape (n, corners)
    inside: Floats  # where cells are asked for these; shape (n corners, dimension)

    def moved(self, moved_at: MovedAt) -> Floats:
        """Return the displacement of the points: the mean over the cells that meet there."""
        own = moved_at(self.inside)
        number = self.parts.ravel()
        share = np.bincount(number)
        return np.stack([np.bincount(number, column) / share for column in own.T], axis=1)


def join(corners: Floats, apart: Floats) -> Joined:
    """Join cells of a size (m), corners of shape (n, corners, dimension), where they touch."""
    flat = corners.reshape(-1, corners.shape[2])
    first, number = same_points(flat, apart / 180.0)  # rounding is far less
    middles = np.repeat(corners.mean(axis=1), corners.shape[1], axis=0)
    inside = flat + 1e-6 * (middles - flat)  # where a corner belongs to no other cell
    return Joined(flat[first], number.reshape(corners.shape[:2]), inside)


class Moving(NamedTuple):
    """Tiles that move in a picture."""

    rest: Floats  # corners at rest (m), shape (n, corners, 2)
    moved: Floats  # by how much they move (m), shape (n, corners, 2)
    size: Floats  # how far the tiles' middles move (m), shape (n,)
    edge: Floats  # how wide they are (m), shape (n,)
    value: Floats  # what they are coloured by, shape (n,)

    @property
    def largest(self) -> float:
        """How far the middle moves that moves most (m)."""
        return float(self.size.max(initial=0.0))

    def scaled(self, share: float) -> Moving:
        """Return the tiles after a share of their load."""
        moved, size, value = share * self.moved, share * self.size, share * self.value
        return self._replace(moved=moved, size=size, value=value)


def moving_cells(result: BodyResult, section: Section, moved_at: MovedAt | None = None) -> Moving:
    """Return the tiles of a body of equal cells; `moved_at`: instead of its own displacements.

    Cells that share a corner move it together: by the mean of what each of them would.
    """
    every, kind = section.ground
    tiles, grid = every[kind >= 0], result.grid
    rest = section.polygons(tiles)

    def moved_in_body(points: Floats) -> Floats:
        """Return displacements (m); 0 at points outside the body, as blocks of cells may have."""
        places = section.in_body(points)
        body = grid.kinds(grid.lattice.locate(places)) >= 0
        moved = np.zeros_like(places)
        moved[body] = (moved_at or result.displacement_near)(places[body])
        return moved

    joined = join(rest, section.tile_size)
    moved = joined.moved(lambda points: section.in_plane(moved_in_body(points)))[joined.parts]
    size = np.linalg.norm(moved_in_body(section.centres(tiles)), axis=1)
    return Moving(rest, moved, size, np.full(len(tiles), float(section.tile_size.min())), size)


def moving_agents(result: ElasticResult, layer: Section, value: Floats) -> Moving:
    """Return agents of many sizes; squares that stand for several move as one of these does."""
    squares = squares_of(layer, Tiles(result.lower, result.size, value))
    size = np.linalg.norm(result.displacement, axis=1)[squares.row]
    moved = np.repeat(layer.in_plane(result.displacement[squares.row])[:, None], 4, axis=1)
    own = np.flatnonzero(squares.size < 1.5 * result.size[squares.row])
    corners = squares.corners[own].reshape(-1, 2)
    first, number = same_points(corners, float(result.size.min()))
    at_corners = result.displacement_near(layer.in_body(corners[first]))
    moved[own] = layer.in_plane(at_corners)[number].reshape(-1, 4, 2)
    return Moving(squares.corners, moved, size, squares.size, squares.value)


def magnification_for(section: Section, tiles: Moving) -> float:
    """Return a round factor that makes a deformation visible, and folds no large tile."""
    shift = float(np.abs(tiles.moved).max(initial=0.0))
    large = tiles.edge >= min(section.span / 64.0, tiles.edge.max())  # smaller ones may fold
    strain = np.abs(np.diff(tiles.moved, axis=1)).max(axis=(1, 2)) / tiles.edge
    steepest = float(strain[large].max())
    return visible(section.span, shift, 0.45 / steepest if steepest > 0.0 else inf)


def check_magnification(magnification: float | None) -> None:
    """Refuse what magnifies nothing."""
    if magnification is not None and not (isfinite(magnification) and magnification > 0.0):
        raise ParameterError(f"magnification: a number above 0 is needed, got {magnification}")


def draw_deformed(
    section: Section,
    tiles: Moving,
    ax: Axes | None,
    stage: int | None,
    *,
    magnification: float | None = None,
    largest: float | None = None,
    share: float = 1.0,
    label: tuple[str, str] = ("displacement", "m"),
    extend: str = "neither",
) -> tuple[BodyPicture, str]:
    """Draw a deformed body over itself at rest, dashed; return also the magnification in words.

    `largest`: where the colours end.
    """
    check_magnification(magnification)
    factor = magnification or magnification_for(section, tiles)
    most = largest or float(tiles.value.max(initial=0.0))

    def moved(points: Floats) -> Floats:
        near = nearest(tiles.rest.mean(axis=1), points)[1]
        return np.asarray(points + factor * tiles.moved[near].mean(axis=1))

    picture = BodyPicture(section, ax, stage, filled=False, outlined=False, share=share, at=moved)
    rest: dict[str, Any] = {"colors": FAINT, "linewidths": 0.7, "linestyles": "--", "zorder": 2}
    surface, _ = section.outlines()
    picture.ax.add_collection(LineCollection(list(surface), gid="at rest", **rest))
    picture.entries.append(Line2D([], [], color=FAINT, lw=0.7, ls="--", label="outline at rest"))
    large = tiles.edge > section.span / OUTLINED
    look: dict[str, Any] = {"cmap": SIZE, "norm": Normalize(0.0, most or 1.0), "zorder": 3}
    look |= {"edgecolors": "#8a8a8a", "linewidths": np.where(large, 0.4, 0.0)}
    look |= {"array": tiles.value, "antialiaseds": large}
    drawn = add_polygons(picture.ax, tiles.rest + factor * tiles.moved, "moved", **look)
    if section.curves is not None:
        section.curves.clip(drawn, factor * share)
    if most > 0.0:
        colour_bar(picture.ax, drawn, *label, extend)
    return picture, f"deformation shown {times(factor)}"


COLOURS = {
    "von_mises": ("equivalent stress,\nlargest of each agent", "Pa"),
    "displacement": ("displacement", "m"),
}
"""What a deformed answer may be coloured by, with its unit; the usual one first."""
STILL = "nothing has moved: largest displacement 0 m"


def plot_deformed(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    colour: str = "von_mises",
    share: float = 1.0,
    magnification: float | None = None,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed agents, coloured by their stress, over the outline of the body at rest."""
    check_magnification(magnification)
    check_word("colour", colour, COLOURS)
    check_number("share", share, 1)
    result = settled(result)
    layer = layer_of(result, cut, crop)
    moves = colour == "displacement"
    values = np.linalg.norm(result.displacement, axis=1) if moves else result.largest_von_mises
    tiles = moving_agents(result, layer, values)
    top, beyond = usual_top(tiles.value, tiles.edge)
    picture, magnified = draw_deformed(
        layer,
        tiles.scaled(share),
        ax,
        result.stage,
        magnification=magnification or magnification_for(layer, tiles),
        largest=top,
        share=share,
        label=COLOURS[colour],
        extend="max" if beyond else "neither",
    )
    farthest = result.max_displacement
    moved = f"largest displacement {quantity(farthest, 'm')}; {magnified}"
    notes = [stress_text(result), moved] if farthest else [STILL]
    part = f"{share:.0%} of the load; " if share < 1.0 else ""
    return picture.finish("Deformed body", [part + notes[0], *notes[1:], *picture.notes])


def settled(result: Any) -> ElasticResult:
    """Return an elastic answer, or that to which agents of the elastic rule have settled."""
    answer: ElasticResult = getattr(result, "result", result)
    return answer


def stress_text(result: ElasticResult) -> str:
    """Return the goals, and the largest stress: along an outline, or at a corner of an agent."""
    asked = where = ""
    for goal in result.goals:
        far = goal.components[0] if len(goal.components) == 1 else hypot(*goal.components)
        told, what, where = quantity(far, goal.figures()["unit"]), "asked for", ""
        if isinstance(goal.quantity, Stress) and goal.place:
            name = "hoop stress" if goal.quantity.component == HOOP else "von Mises"
            what, where = f"{name} asked for, largest by amount", f" along {goal.quantity.at!r}"
            told += f" at ({', '.join(quantity(x, 'm') for x in goal.place)})"
        error = f"{'estimated ' * bool(goal.no_bound)}error {100.0 * goal.relative_error:.2g} %"
        asked += f"{what}: {told}, {error}{where}; "
    if where:  # a goal along an outline: it is the largest stress there
        return asked[:-2]
    found = result.largest_stress
    peaks = {name: abs(peak) for name, (peak, _) in result.largest_along().items()}
    name = max(peaks, key=peaks.__getitem__, default="")
    # along an outline the hoop stress is the better one
    if name and peaks[name] > 0.95 * found.value:
        return f"{asked}largest hoop stress {quantity(peaks[name], 'Pa')} along {name!r}"
    at = ", ".join(quantity(x, "m") for x in found.at)
    away = (
        f", {quantity(found.left_out, 'm')} and more from places without limit"
        if found.left_out
        else ""
    )
    return f"{asked}largest von Mises {quantity(found.value, 'Pa')} at ({at}){away}"


def plot_cells_deformed(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    stage: int | None = None,
    magnification: float | None = None,
    largest: float | None = None,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed cells over the outline of the body at rest, at the end of a stage."""
    if stage is not None:
        check_number("stage", stage, len(result.stages))
    shown = len(result.stages) if stage is None else stage
    section, tiles = _cells_at(result, shown, {"cut": cut, "crop": crop})
    farthest = result.at_stage(shown).max_displacement if shown else 0.0
    options: dict[str, Any] = {"magnification": magnification, "largest": largest}
    options["share"] = float(shown != 0)
    picture, magnified = draw_deformed(section, tiles, ax, stage or result.stage, **options)
    moved = f"{magnified}; largest displacement {quantity(farthest, 'm')}"
    notes = [moved if farthest else STILL, *picture.notes]
    if stage is not None:
        load = [0.0, *applied_loads(result).tolist()]
        notes = [f"applied: {quantity(load[stage], 'N')} of {quantity(load[-1], 'N')}", notes[0]]
    return picture.finish("Deformed body", notes)


def plot_body_in_time(
    course: BodyTimeResult,
    ax: Axes | None = None,
    *,
    record: int = -1,
    magnification: float | None = None,
    largest: float | None = None,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed body at one of the times asked for, the last unless given."""
    record = from_end(record, len(course.times))
    section, tiles = _cells_at(course, record, {"cut": cut, "crop": crop})
    options: dict[str, Any] = {"magnification": magnification, "largest": largest}
    options["share"] = float(course.factors[record] != 0.0)
    picture, magnified = draw_deformed(section, tiles, ax, course.static.stage, **options)
    farthest = f"largest displacement {quantity(course.max_displacement(record), 'm')}"
    notes = [f"{moment_text(course, record)}; {farthest}", magnified]
    return picture.finish("Deformed body", notes)


def _cells_at(result: Any, moment: int, options: Mapping[str, Any]) -> tuple[Section, Moving]:
    """Return what a picture shows of cells at the end of a stage, or at a time."""
    static = getattr(result, "static", result)
    caveats = () if static is not result else static.caveats_in_brief
    section = section_of(
        result.grid, static.focus, options.get("cut"), options.get("crop"), caveats=caveats
    )
    if static is not result:
        moved_at = partial(result.displacement_at, record=moment)
        return section, moving_cells(static, section, moved_at)
    state = result.at_stage(moment) if moment else result
    return section, moving_cells(state, section).scaled(float(moment != 0))


def _whole_run(result: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the magnification and the end of the colours, by all stages or the largest move."""
    if hasattr(result, "stages"):
        moments = list(range(1, len(result.stages) + 1))
    else:
        moments = [int(np.argmax(result.largest_displacement()))]
    states = [_cells_at(result, moment, options) for moment in moments]
    factors = [magnification_for(*state) for state in states if state[1].largest]
    largest = max(tiles.largest for _, tiles in states)
    return {"magnification": min(factors, default=1.0), "largest": largest}


STAGES = Film("deformed", "stage", lambda result: range(len(result.stages) + 1), _whole_run)
"""The stages of loading: the body deforms as the load grows."""
LOADING = Film("deformed", "share", lambda _: np.linspace(0.0, 1.0, 25).tolist(), fps=PER_SECOND)
"""An elastic body whose load grows evenly."""
TIMES = Film("deformed", "record", lambda of: range(len(of.times)), _whole_run, PER_SECOND)
"""A body that creeps, at all times asked for."""
