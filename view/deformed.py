"""The deformed body, magnified until the eye can see it; the factor is stated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize

from kaju.agents.materials import suggestion
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.mesh import same_points
from kaju.model.results.result import BodyResult
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import BodyPicture
from .charts import applied_loads
from .films import IN_TIME, Film
from .layers import OUTLINED, Layer, layer_of, squares_of, usual_top
from .section import Section, section_of
from .style import BODY, FAINT, SIZE, add_polygons, colour_bar
from .units import quantity, round_down, times

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult


MovedAt = Callable[["Floats"], "Floats"]
"""Displacements (m) at points (m)."""

CORNERS = 180.0
"""Corners are the same if they are as near as such a part of a cell, which rounding never is."""
_WITHIN = 1e-6
"""Corners are asked for this share inside the cell, where they belong to no other."""
_LARGEST_SHIFT = 0.09  # of the picture's width
_UNMOVED = 1e-4  # of the largest displacement
_LARGEST_STRAIN = 0.45  # a cell must not be turned inside out
_FOLDED = 64  # agents smaller than this part of the picture may be drawn so


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
    """Join cells, corners of shape (n, corners, dimension), where they touch; see `CORNERS`."""
    flat = corners.reshape(-1, corners.shape[2])
    first, number = same_points(flat, apart / CORNERS)
    middles = np.repeat(corners.mean(axis=1), corners.shape[1], axis=0)
    inside = flat + _WITHIN * (middles - flat)
    return Joined(flat[first], number.reshape(corners.shape[:2]), inside)


def corner_displacements(
    result: BodyResult, section: Section, tiles: Ints, moved_at: MovedAt | None = None
) -> Floats:
    """Return how the corners of tiles move in the plane (m), shape (n, corners, 2).

    Cells that share a corner move it together: by the mean of what each of them would.
    `moved_at` takes the place of the result's own displacements.
    """
    joined = join(section.polygons(tiles), section.tile_size)

    def seen_at(points: Floats) -> Floats:
        return section.in_plane(_within(result, section.in_body(points), moved_at))

    return np.asarray(joined.moved(seen_at)[joined.parts])


def _within(result: BodyResult, points: Floats, moved_at: MovedAt | None) -> Floats:
    """Return displacements (m); 0 at points outside the body, as blocks of cells may have."""
    grid = result.grid
    body = grid.kinds(grid.lattice.locate(points)) >= 0
    moved = np.zeros_like(points)
    moved[body] = (moved_at or result.displacement_at)(points[body])
    return moved


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
    """Return the tiles of a body of equal cells; for `moved_at` see `corner_displacements`."""
    every, kind = section.ground
    tiles = every[kind >= 0]
    moved = corner_displacements(result, section, tiles, moved_at)
    middles = _within(result, section.in_body(section.centres(tiles)), moved_at)
    edge = np.full(len(tiles), float(section.tile_size.min()))
    size = np.linalg.norm(middles, axis=1)
    return Moving(section.polygons(tiles), moved, size, edge, size)


def moving_agents(result: ElasticResult, layer: Layer, value: Floats) -> Moving:
    """Return agents of many sizes; squares that stand for several move as one of these does."""
    squares = squares_of(layer, result.tiles(value))
    size = np.linalg.norm(result.displacement, axis=1)[squares.row]
    moved = np.repeat(layer.in_plane(result.displacement[squares.row])[:, None], 4, axis=1)
    own = np.flatnonzero(squares.size < 1.5 * result.size[squares.row])
    corners = squares.corners[own].reshape(-1, 2)
    first, number = same_points(corners, float(result.size.min()))
    at_corners = result.displacement_at(layer.in_body(corners[first]))
    moved[own] = layer.in_plane(at_corners)[number].reshape(-1, 4, 2)
    return Moving(squares.corners, moved, size, squares.size, squares.value)


def magnification_for(section: Section, tiles: Moving) -> float:
    """Return a round factor that makes a deformation visible, and folds no large tile."""
    shift = float(np.abs(tiles.moved).max(initial=0.0))
    if shift == 0.0:
        return 1.0
    wanted = largest_shift(section.span) / shift
    large = tiles.edge >= min(section.span / _FOLDED, tiles.edge.max())
    strain = np.abs(np.diff(tiles.moved, axis=1)).max(axis=(1, 2)) / tiles.edge
    steepest = float(strain[large].max())
    return round_down(min(wanted, _LARGEST_STRAIN / steepest) if steepest > 0.0 else wanted)


def largest_shift(span: float) -> float:
    """Return how far (m) the point that moves most is drawn from its place."""
    return _LARGEST_SHIFT * span


def check_magnification(magnification: float | None) -> None:
    """Refuse what magnifies nothing."""
    if magnification is not None and not (isfinite(magnification) and magnification > 0.0):
        raise ParameterError(f"magnification: a number above 0 is needed, got {magnification}")


class DeformedPicture(BodyPicture):
    """A body at rest, dashed, on which it is drawn deformed; all magnified alike.

    `largest`: where the colours end.
    """

    def __init__(
        self,
        section: Section,
        magnification: float,
        largest: float,
        ax: Axes | None = None,
        stage: int | None = None,
        share: float = 1.0,
    ) -> None:
        super().__init__(section, ax, stage, filled=False, outlined=False, share=share)
        self.magnification, self.norm = magnification, Normalize(0.0, largest or 1.0)
        surface, _ = section.outlines()
        rest = LineCollection(
            list(surface), colors=FAINT, linewidths=0.7, linestyles="--", zorder=2, gid="at rest"
        )
        self.ax.add_collection(rest)

    def draw(self, tiles: Moving) -> PolyCollection:
        """Draw tiles where they have moved to, coloured; those of next to nothing stay light."""
        large = tiles.edge > self.section.span / OUTLINED
        still = _UNMOVED * float(tiles.value.max(initial=0.0))
        return add_polygons(
            self.ax,
            tiles.rest + self.magnification * tiles.moved,
            "moved",
            array=np.ma.masked_less_equal(tiles.value, still),
            cmap=colormaps[SIZE].with_extremes(bad=BODY[0]),
            norm=self.norm,
            edgecolors="#8a8a8a",
            linewidths=np.where(large, 0.4, 0.0),
            antialiaseds=large,
            zorder=3,
        )

    @property
    def magnified(self) -> str:
        """The magnification in words."""
        return f"deformation shown {times(self.magnification)}"


def plot_tiles_deformed(
    section: Section,
    tiles: Moving,
    magnification: float | None,
    ax: Axes | None,
    stage: int | None,
    share: float = 1.0,
    largest: float | None = None,
    label: tuple[str, str] = ("displacement", "m"),
    extend: str = "neither",
) -> DeformedPicture:
    """Draw a deformed body over itself at rest, magnified until the eye can see it."""
    check_magnification(magnification)
    factor = magnification or magnification_for(section, tiles)
    most = largest or float(tiles.value.max(initial=0.0))
    picture = DeformedPicture(section, factor, most, ax, stage, share)
    drawn = picture.draw(tiles)
    if most > 0.0:
        colour_bar(picture.ax, drawn, *label, extend)
    return picture


COLOURS = {"von_mises": ("equivalent stress", "Pa"), "displacement": ("displacement", "m")}
"""What a deformed answer may be coloured by, with its unit; the usual one first."""


def plot_deformed(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    colour: str = "von_mises",
    share: float = 1.0,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed agents, coloured by their stress, over the outline of the body at rest."""
    check_magnification(magnification)
    if colour not in COLOURS:
        raise ParameterError(
            f"colour: there is no {colour!r}{suggestion(colour, COLOURS)}; there is "
            f"{', '.join(COLOURS)}"
        )
    if not 0.0 <= share <= 1.0:
        raise ParameterError(f"share: of the load, a number from 0 to 1 is needed, got {share}")
    layer = layer_of(result, cut, crop)
    size = np.linalg.norm(result.displacement, axis=1)
    tiles = moving_agents(result, layer, size if colour == "displacement" else result.von_mises)
    top, beyond = usual_top(tiles.value, tiles.edge)
    picture = plot_tiles_deformed(
        layer,
        tiles.scaled(share),
        magnification or magnification_for(layer, tiles),
        ax,
        result.stage,
        share,
        top,
        COLOURS[colour],
        "max" if beyond else "neither",
    )
    farthest = result.max_displacement
    if not farthest:
        notes = ["nothing has moved: largest displacement 0 m"]
    else:
        notes = [stress_text(result), f"largest displacement {quantity(farthest, 'm')}"]
        notes[1] += f"; {picture.magnified}"
    part = f"{share:.0%} of the load; " if share < 1.0 else ""
    return picture.finish("Deformed body", [part + notes[0], *notes[1:], *picture.notes])


