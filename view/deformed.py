"""The deformed body, magnified until the eye can see it; the factor is stated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.mesh import same_points
from kaju.model.results.result import BodyResult
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import draw_body, draw_forces, finish
from .layers import OUTLINED, Layer, layer_of, squares_of
from .section import Section, section_of
from .style import BODY, FAINT, SIZE, add_polygons, colour_bar, new_axes
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

    points: Floats
    """The corners (m), each once. Shape (points, dimension)."""
    parts: Ints
    """The corners of every cell. Shape (n, corners)."""
    inside: Floats
    """Where cells are asked for the displacement of their corners. Shape (n corners, dimension)."""

    def moved(self, moved_at: MovedAt) -> Floats:
        """Return the displacement of the points: the mean of what their cells say."""
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

    rest: Floats
    moved: Floats
    """Corners at rest, and by how much they move (m). Shape (n, corners, 2)."""
    size: Floats
    """How far the tiles' middles move (m). Shape (n,)."""
    edge: Floats
    """How wide they are (m). Shape (n,)."""

    @property
    def largest(self) -> float:
        """How far the middle moves that moves most (m)."""
        return float(self.size.max(initial=0.0))

    def scaled(self, share: float) -> Moving:
        """Return the tiles at a share of their way."""
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


def moved_colours(size: Floats, norm: Normalize) -> dict[str, Any]:
    """Return the colours of what has moved by `size` (m); what has not stays light."""
    still = _UNMOVED * float(size.max(initial=0.0))
    return {
        "array": np.ma.masked_less_equal(size, still),
        "cmap": colormaps[SIZE].with_extremes(bad=BODY[0]),
        "norm": norm,
    }


def draw_deformed(
    ax: Axes, section: Section, tiles: Moving, magnification: float, norm: Normalize
) -> PolyCollection:
    """Draw tiles where they have moved to, coloured by how far; unmoved ones stay light."""
    large = tiles.edge > section.span / OUTLINED
    return add_polygons(
        ax,
        tiles.rest + magnification * tiles.moved,
        "moved",
        **moved_colours(tiles.size, norm),
        edgecolors="#8a8a8a",
        linewidths=np.where(large, 0.4, 0.0),
        antialiaseds=large,
        zorder=3,
    )


def draw_rest(ax: Axes, section: Section) -> None:
    """Draw the outline of the body at rest, dashed."""
    surface, _ = section.outlines()
    rest = LineCollection(list(surface), colors=FAINT, linewidths=0.7, linestyles="--", zorder=2)
    rest.set_gid("at rest")
    ax.add_collection(rest)


def draw_deformation(
    ax: Axes, section: Section, tiles: Moving, magnification: float | None
) -> tuple[list[Artist], str]:
    """Draw a deformed body over itself at rest; return what explains it, and the factor."""
    check_magnification(magnification)
    factor = magnification or magnification_for(section, tiles)
    entries = draw_body(ax, section, filled=False)
    draw_rest(ax, section)
    drawn = draw_deformed(ax, section, tiles, factor, Normalize(0.0, tiles.largest or 1.0))
    if tiles.largest > 0.0:
        colour_bar(ax, drawn, "displacement", "m")
    return entries, f"deformation shown {times(factor)}"


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
    ax = new_axes(ax)
    entries, told = draw_deformation(ax, section, tiles, magnification)
    notes = draw_forces(ax, section, result.stage)
    if tiles.largest > 0.0:
        notes = [f"{told}; largest displacement {quantity(tiles.largest, 'm')}", *notes]
    else:
        notes = ["nothing has moved: largest displacement 0 m", *notes]
    finish(ax, section, "Deformed body", notes, entries)
    return ax
