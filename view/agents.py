"""The agents of a run of load transfer: where and when they spawned, and of which kind they are.

In a plane they are tiles; in space only material agents are solid, boundary agents are marks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import BodyPicture
from .films import Film
from .load_plots import (
    FILM_ARROWS_ACROSS,
    draw_loads,
    load_norm,
    loads_taken,
    sense_entries,
    threshold_of,
)
from .section import Section, one_a_place, section_of
from .space import DrawnBox, box_around, draw_voxels, space_for
from .style import (
    INK,
    PULL,
    SEQUENTIAL,
    add_polygons,
    caption,
    colour_bar,
    legend,
)
from .units import counted, quantity


class Symbol(NamedTuple):
    """How a kind of boundary agent looks: polygon in a cell of edge 1, and in a legend."""

    name: str
    corners: Floats
    marker: str


def _regular(corners: int, turn: float, radius: float) -> Floats:
    angle = np.deg2rad(turn + 360.0 * np.arange(corners) / corners)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


SYMBOLS = {
    AIR: Symbol("free boundary agent", _regular(20, 0.0, 0.36), "o"),
    RIGID: Symbol("rigid boundary agent", _regular(3, 90.0, 0.5), "^"),
    ROLLER: Symbol("roller boundary agent", _regular(4, 0.0, 0.45), "D"),
}


def spawn_norm(generations: int) -> Normalize:
    """Return the scale of spawn steps 1 to `generations`: single colours while there are few."""
    last = max(generations, 1)
    if last <= 24:
        return BoundaryNorm(np.arange(0.5, last + 1.0), colormaps[SEQUENTIAL].N)
    return Normalize(1.0, float(last))


def _boundaries(stage: Stage, until: int) -> Iterator[tuple[Symbol, Ints, Ints]]:
    """Yield symbol, cells and spawn steps of the boundary agents of each kind, if there are any."""
    for kind, symbol in SYMBOLS.items():
        chosen = (stage.boundary_kind == kind) & (stage.boundary_spawn_step <= until)
        if chosen.any():
            yield symbol, stage.boundary_cells[chosen], stage.boundary_spawn_step[chosen]


def draw_agents(
    ax: Axes, section: Section, stage: Stage, norm: Normalize, until: int
) -> list[Artist]:
    """Draw the agents that have spawned until a step; return the artists."""

    def draw(name: str, polygons: Floats, step: Ints, **look: Any) -> Artist:
        values = step.astype(np.float64)
        return add_polygons(ax, polygons, name, array=values, cmap=SEQUENTIAL, norm=norm, **look)

    born = stage.spawn_step <= until
    tiles, step = section.gather(stage.cells[born], stage.spawn_step[born], "min")
    small = len(section.ground[0]) > 10_000
    look = {"edgecolors": "none" if small else "white", "linewidths": 0.0 if small else 0.4}
    artists = [draw("material agents", section.polygons(tiles), step, **look, zorder=2)]
    for symbol, cells, steps in _boundaries(stage, until):
        tiles, step = section.gather(cells, steps, "min")
        shapes = section.centres(tiles)[:, None] + section.tile_size[0] * symbol.corners
        look = {"edgecolors": INK, "linewidths": 0.4}
        artists.append(draw(f"{symbol.name}s", shapes, step, **look, zorder=5))
    return artists


def mark_pulled(ax: Axes, section: Section, stage: Stage) -> list[Artist]:
    """Mark the agents that took more pulls than pushes; return what explains the mark."""
    more = (2.0 * stage.pulled - stage.taken).sum(axis=1)
    tiles, more = section.gather(stage.cells, more, "sum")
    if not (more > 0.0).any():
        return []
    place, size = section.centres(tiles[more > 0.0]), float(section.tile_size.min())
    corners = place[:, None] + 0.4 * size * SYMBOLS[AIR].corners
    add_polygons(ax, corners, "pulled agents", facecolors=PULL, edgecolors="white", zorder=5)
    look: dict[str, Any] = {"ls": "", "marker": "o", "mfc": PULL, "mec": "white", "ms": 5}
    return [Line2D([], [], label="took more pulls than pushes", **look)]


def boundary_entries(kinds: Ints) -> list[Artist]:
    """Return what explains the symbols of these kinds of boundary agents in a legend."""
    return [
        Line2D([], [], ls="", marker=s.marker, mfc="white", mec=INK, ms=6, label=s.name)
        for kind, s in SYMBOLS.items()
        if (kinds == kind).any()
    ]


def spawn_bar(
    ax: Axes,
    norm: Normalize,
    generations: int,
    label: str = "generation in which the agent spawned",
) -> None:
    """Add the colour bar of spawn steps, with whole numbers."""
    bar = colour_bar(ax, ScalarMappable(norm, SEQUENTIAL), label)
    if isinstance(norm, BoundaryNorm):
        every = 1 if generations <= 12 else 2
        bar.set_ticks(list(range(1, max(generations, 1) + 1, every)))
        bar.ax.minorticks_off()
    else:
        bar.locator = MaxNLocator(8, integer=True)
        bar.update_ticks()


def counts(stage: Stage) -> str:
    """Return how many agents there are, in words."""
    material = counted(len(stage.cells), "material agent")
    boundary = counted(len(stage.boundary_cells), "boundary agent")
    return f"{material}, {boundary} after {counted(stage.generations, 'generation')}"


def plot_agents(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    generation: int | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the body with its agents, coloured by the generation in which they spawned.

    With a generation also the loads that were taken in it.
    """
    stage, until = result.last, _until(result.last, generation)
    section = section_of(result.scene, result.focus, cut, crop, caveats=result.caveats_in_brief)
    picture = BodyPicture(section, ax, result.stage)
    if not len(stage.cells):
        return picture.finish("Agents", [stage.outcome, *picture.notes])
    norm = spawn_norm(stage.generations)
    draw_agents(picture.ax, section, stage, norm, until)
    happened = counts(stage)
    if generation is None:
        picture.entries += mark_pulled(picture.ax, section, stage)
    else:
        happened, loads = _generation_text(stage, generation), loads_taken(stage, generation)
        coarse = section_of(result.scene, result.focus, cut, crop, FILM_ARROWS_ACROSS)
        scale = load_norm(stage.history.load)
        draw_loads(picture.ax, coarse, stage, loads, scale, plain=True)
        picture.entries += sense_entries(loads, stage.taken.shape[1], plain=True)
    spawn_bar(picture.ax, norm, stage.generations)
    picture.entries += boundary_entries(stage.boundary_kind[section.holds(stage.boundary_cells)])
    gamma = f"γ = {quantity(threshold_of(result), 'N')}"
    return picture.finish("Agents", [happened, "; ".join([*picture.notes, gamma])])


