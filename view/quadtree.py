"""Agents of many sizes, coloured by what they are: in a plane, or in space.

In space cubes are drawn where they can be seen, one quarter of the body cut away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LogNorm, Normalize
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.result import Tiles
from kaju.model.scene import Scene

from .body_in_space import FACES, DrawnBox, box_around, space_for
from .body_plots import BodyPicture
from .films import Film
from .layers import FINEST, draw_squares, layer_of, merge_small, small_agents, squares_of
from .section import Cut, check_number, check_word
from .style import SEQUENTIAL, SIZE, caption, colour_bar
from .units import grouped, quantity

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult

COLOURS = {
    "level": ("level: how often the largest agent was halved", ""),
    "spawn_step": ("step in which the agent spawned", ""),
    "gap": ("gap between the agent's two opinions", "J"),
    "fitted": ("equivalent stress of the opinion that fits", "Pa"),
    "balanced": ("equivalent stress of the opinion that balances", "Pa"),
    "von_mises": ("equivalent stress", "Pa"),
}
"""What agents can be coloured by, in words, with its unit."""
COUNTED = ("level", "spawn_step")
"""Those of them that are whole numbers."""
OPINIONS = ("gap", "fitted", "balanced")
DECADES = 6
"""Of the scale of colours that are no whole numbers."""


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
    tiles, scale = agents_of(result, colour, generation), _scale_of(result, colour, generation)
    norm, title = _norm(colour, scale), [_title(result, generation)]
    look: dict[str, Any] = {"cmap": SIZE if colour == "level" else SEQUENTIAL, "norm": norm}
    if result.scene.lattice.dimension == 3 and cut is None:
        view = view_of(result, crop)
        space, notes = space_for(ax, result.grid, view.box, result.stage, MOST_ARROWS)
        _draw_cubes(space, result.grid, view, tiles, look)
        _bar(cast(Axes, space), ScalarMappable(**look), colour, scale)
        title += [*notes, *view.notes, "; ".join(result.caveats_in_brief)]
        caption(space, "Agents", title)
        return cast("Axes", space)
    layer = layer_of(result, cut, crop)
    picture = BodyPicture(layer, ax, result.stage, filled=False)
    drawn = draw_squares(picture.ax, layer, squares_of(layer, tiles), "agents", **look)
    _bar(picture.ax, drawn, colour, scale)
    return picture.finish("Agents", [*title, *picture.notes])


def _title(result: ElasticResult, generation: int | None) -> str:
    """Return how many agents there are after how many steps, and their error."""
    if not result.spawned:
        return f"{grouped(result.agents)} equal cells, error {result.error_estimate:.2g}"
    number = len(result.generations) - 1 if generation is None else generation
    found = result.generations[number]
    many = "agent" if found.agents == 1 else "agents"
    error = errors_of(result)[number]
    return f"step {number} of spawning: {grouped(found.agents)} {many}, error {error:.2g}"


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
        return result.tiles(np.asarray(getattr(own, colour), dtype=np.float64))
    check_number("generation", generation, last)
    family = result.family
    rows = family.standing(generation)
    known = {"level": family.level[rows], "spawn_step": family.rows["spawn_step"][rows]}
    known |= {name: getattr(result.generations[generation], name) for name in OPINIONS}
    if colour not in known:
        raise ParameterError(
            f"colour: {colour!r} is known of the last generation only; of earlier ones there is "
            f"{', '.join(known)}"
        )
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
        return BoundaryNorm(np.arange(-0.5, values.max() + 1.0), 256)
    high = float(values.max(initial=0.0)) or 1.0
    low = float(values[values > 0].min(initial=high))
    return LogNorm(max(low, high / 10**DECADES, np.finfo(float).tiny), high * (1 + 1e-12))


def _bar(ax: Axes, drawn: ScalarMappable, colour: str, values: Floats) -> None:
    label, unit = COLOURS[colour]
    bar = colour_bar(ax, drawn, label, unit or None)
    if colour in COUNTED:
        last = int(values.max())
        bar.set_ticks(list(range(0, last + 1, 1 + last // 12)))
        bar.ax.minorticks_off()


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

    @property
    def notes(self) -> list[str]:
        """Where the body is cut, and the crop."""
        x, y = (quantity(place, "m") for place in self.planes)
        crops = [note for note in self.box.notes if note.startswith("cropped")]
        return [f"cut away: x above {x}, y below {y}", *crops]


def view_of(result: ElasticResult, crop: bool | None = None) -> View:
    """Choose the box and the planes by the smallest agents."""
    scene, small = result.grid, small_agents(result)
    edge = scene.lattice.cell_size
    cells = scene.lattice.locate(small.middle)
    first, last = cells.min(axis=0), cells.max(axis=0)
    around = int((last - first).max()) // 2  # also downwards, where small agents lie flat
    lower, upper = scene.bounds()
    cells = np.clip([first - around, last + around], lower, upper - 1)
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


def _draw_cubes(ax: Axes3D, scene: Scene, view: View, tiles: Tiles, look: dict[str, Any]) -> None:
    """Draw the faces of agents that can be seen, coloured by their values."""
    finest = 2.0 * float((view.upper - view.lower).max()) / FINEST
    (lower, size, value), _ = merge_small(tiles, finest)
    faces, owner, light = seen_faces(scene, view, lower, lower + size[:, None])
    colours = colormaps[look["cmap"]](look["norm"](value[owner]))
    colours[:, :3] *= light[:, None]
    small = size[owner] < 4.0 * finest
    rims = np.where(small[:, None], colours, (0.2, 0.2, 0.2, 1.0))
    drawn = Poly3DCollection(
        list(faces), facecolors=colours, edgecolors=rims, linewidths=0.25, zorder=3, gid="agents"
    )
    ax.add_collection3d(drawn)


def seen_faces(
    scene: Scene, view: View, lower: Floats, upper: Floats
) -> tuple[Floats, Ints, Floats]:
    """Return corners, owner and light of the agents' faces on the body's surface and at a cut.

    `lower`, `upper`, shape (agents, 3): corners of the agents (m). The corners of the faces have
    shape (faces, 4, 3).
    """
    corners, owner, light = [], [], []
    x, y = view.planes
    left = view.lower, np.array([x, *view.upper[1:]])
    behind = np.array([x, y, view.lower[2]]), view.upper
    rounding = 1e-9 * np.abs(view.upper).max()
    for first, last in (left, behind):  # the box without its quarter
        low, high = np.maximum(lower, first), np.minimum(upper, last)
        there = np.flatnonzero(np.all(high - low > 1e-9 * (upper - lower), axis=1))
        low, high = low[there], high[there]
        for axis, end in _SEEN:
            place = (high if end else low)[:, axis]
            beyond = 0.5 * (low + high)
            beyond[:, axis] = place + (1e-6 if end else -1e-6) * scene.lattice.cell_size
            bare = scene.kinds(scene.lattice.locate(beyond)) < 0
            cut = ~bare & (np.abs(place - (last if end else first)[axis]) < rounding)
            top = high.copy()
            if axis == 0 and last[0] < view.upper[0]:
                # This plane is bare in front of the other one only: behind it the two parts meet.
                cut &= low[:, 1] < y
                top[cut, 1] = np.minimum(top[cut, 1], y)
            for chosen, bright in ((cut, 1.0), (bare, _LIGHT[axis])):
                span = (top - low)[chosen, None]
                corners.append(low[chosen, None] + FACES[2 * axis + end] * span)
                owner.append(there[chosen])
                light.append(np.full(np.count_nonzero(chosen), bright))
    return np.concatenate(corners), np.concatenate(owner), np.concatenate(light)


GENERATIONS = Film("agents", "generation", lambda result: range(len(result.generations)))
"""The generations of spawning."""
GAPS = GENERATIONS._replace(fixed=lambda _result, _options: {"colour": "gap"})
"""The same, coloured by what the agents' two opinions differ in."""
