"""The deformed body, magnified until the eye can see it; the factor is stated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from kaju.errors import ParameterError
from kaju.model.elastic.export import same_points

from .body import draw_body, finish
from .forces import draw_forces
from .layers import Layer, Squares, draw_squares, layer_of, squares_of
from .section import CORNERS, Section, section_of
from .style import BODY, FAINT, SIZE, add_polygons, colour_bar, new_axes
from .units import quantity, round_down, times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection

    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.propagation.transfer_result import TransferResult
    from kaju.model.result import Field

    from .section import Floats, Ints

MovedAt = Callable[["Floats"], "Floats"]
"""Displacements (m) at points (m)."""

_LARGEST_SHIFT = 0.09  # of the picture's width
_UNMOVED = 1e-4  # of the largest displacement
_LARGEST_STRAIN = 0.45  # a cell must not be turned inside out
_FOLDED = 64  # agents smaller than this part of the picture may be drawn so


def corner_displacements(
    result: Field, section: Section, tiles: Ints, moved_at: MovedAt | None = None
) -> Floats:
    """Return how the corners of tiles move in the plane (m), shape (n, corners, 2).

    Cells that share a corner move it together: by the mean of what each of them would.
    `moved_at` takes the place of the result's own displacements.
    """
    corners = section.polygons(tiles)
    inwards = section.centres(tiles)[:, None] - corners
    inside = (corners + 1e-6 * inwards).reshape(-1, 2)
    moved = section.in_plane(_within(result, section.in_body(inside), moved_at))
    place = np.rint(CORNERS * corners.reshape(-1, 2) / section.tile_size).astype(np.int64)
    key = (place[:, 0] - place[:, 0].min()) * (np.ptp(place[:, 1]) + 1) + place[:, 1]
    _, number = np.unique(key, return_inverse=True)
    share = np.bincount(number)
    mean = np.stack([np.bincount(number, moved[:, i]) / share for i in (0, 1)], axis=1)
    together: Floats = mean[number].reshape(corners.shape)
    return together


def sizes_of(
    result: Field, section: Section, tiles: Ints, moved_at: MovedAt | None = None
) -> Floats:
    """Return how far the middles of tiles move (m), shape (n,)."""
    moved = _within(result, section.in_body(section.centres(tiles)), moved_at)
    size: Floats = np.linalg.norm(moved, axis=1)
    return size


def _within(result: Field, points: Floats, moved_at: MovedAt | None) -> Floats:
    """Return displacements (m); 0 at points outside the body, as blocks of cells may have."""
    grid = result.grid
    body = grid.kinds(grid.lattice.locate(points)) >= 0
    moved = np.zeros_like(points)
    moved[body] = (moved_at or result.displacement_at)(points[body])
    return moved


def magnification_for(section: Section, tiles: Ints, moved: Floats) -> float:
    """Return a round factor that makes a deformation visible without folding any tile."""
    shift = float(np.abs(moved).max(initial=0.0))
    if shift == 0.0:
        return 1.0
    lower, upper = section.box
    wanted = largest_shift(float((upper - lower).max())) / shift
    edges = np.abs(np.diff(moved, axis=1)).max() / float(section.tile_size.min())
    if edges > 0.0:
        wanted = min(wanted, _LARGEST_STRAIN / float(edges))
    return round_down(wanted)


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
    ax: Axes,
    section: Section,
    tiles: Ints,
    moved: Floats,
    size: Floats,
    magnification: float,
    norm: Normalize,
) -> PolyCollection:
    """Draw tiles where they have moved to, coloured by `size` (m); unmoved ones stay light."""
    corners = section.polygons(tiles) + magnification * moved
    small = len(tiles) > 10_000
    return add_polygons(
        ax,
        corners,
        "moved",
        **moved_colours(size, norm),
        edgecolors="none" if small else "#8a8a8a",
        linewidths=0.0 if small else 0.4,
        antialiased=not small,
        zorder=3,
    )


def plot_deformed(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed grid over the outline of the body at rest."""
    check_magnification(magnification)
    section = section_of(result.grid, result.focus, cut, crop)
    ax = new_axes(ax)
    every, kind = section.ground
    tiles = every[kind >= 0]
    moved = corner_displacements(result, section, tiles)
    factor = magnification or magnification_for(section, tiles, moved)
    size = sizes_of(result, section, tiles)
    largest = float(size.max(initial=0.0))
    entries = draw_body(ax, section, filled=False)
    draw_rest(ax, section)
    drawn = draw_deformed(ax, section, tiles, moved, size, factor, Normalize(0.0, largest or 1.0))
    notes = draw_forces(ax, section, result.stage)
    if largest > 0.0:
        colour_bar(ax, drawn, "displacement", "m")
        notes = [f"deformation shown {times(factor)}", *notes]
        notes[0] += f"; largest displacement {quantity(largest, 'm')}"
    else:
        notes = ["nothing has moved", *notes]
    finish(ax, section, "Deformed body", notes, entries)
    return ax


