"""What breaks: where the crack runs, what load is borne, how large avalanches are."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.scene import Scene

from .body_plots import BodyPicture
from .films import Film
from .network_plots import NetworkPicture
from .section import section_of
from .style import (
    DIVERGING,
    FAINT,
    FORCE,
    INK,
    add_polygons,
    colour_bar,
    frame_curves,
    label_axis,
    legend,
    new_axes,
)
from .units import counted, quantity, times

if TYPE_CHECKING:
    from kaju.model.fracture.fracture_result import FractureResult
    from kaju.model.network.network_result import NetworkResult

_BROKEN = "#c44e52"


def plot_crack(
    result: FractureResult,
    ax: Axes | None = None,
    *,
    breaks: int | None = None,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
) -> Axes:
    """Draw what is left after breaks by what it bears: springs deformed, cells at rest."""
    count = result.standing if breaks is None else breaks
    if isinstance(result.subject, Scene):
        if magnification is not None:
            raise ParameterError("magnification: cells that break are drawn at rest")
        return _plot_broken_cells(result, ax, count, cut)
    if cut is not None:
        raise ParameterError("cut: networks are drawn as a whole")
    state = cast("NetworkResult", result.state(breaks))
    picture = NetworkPicture(state, ax, "tension", magnification)
    picture.draw_springs(1)
    _draw_broken(picture, result, count)
    picture.finish([_text(result, count), f"deformation shown {times(picture.factor)}"])
    legend(picture.ax, [Line2D([], [], color=_BROKEN, lw=1.6, label="broken")])
    return picture.ax


def _draw_broken(picture: NetworkPicture, result: FractureResult, count: int) -> Artist:
    """Draw the springs that broke, between the nodes that they joined."""
    springs = result.network.springs
    width = max(0.8, min(2.2, 60.0 / np.sqrt(len(springs))))
    broken = springs[result.broken[:count]]
    look: dict[str, Any] = {"colors": _BROKEN, "linewidths": width, "zorder": 5}
    return picture.draw_lines(picture.places(1), broken, "broken", **look)


def _text(result: FractureResult, count: int) -> str:
    """Return how much is broken, and the load factor."""
    at = max(count - 1, 0)
    factor = float(result.load_factor[at]) if result.breaks else 1.0
    load = f"{counted(count, result.parts)} broken; load factor {factor:.4g}"
    return f"{load}, largest so far {result.load_factor[: at + 1].max(initial=0.0):.4g}"


def plot_load_and_displacement(result: FractureResult, ax: Axes | None = None) -> Axes:
    """Draw the load at every break over how far it had moved, and the largest."""
    ax = new_axes(ax, (6.4, 4.2))
    moved = np.concatenate([[0.0], result.displacement])
    force = np.concatenate([[0.0], result.force])
    ax.plot(moved, force, lw=1.0, color=INK, marker="o", ms=2.5, label="breaks, in their order")
    if result.breaks:
        top = 1 + int(np.argmax(result.force))
        label = f"largest load {quantity(force[top], 'N')}"
        ax.plot(moved[top], force[top], ls="", marker="o", ms=8, mfc="none", mec=FORCE, label=label)
    label_axis(ax.xaxis, "displacement of the load", list(moved), "m")
    label_axis(ax.yaxis, "load", list(force), "N")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    title = f"Load and displacement while {result.parts}s break"
    return frame_curves(ax, title, [result.outcome])


def plot_avalanches(result: FractureResult, ax: Axes | None = None) -> Axes:
    """Draw how many avalanches there are of each size, beside the power −5/2 of fibre bundles."""
    ax = new_axes(ax, (6.4, 4.2))
    sizes = result.avalanche_sizes[:-1]  # the last one ends the network, or was cut off
    edges = np.unique(np.geomspace(1, max(int(sizes.max(initial=1)) + 1, 2), 24).astype(int))
    count, _ = np.histogram(sizes, edges)
    per_size = count / np.diff(edges)
    middle = np.sqrt(edges[:-1] * np.maximum(edges[1:] - 1, 1))
    found = per_size > 0
    ax.loglog(middle[found], per_size[found], ls="", marker="o", color=INK, label="avalanches")
    if found.any():
        power = per_size[found][0] * (middle / middle[found][0]) ** -2.5
        ax.loglog(middle, power, ls="--", lw=1.0, color=FAINT, label="size$^{-5/2}$")
        ax.set_ylim(bottom=0.5 * per_size[found].min())
    ax.set_xlabel(f"{result.parts}s that break in one avalanche")
    ax.set_ylabel("avalanches of that size")
    return frame_curves(
        ax, "Avalanches", [f"{counted(len(sizes), 'avalanche')} before the last one"]
    )


def _plot_broken_cells(
    result: FractureResult, ax: Axes | None, count: int, cut: Mapping[str, float] | None
) -> Axes:
    stresses = _stresses(result, range(count, count + 1))
    picture, norm = _body_to_break(result, ax, cut, stresses)
    _draw_cells(picture, result, count, stresses[0], norm)
    return picture.finish("What is left of a body", [_text(result, count), *picture.notes])


def _stresses(result: FractureResult, counts: range) -> list[Floats]:
    """Return the largest principal stresses (Pa) of the cells after so many breaks each."""
    bodies = zip(counts, result.replayed(counts), strict=True)
    return [result.factor_after(count) * body.borne() for count, body in bodies]


def _body_to_break(
    result: FractureResult,
    ax: Axes | None,
    cut: Mapping[str, float] | None,
    stresses: list[Floats],
) -> tuple[BodyPicture, Normalize]:
    """Return a body and its supports with a bar of stresses, and the scale of this."""
    most = max(float(np.abs(borne).max(initial=0.0)) for borne in stresses) or 1.0
    norm = Normalize(-most, most)
    picture = BodyPicture(section_of(cast(Scene, result.subject), None, cut), ax)
    colour_bar(picture.ax, ScalarMappable(norm, DIVERGING), "largest principal stress", "Pa")
    picture.entries.append(Patch(color=_BROKEN, label="broken"))
    return picture, norm


def _draw_cells(
    picture: BodyPicture, result: FractureResult, count: int, borne: Floats, norm: Normalize
) -> list[Artist]:
    """Draw the cells that are left, by their stresses, and those that broke."""
    ax, section = picture.ax, picture.section
    cells = np.argwhere(section.scene.rasterise() >= 0)
    look: dict[str, Any] = {"edgecolors": "none", "linewidths": 0.0, "antialiased": False}
    tiles, shown = section.gather(cells, borne, "max")
    look |= {"array": shown, "cmap": DIVERGING, "norm": norm, "zorder": 2}
    drawn: list[Artist] = [add_polygons(ax, section.polygons(tiles), "cells", **look)]
    if count:
        tiles, _ = section.gather(cells[result.broken[:count]], np.ones(count), "max")
        places = section.polygons(tiles)
        drawn.append(add_polygons(ax, places, "broken", facecolors=_BROKEN, zorder=3))
    return drawn


def breaking(
    result: FractureResult,
    magnification: float | None = None,
    cut: Mapping[str, float] | None = None,
) -> Film:
    """Return what is left after every break, one frame each, as far as it resists."""
    last = result.standing

    def text(count: int) -> str:
        return _text(result, count)

    if isinstance(result.subject, Scene):
        stresses = _stresses(result, range(last + 1))
        body, norm = _body_to_break(result, None, cut, stresses)
        return body.film(
            "A body breaks",
            last,
            lambda count: _draw_cells(body, result, count, stresses[count], norm),
            text,
        )
    end = cast("NetworkResult", result.state(last))
    picture = NetworkPicture(end, None, "tension", magnification)

    def draw(count: int) -> list[Artist]:
        now = copy(picture)
        now.result = cast("NetworkResult", result.state(count))
        now.network = now.result.network
        return [*now.draw_springs(1), _draw_broken(now, result, count)]

    return picture.film(text, draw, last)
