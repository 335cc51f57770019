"""Bodies that grow: the design that has grown, and how it came to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
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
    picture = _body(result, cut, ax)
    _draw_densities(picture, result, step)
    notes = [_text(result, result.steps if step is None else step), *picture.notes]
    notes += [result.outcome] if step is None else []
    return picture.finish(f"What grows by the rule of {result.rule}", notes)


def growing_body(result: GrowthResult, cut: Mapping[str, float] | None = None) -> Film:
    """Return the densities after every step, one frame each."""
    picture = _body(result, cut)
    return picture.film(
        f"Growth by the rule of {result.rule}",
        result.steps,
        lambda step: [_draw_densities(picture, result, step)],
        lambda step: _text(result, step),
    )


def _body(
    result: GrowthResult, cut: Mapping[str, float] | None, ax: Axes | None = None
) -> BodyPicture:
    """Return the body before it grows, with a bar of densities."""
    picture = BodyPicture(section_of(result.scene, None, cut), ax, result.stage)
    colour_bar(picture.ax, ScalarMappable(_DENSITIES, "Greys"), "density", "")
    return picture


def _draw_densities(picture: BodyPicture, result: GrowthResult, step: int | None) -> PolyCollection:
    section = picture.section
    tiles, shown = section.gather(np.argwhere(result.body), result.density_at(step), "max")
    return add_polygons(
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
