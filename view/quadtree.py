"""Agents of many sizes: a quadtree, or a layer of an octree, coloured by what they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.colors import BoundaryNorm, LogNorm, Normalize

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError

from .style import (
    SEQUENTIAL,
    SIZE,
    add_polygons,
    caption,
    colour_bar,
    fit_figure,
    label_axis,
    new_axes,
)
from .units import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from kaju.model.spawning.spawned_result import SpawnedResult


class Colour(NamedTuple):
    """What agents can be coloured by: attribute of the result, label and unit."""

    attribute: str
    label: str
    unit: str


COLOURS = {
    "level": Colour("level", "level: how often the largest agent was halved", ""),
    "spawn_step": Colour("spawn_step", "step in which the agent spawned", ""),
    "unbalanced_load": Colour("unbalanced_load", "load that the agent leaves unbalanced", "N"),
    "von_mises": Colour("von_mises", "equivalent stress", "Pa"),
}
MANY = 20_000
"""More agents than this are drawn without outlines."""
DECADES = 6


def plot_quadtree(
    result: SpawnedResult,
    ax: Axes | None = None,
    *,
    colour: str = "level",
    cut: Mapping[str, float] | None = None,
    step: int | None = None,
) -> Axes:
    """Draw agents at their places and in their sizes.

    Parameters
    ----------
    result : SpawnedResult
        Agents of many sizes.
    ax : matplotlib Axes, optional
        Where to draw; a new figure unless given.
    colour : {"level", "spawn_step", "unbalanced_load", "von_mises"}
        What the colours show.
    cut : dict, optional
        Of a three-dimensional body the plane to show, such as ``{"y": 0.05}`` (m); by
        default through the agent that spawned last.
    step : int, optional
        Outline boldly the agents that spawned in this step.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ParameterError
        For an unknown colour, a plane outside of the body, or a cut through two dimensions.
    """
    if colour not in COLOURS:
        raise ParameterError(
            f"colour: there is no {colour!r}{suggestion(colour, COLOURS)}; there is "
            f"{', '.join(COLOURS)}"
        )
    shown, axes, place = _layer(result, cut)
    what = COLOURS[colour]
    values = np.asarray(getattr(result, what.attribute), dtype=np.float64)
    ax = new_axes(ax)
    lower, size = result.lower[shown][:, axes], result.size[shown]
    ring = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    corners = lower[:, None] + ring * size[:, None, None]
    thin = 0.0 if len(size) > MANY else 0.25
    drawn = add_polygons(
        ax,
        corners,
        "agents",
        array=values[shown],
        cmap=SIZE if colour == "level" else SEQUENTIAL,
        norm=_norm(values, whole=not what.unit),
        edgecolors="#262626" if thin else "none",
        linewidths=thin,
    )
    if step is not None:
        born = result.spawn_step[shown] == step
        look = {"facecolors": "none", "edgecolors": "#b2340b", "linewidths": 1.2}
        add_polygons(ax, corners[born], "spawned", **look)
    low, high = lower.min(axis=0), (lower + size[:, None]).max(axis=0)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    label_axis(ax.xaxis, "xyz"[axes[0]], (low[0], high[0]), "m")
    label_axis(ax.yaxis, "xyz"[axes[1]], (low[1], high[1]), "m")
    bar = colour_bar(ax, drawn, what.label, what.unit)
    if not what.unit:
        last = int(values.max())
        bar.set_ticks(list(range(0, last + 1, 1 + last // 12)))
        bar.ax.minorticks_off()
    span = high - low
    fit_figure(ax, float(span[0] / span[1]), 0)
    steps = len(result.generations) - 1
    counts = f"{counted(result.agents, 'agent')} after {counted(steps, 'step')} of spawning"
    caption(ax, "Agents", [counts, f"estimated error {result.error_estimate:.2g}{place}"])
    return ax


def _layer(
    result: SpawnedResult, cut: Mapping[str, float] | None
) -> tuple[NDArray[np.bool_], list[int], str]:
    """Return which agents a plane meets, the axes in it, and where it lies in words."""
    d = result.lower.shape[1]
    if d == 2:
        if cut:
            raise ParameterError("cut: belongs to three dimensions; leave it out")
        return np.ones(result.agents, dtype=np.bool_), [0, 1], ""
    if cut is None:
        last = int(np.argmin(result.size))
        cut = {"y": float(result.lower[last, 1] + 0.5 * result.size[last])}
    if len(cut) != 1 or not set(cut) <= set("xyz"):
        raise ParameterError(f"cut: names one of x, y and z, such as {{'y': 0.05}}; got {cut}")
    ((name, place),) = cut.items()
    axis = "xyz".index(name)
    low = result.lower[:, axis]
    shown = (low <= place) & (place < low + result.size)
    if not shown.any():
        raise ParameterError(f"cut: no agent stands at {name} = {place:g} m")
    return shown, [a for a in range(3) if a != axis], f"; cut at {name} = {place:g} m"


def _norm(values: NDArray[np.float64], *, whole: bool) -> Normalize:
    if whole:
        last = int(values.max())
        return BoundaryNorm(np.arange(-0.5, last + 1.0), 256)
    high = float(values.max()) or 1.0
    low = float(values[values > 0].min(initial=high))
    return LogNorm(max(low, high / 10**DECADES, np.finfo(float).tiny), high * (1 + 1e-12))
