"""Loads as arrows: what each agent took by direction, and which agent loaded which."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm, to_hex
from matplotlib.lines import Line2D

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats, first_largest
from kaju.errors import ParameterError
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer_result import TransferResult, load_path

from .body_plots import BodyPicture
from .section import WHOLE_UP_TO, Section, section_of
from .style import (
    FORCE,
    INK,
    LOADS,
    PULL,
    PULLS,
    RIM,
    add_polygons,
    arrow_polygons,
    colour_bar,
)
from .units import counted, grouped, quantity

if TYPE_CHECKING:
    import networkx


ARROWS_ACROSS = 64
"""Where more tiles than this lie side by side, arrows stand for blocks of cells."""

FILM_ARROWS_ACROSS = 24
"""The same in films, where a frame is seen for half a second."""

CLOSE_UP = 12
"""Bodies of more cells across than this are cropped to the agents, so that arrows can be read."""


def threshold_of(result: TransferResult) -> float:
    """Return γ (N)."""
    rule = result.scene.rule
    assert isinstance(rule, PrescribedRule)
    return rule.threshold


def loads_taken(stage: Stage, generation: int | None) -> Floats:
    """Return loads taken (N) in a generation, or all: (agents, states), pulls after pushes."""
    count = stage.taken.shape[1]
    if generation is None:
        states = np.hstack([stage.taken - stage.pulled, stage.pulled])
    else:
        history = stage.history
        then = history.generation == generation
        state = history.direction + count * history.pull
        states = np.zeros((len(stage.taken), 2 * count))
        np.add.at(states, (history.agent[then], state[then]), history.load[then])
    return states if stage.pulled.any() else states[:, :count]


def sense_entries(loads: Floats, directions: int, plain: bool = False) -> list[Artist]:
    """Return what explains the arrows of pushes and pulls, if there are both, in a legend."""
    if loads.shape[1] == directions:
        names = {FORCE: "load taken"} if plain else {}
    else:
        names = {
            FORCE if plain else to_hex(LOADS(0.6)): "push: goes on along its arrow",
            PULL if plain else to_hex(PULLS(0.6)): "pull: goes on against its arrow",
        }
    look: dict[str, Any] = {"ls": "", "marker": "$\u279e$", "mew": 0.0, "ms": 9}
    return [Line2D([], [], color=colour, label=name, **look) for colour, name in names.items()]


def load_norm(loads: Floats) -> LogNorm:
    """Return a logarithmic scale over the loads above 0; loads fall off by factors."""
    positive = loads[loads > 0.0]
    if not len(positive):
        return LogNorm(0.1, 1.0)
    low, high = float(positive.min()), float(positive.max())
    return LogNorm(low, high) if high > 1.001 * low else LogNorm(0.5 * high, 2.0 * high)


def draw_loads(
    ax: Axes, section: Section, stage: Stage, loads: Floats, norm: LogNorm, plain: bool = False
) -> bool:
    """Draw loads, as `loads_taken` returns them, as arrows out of the cells' middles.

    They are coloured by load and sense; `plain` ones, as films need them, are larger and coloured
    by sense alone. Returns whether loads were left out because they point across the section.
    """
    tiles, loads = section.gather(stage.cells, loads, "sum")
    normals = section.in_plane(section.scene.lattice.normals)
    row, state = np.nonzero(loads)
    across = np.linalg.norm(normals, axis=1)[state % len(normals)] < 0.5
    row, state = row[~across], state[~across]
    load = loads[row, state]
    lightest_first = np.argsort(load)
    row, state, load = (column[lightest_first] for column in (row, state, load))
    along, pull = normals[state % len(normals)], state >= len(normals)
    share = np.sqrt(np.clip(load / norm.vmax, 0.0, 1.0)) if len(load) else load
    size = float(section.tile_size.min())
    # In a film arrows are the only thing that moves on: they reach into the next tile.
    least, most, width = (0.5, 1.0, 0.11) if plain else (0.42, 0.8, 0.095)
    tail = section.centres(tiles)[row]
    if loads.shape[1] > len(normals):  # pushes and pulls of one direction lie side by side
        aside = np.where(pull, 0.5, -0.5) * (width + 0.06)
        tail = tail + (size * aside)[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    head = tail + (size * (least + (most - least) * share))[:, None] * along
    outlines = arrow_polygons(tail, head, size * (width + 0.06 * share))
    if plain:
        colours, rim = np.where(pull, PULL, FORCE), {"edgecolors": "white", "linewidths": 0.6}
    else:
        shade = norm(load)
        colours, rim = np.where(pull[:, None], PULLS(shade), LOADS(shade)), RIM
    add_polygons(ax, outlines, "loads taken", facecolors=colours, zorder=6, **rim)
    return bool(across.any())


def plot_loads(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    generation: int | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the applied forces, and the loads that each agent took, by direction."""
    stage = result.last
    if generation is not None and not 1 <= generation <= stage.generations:
        raise ParameterError(
            f"generation: this run has the generations 1 to {stage.generations}, got {generation}"
        )
    whole = CLOSE_UP if len(stage.cells) else WHOLE_UP_TO
    section = section_of(
        result.scene, result.focus, cut, crop, ARROWS_ACROSS, whole, result.caveats_in_brief
    )
    picture = BodyPicture(section, ax, result.stage)
    loads = loads_taken(stage, generation)
    title = "Loads taken" if generation is None else f"Loads taken in generation {generation}"
    if not loads.any():
        return picture.finish(title, [stage.outcome, *picture.notes])
    norm = load_norm(section.gather(stage.cells, loads, "sum")[1])
    across = draw_loads(picture.ax, section, stage, loads, norm)
    pulls = sense_entries(loads, stage.taken.shape[1])
    picture.entries += pulls
    colour_bar(picture.ax, ScalarMappable(norm, LOADS), "load taken along the arrow", "N")
    total = f"{quantity(float(loads.sum()), 'N')} taken in all, arrow length grows like √load"
    notes = ["; ".join(picture.notes), total]
    notes += ["pulls in shades of red-violet, as dark as pushes of their size"] if pulls else []
    notes += ["loads across the section are not shown"] if across else []
    return picture.finish(title, notes)


