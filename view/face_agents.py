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
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, LogNorm, Normalize
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError

from .agents import spawn_bar, spawn_norm
from .body_plots import BodyPicture
from .charts import plot_cuts
from .deformed import plot_deformed
from .films import TWO_LINES, Film
from .maps import plot_displacement, plot_strain, plot_stress, plot_von_mises
from .section import section_of
from .style import LOADS, SEQUENTIAL, add_polygons, colour_bar, new_figure
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
    run: ElasticRun, ax: Axes | None = None, *, cut: Cut | None = None, crop: bool | None = None
) -> Axes:
    """Draw the loads that the agents of the cells' own faces have left at the end."""
    shown = _LevelOfAgents(run, 0, cut, crop)
    picture = BodyPicture(shown.section, ax, run.stage)
    left = np.abs(run.agents.left)
    drawn = shown.draw(picture.ax, "left", shown.agents, left[shown.agents], _norm(left))
    colour_bar(picture.ax, drawn, "load left", "N", extend="min")
    rests = f"γ = {quantity(run.threshold, 'N')}: a load up to it rests"
    return picture.finish("Loads that are left", [rests, run.outcome, *picture.notes])


def waves(run: ElasticRun, *, cut: Cut | None = None, crop: bool | None = None) -> Film:
    """Return the steps of a run: on the left the loads left, on the right the acting agents."""
    moments, agents = run.moments, run.agents
    levels = [
        _LevelOfAgents(run, level, cut, crop)
        for level in range(int(agents.level.max(initial=0)) + 1)
    ]
    finest = levels[0]
    acted = np.diff(moments.taken, axis=0, prepend=moments.taken[:1])
    left_norm, acted_norm = _norm(np.abs(moments.left[:, finest.agents])), _norm(acted)
    axes = new_figure((11.0, 5.6)).subplots(1, 2)
    rest, act = (BodyPicture(finest.section, ax, run.stage) for ax in axes)
    for picture, norm, label in (
        (rest, left_norm, "load left"),
        (act, acted_norm, "loads taken since the picture before"),
    ):
        picture.entries = []
        colour_bar(picture.ax, ScalarMappable(norm, LOADS), label, "N", extend="min")
    act.finish("Who acts", TWO_LINES)
    right = act.ax.texts[-1]

    def draw(number: int) -> list[Artist]:
        awake = finest.agents[agents.spawn_step[finest.agents] <= moments.step[number]]
        size = np.abs(moments.left[number, awake])
        artists: list[Artist] = [finest.draw(rest.ax, "left", awake, size, left_norm)]
        for shown in levels:
            busy = shown.agents[acted[number, shown.agents] > 0.0]
            artists.append(shown.draw(act.ax, "acting", busy, acted[number, busy], acted_norm))
        right.set_text(_acting(acted[number], agents.level))
        return artists

    def text(number: int) -> str:
        step, last = int(moments.step[number]), int(moments.step[-1])
        energy = quantity(float(moments.energy[number]), "J")
        stood = int(np.sum((agents.spawn_step <= step) & (agents.level == 0)))
        return f"step {step} of {last}: {counted(stood, 'agent')} awake\nenergy {energy}"

    return rest.film("What is left", len(moments.step) - 1, draw, text)


def _acting(acted: Floats, level: Ints) -> str:
    """Return how many agents of each level acted."""
    busy = acted > 0.0
    if not busy.any():
        return "nobody has acted yet\n"
    visited = np.unique(level[busy])
    named = [f"{int(np.sum(busy & (level == number)))} of level {number}" for number in visited]
    if level.any():
        return "agents that acted: " + ", ".join(named) + "\n(level 0: the cells' own faces)"
    return f"{counted(int(busy.sum()), 'agent')} acted\n"


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
