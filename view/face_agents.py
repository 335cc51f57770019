"""Agents of the elastic rule: where they spawned, what is left on them, and who acts when.

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
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.view.films import TWO_LINES, Film

from .agents import spawn_bar, spawn_norm
from .body_plots import draw_body, draw_forces, finish
from .cut_plots import plot_cuts
from .deformed import plot_deformed
from .maps import plot_displacement, plot_strain, plot_stress, plot_von_mises
from .section import Section, section_of
from .style import LOADS, SEQUENTIAL, add_polygons, colour_bar, figure_of, new_axes, new_figure
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
    shown = _shown(run, level, cut, crop)
    ax = new_axes(ax)
    entries = draw_body(ax, shown.section)
    notes = draw_forces(ax, shown.section, run.stage)
    steps = run.agents.spawn_step
    last = int(steps.max(initial=1))
    norm = spawn_norm(last)
    spawned = steps[shown.agents].astype(np.float64)
    add_polygons(
        ax, shown.diamonds(shown.agents), "face agents", array=spawned, cmap=SEQUENTIAL,
        norm=norm, edgecolors="white", linewidths=0.3, zorder=2,
    )  # fmt: skip
    spawn_bar(ax, norm, last, "step in which the agent spawned")
    told = f"{counted(len(shown.agents), 'agent')} on faces"
    if level:
        told = f"{counted(len(shown.agents), 'parent')} of level {level}"
    finish(ax, shown.section, "Agents of the elastic rule", [told, run.outcome, *notes], entries)
    return ax


def plot_left(
    run: ElasticRun, ax: Axes | None = None, *, cut: Cut | None = None, crop: bool | None = None
) -> Axes:
    """Draw the loads that the agents of the cells' own faces have left at the end."""
    shown = _shown(run, 0, cut, crop)
    ax = new_axes(ax)
    entries = draw_body(ax, shown.section)
    notes = draw_forces(ax, shown.section, run.stage)
    left = np.abs(run.agents.left)
    norm = _norm(left)
    drawn = shown.draw(ax, "left", shown.agents, left[shown.agents], norm)
    colour_bar(ax, drawn, "load left", "N", extend="min")
    told = f"γ = {quantity(run.threshold, 'N')}: a load up to it rests"
    finish(ax, shown.section, "Loads that are left", [told, run.outcome, *notes], entries)
    return ax


def waves(run: ElasticRun, *, cut: Cut | None = None, crop: bool | None = None) -> Film:
    """Return the steps of a run: on the left what is left, on the right who acts."""
    moments, agents = run.moments, run.agents
    levels = [
        _shown(run, level, cut, crop) for level in range(int(agents.level.max(initial=0)) + 1)
    ]
    section = levels[0].section
    acted = np.diff(moments.taken, axis=0, prepend=moments.taken[:1])
    left_norm, acted_norm = _norm(np.abs(moments.left[:, levels[0].agents])), _norm(acted)
    figure = new_figure((11.0, 5.6))
    rest, act = figure.subplots(1, 2)
    for ax in (rest, act):
        draw_body(ax, section)
        draw_forces(ax, section, run.stage)
    for ax, norm, label in (
        (rest, left_norm, "load left"),
        (act, acted_norm, "loads taken since the picture before"),
    ):
        colour_bar(ax, ScalarMappable(norm, LOADS), label, "N", extend="min")
    finish(act, section, "Who acts", TWO_LINES, [])
    notes = finish(rest, section, "What is left", TWO_LINES, [])
    right = act.texts[-1]

    def draw(number: int) -> list[Artist]:
        here = levels[0]
        standing = here.agents[agents.spawn_step[here.agents] <= moments.step[number]]
        size = np.abs(moments.left[number, standing])
        artists = [here.draw(rest, "left", standing, size, left_norm)]
        for shown in levels:
            busy = shown.agents[acted[number, shown.agents] > 0.0]
            artists.append(shown.draw(act, "acting", busy, acted[number, busy], acted_norm))
        right.set_text(_who(acted[number], agents.level))
        return artists

    def words(number: int) -> str:
        step, last = int(moments.step[number]), int(moments.step[-1])
        energy = quantity(float(moments.energy[number]), "J")
        stood = int(np.sum((agents.spawn_step <= step) & (agents.level == 0)))
        return f"step {step} of {last}: {counted(stood, 'agent')} awake\nenergy {energy}"

    return Film(figure_of(rest), len(moments.step) - 1, draw, notes, words)


def _who(acted: Floats, level: Ints) -> str:
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


class _Shown:
    """The agents of one level that a picture shows, by their rows in the run's table."""

    def __init__(self, run: ElasticRun, section: Section, agents: Ints, level: int) -> None:
        self.run, self.section, self.agents = run, section, agents
        self.half = 0.5 * run.grid.lattice.cell_size * 2.0**level

    def diamonds(self, agents: Ints) -> Floats:
        """Return the corners of agents' diamonds (m), shape (n, 4, 2)."""
        middle = self.section.in_plane(self.run.agents.position[agents])
        corners = self.half * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
        return middle[:, None] + corners

    def draw(self, ax: Axes, name: str, agents: Ints, values: Floats, norm: LogNorm) -> Any:
        """Draw agents, coloured by values on a logarithmic scale."""
        return add_polygons(
            ax, self.diamonds(agents), name, array=values.astype(np.float64), cmap=LOADS,
            norm=norm, edgecolors="white", linewidths=0.3, zorder=2,
        )  # fmt: skip


def _shown(run: ElasticRun, level: int, cut: Cut | None, crop: bool | None) -> _Shown:
    agents, grid = run.agents, run.grid
    chosen = np.flatnonzero(agents.level == level)
    if level < 0 or (level > 0 and not len(chosen)):
        last = int(agents.level.max(initial=0))
        raise ParameterError(f"level: this run has agents of the levels 0 to {last}, got {level}")
    finest = agents.position[agents.level == 0]
    section = section_of(grid, grid.lattice.locate(finest) if len(finest) else None, cut, crop)
    if section.cut is not None:  # the faces in the layer's middle, whose normals lie in the plane
        axis, index = section.cut
        edge = grid.lattice.cell_size
        apart = np.abs(agents.position[chosen, axis] - (index + 0.5) * edge)
        near = apart < 0.5 * edge * 2.0**level + 1e-9 * edge
        chosen = chosen[near & (agents.axis[chosen] != axis)]
    return _Shown(run, section, chosen, level)


def _settled(plot: Callable[..., Axes]) -> Callable[..., Axes]:
    """Draw what the agents have settled to."""

    @wraps(plot)
    def draw(run: ElasticRun, ax: Axes | None = None, **options: Any) -> Axes:
        return plot(run.result, ax, **options)

    return draw


deformed, cuts = _settled(plot_deformed), _settled(plot_cuts)
displacement, strain = _settled(plot_displacement), _settled(plot_strain)
stress, von_mises = _settled(plot_stress), _settled(plot_von_mises)
