"""Agents of the elastic rule: where they spawned, the loads left on them, and which act when.

An agent stands on a face. It is drawn as the diamond between the ends of its face and the
middles of the two cells beside it; diamonds of both kinds of faces tile the plane. Parents
are larger diamonds, on their own level.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, LogNorm, Normalize
from numpy.typing import NDArray

from kaju.arrays import Ints
from kaju.errors import ParameterError

from .agents import spawn_bar, spawn_norm
from .body_plots import BodyPicture
from .charts import plot_cuts
from .deformed import plot_deformed
from .films import Film
from .maps import plot_displacement, plot_strain, plot_stress, plot_von_mises
from .section import section_of
from .style import LOADS, SEQUENTIAL, add_polygons, colour_bar
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.elastic_run import ElasticRun

Cut = Mapping[str, float]

DECADES = 4.0
"""Loads below the largest by more decades than this are all drawn as the least."""


def plot_face_agents(
    run: ElasticRun,
    ax: Axes | None = None,
    *,
    level: int = 0,
    cut: Cut | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the agents of one level, coloured by the step in which they spawned."""
    shown = _LevelOfAgents(run, level, cut, crop)
    picture = BodyPicture(shown.section, ax, run.stage)
    steps = run.agents.spawn_step
    last = int(steps.max(initial=1))
    norm = spawn_norm(last)
    shown.draw(picture.ax, "face agents", shown.agents, steps[shown.agents], norm, SEQUENTIAL)
    spawn_bar(picture.ax, norm, last, "step in which the agent spawned")
    many = f"{counted(len(shown.agents), 'agent')} on faces"
    if level:
        many = f"{counted(len(shown.agents), 'parent')} of level {level}"
    return picture.finish("Agents of the elastic rule", [many, run.outcome, *picture.notes])


def plot_left(
    run: ElasticRun,
    ax: Axes | None = None,
    *,
    moment: int | None = None,
    cut: Cut | None = None,
    crop: bool | None = None,
) -> Axes:
    """Draw the loads that the agents of the cells' own faces have left, at the end or before."""
    shown = _LevelOfAgents(run, 0, cut, crop)
    picture = BodyPicture(shown.section, ax, run.stage)
    agents, left = shown.agents, np.abs(run.agents.left)
    norm, happened = _norm(left), run.outcome
    if moment is not None:
        moments = run.moments
        if not 0 <= moment < len(moments.step):
            last = len(moments.step) - 1
            raise ParameterError(f"moment: this run has the moments 0 to {last}, got {moment}")
        norm, left = _norm(np.abs(moments.left[:, agents])), np.abs(moments.left[moment])
        agents = agents[run.agents.spawn_step[agents] <= moments.step[moment]]
        happened = _so_far(run, moment)
    drawn = shown.draw(picture.ax, "left", agents, left[agents], norm)
    colour_bar(picture.ax, drawn, "load left", "N", extend="min")
    rests = f"γ = {quantity(run.threshold, 'N')}: a load up to it rests"
    return picture.finish("Loads that are left", [rests, happened, *picture.notes])


def _so_far(run: ElasticRun, moment: int) -> str:
    """Return the step of a moment, who acted since the one before, and the energy."""
    moments = run.moments
    before = moments.taken[max(moment - 1, 0)]
    busy = counted(int(np.sum(moments.taken[moment] > before)), "agent")
    energy = quantity(float(moments.energy[moment]), "J")
    return f"step {moments.step[moment]} of {moments.step[-1]}: {busy} acted; energy {energy}"


WAVES = Film("left", "moment", lambda run: range(len(run.moments.step)))
"""The loads left after every step."""


def _norm(sizes: NDArray[np.floating]) -> LogNorm:
    largest = float(sizes.max(initial=0.0)) or 1.0
    return LogNorm(largest * 10.0**-DECADES, largest, clip=True)


class _LevelOfAgents:
    """The agents of one level that a picture shows, by their rows in the run's table."""

    def __init__(self, run: ElasticRun, level: int, cut: Cut | None, crop: bool | None) -> None:
        agents, grid = run.agents, run.grid
        chosen = np.flatnonzero(agents.level == level)
        if level < 0 or (level > 0 and not len(chosen)):
            last = int(agents.level.max(initial=0))
            raise ParameterError(
                f"level: this run has agents of the levels 0 to {last}, got {level}"
            )
        finest = agents.position[agents.level == 0]
        section = section_of(grid, grid.lattice.locate(finest) if len(finest) else None, cut, crop)
        edge = grid.lattice.cell_size
        self.half = 0.5 * edge * 2.0**level
        if section.cut is not None:  # faces in the layer's middle, whose normals lie in the plane
            axis, index = section.cut
            apart = np.abs(agents.position[chosen, axis] - (index + 0.5) * edge)
            near = apart < self.half + 1e-9 * edge
            chosen = chosen[near & (agents.axis[chosen] != axis)]
        self.run, self.section, self.agents = run, section, chosen

    def draw(
        self,
        ax: Axes,
        name: str,
        agents: Ints,
        values: NDArray[Any],
        norm: Normalize,
        cmap: str | Colormap = LOADS,
    ) -> PolyCollection:
        """Draw the diamonds of agents, coloured by values."""
        middle = self.section.in_plane(self.run.agents.position[agents])
        corners = self.half * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
        return add_polygons(
            ax, middle[:, None] + corners, name, array=values.astype(np.float64), cmap=cmap,
            norm=norm, edgecolors="white", linewidths=0.3, zorder=2,
        )  # fmt: skip


def _settled(plot: Callable[..., Axes]) -> Callable[..., Axes]:
    """Draw what the agents have settled to."""

    @wraps(plot)
    def draw(run: ElasticRun, ax: Axes | None = None, **options: Any) -> Axes:
        return plot(run.result, ax, **options)

    return draw


deformed, cuts = _settled(plot_deformed), _settled(plot_cuts)
displacement, strain = _settled(plot_displacement), _settled(plot_strain)
stress, von_mises = _settled(plot_stress), _settled(plot_von_mises)
