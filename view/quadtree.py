"""Agents of many sizes, coloured by what they are: in a plane, or in space.

In space cubes are drawn where they can be seen, one quarter of the body cut away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize

from kaju.arrays import Flags, Floats
from kaju.errors import ParameterError, require

from .body_in_space import box_around, draw_boxes, space_for
from .body_plots import BodyPicture
from .films import Film
from .layers import FINEST, Tiles, draw_squares, layer_of, merge_small, small_agents, squares_of
from .section import Cut, check_number, check_word
from .style import SEQUENTIAL, SIZE, caption, colour_bar, count_bar, count_norm
from .units import counted, grouped, quantity

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult

COLOURS = {
    "level": ("level: how often the largest agent was halved", ""),
    "spawn_step": ("step in which the agent spawned", ""),
    "gap": ("gap between the agent's two opinions", "J"),
    "fitted": ("equivalent stress of the opinion that fits,\nmeans of agents", "Pa"),
    "balanced": ("equivalent stress of the opinion that balances,\nmeans of agents", "Pa"),
    "von_mises": ("equivalent stress,\nlargest of each agent", "Pa"),
}
"""What agents can be coloured by, in words, with its unit."""
COUNTED = ("level", "spawn_step")
"""Those of them that are whole numbers."""
OPINIONS = ("gap", "fitted", "balanced")


def plot_agents_of_many_sizes(
    result: ElasticResult,
    ax: Axes | None = None,
    *,
    colour: str = "level",
    cut: Cut = None,
    crop: bool | None = None,
    generation: int | None = None,
) -> Axes:
    """Draw agents at their places and in their sizes, of bodies of cubes in space unless cut."""
    tiles, title = agents_of(result, colour, generation), [_title(result, generation)]
    norm = _norm(colour, _scale_of(result, colour, generation))
    look: dict[str, Any] = {"cmap": SIZE if colour == "level" else SEQUENTIAL, "norm": norm}
    if result.scene.lattice.dimension == 3 and cut is None:
        space, notes = _plot_in_space(result, ax, tiles, look, crop)
        _bar(space, ScalarMappable(**look), colour)
        caption(space, "Agents", [*title, *notes, "; ".join(result.caveats_in_brief)])
        return space
    layer = layer_of(result, cut, crop)
    picture = BodyPicture(layer, ax, result.stage, filled=False)
    drawn = draw_squares(picture.ax, layer, squares_of(layer, tiles), "agents", **look)
    _bar(picture.ax, drawn, colour)
    return picture.finish("Agents", [*title, *picture.notes])


def _title(result: ElasticResult, generation: int | None) -> str:
    """Return how many agents there are after how many steps, and their error."""
    if not result.spawned:
        return f"{grouped(result.agents)} equal cells, error {result.error_estimate:.2g}"
    number = len(result.generations) - 1 if generation is None else generation
    found = result.generations[number]
    many, error = counted(found.agents, "agent"), errors_of(result)[number]
    return f"step {number} of spawning: {many}, error {error:.2g}"


def errors_of(result: ElasticResult) -> list[float]:
    """Return the relative error in the energy norm of every generation."""
    *before, _ = result.generations
    return [*(g.error for g in before), result.error_estimate]


def agents_of(result: ElasticResult, colour: str, generation: int | None = None) -> Tiles:
    """Return the agents of a generation with what their colours show."""
    check_word("colour", colour, COLOURS)
    last = len(result.generations) - 1
    if colour in OPINIONS and not result.spawned:
        raise ParameterError(
            f"colour: equal cells have no {colour!r}, because they have one stress only; solve "
            "with a tolerance"
        )
    if colour == "balanced" and result.scene.lattice.dimension == 3:
        raise ParameterError("colour: in space agents have one stress only: 'fitted'")
    if generation is None or generation == last:
        own = result.generations[-1] if colour in OPINIONS else result
        name = "largest_von_mises" if colour == "von_mises" else colour
        value = np.asarray(getattr(own, name), dtype=np.float64)
        return Tiles(result.lower, result.size, value)
    check_number("generation", generation, last)
    family = result.family
    rows = family.standing(generation)
    known = {"level": family.level[rows], "spawn_step": family.rows["spawn_step"][rows]}
    known |= {name: getattr(result.generations[generation], name) for name in OPINIONS}
    told = f"colour: {colour!r} is known of the last generation only; of earlier ones there is"
    require(colour in known, f"{told} {', '.join(known)}")
    value = np.asarray(known[colour], dtype=np.float64)
    return Tiles(family.lower[rows], family.size[rows], value)


def _scale_of(result: ElasticResult, colour: str, generation: int | None) -> Floats:
    """Return the values that a scale covers: of one generation among others those of all."""
    if generation is None or colour not in OPINIONS:
        return agents_of(result, colour).value
    # The two opinions are seen on one scale.
    two = colour != "gap" and result.scene.lattice.dimension == 2
    names = ("fitted", "balanced") if two else (colour,)
    return np.concatenate([getattr(one, n) for one in result.generations for n in names])


def _norm(colour: str, values: Floats) -> Normalize:
    if colour in COUNTED:
        return count_norm(0, int(values.max()))
    high = float(values.max(initial=0.0)) or 1.0
    low = float(values[values > 0].min(initial=high))
    return LogNorm(max(low, high / 1e6, np.finfo(float).tiny), high * (1 + 1e-12))


def _bar(ax: Axes, drawn: ScalarMappable, colour: str) -> None:
    if colour in COUNTED:
        count_bar(ax, drawn, COLOURS[colour][0])
    else:
        colour_bar(ax, drawn, *COLOURS[colour])


def _plot_in_space(
    result: ElasticResult, ax: Axes | None, tiles: Tiles, look: dict[str, Any], crop: bool | None
) -> tuple[Axes, list[str]]:
    """Draw agents around the smallest ones, less the quarter in front of two upright planes."""
    scene, (small, middle, hidden) = result.grid, small_agents(result)
    edge = scene.lattice.cell_size
    cells = scene.lattice.locate(middle)
    first, last = cells.min(axis=0), cells.max(axis=0)
    around = int((last - first).max()) // 2  # also downwards, where small agents lie flat
    lower, upper = scene.bounds()
    cells = np.clip([first - around, last + around], lower, upper - 1)
    box = box_around(scene, cells, hidden if crop is None else crop)
    # Few arrows, for they hide what lies below.
    space, notes = space_for(ax, scene, box, result.stage, 2)
    low, high = box.lower * edge, box.upper * edge
    x, y = (_plane(small[:, axis], float(result.size.min())) for axis in (0, 1))

    def hides(at: Floats) -> Flags:
        shown = np.all((at > low) & (at < high), axis=1) & ~((at[:, 0] > x) & (at[:, 1] < y))
        body: Flags = shown & (scene.kinds(scene.lattice.locate(at)) >= 0)
        return body

    (corner, size, value), _ = merge_small(tiles, 2.0 * float((high - low).max()) / FINEST)
    colours = colormaps[look["cmap"]](look["norm"](value))
    # Three boxes are what is left: before both planes to the left, behind it, and to its right.
    parts = (low, [x, y, high[2]]), ([low[0], y, low[2]], [x, *high[1:]]), ([x, y, low[2]], high)
    found = [(np.maximum(corner, a), np.minimum(corner + size[:, None], b)) for a, b in parts]
    first, last = (np.concatenate(ends) for ends in zip(*found, strict=True))
    there = np.all(last - first > 1e-9 * np.tile(size, 3)[:, None], axis=1)
    drawn = draw_boxes(space, first[there], last[there], np.tile(colours, (3, 1))[there], hides)
    drawn.set_gid("agents")
    notes.append(f"cut away: x above {quantity(x, 'm')}, y below {quantity(y, 'm')}")
    return cast(Axes, space), notes + [note for note in box.notes if note.startswith("cropped")]


def _plane(place: Floats, unit: float) -> float:
    """Return where to cut: near the middle of some places, and along sides of large agents."""
    low, middle, high = np.quantile(place, (0.25, 0.5, 0.75))
    near = np.unique(place[(place >= low) & (place <= high)])
    steps = np.rint(near / unit).astype(np.int64)
    largest = steps & -steps  # a side of agents of up to this size, in the smallest ones
    roundest = near[largest == largest.max()]
    return float(roundest[np.abs(roundest - middle).argmin()])


GENERATIONS = Film("agents", "generation", lambda result: range(len(result.generations)))
"""The generations of spawning."""
GAPS = GENERATIONS._replace(fixed=lambda _result, _options: {"colour": "gap"})
"""The same, coloured by what the agents' two opinions differ in."""
