"""Networks that break: where the crack runs, what load they bear, how large avalanches are."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from .network_plots import Stand
from .reels import TWO_LINES, Reel
from .style import FAINT, FORCE, INK, LINE, caption, figure_of, label_axis, legend, new_axes
from .units import counted, quantity, times

if TYPE_CHECKING:
    from kaju.model.fracture.fracture_result import FractureResult

_BROKEN = "#c44e52"


def plot_crack(
    result: FractureResult,
    ax: Axes | None = None,
    *,
    breaks: int | None = None,
    magnification: float | None = None,
) -> Axes:
    """Draw what is left after so many breaks, its springs coloured by tension, and what broke."""
    count = result.standing if breaks is None else breaks
    stand = Stand(result.state(breaks), ax, "tension", magnification)
    stand.bar(stand.draw_springs(1)[0])
    _draw_broken(stand, result, count)
    stand.finish([*_words(result, count), f"deformation shown {times(stand.factor)}"])
    legend(stand.ax, [Line2D([], [], color=_BROKEN, lw=1.6, label="broken")])
    return stand.ax


def _draw_broken(stand: Stand, result: FractureResult, count: int) -> Artist:
    """Draw the springs that broke, between the nodes that they joined."""
    kind = LineCollection if stand.flat else Line3DCollection
    lines = cast(Any, stand.places(1)[result.network.springs[result.spring[:count]]])
    width = max(0.8, min(2.2, 60.0 / np.sqrt(len(result.network.springs))))
    broken = kind(lines, colors=_BROKEN, linewidths=width, zorder=5)
    broken.set_gid("broken")
    cast(Any, stand.ax).add_collection(broken, autolim=False)
    return broken


def _words(result: FractureResult, count: int) -> list[str]:
    at = max(count - 1, 0)
    factor = float(result.load_factor[at]) if result.breaks else 1.0
    load = f"{counted(count, 'spring')} broken; load factor {factor:.4g}"
    return [f"{load}, largest so far {result.load_factor[: at + 1].max(initial=0.0):.4g}"]


def plot_load_and_displacement(result: FractureResult, ax: Axes | None = None) -> Axes:
    """Draw the load at every break over how far it had moved, and the largest."""
    ax = new_axes(ax, (6.4, 4.2))
    moved = np.concatenate([[0.0], result.displacement])
    force = np.concatenate([[0.0], result.force])
    ax.plot(moved, force, lw=1.0, color=INK, marker="o", ms=2.5, label="breaks, in their order")
    if result.breaks:
        top = 1 + int(np.argmax(result.force))
        told = f"largest load {quantity(force[top], 'N')}"
        ax.plot(moved[top], force[top], ls="", marker="o", ms=8, mfc="none", mec=FORCE, label=told)
    label_axis(ax.xaxis, "displacement of the load", list(moved), "m")
    label_axis(ax.yaxis, "load", list(force), "N")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.grid(color=LINE, lw=0.4)
    ax.legend(fontsize=8, framealpha=1.0, edgecolor="white")
    caption(ax, "Load and displacement while springs break", [result.outcome])
    return ax


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
        ax.legend(fontsize=8, framealpha=1.0, edgecolor="white")
        ax.set_ylim(bottom=0.5 * per_size[found].min())
    ax.set_xlabel("springs that break in one avalanche")
    ax.set_ylabel("avalanches of that size")
    ax.grid(color=LINE, lw=0.4)
    caption(ax, "Avalanches", [f"{counted(len(sizes), 'avalanche')} before the last one"])
    return ax


def breaking(result: FractureResult, magnification: float | None = None) -> Reel:
    """Return the network after every break, one frame each, as far as it resists."""
    last = result.standing
    stand = Stand(result.state(last), None, "tension", magnification)
    first = stand.draw_springs(1)
    stand.bar(first[0])
    for artist in first:
        artist.set_visible(False)

    def draw(count: int) -> list[Artist]:
        now = copy(stand)
        now.result = result.state(count)
        now.network = now.result.network
        return [*now.draw_springs(1), _draw_broken(now, result, count)]

    notes = stand.finish(TWO_LINES)

    def words(count: int) -> str:
        return "\n".join(_words(result, count))

    return Reel(figure_of(stand.ax), last, draw, notes, words)
