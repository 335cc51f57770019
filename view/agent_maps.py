"""Fields on agents of many sizes: maps, and the deformed body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import Normalize

from kaju.model.elasticity.export import same_points

from .body import draw_body, finish
from .deformed import check_magnification, draw_rest, largest_shift, moved_colours
from .forces import draw_forces
from .layers import Layer, Squares, draw_squares, draw_surroundings, layer_of, squares_of
from .maps import colours_of, quantity_of
from .section import Floats
from .style import colour_bar, new_axes
from .units import quantity, round_down, times

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaju.model.elasticity.elastic_result import ElasticResult

PEAK = 2e-3
"""Values on this share of the picture may lie beyond the scale: stresses grow at corners."""
_LARGEST_STRAIN = 0.45
_FOLDED = 64
"""Agents smaller than this part of the picture may be drawn folded."""


def plot_agent_map(
    result: ElasticResult,
    what: str,
    ax: Axes | None = None,
    *,
    component: str | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw a field as the colours of the agents.

    Parameters
    ----------
    result : ElasticResult
        Agents of many sizes.
    what, ax, component
        As for `plot_map`.
    cut, crop
        As for `plot_quadtree`.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ParameterError
        If there is no such component, or the cut lies outside of the body.
    """
    layer = layer_of(result, cut, crop)
    shown = quantity_of(result, what, component)
    ax = new_axes(ax)
    entries = draw_surroundings(ax, layer)
    notes = draw_forces(ax, layer, result.stage)
    squares = squares_of(layer, result.tiles(shown.values))
    top, beyond = _top(squares)
    look = colours_of(shown, squares.value, top)
    drawn = draw_squares(ax, layer, squares, "map", array=squares.value, **look)
    extend = ("both" if shown.signed else "max") if beyond else "neither"
    colour_bar(ax, drawn, shown.title[0].lower() + shown.title[1:], shown.unit, extend)
    extreme = shown.values[np.argmax(np.abs(shown.values))]
    notes = [f"largest value {quantity(float(extreme), shown.unit)}; " + "; ".join(notes)]
    finish(ax, layer, shown.title, notes, entries)
    return ax


def _top(squares: Squares) -> tuple[float, bool]:
    """Return the largest value of the scale, and whether there are values beyond it."""
    size = np.abs(squares.value)
    order = np.argsort(-size, kind="stable")
    area = np.cumsum(squares.size[order] ** 2)
    usual = float(size[order[np.searchsorted(area, PEAK * area[-1])]])
    largest = float(size.max())
    return (usual, True) if 0.0 < 1.5 * usual < largest else (largest, False)


def plot_agents_deformed(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the deformed agents over the outline of the body at rest.

    Parameters
    ----------
    result : ElasticResult
        Agents of many sizes.
    ax, magnification
        As for `plot_deformed`.
    cut, crop
        As for `plot_quadtree`.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ParameterError
        If the magnification is not a positive number, or the cut lies outside of the body.
    """
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