MOST_AGENTS = 4000
"""Of more agents than this, only those around the one that took most are drawn."""
REACH = 30
"""How far around it (cells)."""

_MARKERS = {"material": "s", "free": "o", "rigid": "^", "roller": "D"}


def around_heaviest(stage: Stage, most: int = MOST_AGENTS) -> Stage:
    """Return a stage with only the agents around the one that took most, if there are many."""
    if len(stage.cells) <= most:
        return stage
    heaviest = stage.cells[first_largest(stage.taken.sum(axis=1))]
    kept = np.abs(stage.cells - heaviest).max(axis=1) <= REACH
    loads = ("taken", "pulled", "kept", "shortened", "widened", "passed", "dropped")
    names = ("cells", "material", "spawn_step", "woken_by", *loads)
    beside = np.abs(stage.boundary_cells - heaviest).max(axis=1) <= REACH + 1
    edge = ("boundary_cells", "boundary_kind", "boundary_spawn_step", "returned", "arrived")
    columns = {name: getattr(stage, name)[kept] for name in names}
    columns |= {name: getattr(stage, name)[beside] for name in edge}
    return replace(stage, **columns)


def edges_in(section: Section, graph: networkx.DiGraph) -> tuple[Floats, Floats, Floats]:
    """Return tails and heads (m), each (n, 2), and loads (N) of the edges within a section."""
    edges = [(a, b, weight) for a, b, weight in graph.edges(data="weight") if weight > 0.0]
    if not edges:
        return np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
    shown = np.ones(len(edges), dtype=np.bool_)
    ends = []
    for end in (0, 1):
        shown &= section.holds(np.array([edge[end] for edge in edges], dtype=np.int64))
        points = np.array([graph.nodes[edge[end]]["pos"] for edge in edges], dtype=np.float64)
        ends.append(section.in_plane(points))
    weight = np.array([edge[2] for edge in edges])
    return ends[0][shown], ends[1][shown], weight[shown]


def draw_edges(
    ax: Axes, section: Section, tail: Floats, head: Floats, load: Floats, norm: LogNorm
) -> PolyCollection:
    """Draw edges as arrows from cell to cell, each on the right of its own direction."""
    order = np.argsort(load)
    tail, head, load = tail[order], head[order], load[order]
    along = head - tail
    right = np.stack([along[:, 1], -along[:, 0]], axis=1)
    size = float(section.tile_size.min())
    share = np.clip(norm(load), 0.0, 1.0)
    outlines = arrow_polygons(
        tail + 0.17 * along + 0.1 * right,
        head - 0.17 * along + 0.1 * right,
        size * (0.012 + 0.085 * share),
    )
    return add_polygons(ax, outlines, "edges", array=load, cmap=LOADS, norm=norm, zorder=6, **RIM)


def draw_nodes(ax: Axes, section: Section, graph: networkx.DiGraph) -> list[Artist]:
    """Draw cells as small symbols; return what explains them."""
    entries: list[Artist] = []
    lower, upper = section.box
    across = float(((upper - lower) / section.tile_size).max())
    size = max(1.2, min(5.0, 75.0 / across))
    for kind, marker in _MARKERS.items():
        chosen = [node for node, of in graph.nodes(data="kind") if of == kind]
        if not chosen:
            continue
        shown = section.holds(np.array(chosen, dtype=np.int64))
        points = np.array([graph.nodes[node]["pos"] for node in chosen], dtype=np.float64)
        if shown.any():
            place = section.in_plane(points[shown])
            face = INK if kind == "material" else "white"
            style = {"ls": "", "marker": marker, "mfc": face, "mec": INK, "mew": 0.7}
            drawn = ax.plot(*place.T, ms=size, zorder=7, **style)[0]  # type: ignore[arg-type]
            drawn.set_gid(f"{kind} nodes")
            name = "material agent" if kind == "material" else f"{kind} boundary agent"
            entries.append(Line2D([], [], ms=5, label=name, **style))  # type: ignore[arg-type]
    return entries


def plot_load_path(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw how much each agent passed to which: the graph of `TransferResult.load_path`."""
    whole = result.last
    stage = around_heaviest(whole)
    graph = load_path(result.scene, stage)
    focus, close = (stage.cells, CLOSE_UP) if len(stage.cells) else (result.focus, WHOLE_UP_TO)
    section = section_of(result.scene, focus, cut, crop, 2**62, close, result.caveats_in_brief)
    picture = BodyPicture(section, ax, result.stage)
    tail, head, load = edges_in(section, graph)
    if not len(load):
        return picture.finish("Load path", [whole.outcome, *picture.notes])
    drawn = draw_edges(picture.ax, section, tail, head, load, load_norm(load))
    colour_bar(picture.ax, drawn, "load passed on", "N")
    picture.entries += draw_nodes(picture.ax, section, graph)
    drawn_edges = f"{counted(len(load), 'edge')}; each is drawn to the right of its own way"
    notes = [drawn_edges, *picture.notes]
    if stage is not whole:
        notes.append(
            f"only the {grouped(len(stage.cells))} agents around the one that took most, "
            f"of {grouped(len(whole.cells))}, are drawn"
        )
    return picture.finish("Load path", notes)
