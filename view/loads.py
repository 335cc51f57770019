"""Loads on their way: what each agent took along which direction, as arrows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LogNorm

from kaju.errors import ParameterError

from .arrows import arrow_polygons
from .body import draw_body, finish
from .cropping import WHOLE_UP_TO, section_of
from .forces import draw_forces
from .section import Section
from .style import FORCE, LOADS, RIM, add_polygons, colour_bar, new_axes
from .units import quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection

    from kaju.model.propagation.stage import Stage
    from kaju.model.propagation.transfer_result import TransferResult

    from .section import Floats

ARROWS_ACROSS = 64
"""Where more tiles than this lie side by side, arrows stand for blocks of cells."""

FILM_ARROWS_ACROSS = 24
"""The same in films, where a frame is seen for half a second."""

CLOSE_UP = 12
"""Bodies of more cells across than this are cropped to the agents, so that arrows can be read."""


def taken_in(stage: Stage, generation: int | None) -> Floats:
    """Return the loads taken (N) in one generation, or in all, shape (agents, directions)."""
    if generation is None:
        return stage.taken
    history = stage.history
    then = history.generation == generation
    taken = np.zeros_like(stage.taken)
    np.add.at(taken, (history.agent[then], history.direction[then]), history.load[then])
    return taken


def load_norm(loads: Floats) -> LogNorm:
    """Return a logarithmic scale over the loads above 0; loads fall off by factors."""
    positive = loads[loads > 0.0]
    if not len(positive):
        return LogNorm(0.1, 1.0)
    low, high = float(positive.min()), float(positive.max())
    return LogNorm(low, high) if high > 1.001 * low else LogNorm(0.5 * high, 2.0 * high)


def draw_loads(
    ax: Axes, section: Section, stage: Stage, loads: Floats, norm: LogNorm, plain: bool = False
) -> tuple[PolyCollection, bool]:
    """Draw loads, shape (agents, directions), as rosettes of arrows out of the cells' middles.

    Returns
    -------
    arrows : PolyCollection
        Coloured by load, or, larger and in one plain colour, as films need them.
    left_out : bool
        Whether loads were left out because they point across the section.
    """
    tiles, loads = section.gather(stage.cells, loads, "sum")
    normals = section.in_plane(section.scene.lattice.normals)
    row, direction = np.nonzero(loads)
    across = np.linalg.norm(normals, axis=1)[direction] < 0.5
    row, direction = row[~across], direction[~across]
    load = loads[row, direction]
    lightest_first = np.argsort(load)
    row, direction, load = (column[lightest_first] for column in (row, direction, load))
    share = np.sqrt(np.clip(load / norm.vmax, 0.0, 1.0)) if len(load) else load
    size = float(section.tile_size.min())
    # In a film arrows are the only thing that moves on: they reach into the next tile.
    least, most, width = (0.5, 1.0, 0.11) if plain else (0.24, 0.49, 0.048)
    tail = section.centres(tiles)[row]
    head = tail + (size * (least + (most - least) * share))[:, None] * normals[direction]
    outlines = arrow_polygons(tail, head, size * (width + 0.06 * share))
    look = (
        {"fc": FORCE, "ec": "white", "lw": 0.6} if plain else {"array": load, "cmap": LOADS, **RIM}
    )
    drawn = add_polygons(ax, outlines, "loads taken", norm=norm, zorder=6, **look)
    return drawn, bool(across.any())


def plot_loads(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    generation: int | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the applied forces, and the loads that each agent took, by direction.

    Parameters
    ----------
    result : TransferResult
        A run.
    ax : matplotlib Axes, optional
        Where to draw; a new figure unless given.
    generation : int, optional
        Only the loads taken in this generation, counted from 1; all unless given.
    cut, crop
        As for `plot_agents`.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ParameterError
        If there was no such generation.
    """
    stage = result.last
    if generation is not None and not 1 <= generation <= stage.generations:
        raise ParameterError(
            f"generation: this run has the generations 1 to {stage.generations}, got {generation}"
        )
    whole = CLOSE_UP if len(stage.cells) else WHOLE_UP_TO
    section = section_of(result.scene, result.focus, cut, crop, ARROWS_ACROSS, whole)
    ax = new_axes(ax)
    entries = draw_body(ax, section)
    notes = draw_forces(ax, section, result.stage)
    loads = taken_in(stage, generation)
    title = "Loads taken" if generation is None else f"Loads taken in generation {generation}"
    total = f"{quantity(float(loads.sum()), 'N')} taken in all, arrow length grows like √load"
    if loads.any():
        norm = load_norm(section.gather(stage.cells, loads, "sum")[1])
        arrows, across = draw_loads(ax, section, stage, loads, norm)
        colour_bar(ax, arrows, "load taken along the arrow", "N")
        notes = ["; ".join(notes), total]
        notes += ["loads across the section are not shown"] if across else []
    else:
        notes = [stage.outcome, *notes]
    finish(ax, section, title, notes, entries)
    return ax