def stress_text(result: ElasticResult) -> str:
    """Return the largest stress, where it is, and whether it has a limit."""
    found = result.largest_stress
    at = ", ".join(quantity(place, "m") for place in found.at)
    words = f"largest stress {quantity(found.value, 'Pa')} at ({at})"
    return f"{words}, without limit: {found.no_limit}" if found.no_limit else words


def plot_cells_deformed(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    stage: int | None = None,
    magnification: float | None = None,
    largest: float | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed cells over the outline of the body at rest, at the end of a stage."""
    section = section_of(result.grid, result.focus, cut, crop, caveats=result.caveats_in_brief)
    count = len(result.stages)
    if stage is not None and not 0 <= stage <= count:
        raise ParameterError(f"stage: this run has the stages 0 to {count}, got {stage}")
    state = result.at_stage(stage) if stage else result
    tiles, farthest = moving_cells(state, section), state.max_displacement
    if stage == 0:
        tiles, farthest = tiles.scaled(0.0), 0.0
    picture = plot_tiles_deformed(
        section, tiles, magnification, ax, stage or result.stage, float(stage != 0), largest
    )
    moved = f"{picture.magnified}; largest displacement {quantity(farthest, 'm')}"
    if not farthest:
        moved = "nothing has moved: largest displacement 0 m"
    notes = [moved, *picture.notes]
    if stage is not None:
        load = [0.0, *applied_loads(result).tolist()]
        notes = [f"applied: {quantity(load[stage], 'N')} of {quantity(load[-1], 'N')}", moved]
    return picture.finish("Deformed body", notes)


def _over_stages(result: TransferResult, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the magnification and the end of the colours, by all stages."""
    section = section_of(result.grid, result.focus, options.get("cut"), options.get("crop"))
    states = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    moves = [moving_cells(state, section) for state in states]
    factors = [magnification_for(section, move) for move in moves if move.largest]
    largest = max(move.largest for move in moves)
    return {"magnification": min(factors, default=1.0), "largest": largest}


STAGES = Film("deformed", "stage", lambda result: range(len(result.stages) + 1), _over_stages)
"""The stages of loading: the body deforms as the load grows."""
LOADING = Film("deformed", "share", lambda _: np.linspace(0.0, 1.0, 25).tolist(), fps=IN_TIME)
"""An elastic body whose load grows evenly."""
