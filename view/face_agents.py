"""Agents of the elastic rule: where they spawned, the loads left on them, and which act when.

An agent stands on a face. It is drawn as the diamond between the ends of its face and the
middles of the two cells beside it; diamonds of both kinds of faces tile the plane. Parents
are larger diamonds, on their own level.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from kaju.arrays import Ints

from .body_plots import BodyPicture
from .films import Film
from .section import Cut, Section, check_number, section_of
from .style import LOADS, SEQUENTIAL, add_polygons, colour_bar, count_bar, count_norm
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.elastic_run import ElasticRun


def plot_face_agents(
    run: ElasticRun,
    ax: Axes | None = None,
    *,
    level: int = 0,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the agents of one level, coloured by the step in which they spawned."""
    steps = run.agents.spawn_step
    last = int(steps.max(initial=1))
    look: dict[str, Any] = {"norm": count_norm(1, last), "cmap": SEQUENTIAL}
    agents, section = _level_of(run, level, cut, crop)
    picture = BodyPicture(section, ax, run.stage)
    drawn = _draw_diamonds(picture, run, "face agents", agents, steps, look)
    count_bar(picture.ax, drawn, "step in which the agent spawned")
    many = f"{counted(len(agents), 'parent')} of level {level}"
    many = many if level else f"{counted(len(agents), 'agent')} on faces"
    return picture.finish("Agents of the elastic rule", [many, run.outcome, *picture.notes])


def plot_left(
    run: ElasticRun,
    ax: Axes | None = None,
    *,
    moment: int | None = None,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the loads that the agents of the cells' own faces have left, at the end or before."""
    (agents, section), moments = _level_of(run, 0, cut, crop), run.moments
    picture, left, happened = BodyPicture(section, ax, run.stage), run.agents.left, run.outcome
    most = float(np.abs(left).max(initial=0.0))
    if moment is not None:
        check_number("moment", moment, len(moments.step) - 1)
        most = float(np.abs(moments.left[:, agents]).max(initial=0.0))
        left, step = moments.left[moment], moments.step[moment]
        agents = agents[run.agents.spawn_step[agents] <= step]
        acted = moments.taken[moment] > moments.taken[max(moment - 1, 0)]
        energy = quantity(run.history[step - 1].energy if step else 0.0, "J")
        busy = counted(int(np.sum(acted)), "agent")
        happened = f"step {step} of {moments.step[-1]}: {busy} acted; energy {energy}"
    norm = LogNorm(1e-4 * (most or 1.0), most or 1.0, clip=True)
    look: dict[str, Any] = {"norm": norm, "cmap": LOADS}
    drawn = _draw_diamonds(picture, run, "left", agents, np.abs(left), look)
    colour_bar(picture.ax, drawn, "load left", "N", extend="min")
    rests = f"γ = {quantity(run.threshold, 'N')}: a load up to it rests"
    return picture.finish("Loads that are left", [rests, happened, *picture.notes])


def _level_of(run: ElasticRun, level: int, cut: Cut, crop: bool | None) -> tuple[Ints, Section]:
    """Return the rows of the agents of one level that a picture shows, and what part it shows."""
    agents, grid = run.agents, run.grid
    check_number("level", level, int(agents.level.max(initial=0)))
    chosen = np.flatnonzero(agents.level == level)
    finest = agents.position[agents.level == 0]
    section = section_of(grid, grid.lattice.locate(finest) if len(finest) else None, cut, crop)
    if section.cut is not None:  # faces in the layer's middle, whose normals lie in the plane
        axis, edge = section.cut[0], grid.lattice.cell_size
        off = np.abs(agents.position[chosen, axis] - section.place)
        near = off < edge * (0.5 * 2.0**level + 1e-9)
        chosen = chosen[near & (agents.axis[chosen] != axis)]
    return chosen, section


def _draw_diamonds(
    picture: BodyPicture,
    run: ElasticRun,
    name: str,
    agents: Ints,
    values: NDArray[Any],
    look: dict[str, Any],
) -> PolyCollection:
    """Draw agents of one level as diamonds, coloured by their values."""
    level = run.agents.level[agents[:1]].max(initial=0)
    half = 0.5 * run.grid.lattice.cell_size * 2.0**level
    middle = picture.section.in_plane(run.agents.position[agents])
    corners = middle[:, None] + half * np.array([[-1.0, 0], [0, -1.0], [1.0, 0], [0, 1.0]])
    look |= {"edgecolors": "white", "linewidths": 0.3, "zorder": 2}
    return add_polygons(picture.ax, corners, name, array=values[agents].astype(float), **look)


WAVES = Film("left", "moment", lambda run: range(len(run.moments.step)))
"""The loads left after every step."""