def draw_rest(ax: Axes, section: Section) -> None:
    """Draw the outline of the body at rest, dashed."""
    surface, _ = section.outlines()
    rest = LineCollection(list(surface), colors=FAINT, linewidths=0.7, linestyles="--", zorder=2)
    rest.set_gid("at rest")
    ax.add_collection(rest)


def plot_agents_deformed(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed agents over the outline of the body at rest."""
    check_magnification(magnification)
    layer = layer_of(result, cut, crop)
    ax = new_axes(ax)
    distance = np.linalg.norm(result.displacement, axis=1)
    squares = squares_of(layer, result.tiles(distance))
    moved = corner_moves(result, layer, squares)
    factor = magnification or _magnification(layer, squares, moved)
    largest = float(squares.value.max(initial=0.0))
    entries = draw_body(ax, layer, filled=False)
    draw_rest(ax, layer)
    places = squares.corners + factor * moved
    look = moved_colours(squares.value, Normalize(0.0, largest or 1.0))
    drawn = draw_squares(ax, layer, squares, "moved", places, **look)
    notes = draw_forces(ax, layer, result.stage)
    colour_bar(ax, drawn, "displacement", "m")
    told = f"deformation shown {times(factor)}; largest displacement {quantity(largest, 'm')}"
    finish(ax, layer, "Deformed body", [told, *notes], entries)
    return ax


def corner_moves(result: ElasticResult, layer: Layer, squares: Squares) -> Floats:
    """Return how the corners of squares move in the picture (m), shape (n, 4, 2).

    Squares that stand for several agents move as a whole, as one of them does.
    """
    moved = np.repeat(layer.in_plane(result.displacement[squares.row])[:, None], 4, axis=1)
    own = np.flatnonzero(squares.size < 1.5 * result.size[squares.row])
    corners = squares.corners[own].reshape(-1, 2)
    first, number = same_points(corners, float(result.size.min()))
    at_corners = result.displacement_at(layer.in_body(corners[first]))
    moved[own] = layer.in_plane(at_corners)[number].reshape(-1, 4, 2)
    return moved


def _magnification(layer: Layer, squares: Squares, moved: Floats) -> float:
    """Return a round factor that makes a deformation visible, and folds no large agent."""
    shift = float(np.abs(moved).max(initial=0.0))
    if shift == 0.0:
        return 1.0
    low, high = layer.box
    span = float((high - low).max())
    wanted = largest_shift(span) / shift
    large = squares.size > span / _FOLDED
    edges = np.abs(np.diff(moved, axis=1)).max(axis=(1, 2)) / squares.size
    strain = float(edges[large].max(initial=0.0))
    return round_down(min(wanted, _LARGEST_STRAIN / strain) if strain > 0.0 else wanted)
