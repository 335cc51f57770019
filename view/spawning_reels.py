"""Agents of many sizes, generation by generation: how they spawned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.cm import ScalarMappable
from mpl_toolkits.mplot3d import Axes3D

from kaju.errors import ParameterError

from .body import finish
from .forces import draw_forces
from .layers import draw_squares, draw_surroundings, layer_of, squares_of
from .octree import MOST_ARROWS, SPACE, draw_cubes, view_of, view_told
from .quadtree import OF_EVERY_GENERATION, bar_of, look_of, standing, told
from .reels import TWO_LINES, Reel
from .section import Floats
from .space import draw_arrows, draw_frame
from .style import caption, figure_of, new_axes

if TYPE_CHECKING:
    from matplotlib.artist import Artist

    from kaju.model.elastic.elastic_result import ElasticResult

TITLE = "Agents spawn where load is left unbalanced"


def generations(
    result: ElasticResult,
    colour: str = "level",
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Reel:
    """Return the generations of spawning, coloured by what is known of each of them."""
    values = _all_values(result, colour)
    look = look_of(colour, values)
    if result.lower.shape[1] == 3 and cut is None:
        return _in_space(result, colour, crop, look, values)
    layer = layer_of(result, cut, crop)
    ax = new_axes(None)
    entries = draw_surroundings(ax, layer)
    draw_forces(ax, layer, result.stage)
    bar_of(ax, ScalarMappable(look["norm"], look["cmap"]), colour, values)
    notes = finish(ax, layer, TITLE, TWO_LINES, entries)

    def draw(number: int) -> list[Artist]:
        agents = standing(result, colour, number)
        shown = squares_of(layer, agents.tiles)
        return [draw_squares(ax, layer, shown, "agents", array=shown.value, **look)]

    words = _words(result, "; ".join(layer.notes))
    return Reel(figure_of(ax), len(result.generations) - 1, draw, notes, words)


def _in_space(
    result: ElasticResult, colour: str, crop: bool | None, look: dict[str, Any], values: Floats
) -> Reel:
    view = view_of(result, crop)
    ax = new_axes(None, SPACE, "3d")
    space = cast(Axes3D, ax)
    draw_frame(space, result.grid, view.box)
    draw_arrows(space, result.grid, view.box, result.stage, MOST_ARROWS)
    bar_of(space, ScalarMappable(look["norm"], look["cmap"]), colour, values)
    notes = caption(ax, TITLE, TWO_LINES)

    def draw(number: int) -> list[Artist]:
        return [draw_cubes(space, result.grid, view, standing(result, colour, number), look)]

    words = _words(result, "; ".join(view_told(view)))
    return Reel(figure_of(ax), len(result.generations) - 1, draw, notes, words)


def _words(result: ElasticResult, still: str) -> Callable[[int], str]:
    return lambda number: f"{told(result, number)}\n{still}"


def _all_values(result: ElasticResult, colour: str) -> Floats:
    """Return what the colours show of all generations together."""
    if colour not in OF_EVERY_GENERATION:
        raise ParameterError(
            f"colour: an animation shows {', '.join(OF_EVERY_GENERATION)}, got {colour!r}"
        )
    if colour == "unbalanced_load":
        return np.concatenate([generation.load for generation in result.generations])
    return np.asarray(standing(result, colour).value)
