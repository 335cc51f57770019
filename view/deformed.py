"""The deformed body, magnified until the eye can see it; the factor is stated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize

from kaju.arrays import Floats, Ints, first_largest
from kaju.errors import ParameterError
from kaju.model.results.mesh import same_points
from kaju.model.results.result import BodyResult
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import BodyPicture, draw_forces
from .charts import applied_loads
from .films import Film
from .layers import OUTLINED, Layer, layer_of, squares_of
from .section import Section, section_of
from .style import BODY, FAINT, SIZE, add_polygons, colour_bar
from .units import counted, quantity, round_down, times

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.rheology.creeping_elastic import ElasticCreepResult
    from kaju.model.rheology.creeping_elements import TransferCreepResult


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

    @property
    def largest(self) -> float:
        """How far the middle moves that moves most (m)."""
        return float(self.size.max(initial=0.0))

    def scaled(self, share: float) -> Moving:
        """Return the tiles after a share of their displacement."""
        return self._replace(moved=share * self.moved, size=share * self.size)


def moving_cells(result: BodyResult, section: Section, moved_at: MovedAt | None = None) -> Moving:
    """Return the tiles of a body of equal cells; for `moved_at` see `corner_displacements`."""
    every, kind = section.ground
    tiles = every[kind >= 0]
    moved = corner_displacements(result, section, tiles, moved_at)
    middles = _within(result, section.in_body(section.centres(tiles)), moved_at)
    edge = np.full(len(tiles), float(section.tile_size.min()))
    return Moving(section.polygons(tiles), moved, np.linalg.norm(middles, axis=1), edge)


def moving_agents(result: ElasticResult, layer: Layer) -> Moving:
    """Return agents of many sizes; squares that stand for several move as one of these does."""
    squares = squares_of(layer, result.tiles(np.linalg.norm(result.displacement, axis=1)))
    moved = np.repeat(layer.in_plane(result.displacement[squares.row])[:, None], 4, axis=1)
    own = np.flatnonzero(squares.size < 1.5 * result.size[squares.row])
    corners = squares.corners[own].reshape(-1, 2)
    first, number = same_points(corners, float(result.size.min()))
    at_corners = result.displacement_at(layer.in_body(corners[first]))
    moved[own] = layer.in_plane(at_corners)[number].reshape(-1, 4, 2)
    return Moving(squares.corners, moved, squares.value, squares.size)


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
    """A body at rest, dashed, on which it is drawn deformed; all magnified alike."""

    def __init__(
        self,
        section: Section,
        magnification: float,
        largest: float,
        ax: Axes | None = None,
        stage: int | None = None,
        loaded: bool = True,
    ) -> None:
        super().__init__(section, ax, stage, filled=False, outlined=False, loaded=loaded)
        self.magnification, self.norm = magnification, Normalize(0.0, largest or 1.0)
        surface, _ = section.outlines()
        rest = LineCollection(
            list(surface), colors=FAINT, linewidths=0.7, linestyles="--", zorder=2, gid="at rest"
        )
        self.ax.add_collection(rest)

    def draw(self, tiles: Moving) -> PolyCollection:
        """Draw tiles where they have moved to, coloured by how far; unmoved ones stay light."""
        large = tiles.edge > self.section.span / OUTLINED
        still = _UNMOVED * tiles.largest
        return add_polygons(
            self.ax,
            tiles.rest + self.magnification * tiles.moved,
            "moved",
            array=np.ma.masked_less_equal(tiles.size, still),
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
    loaded: bool = True,
) -> DeformedPicture:
    """Draw a deformed body over itself at rest, magnified until the eye can see it."""
    check_magnification(magnification)
    factor = magnification or magnification_for(section, tiles)
    picture = DeformedPicture(section, factor, tiles.largest, ax, stage, loaded)
    drawn = picture.draw(tiles)
    if tiles.largest > 0.0:
        colour_bar(picture.ax, drawn, "displacement", "m")
    return picture


def plot_deformed(
    result: ElasticResult | TransferResult,
    ax: Axes | None = None,
    *,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed cells, or agents, over the outline of the body at rest."""
    section: Section
    if result.kind == "elastic":
        section = layer = layer_of(cast("ElasticResult", result), cut, crop)
        tiles = moving_agents(cast("ElasticResult", result), layer)
    else:
        section = section_of(result.grid, result.focus, cut, crop, caveats=result.caveats_in_brief)
        tiles = moving_cells(result, section)
    picture = plot_tiles_deformed(section, tiles, magnification, ax, result.stage)
    if tiles.largest > 0.0:
        moved = f"{picture.magnified}; largest displacement {quantity(tiles.largest, 'm')}"
    else:
        moved = "nothing has moved: largest displacement 0 m"
    return picture.finish("Deformed body", [moved, *picture.notes])


