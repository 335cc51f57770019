"""Loads as arrows: what each agent took by direction, and which agent loaded which."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, to_hex
from matplotlib.lines import Line2D

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import BodyPicture
from .section import WHOLE_UP_TO, Cut, Section, section_of
from .style import FORCE, LOADS, PULL, PULLS, RIM, add_polygons, arrow_polygons, colour_bar
from .units import quantity


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
    lightest_first = np.argsort(loads[row, state])
    row, state = row[lightest_first], state[lightest_first]
    load, along, pull = loads[row, state], normals[state % len(normals)], state >= len(normals)
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
    result: TransferResult, ax: Axes | None = None, *, cut: Cut = None, crop: bool | None = None
) -> Axes:
    """Draw the applied forces, and the loads that each agent took, by direction."""
    stage, caveats = result.last, result.caveats_in_brief
    whole = 12 if len(stage.cells) else WHOLE_UP_TO  # cropped, so that arrows can be read
    section = section_of(result.scene, result.focus, cut, crop, 64, whole, caveats)
    picture = BodyPicture(section, ax, result.stage)
    loads = loads_taken(stage, None)
    if not loads.any():
        return picture.finish("Loads taken", [stage.outcome, *picture.notes])
    norm = load_norm(section.gather(stage.cells, loads, "sum")[1])
    across = draw_loads(picture.ax, section, stage, loads, norm)
    pulls = sense_entries(loads, stage.taken.shape[1])
    picture.entries += pulls
    colour_bar(picture.ax, ScalarMappable(norm, LOADS), "load taken along the arrow", "N")
    total = f"{quantity(float(loads.sum()), 'N')} taken by all agents; arrows grow like √load"
    notes = ["; ".join(picture.notes), total]
    notes += ["pulls in shades of red-violet, as dark as pushes of their size"] if pulls else []
    notes += ["loads across the section are not shown"] if across else []
    return picture.finish("Loads taken", notes)
