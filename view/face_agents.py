"""Agents of the elastic rule: where they spawned, the loads left on them, and which act when.

An agent stands on a face. It is drawn as the diamond between the ends of its face and the
middles of the two cells beside it; diamonds of both kinds of faces tile the plane. Parents
are larger diamonds, on their own level.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints

from .agents import spawn_bar, spawn_norm
from .body_plots import BodyPicture
from .films import Film
from .section import Cut, Section, check_number, section_of
from .style import LOADS, SEQUENTIAL, add_polygons, colour_bar
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.elastic_run import ElasticRun

DECADES = 4.0
"""Loads below the largest by more decades than this are all drawn as the least."""


class ShownLevel(NamedTuple):
    """The agents of one level that a picture shows."""

    section: Section
    agents: Ints  # their rows in the run's table
    corners: Floats  # of a diamond round its middle (m), shape (4, 2)

    def draw(
        self, ax: Axes, run: ElasticRun, name: str, agents: Ints, values: NDArray[Any], **look: Any
    ) -> PolyCollection:
        """Draw the diamonds of agents, coloured by values."""
        middle = self.section.in_plane(run.agents.position[agents])
        look |= {"edgecolors": "white", "linewidths": 0.3, "zorder": 2}
        shown = values.astype(np.float64)
        return add_polygons(ax, middle[:, None] + self.corners, name, array=shown, **look)


def _level_of(run: ElasticRun, level: int, cut: Cut, crop: bool | None) -> ShownLevel:
    agents, grid = run.agents, run.grid
    chosen = np.flatnonzero(agents.level == level)
    check_number("level", level, int(agents.level.max(initial=0)))
    finest = agents.position[agents.level == 0]
    section = section_of(grid, grid.lattice.locate(finest) if len(finest) else None, cut, crop)
    edge = grid.lattice.cell_size
    half = 0.5 * edge * 2.0**level
    if section.cut is not None:  # faces in the layer's middle, whose normals lie in the plane
        axis = section.cut[0]
        near = np.abs(agents.position[chosen, axis] - section.place) < half + 1e-9 * edge
        chosen = chosen[near & (agents.axis[chosen] != axis)]
    return ShownLevel(section, chosen, half * np.array([[-1.0, 0], [0, -1.0], [1.0, 0], [0, 1.0]]))


def plot_face_agents(
    run: ElasticRun,
    ax: Axes | None = None,
    *,
    level: int = 0,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the agents of one level, coloured by the step in which they spawned."""
    shown, steps = _level_of(run, level, cut, crop), run.agents.spawn_step
    picture = BodyPicture(shown.section, ax, run.stage)
    last = int(steps.max(initial=1))
    look: dict[str, Any] = {"norm": spawn_norm(last), "cmap": SEQUENTIAL}
    shown.draw(picture.ax, run, "face agents", shown.agents, steps[shown.agents], **look)
    spawn_bar(picture.ax, look["norm"], last, "step in which the agent spawned")
    many = f"{counted(len(shown.agents), 'agent')} on faces"
    if level:
        many = f"{counted(len(shown.agents), 'parent')} of level {level}"
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
    shown = _level_of(run, 0, cut, crop)
    picture = BodyPicture(shown.section, ax, run.stage)
    agents, moments = shown.agents, run.moments
    left, happened = np.abs(run.agents.left), run.outcome
    most = float(left.max(initial=0.0))
    if moment is not None:
        check_number("moment", moment, len(moments.step) - 1)
        most = float(np.abs(moments.left[:, agents]).max(initial=0.0))
        left, step = np.abs(moments.left[moment]), moments.step[moment]
        agents = agents[run.agents.spawn_step[agents] <= step]
        acted = moments.taken[moment] > moments.taken[max(moment - 1, 0)]
        energy = quantity(float(moments.energy[moment]), "J")
        busy = counted(int(np.sum(acted)), "agent")
        happened = f"step {step} of {moments.step[-1]}: {busy} acted; energy {energy}"
    norm = LogNorm((most or 1.0) * 10.0**-DECADES, most or 1.0, clip=True)
    drawn = shown.draw(picture.ax, run, "left", agents, left[agents], norm=norm, cmap=LOADS)
    colour_bar(picture.ax, drawn, "load left", "N", extend="min")
    rests = f"γ = {quantity(run.threshold, 'N')}: a load up to it rests"
    return picture.finish("Loads that are left", [rests, happened, *picture.notes])


WAVES = Film("left", "moment", lambda run: range(len(run.moments.step)))
"""The loads left after every step."""