def loading(
    result: TransferResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Film:
    """Return the stages of loading: the body deforms as the load grows."""
    section = section_of(result.scene, result.focus, cut, crop)
    states = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    load = [0.0, *applied_loads(result).tolist()]

    def text(number: int) -> str:
        agents = len(result.stages[number - 1].cells) if number else 0
        applied = f"{quantity(load[number], 'N')} of {quantity(load[-1], 'N')}"
        return f"applied: {applied}; {counted(agents, 'material agent')}"

    shares = [value / load[-1] if load[-1] else 1.0 for value in load]
    moves = [moving_cells(state, section) for state in states]
    return _deforming(result, section, [moves[0].scaled(0.0), *moves], shares, text, staged=True)


GROWING = 24
"""Frames in which an elastic body takes its load."""


def growing(
    result: BodyResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Film:
    """Return an elastic body whose load grows evenly, and its displacements with it."""
    section = section_of(result.grid, result.focus, cut, crop)
    full = moving_cells(result, section)
    shares = [number / GROWING for number in range(GROWING + 1)]
    moves = [full.scaled(share) for share in shares]
    return _deforming(result, section, moves, shares, lambda k: f"{shares[k]:.0%} of the load")


def creeping(
    result: TransferCreepResult | ElasticCreepResult,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Film:
    """Return a body in time, at the moments asked for."""
    section = section_of(result.static.grid, result.static.focus, cut, crop)
    moves = [
        moving_cells(result.static, section, partial(result.displacement_at, record=k))
        for k in range(len(result.times))
    ]
    shares = result.factors.tolist()

    def text(number: int) -> str:
        return f"{quantity(result.times[number], 's')}; {shares[number]:.0%} of the load"

    return _deforming(result.static, section, moves, shares, text)


def _deforming(
    result: BodyResult,
    section: Section,
    moves: list[Moving],
    shares: list[float],
    text: Callable[[int], str],
    *,
    staged: bool = False,
) -> Film:
    """Return a body that deforms: one move and one share of the load a frame.

    `staged` frames are the scene's own stages of loading.
    """
    factor = min((magnification_for(section, m) for m in moves if m.largest), default=1.0)
    largest = max(move.largest for move in moves)
    picture = DeformedPicture(section, factor, largest, None, result.stage)
    ax = picture.ax
    # The fullest frame and its forces only make room: every frame draws its own.
    fullest = moves[first_largest(np.array([np.abs(m.moved).max(initial=0.0) for m in moves]))]
    colour_bar(ax, picture.draw(fullest), "displacement", "m")
    passing = [drawn for drawn in ax.collections if drawn.get_gid() in ("moved", "forces")]

    def draw(number: int) -> list[Artist]:
        still = len(ax.collections)
        picture.draw(moves[number])
        if shares[number]:
            stage = number if staged else result.stage
            draw_forces(ax, section, stage, share=shares[number])
        return [*ax.collections[still:]]

    below = "; ".join([picture.magnified, *section.notes])
    film = picture.film(
        "The body deforms", len(moves) - 1, draw, lambda number: f"{text(number)}\n{below}"
    )
    for drawn in passing:
        drawn.set_visible(False)
    return film
