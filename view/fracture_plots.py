"""What grows and what breaks: densities, where the crack runs, and how large avalanches are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from kaju.errors import require
from kaju.model.scene import Scene

from .body_plots import BodyPicture, draw_cells
from .charts import last_loaded
from .films import Film
from .network_plots import NetworkPicture
from .section import Cut, check_number, section_of
from .style import DIVERGING, FAINT, INK, LINE, add_polygons, caption, colour_bar, legend, new_axes
from .units import counted, quantity, times, visible

if TYPE_CHECKING:
    from kaju.model.fracture.fracture_result import FractureResult
    from kaju.model.growth.growth_result import GrowthResult
    from kaju.model.network.network_result import NetworkResult

_BROKEN = "#c44e52"


def plot_crack(
    result: FractureResult,
    ax: Axes | None = None,
    *,
    breaks: int | None = None,
    magnification: float | None = None,
    largest: float | None = None,
    cut: Cut = None,
) -> Axes:
    """Draw what is left after breaks by what it bears: springs deformed, cells at rest.

    What has parted, or bears next to nothing any more, is drawn as it stood when it last did.
    """
    count = result.breaks if breaks is None else breaks
    check_number("breaks", count, result.breaks)
    if isinstance(result.subject, Scene):
        told = "magnification: cells that break are drawn undeformed; leave it out"
        require(magnification is None, told)
        return _plot_broken_cells(result, ax, count, largest, cut)
    require(cut is None, "cut: networks are drawn as a whole; leave it out")
    state = cast("NetworkResult", result.state(bearing(result, count)))
    picture = NetworkPicture(state, ax, magnification, largest)
    picture.draw(1)
    springs = result.network.springs
    width = max(0.8, min(2.2, 60.0 / np.sqrt(len(springs))))
    look: dict[str, Any] = {"colors": _BROKEN, "linewidths": width, "zorder": 5}
    picture.draw_lines(picture.places(1), springs[result.broken[:count]], "broken", **look)
    legend(picture.ax, [Line2D([], [], color=_BROKEN, lw=1.6, label="broken")])
    return picture.finish([_text(result, count), f"deformation shown {times(picture.factor)}"])


def bearing(result: FractureResult, count: int) -> int:
    """Return after how many breaks a body is drawn of which so many parts have broken."""
    return min(count, result.breaks_resisted, last_loaded(result))


def _scale(result: FractureResult, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the end of the colours, and of networks the magnification, by all states."""
    borne, moved = 0.0, 0.0
    counts = range(bearing(result, result.breaks) + 1)
    for count, body in zip(counts, result.replayed(counts), strict=True):
        factor = result.factor_after(count)
        borne = max(borne, float(np.abs(factor * body.borne()).max(initial=0.0)))
        moved = max(moved, float(np.abs(factor * body.displacement()).max(initial=0.0)))
    if isinstance(result.subject, Scene):
        return {"largest": borne}
    span = float(np.ptp(result.network.positions, axis=0).max())
    return {"largest": borne, "magnification": visible(span, moved)}


BREAKS = Film("crack", "breaks", lambda result: range(result.breaks + 1), _scale)
"""What is left after every break."""


def _text(result: FractureResult, count: int) -> str:
    """Return how much is broken, and the load factor."""
    at = max(count - 1, 0)
    factor = float(result.load_factor[at]) if result.breaks else 1.0
    parted = "; parted" if count > result.breaks_resisted else ""
    load = f"{counted(count, result.parts)} broken{parted}; load factor {factor:.4g}"
    return f"{load}, largest so far {result.load_factor[: at + 1].max(initial=0.0):.4g}"


def _plot_broken_cells(
    result: FractureResult, ax: Axes | None, count: int, largest: float | None, cut: Cut
) -> Axes:
    """Draw the cells that are left, by their largest principal stress, and those that broke."""
    shown = bearing(result, count)
    (body,) = result.replayed([shown])
    borne = result.factor_after(shown) * body.borne()
    most = largest or float(np.abs(borne).max(initial=0.0)) or 1.0
    picture = BodyPicture(section_of(cast(Scene, result.subject), None, cut), ax)
    section, cells = picture.section, np.argwhere(picture.section.scene.rasterise() >= 0)
    look: dict[str, Any] = {"cmap": DIVERGING, "norm": Normalize(-most, most)}
    drawn = draw_cells(picture.ax, section, cells, borne, "max", "cells", rims=False, **look)
    colour_bar(picture.ax, drawn, "largest principal stress", "Pa")
    if count:
        tiles, _ = section.gather(cells[result.broken[:count]], np.ones(count), "max")
        broken: dict[str, Any] = {"facecolors": _BROKEN, "zorder": 3}
        add_polygons(picture.ax, section.polygons(tiles), "broken", **broken)
    picture.entries.append(Patch(color=_BROKEN, label="broken"))
    return picture.finish("What is left of a body", [_text(result, count), *picture.notes])


def plot_avalanches(result: FractureResult, ax: Axes | None = None) -> Axes:
    """Draw how many avalanches there are of each size, beside the power −5/2 of fibre bundles."""
    ax = new_axes(ax, (6.4, 4.2))
    sizes = result.avalanche_sizes[:-1]  # the last one ends the network, or was cut off
    edges = np.unique(np.geomspace(1, max(int(sizes.max(initial=1)) + 1, 2), 24).astype(int))
    per_size = np.histogram(sizes, edges)[0] / np.diff(edges)
    middle = np.sqrt(edges[:-1] * np.maximum(edges[1:] - 1, 1))
    found = per_size > 0
    ax.loglog(middle[found], per_size[found], ls="", marker="o", color=INK, label="avalanches")
    if found.any():
        power = per_size[found][0] * (middle / middle[found][0]) ** -2.5
        ax.loglog(middle, power, ls="--", lw=1.0, color=FAINT, label="size$^{-5/2}$")
        ax.set_ylim(bottom=0.5 * per_size[found].min())
    ax.set_xlabel(f"{result.parts}s that break in one avalanche")
    ax.set_ylabel("avalanches of that size")
    ax.grid(color=LINE, lw=0.4)
    ax.legend(fontsize=8, framealpha=1.0, edgecolor="white")
    caption(ax, "Avalanches", [f"{counted(len(sizes), 'avalanche')} before the last one"])
    return ax


def plot_design(
    result: GrowthResult, ax: Axes | None = None, *, step: int | None = None, cut: Cut = None
) -> Axes:
    """Draw the densities of the cells, of a body of cubes those in a plane."""
    section, values = section_of(result.scene, None, cut), result.density_at(step)
    picture, cells = BodyPicture(section, ax, result.stage), np.argwhere(result.body)
    look: dict[str, Any] = {"cmap": "Greys", "norm": Normalize(0.0, 1.0)}
    drawn = draw_cells(picture.ax, section, cells, values, "max", "densities", False, **look)
    colour_bar(picture.ax, drawn, "density", "")
    at = result.steps if step is None else step
    compliance, volume = quantity(float(result.compliances[at]), "J"), result.volumes[at]
    notes = [f"after {counted(at, 'step')}: F·u = {compliance}, volume {volume:.1%}"]
    notes += [*picture.notes, *([result.outcome] if step is None else [])]
    return picture.finish(f"What grows by the rule of {result.rule}", notes)


STEPS = Film("design", "step", lambda result: range(result.steps + 1))
"""The densities after every step."""
