"""Spring networks: how they give way, which springs are pulled and which are pressed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kaju.errors import ParameterError

from .network_stand import Colour, Stand
from .reels import TWO_LINES, Reel
from .style import FAINT, INK, LINE, caption, figure_of, label_axis, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaju.model.network.network_result import NetworkResult


def plot_network(
    result: NetworkResult,
    ax: Axes | None = None,
    *,
    record: int = -1,
    colour: Colour = "tension",
    magnification: float | None = None,
) -> Axes:
    """Draw a loaded network over the one at rest, its springs coloured by tension or strain."""
    stand = Stand(result, ax, colour, magnification)
    if not -len(stand.records) <= record < len(stand.records):
        raise ParameterError(
            f"record: this result has the records 0 to {len(stand.records) - 1}, got {record}"
        )
    stand.draw_rest()
    springs = stand.draw_springs(record)[0]
    stand.bar(springs)
    stand.finish(stand.words(record))
    return stand.ax


def plot_response(result: NetworkResult, ax: Axes | None = None) -> Axes:
    """Draw how far the node that moves most has moved, along the load path."""
    name, _ = result.largest_displacement()
    moved = np.linalg.norm(result.displacement[:, result.network.node(name)], axis=1)
    ax = new_axes(ax, (6.4, 4.2))
    ax.plot(result.stage, moved, marker="o", ms=4, lw=1.4, color=INK, label=f"node {name}")
    if result.network.stages == 1:
        ends = [0.0, float(result.stage[-1])]
        ax.plot(ends, [0.0, moved[-1]], ls="--", lw=1.0, color=FAINT, label="proportional")
    label_axis(ax.xaxis, "load path (1: end of the first stage)", list(result.stage), "")
    label_axis(ax.yaxis, "displacement", list(moved), "m")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.grid(color=LINE, lw=0.4)
    ax.legend(fontsize=8, loc="upper left", framealpha=1.0, edgecolor="white")
    caption(ax, "Displacement along the load path", [])
    return ax


def increments(
    result: NetworkResult, colour: Colour = "tension", magnification: float | None = None
) -> Reel:
    """Return the states of a network, one frame each."""
    stand = Stand(result, None, colour, magnification)
    stand.draw_rest()
    first = stand.draw_springs(0)
    stand.bar(first[0])
    for artist in first:
        artist.set_visible(False)
    notes = stand.finish(TWO_LINES)
    last = len(stand.records) - 1

    def words(record: int) -> str:
        load, shown = stand.words(record)
        return f"increment {record} of {last}; {load}\n{shown}"

    return Reel(figure_of(stand.ax), last, stand.draw_springs, notes, words)
