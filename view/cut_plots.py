"""Force through every cut: what an answer carries, beside what equilibrium needs."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from kaju.model.results.cuts import Cuts
from kaju.model.results.result import BodyResult
from kaju.model.transfer.transfer_result import TransferResult

from .style import FAINT, INK, caption, label_axis, legend, new_axes
from .units import quantity

_BAR = "#4f7fa8"
KEPT = 1e-6
"""Forces below this share of the load are what rounding and iterations leave."""


def plot_cuts(result: BodyResult, ax: Axes | None = None, *, axis: str | None = None) -> Axes:
    """Draw the force through every cut, a bar where each lies, and what equilibrium needs."""
    cuts = result.cuts(axis)
    ax = new_axes(ax, (6.4, 4.6))
    upright = cuts.axis == "xyz"[result.scene.lattice.dimension - 1]
    thick = np.gradient(cuts.at) if len(cuts.at) > 1 else np.full(1, 0.5 * float(cuts.at[0]))
    draw_bars = ax.barh if upright else ax.bar
    draw_bars(cuts.at, cuts.carried, 0.82 * thick, color=_BAR, label="carried")
    line = (cuts.balance, cuts.at) if upright else (cuts.at, cuts.balance)
    look: dict[str, Any] = {
        "color": INK,
        "linewidth": 1.0,
        "linestyle": "--",
        "marker": "s",
        "markersize": 3.5,
    }
    ax.plot(*line, markerfacecolor="white", label="needed for equilibrium", **look)
    ends = frame_cuts(ax, cuts, upright)
    if np.isfinite(ends).all():
        for place, force in zip(cuts.at, cuts.carried, strict=True):
            if len(cuts.at) <= 24 and upright and abs(force) > KEPT * np.abs(ends).max():
                inside = force > 0.8 * max(ends)
                shift, anchor = (-3, "right") if inside else (3, "left")
                ink = "white" if inside else FAINT
                ax.annotate(f"{force:.4g}", (force, place), (shift, 0), fontsize=7, color=ink,
                            textcoords="offset points", ha=anchor, va="center")  # fmt: skip
    legend(ax, ax.get_legend_handles_labels()[0])
    caption(ax, "Force through each cut", words_of(cuts, isinstance(result, TransferResult)))
    return ax


def frame_cuts(ax: Axes, cuts: Cuts, upright: bool = True) -> list[float]:
    """Label both axes; return the ends of the forces (N)."""
    forces = np.concatenate([cuts.carried, cuts.balance[np.isfinite(cuts.balance)], [0.0]])
    place, force = (ax.yaxis, ax.xaxis) if upright else (ax.xaxis, ax.yaxis)
    label_axis(place, cuts.axis, cuts.at.tolist(), "m")
    label_axis(force, "force", forces.tolist(), "N")
    for name in ("top", "right"):
        ax.spines[name].set_visible(False)
    return [float(forces.min()), float(forces.max())]


def words_of(cuts: Cuts, prescribed: bool) -> list[str]:
    """Say in words whether equilibrium is kept."""
    missing, load = cuts.missing, abs(cuts.load)
    if np.isnan(missing).all():
        return ["supports hold the body on both sides of every cut: what it needs is not known"]
    worst = float(np.nanmax(np.abs(missing)))
    largest = max(load, float(np.nanmax(np.abs(cuts.balance))))
    if worst <= KEPT * largest:
        return [f"every cut carries what lies on it, to {worst:.0e} N"]
    told = [f"up to {quantity(worst, 'N')} of {quantity(largest, 'N')} are missing"]
    if prescribed:
        told.append("the prescribed rule shows how a pattern emerges, it keeps no equilibrium")
    return told
