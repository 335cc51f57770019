"""Agents of many sizes: a quadtree, or a layer of an octree, coloured by what they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.colors import BoundaryNorm, LogNorm, Normalize

from kaju.agents.materials import suggestion
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.result import Tiles

from .body import finish
from .forces import draw_forces
from .layers import agents_told, draw_squares, draw_surroundings, layer_of, squares_of
from .style import FORCE, SEQUENTIAL, SIZE, add_polygons, colour_bar, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

    from kaju.model.elastic.elastic_result import ElasticResult


class Colour(NamedTuple):
    """What agents can be coloured by: label, unit, and whether it counts something."""

    label: str
    unit: str
    whole: bool = False


COLOURS = {
    "level": Colour("level: how often the largest agent was halved", "", whole=True),
    "spawn_step": Colour("step in which the agent spawned", "", whole=True),
    "unbalanced_load": Colour("load that the agent leaves unbalanced", "N"),
    "error_share": Colour("share in the square of the error", ""),
    "von_mises": Colour("equivalent stress", "Pa"),
}
OF_EVERY_GENERATION = ("level", "spawn_step", "unbalanced_load")
"""What is known of agents that have retired."""
DECADES = 6


class Standing(NamedTuple):
    """The agents of a generation with what their colours show, and when they spawned."""

    tiles: Tiles
    spawn_step: Ints

    @property
    def value(self) -> Floats:
        """What their colours show."""
        return self.tiles.value


def plot_quadtree(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    colour: str = "level",
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
    generation: int | None = None,
    step: int | None = None,
) -> Axes:
    """Draw agents at their places and in their sizes."""
    agents = standing(result, colour, generation)
    layer = layer_of(result, cut, crop)
    ax = new_axes(ax)
    entries = draw_surroundings(ax, layer)
    notes = draw_forces(ax, layer, result.stage)
    shown = squares_of(layer, agents.tiles)
    look = look_of(colour, agents.value)
    drawn = draw_squares(ax, layer, shown, "agents", array=shown.value, **look)
    if step is not None:
        born = agents.spawn_step[shown.row] == step
        bold: dict[str, Any] = {"facecolors": "none", "edgecolors": FORCE, "linewidths": 0.8}
        add_polygons(ax, shown.corners[born], "spawned", **bold, zorder=3)
    bar_of(ax, drawn, colour, agents.value)
    finish(ax, layer, "Agents", [told(result, generation), *notes], entries)
    return ax


def told(result: ElasticResult, generation: int | None) -> str:
    """Return in words what stands in a generation."""
    last = len(result.generations) - 1
    number = last if generation is None else generation
    found = result.generations[number]
    return agents_told(found.agents, number, found.error)


def standing(result: ElasticResult, colour: str, generation: int | None = None) -> Standing:
    """Return the agents of a generation, with what their colours show."""
    if colour not in COLOURS:
        raise ParameterError(
            f"colour: there is no {colour!r}{suggestion(colour, COLOURS)}; there is "
            f"{', '.join(COLOURS)}"
        )
    last = len(result.generations) - 1
    if generation is None or generation == last:
        value = np.asarray(getattr(result, colour), dtype=np.float64)
        return Standing(result.tiles(value), result.spawn_step)
    if not 0 <= generation <= last:
        raise ParameterError(f"generation: must lie between 0 and {last}, got {generation}")
    if colour not in OF_EVERY_GENERATION:
        raise ParameterError(
            f"colour: {colour!r} is known of the last generation only; of earlier ones there is "
            f"{', '.join(OF_EVERY_GENERATION)}"
        )
    family = result.family
    rows = family.standing(generation)
    values = {
        "level": family.level[rows],
        "spawn_step": family.rows["spawn_step"][rows],
        "unbalanced_load": result.generations[generation].load,
    }
    value = np.asarray(values[colour], dtype=np.float64)
    tiles = Tiles(family.lower[rows], family.size[rows], value)
    return Standing(tiles, values["spawn_step"])


def look_of(colour: str, values: Floats) -> dict[str, Any]:
    """Return colour map and scale."""
    return {"cmap": SIZE if colour == "level" else SEQUENTIAL, "norm": _norm(colour, values)}


def bar_of(ax: Axes, drawn: ScalarMappable, colour: str, values: Floats) -> None:
    """Add the colour bar."""
    what = COLOURS[colour]
    bar = colour_bar(ax, drawn, what.label, what.unit)
    if what.whole:
        last = int(values.max())
        bar.set_ticks(list(range(0, last + 1, 1 + last // 12)))
        bar.ax.minorticks_off()


def _norm(colour: str, values: Floats) -> Normalize:
    if COLOURS[colour].whole:
        return BoundaryNorm(np.arange(-0.5, values.max() + 1.0), 256)
    high = float(values.max(initial=0.0)) or 1.0
    low = float(values[values > 0].min(initial=high))
    return LogNorm(max(low, high / 10**DECADES, np.finfo(float).tiny), high * (1 + 1e-12))
