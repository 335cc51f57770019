"""Agents of many sizes, coloured by what they are: in a plane, or in space.

In space cubes are drawn where they can be seen, one quarter of the body cut away.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LogNorm, Normalize
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from kaju.agents.materials import suggestion
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.result import Tiles
from kaju.model.scene import Scene

from .body_plots import draw_forces, finish
from .layers import (
    FINEST,
    agents_told,
    draw_squares,
    draw_surroundings,
    layer_of,
    small_agents,
    squares_of,
    together,
)
from .space import DrawnBox, box_around, space_for
from .style import FORCE, SEQUENTIAL, SIZE, add_polygons, caption, colour_bar, new_axes
from .units import quantity

if TYPE_CHECKING:
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


class DrawnAgents(NamedTuple):
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


def standing(result: ElasticResult, colour: str, generation: int | None = None) -> DrawnAgents:
    """Return the agents of a generation, with what their colours show."""
    if colour not in COLOURS:
        raise ParameterError(
            f"colour: there is no {colour!r}{suggestion(colour, COLOURS)}; there is "
            f"{', '.join(COLOURS)}"
        )
    last = len(result.generations) - 1
    if generation is None or generation == last:
        value = np.asarray(getattr(result, colour), dtype=np.float64)
        return DrawnAgents(result.tiles(value), result.spawn_step)
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
    return DrawnAgents(tiles, values["spawn_step"])


def look_of(colour: str, values: Floats) -> dict[str, Any]:
    """Return colour map and scale."""
    return {"cmap": SIZE if colour == "level" else SEQUENTIAL, "norm": _norm(colour, values)}


def bar_of(ax: Axes, drawn: ScalarMappable, colour: str, values: Floats) -> None:
    """Add the colour bar."""
    what = COLOURS[colour]
    bar = colour_bar(ax, drawn, what.label, what.unit or None)
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


MOST_ARROWS = 5
"""Few, for they hide what lies below."""
_SEEN = ((0, 1), (1, 0), (2, 1))
"""Axis and end of the faces that look towards the reader."""
_LIGHT = {0: 0.88, 1: 0.8, 2: 0.95}
"""Of the body's surface by axis; cuts have full light."""


class View(NamedTuple):
    """What is shown of a body: a box (m), less the quarter in front of two upright planes."""

    box: DrawnBox
    lower: Floats
    upper: Floats
    planes: tuple[float, float]


def plot_octree(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    colour: str = "level",
    crop: bool | None = None,
    generation: int | None = None,
) -> Axes:
    """Draw agents as cubes in space, with a quarter of the body cut away at small ones."""
    agents = standing(result, colour, generation)
    view = view_of(result, crop)
    space, notes = space_for(ax, result.grid, view.box, result.stage, MOST_ARROWS)
    look = look_of(colour, agents.value)
    draw_cubes(space, result.grid, view, agents, look)
    bar_of(space, ScalarMappable(look["norm"], look["cmap"]), colour, agents.value)
    notes = [*notes, *view_told(view), "; ".join(result.caveats_in_brief)]
    caption(space, "Agents", [told(result, generation), *filter(None, notes)])
    return cast("Axes", space)


def view_of(result: ElasticResult, crop: bool | None = None) -> View:
    """Choose the box and the planes by the smallest agents."""
    scene, small = result.grid, small_agents(result)
    edge = scene.lattice.cell_size
    cells = scene.lattice.locate(small.middle)
    first, last = cells.min(axis=0), cells.max(axis=0)
    around = int((last - first).max()) // 2  # also downwards, where small agents lie flat
    cells = np.clip([first - around, last + around], *_ends(scene))
    box = box_around(scene, cells, small.hidden if crop is None else crop)
    unit = float(result.size.min())
    x, y = (_plane(small.lower[:, axis], unit) for axis in (0, 1))
    low, high = (np.asarray(end * edge, dtype=np.float64) for end in (box.lower, box.upper))
    return View(box, low, high, (x, y))


def _plane(place: Floats, unit: float) -> float:
    """Return where to cut: near the middle of some places, and along sides of large agents."""
    low, middle, high = np.quantile(place, (0.25, 0.5, 0.75))
    near = np.unique(place[(place >= low) & (place <= high)])
    steps = np.rint(near / unit).astype(np.int64)
    largest = steps & -steps  # a side of agents of up to this size, in the smallest ones
    roundest = near[largest == largest.max()]
    return float(roundest[np.abs(roundest - middle).argmin()])


