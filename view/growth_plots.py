"""Bodies that grow: the design that has grown, and how it came to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from kaju.view.films import TWO_LINES, Film

from .body_plots import draw_body, draw_forces, finish
from .section import Section, section_of
from .style import (
    FAINT,
    INK,
    add_polygons,
    colour_bar,
    figure_of,
    frame_curves,
    label_axis,
    new_axes,
)
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.growth.growth_result import GrowthResult


def plot_design(
    result: GrowthResult,
    ax: Axes | None = None,
    *,
    step: int | None = None,
    cut: Mapping[str, float] | None = None,
) -> Axes:
    """Draw the densities of the cells, of a body of cubes those in a plane."""
    section = section_of(result.scene, None, cut)
    ax = new_axes(ax)
    entries = draw_body(ax, section)
    drawn = _draw_densities(ax, section, result, step)
    colour_bar(ax, drawn, "density", "")
    notes = [_words(result, result.steps if step is None else step)]
    notes += draw_forces(ax, section, result.stage)
    if step is None:
        notes += [result.outcome]
    finish(ax, section, f"What grows by the rule of {result.rule}", notes, entries)
    return ax


def _draw_densities(
    ax: Axes, section: Section, result: GrowthResult, step: int | None
) -> PolyCollection:
    tiles, shown = section.gather(np.argwhere(result.body), result.density_at(step), "max")
    return add_polygons(
        ax,
        section.polygons(tiles),
        "densities",
        array=shown,
        cmap="Greys",
        norm=Normalize(0.0, 1.0),
        edgecolors="none",
        linewidths=0.0,
        antialiased=False,
        zorder=2,
    )


def _words(result: GrowthResult, step: int) -> str:
    compliance = quantity(float(result.compliances[step]), "J")
    return f"after {counted(step, 'step')}: F·u = {compliance}, volume {result.volumes[step]:.1%}"


def plot_growth(result: GrowthResult, ax: Axes | None = None) -> Axes:
    """Draw the compliance and the volume after every step."""
    ax = new_axes(ax, (6.4, 4.2))
    steps = np.arange(result.steps + 1)
    ax.plot(steps, result.compliances, lw=1.2, color=INK, label="compliance F·u")
    label_axis(ax.yaxis, "compliance", list(result.compliances), "J")
    ax.set_xlabel("step")
    ax.set_ylim(bottom=0.0)
    other = ax.twinx()
    other.plot(steps, result.volumes, lw=1.0, ls="--", color=FAINT, label="volume")
    other.set_ylim(0.0, 1.0)
    other.set_ylabel("share of the volume", color=FAINT)
    lines = [*ax.get_lines(), *other.get_lines()]
    title = "Compliance and volume while a body grows"
    return frame_curves(ax, title, [result.outcome], handles=lines)


def growing_body(result: GrowthResult, cut: Mapping[str, float] | None = None) -> Film:
    """Return the densities after every step, one frame each."""
    section = section_of(result.scene, None, cut)
    ax = new_axes(None)
    entries = draw_body(ax, section)
    draw_forces(ax, section, result.stage)
    first = _draw_densities(ax, section, result, 0)
    colour_bar(ax, first, "density", "")
    first.set_visible(False)

    def draw(step: int) -> list[Artist]:
        return [_draw_densities(ax, section, result, step)]

    notes = finish(ax, section, f"Growth by the rule of {result.rule}", TWO_LINES, entries)
    return Film(figure_of(ax), result.steps, draw, notes, lambda step: _words(result, step))
