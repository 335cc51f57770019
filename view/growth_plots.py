"""Bodies that grow: the design that has grown, and how it came to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from .body_plots import BodyPicture
from .films import Film
from .section import section_of
from .style import FAINT, INK, add_polygons, colour_bar, frame_curves, label_axis, new_axes
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.growth.growth_result import GrowthResult

_DENSITIES = Normalize(0.0, 1.0)


def plot_design(
    result: GrowthResult,
    ax: Axes | None = None,
    *,
    step: int | None = None,
    cut: Mapping[str, float] | None = None,
) -> Axes:
    """Draw the densities of the cells, of a body of cubes those in a plane."""
    section = section_of(result.scene, None, cut)
    picture = BodyPicture(section, ax, result.stage)
    colour_bar(picture.ax, ScalarMappable(_DENSITIES, "Greys"), "density", "")
    tiles, shown = section.gather(np.argwhere(result.body), result.density_at(step), "max")
    add_polygons(
        picture.ax,
        section.polygons(tiles),
        "densities",
        array=shown,
        cmap="Greys",
        norm=_DENSITIES,
        edgecolors="none",
        linewidths=0.0,
        antialiased=False,
        zorder=2,
    )
    notes = [_text(result, result.steps if step is None else step), *picture.notes]
    notes += [result.outcome] if step is None else []
    return picture.finish(f"What grows by the rule of {result.rule}", notes)


STEPS = Film("design", "step", lambda result: range(result.steps + 1))
"""The densities after every step."""


def _text(result: GrowthResult, step: int) -> str:
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
