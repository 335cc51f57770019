"""The agents of a run: where they spawned, when, and of which kind they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats, Ints
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import draw_body, draw_forces, finish
from .section import Section, section_of
from .style import INK, PULL, SEQUENTIAL, add_polygons, colour_bar, new_axes
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


def threshold_of(result: TransferResult) -> float:
    """Return γ (N)."""
    rule = result.scene.rule
    assert isinstance(rule, PrescribedRule)
    return rule.threshold


def spawn_norm(generations: int) -> Normalize:
    """Return the scale of spawn steps 1 to `generations`: single colours while there are few."""
    last = max(generations, 1)
    if last <= 24:
        return BoundaryNorm(np.arange(0.5, last + 1.0), colormaps[SEQUENTIAL].N)
    return Normalize(1.0, float(last))


def draw_agents(
    ax: Axes, section: Section, stage: Stage, norm: Normalize, generation: int | None = None
) -> list[Artist]:
    """Draw the agents that have spawned up to a generation; return the artists."""
    until = stage.generations + 1 if generation is None else generation
    born = stage.spawn_step <= until
    tiles, step = section.gather(stage.cells[born], stage.spawn_step[born], "min")
    small = len(section.ground[0]) > 10_000
    look = {"edgecolors": "none" if small else "white", "linewidths": 0.0 if small else 0.4}
    artists: list[Artist] = [
        _coloured(ax, section.polygons(tiles), "material agents", step, norm, **look, zorder=2)
    ]
    for kind, symbol in SYMBOLS.items():
        chosen = (stage.boundary_kind == kind) & (stage.boundary_spawn_step <= until)
        if chosen.any():
            cells, steps = stage.boundary_cells[chosen], stage.boundary_spawn_step[chosen]
            tiles, step = section.gather(cells, steps, "min")
            shapes = section.centres(tiles)[:, None] + section.tile_size[0] * symbol.corners
            look = {"edgecolors": INK, "linewidths": 0.4}
            name = f"{symbol.name}s"
            artists.append(_coloured(ax, shapes, name, step, norm, **look, zorder=5))
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


def _coloured(
    ax: Axes, polygons: Floats, name: str, step: Ints, norm: Normalize, **look: Any
) -> Artist:
    values = step.astype(np.float64)
    return add_polygons(ax, polygons, name, array=values, cmap=SEQUENTIAL, norm=norm, **look)


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
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the body with its agents, coloured by the generation in which they spawned."""
    stage = result.last
    section = section_of(result.scene, result.focus, cut, crop, caveats=result.caveats_in_brief)
    ax = new_axes(ax)
    entries = draw_body(ax, section)
    notes = draw_forces(ax, section, result.stage)
    gamma = quantity(threshold_of(result), "N")
    if len(stage.cells):
        norm = spawn_norm(stage.generations)
        draw_agents(ax, section, stage, norm)
        entries += mark_pulled(ax, section, stage)
        spawn_bar(ax, norm, stage.generations)
        entries += boundary_entries(stage.boundary_kind[section.holds(stage.boundary_cells)])
        notes = [counts(stage), "; ".join([*notes, f"γ = {gamma}"])]
    else:
        notes = [stage.outcome, *notes]
    finish(ax, section, "Agents", notes, entries)
    return ax
