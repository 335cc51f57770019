"""The agents of a run of load transfer: where and when they spawned, and what they know.

In a plane they are tiles; in space only material agents are solid, boundary agents are marks.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.lines import Line2D

from kaju.arrays import Floats, Ints
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer import BOUNDARY_NAMES
from kaju.model.transfer.transfer_result import TransferResult

from . import load_plots, style
from .body_in_space import box_around, draw_voxels, space_for
from .body_plots import BodyPicture, draw_cells
from .films import Film
from .section import Cut, Section, check_number, one_a_place, section_of
from .style import INK, PULL, SEQUENTIAL, add_polygons, caption, colour_bar, legend
from .units import counted, quantity

WOKE = "generation in which the cell woke"


class Symbol(NamedTuple):
    """How a kind of boundary agent looks, polygon in a cell of edge 1, and what a legend says."""

    name: str
    does: str
    corners: Floats
    marker: str


def _regular(corners: int, turn: float, radius: float) -> Floats:
    angle = np.deg2rad(turn + 360.0 * np.arange(corners) / corners)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


SYMBOLS = {
    AIR: Symbol("free boundary agent", "air, gives loads back", _regular(20, 0.0, 0.36), "o"),
    RIGID: Symbol("rigid boundary agent", "ground, gives loads back", _regular(3, 90.0, 0.5), "^"),
    ROLLER: Symbol("roller boundary agent", "gives loads back", _regular(4, 0.0, 0.45), "D"),
}


def _boundaries(stage: Stage, until: int) -> Iterator[tuple[Symbol, Ints, Ints]]:
    """Yield symbol, cells and spawn steps of the boundary agents of each kind, if there are any."""
    for kind, symbol in SYMBOLS.items():
        chosen = (stage.boundary_kind == kind) & (stage.boundary_spawn_step <= until)
        if chosen.any():
            yield symbol, stage.boundary_cells[chosen], stage.boundary_spawn_step[chosen]


def _mark_pulled(ax: Axes, section: Section, stage: Stage) -> list[Artist]:
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


def _entries(result: TransferResult, kinds: Ints) -> list[Artist]:
    """Return what explains the symbols of these kinds of boundary agents in a legend."""
    look: dict[str, Any] = {"ls": "", "marker": "o", "mfc": "white", "mec": INK, "ms": 6}
    entries: list[Artist] = []
    for kind, symbol in SYMBOLS.items():
        own = result.own_boundaries.get(BOUNDARY_NAMES[kind])
        label = f"{own}: {symbol.name} of your own" if own else f"{symbol.name}: {symbol.does}"
        if (kinds == kind).any():
            entries.append(Line2D([], [], **look | {"marker": symbol.marker}, label=label))
    return entries


def _until(stage: Stage, generation: int | None) -> int:
    """Return the last spawn step that is shown; boundary agents of the end spawn after it."""
    if generation is None:
        return stage.generations + 1
    check_number("generation", generation, stage.generations)
    return generation


def _happened(stage: Stage, generation: int | None) -> str:
    """Return what has happened up to a generation, or in all."""
    if generation is None:
        material = counted(len(stage.cells), "material agent")
        boundary = counted(len(stage.boundary_cells), "boundary agent")
        return f"{material}, {boundary} after {counted(stage.generations, 'generation')}"
    if generation == 0:
        return "before the first generation: the load has not been taken yet"
    agents = int((stage.spawn_step <= generation).sum())
    return f"generation {generation} of {stage.generations}: {counted(agents, 'cell')} awake"


def plot_agents(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    generation: int | None = None,
    cut: Cut = None,
    crop: bool | None = None,
    state: str | None = None,
) -> Axes:
    """Draw the body with its agents, coloured by the generation in which they spawned.

    With a generation also the loads that were taken in it. Bodies in space unless cut as blocks.
    With the name of a state of agents of one's own, coloured by that.
    """
    if result.scene.lattice.dimension == 3 and cut is None and state is None:
        return _plot_in_space(result, ax, generation, crop)
    stage, until = result.last, _until(result.last, generation)
    section = section_of(result.scene, result.focus, cut, crop, caveats=result.caveats_in_brief)
    picture = BodyPicture(section, ax, result.stage)
    if state is not None:
        return _finish_states(result, picture, state, generation)
    if not len(stage.cells):
        return picture.finish("Agents", [stage.outcome, *picture.notes])
    norm, born = style.count_norm(1, stage.generations), stage.spawn_step <= until
    agents = stage.cells[born], stage.spawn_step[born]
    look: dict[str, Any] = {"cmap": SEQUENTIAL, "norm": norm}
    draw_cells(picture.ax, section, *agents, "min", "material agents", **look)
    look |= {"edgecolors": INK, "linewidths": 0.4, "zorder": 5}
    for symbol, cells, steps in _boundaries(stage, until):
        tiles, step = section.gather(cells, steps.astype(np.float64), "min")
        shapes = section.centres(tiles)[:, None] + section.tile_size[0] * symbol.corners
        add_polygons(picture.ax, shapes, f"{symbol.name}s", array=step, **look)
    if generation is None:
        picture.entries += _mark_pulled(picture.ax, section, stage)
    else:
        loads = load_plots.loads_taken(stage, generation)
        # In a film arrows are seen for half a second: few of them.
        coarse = section_of(result.scene, result.focus, cut, crop, 24)
        scale = load_plots.load_norm(stage.history.load)
        load_plots.draw_loads(picture.ax, coarse, stage, loads, scale, plain=True)
        picture.entries += load_plots.sense_entries(loads, stage.taken.shape[1], plain=True)
    style.count_bar(picture.ax, ScalarMappable(norm, SEQUENTIAL), WOKE)
    picture.entries += _entries(result, stage.boundary_kind[section.holds(stage.boundary_cells)])
    gamma = f"γ = {quantity(load_plots.threshold_of(result), 'N')}"
    notes = [_happened(stage, generation), "; ".join([*picture.notes, gamma])]
    return picture.finish("Agents" if generation is None else "Cells wake and pass loads on", notes)


def _finish_states(
    result: TransferResult, picture: BodyPicture, state: str, generation: int | None
) -> Axes:
    """Draw the agents by what they know (`kaju.State`), after a generation or in the end."""
    stage, known = result.last, result.states[state]
    last = stage.generations if generation is None else generation
    every = np.append(known.value, known.default)  # in all generations: one scale
    yes_or_no, counts = (type(known.default) is kind for kind in (bool, int))
    low, high = (0.0, 1.0) if yes_or_no else (float(every.min()), float(every.max()))
    norm = Normalize(low, high) if low < high else Normalize(low - 0.5, low + 0.5)
    if yes_or_no:
        norm = BoundaryNorm([-0.5, 0.5, 1.5], colormaps[SEQUENTIAL].N)
    if counts:
        norm = style.count_norm(int(low), int(high))
    born = stage.spawn_step <= last
    agents = stage.cells[born], known.values(last)[born]
    look: dict[str, Any] = {"cmap": SEQUENTIAL, "norm": norm}
    draw_cells(picture.ax, picture.section, *agents, "max", "states", **look)
    shown = picture.ax, ScalarMappable(norm, SEQUENTIAL), known.meaning
    if counts:
        style.count_bar(*shown)
    else:
        bar = colour_bar(*shown)
        if yes_or_no:
            bar.set_ticks([0.0, 1.0], labels=["no", "yes"])
            bar.ax.minorticks_off()
    return picture.finish(state, [f"after generation {last} of {stage.generations}", ""])


def _plot_in_space(
    result: TransferResult, ax: Axes | None, generation: int | None, crop: bool | None
) -> Axes:
    """Draw material agents as cubes, and boundary agents as marks."""
    scene, stage, cells = result.scene, result.last, result.focus
    assert cells is not None
    box = box_around(scene, cells, crop)
    space, notes = space_for(ax, scene, box, result.stage)
    if not len(stage.cells):
        caption(space, "Agents", [stage.outcome, *notes, *box.notes])
        return cast("Axes", space)
    norm, until = style.count_norm(1, stage.generations), _until(stage, generation)
    colour, edge = colormaps[SEQUENTIAL], scene.lattice.cell_size * box.block
    born = stage.spawn_step <= until
    voxels, step = one_a_place(stage.cells[born] // box.block, stage.spawn_step[born], "min")
    if len(voxels):
        draw_voxels(space, voxels, edge, colour(norm(step))).set_gid("material agents")
    for symbol, walls, steps in _boundaries(stage, until):
        places, step = one_a_place(walls // box.block, steps, "min")
        look: dict[str, Any] = {"marker": symbol.marker, "edgecolors": INK, "linewidths": 0.6}
        look |= {"s": 26, "depthshade": False, "zorder": 4, "gid": f"{symbol.name}s"}
        space.scatter(*((places + 0.5) * edge).T, c=colour(norm(step)), **look)
    style.count_bar(space, ScalarMappable(norm, SEQUENTIAL), WOKE)
    legend(space, _entries(result, stage.boundary_kind))
    caption(space, "Agents", [_happened(stage, generation), *notes, *box.notes])
    return cast("Axes", space)


GENERATIONS = Film("agents", "generation", lambda result: range(result.last.generations + 1))
"""The generations of a run's last stage: agents spawn, loads are taken."""