def _until(stage: Stage, generation: int | None) -> int:
    """Return the last spawn step that is shown; boundary agents of the end spawn after it."""
    if generation is None:
        return stage.generations + 1
    if not 0 <= generation <= stage.generations:
        raise ParameterError(
            f"generation: this run has the generations 0 to {stage.generations}, got {generation}"
        )
    return generation


def _state_norm(values: NDArray[Any]) -> Normalize:
    """Return the scale of what agents know; of True and False two colours."""
    if values.dtype == np.bool_:
        return BoundaryNorm([-0.5, 0.5, 1.5], colormaps[SEQUENTIAL].N)
    low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
    return Normalize(low, high) if low < high else Normalize(low - 0.5, low + 0.5)


def _state_bar(ax: Axes, norm: Normalize, label: str) -> None:
    bar = colour_bar(ax, ScalarMappable(norm, SEQUENTIAL), label)
    if isinstance(norm, BoundaryNorm):
        bar.set_ticks([0.0, 1.0], labels=["no", "yes"])
        bar.ax.minorticks_off()


def draw_state(
    ax: Axes, section: Section, stage: Stage, values: NDArray[Any], norm: Normalize, until: int
) -> Artist:
    """Draw the agents that are awake, coloured by what they know."""
    born = stage.spawn_step <= until
    tiles, shown = section.gather(stage.cells[born], values[born].astype(np.float64), "max")
    look = {"edgecolors": "white", "linewidths": 0.4, "cmap": SEQUENTIAL, "norm": norm}
    return add_polygons(ax, section.polygons(tiles), "states", array=shown, zorder=2, **look)


def plot_state(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    state: str,
    generation: int | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the agents by what they know (`kaju.State`), after a generation or in the end."""
    stage, known = result.last, result.states[state]
    section = section_of(result.scene, result.focus, cut, crop, caveats=result.caveats_in_brief)
    picture = BodyPicture(section, ax, result.stage)
    norm = _state_norm(known.values())
    last = stage.generations if generation is None else generation
    draw_state(picture.ax, section, stage, known.values(last), norm, last + 1)
    _state_bar(picture.ax, norm, known.meaning)
    return picture.finish(state, [f"after generation {last} of {stage.generations}", ""])


def plot_material_agents(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    generation: int | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the agents that spawned, of bodies of cubes in space unless cut."""
    if result.scene.lattice.dimension == 2 or cut is not None:
        return plot_agents(result, ax, generation=generation, cut=cut, crop=crop)
    scene, stage, cells = result.scene, result.last, result.focus
    assert cells is not None
    box = box_around(scene, cells, crop)
    space, notes = space_for(ax, scene, box, result.stage)
    happened = stage.outcome
    if len(stage.cells):
        norm, until = spawn_norm(stage.generations), _until(stage, generation)
        _draw_in_space(space, scene.lattice.cell_size, stage, box, norm, until)
        spawn_bar(space, norm, stage.generations)
        legend(space, boundary_entries(stage.boundary_kind))
        happened = counts(stage) if generation is None else _generation_text(stage, generation)
    caption(space, "Agents", [happened, *notes, *box.notes])
    return cast("Axes", space)


def _draw_in_space(
    ax: Axes3D, cell_size: float, stage: Stage, box: DrawnBox, norm: Normalize, until: int
) -> None:
    """Draw the agents that have spawned until a step."""
    colour, edge = colormaps[SEQUENTIAL], cell_size * box.block
    born = stage.spawn_step <= until
    voxels, step = one_a_place(stage.cells[born] // box.block, stage.spawn_step[born], "min")
    if len(voxels):
        drawn = draw_voxels(ax, voxels, edge, np.atleast_2d(colour(norm(step))))
        drawn.set_gid("material agents")
    for symbol, cells, steps in _boundaries(stage, until):
        places, step = one_a_place(cells // box.block, steps, "min")
        marks = ax.scatter(
            *((places + 0.5) * edge).T,
            c=colour(norm(step)),
            s=26,
            marker=symbol.marker,
            edgecolors=INK,
            linewidths=0.6,
            depthshade=False,
            zorder=4,
        )
        marks.set_gid(f"{symbol.name}s")


def _generation_text(stage: Stage, generation: int) -> str:
    """Return what has happened in a generation."""
    agents = int((stage.spawn_step <= generation).sum())
    taken = float(stage.history.load[stage.history.generation == generation].sum())
    if generation == 0:
        return "before the first generation: the load has not been taken yet"
    return (
        f"generation {generation} of {stage.generations}: "
        f"{counted(agents, 'material agent')}, {quantity(taken, 'N')} taken"
    )


GENERATIONS = Film("agents", "generation", lambda result: range(result.last.generations + 1))
"""The generations of a run's last stage: agents spawn, loads are taken."""
