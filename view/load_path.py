"""The load path: who loaded whom, as a graph drawn where its cells are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D

from kaju.arrays import Floats
from kaju.model.propagation.transfer_result import load_path

from .body import draw_body, draw_forces, finish
from .loads import CLOSE_UP, load_norm
from .section import WHOLE_UP_TO, Section, section_of
from .style import INK, LOADS, RIM, add_polygons, arrow_polygons, colour_bar, new_axes
from .units import counted, grouped

if TYPE_CHECKING:
    import networkx
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection

    from kaju.model.propagation.stage import Stage
    from kaju.model.propagation.transfer_result import TransferResult

MOST_AGENTS = 4000
"""Of more agents than this, only those around the one that took most are drawn."""
REACH = 30
"""How far around it (cells)."""

_MARKERS = {"material": "s", "free": "o", "rigid": "^", "roller": "D"}


def around_heaviest(stage: Stage, most: int = MOST_AGENTS) -> Stage:
    """Return a stage with only the agents around the one that took most, if there are many."""
    if len(stage.cells) <= most:
        return stage
    heaviest = stage.cells[np.argmax(stage.taken.sum(axis=1))]
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
    """Draw who passed how much to whom: the graph of `TransferResult.load_path`."""
    whole = result.last
    stage = around_heaviest(whole)
    graph = load_path(result.scene, stage)
    focus, close = (stage.cells, CLOSE_UP) if len(stage.cells) else (result.focus, WHOLE_UP_TO)
    section = section_of(result.scene, focus, cut, crop, 2**62, close)
    ax = new_axes(ax)
    entries = draw_body(ax, section)
    notes = draw_forces(ax, section, result.stage)
    tail, head, load = edges_in(section, graph)
    if len(load):
        drawn = draw_edges(ax, section, tail, head, load, load_norm(load))
        colour_bar(ax, drawn, "load passed on", "N")
        entries += draw_nodes(ax, section, graph)
        notes.insert(0, f"{counted(len(load), 'edge')}; each is drawn to the right of its own way")
        if stage is not whole:
            notes.append(
                f"only the {grouped(len(stage.cells))} agents around the one that took most, "
                f"of {grouped(len(whole.cells))}, are drawn"
            )
    else:
        notes = [whole.outcome, *notes]
    finish(ax, section, "Load path", notes, entries)
    return ax
