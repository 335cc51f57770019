"""Bodies that grow: the design that has grown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from .body_plots import BodyPicture
from .films import Film
from .section import Cut, section_of
from .style import add_polygons, colour_bar
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.growth.growth_result import GrowthResult


def plot_design(
    result: GrowthResult, ax: Axes | None = None, *, step: int | None = None, cut: Cut = None
) -> Axes:
    """Draw the densities of the cells, of a body of cubes those in a plane."""
    section, norm = section_of(result.scene, None, cut), Normalize(0.0, 1.0)
    picture = BodyPicture(section, ax, result.stage)
    colour_bar(picture.ax, ScalarMappable(norm, "Greys"), "density", "")
    tiles, shown = section.gather(np.argwhere(result.body), result.density_at(step), "max")
    look: dict[str, Any] = {"array": shown, "cmap": "Greys", "norm": norm, "zorder": 2}
    look |= {"edgecolors": "none", "linewidths": 0.0, "antialiased": False}
    add_polygons(picture.ax, section.polygons(tiles), "densities", **look)
    at = result.steps if step is None else step
    compliance, volume = quantity(float(result.compliances[at]), "J"), result.volumes[at]
    notes = [f"after {counted(at, 'step')}: F·u = {compliance}, volume {volume:.1%}"]
    notes += [*picture.notes, *([result.outcome] if step is None else [])]
    return picture.finish(f"What grows by the rule of {result.rule}", notes)


STEPS = Film("design", "step", lambda result: range(result.steps + 1))
"""The densities after every step."""