def _ends(scene: Scene) -> tuple[Ints, Ints]:
    lower, upper = scene.bounds()
    return lower, upper - 1


def view_told(view: View) -> list[str]:
    """Return what a reader must be told."""
    x, y = (quantity(place, "m") for place in view.planes)
    crops = [note for note in view.box.notes if note.startswith("cropped")]
    return [f"cut away: x above {x}, y below {y}", *crops]


def draw_cubes(
    ax: Axes3D, scene: Scene, view: View, agents: DrawnAgents, look: dict[str, Any]
) -> Poly3DCollection:
    """Draw the faces of agents that can be seen, coloured by their values."""
    finest = 2.0 * float((view.upper - view.lower).max()) / FINEST
    (lower, size, value), _ = together(agents.tiles, finest)
    faces, owner, light = seen_faces(scene, view, lower, lower + size[:, None])
    colours = colormaps[look["cmap"]](look["norm"](value[owner]))
    colours[:, :3] *= light[:, None]
    small = size[owner] < 4.0 * finest
    drawn = Poly3DCollection(
        list(faces),
        facecolors=colours,
        edgecolors=np.where(small[:, None], colours, (0.2, 0.2, 0.2, 1.0)),
        linewidths=0.25,
        zorder=3,
    )
    drawn.set_gid("agents")
    ax.add_collection3d(drawn)
    return drawn


def seen_faces(
    scene: Scene, view: View, lower: Floats, upper: Floats
) -> tuple[Floats, Ints, Floats]:
    """Return the faces of agents that can be seen: on the body's surface, or by a cut.

    `scene`: the body; `view`: what is shown of it; `lower`, `upper`, shape (agents, 3): corners of
    the agents (m). Returns `corners`, shape (faces, 4, 3); `owner`, shape (faces,); `light`, shape
    (faces,).
    """
    corners, owner, light = [], [], []
    for first, last in _parts(view):
        low, high = np.maximum(lower, first), np.minimum(upper, last)
        there = np.flatnonzero(np.all(high - low > 1e-9 * (upper - lower), axis=1))
        low, high = low[there], high[there]
        for axis, end in _SEEN:
            free = _bare(scene, low, high, axis, end)
            cut = ~free & _by_cut(view, low, high, axis, (last if end else first)[axis], end)
            for chosen, bright in ((cut, 1.0), (free, _LIGHT[axis])):
                top = high[chosen]
                if axis == 0 and bright == 1.0 and last[0] < view.upper[0]:
                    top[:, 1] = np.minimum(top[:, 1], view.planes[1])
                corners.append(_rectangles(low[chosen], top, axis, end))
                owner.append(there[chosen])
                light.append(np.full(np.count_nonzero(chosen), bright))
    return np.concatenate(corners), np.concatenate(owner), np.concatenate(light)


def _parts(view: View) -> list[tuple[Floats, Floats]]:
    """Return the box without its quarter as two boxes (lower and upper corner, m)."""
    x, y = view.planes
    left, behind = view.upper.copy(), view.lower.copy()
    left[0] = x
    behind[0], behind[1] = x, y
    return [(view.lower, left), (behind, view.upper)]


def _by_cut(view: View, low: Floats, high: Floats, axis: int, limit: float, end: int) -> Flags:
    """Tell which faces lie where a part ends inside of the body, with nothing shown beyond."""
    outer = (view.upper if end else view.lower)[axis]
    face = (high if end else low)[:, axis]
    cut = np.abs(face - limit) < 1e-9 * np.abs(view.upper).max()
    if axis == 0 and limit < outer:
        cut &= low[:, 1] < view.planes[1]  # behind that plane the two parts meet
    return np.asarray(cut)


def _bare(scene: Scene, low: Floats, high: Floats, axis: int, end: int) -> Flags:
    """Tell which faces have no body beyond them."""
    middle = 0.5 * (low + high)
    shift = 1e-6 * scene.lattice.cell_size
    middle[:, axis] = high[:, axis] + shift if end else low[:, axis] - shift
    return np.asarray(scene.kinds(scene.lattice.locate(middle)) < 0)


def _rectangles(low: Floats, high: Floats, axis: int, end: int) -> Floats:
    """Return one face each of boxes, shape (n, 4, 3)."""
    first, second = (a for a in range(3) if a != axis)
    corners = np.repeat(low[:, None], 4, axis=1)
    corners[..., axis] = (high if end else low)[:, None, axis]
    corners[:, 1:3, first] = high[:, None, first]
    corners[:, 2:4, second] = high[:, None, second]
    return corners
