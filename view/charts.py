"""Charts: loads and displacements in stages, the ledger, forces through cuts, curves in time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.results.cuts import Cuts
from kaju.model.results.result import BodyResult, Curves
from kaju.model.transfer.transfer_result import TransferResult

from .load_plots import threshold_of
from .style import (
    COLOURS,
    FAINT,
    FORCE,
    INK,
    LINE,
    caption,
    figure_of,
    frame_curves,
    label_axis,
    legend,
    new_axes,
    new_figure,
)
from .units import counted, quantity


def applied_loads(result: TransferResult) -> Floats:
    """Return the sum of the applied forces (N) at the end of every stage."""
    every = range(1, len(result.stages) + 1)
    forces = (result.scene.applied(stage).force for stage in every)
    return np.array([np.linalg.norm(force, axis=1).sum() for force in forces])


def _loaded_displacements(result: TransferResult) -> Floats:
    """Return the mean displacement (m) of the loaded cells, weighted with and along the forces."""
    applied = result.scene.applied()
    weight = np.linalg.norm(applied.force, axis=1).sum()
    points = result.scene.lattice.centres(applied.cells)
    given = []
    for stage in range(1, len(result.stages) + 1):
        moved = result.at_stage(stage).displacement_at(points)
        given.append(np.einsum("ij,ij->", moved, applied.force) / weight if weight else 0.0)
    return np.array(given)


def plot_stages(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    quantity_shown: Literal["displacement", "agents"] | None = None,
) -> Axes | Figure:
    """Draw displacement or number of agents against the load; side by side unless one is asked."""
    if quantity_shown not in (None, "displacement", "agents"):
        raise ParameterError(f"quantity_shown: 'displacement' or 'agents', got {quantity_shown!r}")
    if ax is None and quantity_shown is None:
        figure = new_figure((9.6, 4.2))
        left, right = figure.subplots(1, 2)
        plot_stages(result, left, quantity_shown="displacement")
        plot_stages(result, right, quantity_shown="agents")
        about = f"{counted(len(result.stages), 'stage')} of loading, each run from the start"
        figure.suptitle(about, x=0.01, ha="left", fontsize=9, color=FAINT)
        return figure
    ax = new_axes(ax, (6.4, 4.2))
    load = np.append(0.0, applied_loads(result))
    gamma = threshold_of(result)
    if quantity_shown == "agents":
        title = "Agents against load"
        values = np.append(0, [len(stage.cells) for stage in result.stages])
        boundary = np.append(0, [len(stage.boundary_cells) for stage in result.stages])
        label_axis(ax.yaxis, "number of agents", [1.0], "")
        ax.plot(load, values, marker="s", ms=4, lw=1.4, color=INK, label="material agents")
        ax.plot(load, boundary, marker="o", ms=4, lw=1.2, mfc="white", color=FORCE,
                label="boundary agents")  # fmt: skip
    else:
        title = "Displacement against load"
        values = np.append(0.0, _loaded_displacements(result))
        label_axis(ax.yaxis, "displacement of the loaded cells", list(values), "m")
        ax.plot(load[[0, -1]], values[[0, -1]], ls="--", lw=1.0, color=FAINT, label="proportional")
        ax.plot(load, values, marker="o", ms=4, lw=1.4, color=INK, label="load transfer")
    # The band alone could not be seen where γ is a hundredth of the load; its edge can.
    ax.axvspan(0.0, gamma, color="#e6e6e6", lw=0.0)
    ax.axvline(gamma, color=FAINT, lw=1.0, ls=":", label=f"γ = {quantity(gamma, 'N')}")
    label_axis(ax.xaxis, "sum of the applied loads", list(load), "N")
    ax.set_xlim(0.0, 1.04 * float(load.max(initial=0.0)) or 1.0)
    grown = float(values.max(initial=0.0))
    ax.set_ylim(0.0, 1.06 * grown or 1.0)
    notes = [] if grown else ["no load exceeds γ: nothing happens"]
    return frame_curves(ax, title, notes, loc="upper left")


_SHARES = ("#3b6a8f", "#e2c14d", "#9fbfcf", "#b9b9b9")
_HATCHES = ("", "///", "...", "xx")


def plot_ledger(result: TransferResult, ax: Axes | None = None) -> Axes:
    """Draw the ledger of the last stage: two bars of equal length, and what was passed on."""
    ledger = result.last.ledger
    small = ledger.emitted - ledger.passed - ledger.returned
    bars = {
        "what entered": {"applied": ledger.applied, "sent out by agents": ledger.emitted},
        "what became of it": {
            "taken": ledger.taken,
            "dropped (up to γ)": ledger.dropped,
            "still on its way": ledger.pending,
        },
        "sent out": {
            "passed to agents": ledger.passed,
            "returned by boundaries": ledger.returned,
            "too small": max(small, 0.0),
        },
        "of it kept": {"as strain": ledger.kept},
    }
    ax = new_axes(ax, (7.6, 3.8))
    longest = max(ledger.applied + ledger.emitted, 1e-300)
    for row, parts in enumerate(bars.values()):
        _draw_bar(ax, row, parts, longest)
    ax.set_yticks(np.arange(len(bars)), list(bars), fontsize=9)
    ax.set_ylim(len(bars) - 0.4, -0.6)
    ax.set_xlim(0.0, longest)
    label_axis(ax.xaxis, "load", [longest], "N")
    for name in ("top", "right", "left"):
        ax.spines[name].set_visible(False)
    ax.tick_params(axis="y", length=0)
    lost = ledger.imbalance
    balance = f"to {lost:.0e} of all loads" if lost else "exactly"
    notes = [f"the books balance {balance}"]
    if ledger.applied > 0.0:
        often = f"{ledger.taken / ledger.applied:.3g} times"
        notes.append(
            f"{quantity(ledger.applied, 'N')} applied are taken {often} over: every agent that a "
            "load passes counts it anew"
        )
    caption(ax, "Ledger", notes)
    return ax


def _draw_bar(ax: Axes, row: int, parts: dict[str, float], longest: float) -> None:
    left = 0.0
    room = figure_of(ax).get_figwidth() * 0.82
    for number, (name, load) in enumerate(parts.items()):
        if load <= 0.0:
            continue
        ax.barh(row, load, left=left, height=0.5, color=_SHARES[number], hatch=_HATCHES[number],
                edgecolor="white", linewidth=0.6)  # fmt: skip
        label = f"{name}\n{quantity(load, 'N')}"
        middle = left + 0.5 * load
        if room * load / longest > 0.085 * max(map(len, label.split("\n"))):
            box = {"fc": "white", "ec": "none", "pad": 1.0, "alpha": 0.85}
            ax.text(middle, row, label, ha="center", va="center", fontsize=7.5, color=INK, bbox=box)
        else:
            side = "right" if left > 0.5 * longest else "left"
            ax.annotate(
                label.replace("\n", " "),
                (middle, row + 0.25),
                (0, -3),
                textcoords="offset points",
                ha=side,
                va="top",
                fontsize=7.5,
                color=INK,
            )
        left += load


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
    look: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": "--", "marker": "s", "ms": 3.5}
    ax.plot(*line, mfc="white", label="needed for equilibrium", **look)
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
    caption(ax, "Force through each cut", _balance_notes(cuts, isinstance(result, TransferResult)))
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


def _balance_notes(cuts: Cuts, prescribed: bool) -> list[str]:
    """Say whether equilibrium is kept."""
    missing, load = cuts.missing, abs(cuts.load)
    if np.isnan(missing).all():
        return ["supports hold the body on both sides of every cut: what it needs is not known"]
    worst = float(np.nanmax(np.abs(missing)))
    largest = max(load, float(np.nanmax(np.abs(cuts.balance))))
    if worst <= KEPT * largest:
        return [f"every cut carries what lies on it, to {worst:.0e} N"]
    notes = [f"up to {quantity(worst, 'N')} of {quantity(largest, 'N')} are missing"]
    if prescribed:
        notes.append("the prescribed rule shows how a pattern emerges, it keeps no equilibrium")
    return notes


_ACROSS = 2  # panels side by side
_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


class HasCurves(Protocol):
    """An answer that changes along something."""

    def curves(self) -> Sequence[Curves]:
        """Return what changes, a panel each."""


def plot_curves(result: HasCurves, ax: Axes | None = None, *, panel: int = 0) -> Axes | Figure:
    """Draw all curves of a result, or one panel of them on axes that are given."""
    every = result.curves()
    if ax is not None:
        return draw_curves(ax, every[panel])
    figure, panels = panels_for(every)
    for drawn, curves in zip(panels, every, strict=True):
        draw_curves(drawn, curves)
    return figure


def panels_for(every: Sequence[Curves]) -> tuple[Figure, list[Axes]]:
    """Return a new figure, and axes in it for each of some curves."""
    rows, across = -(-len(every) // _ACROSS), min(_ACROSS, len(every))
    figure = new_figure((4.9 * across, 3.6 * rows))
    panels = figure.subplots(rows, across, squeeze=False).ravel().tolist()
    for empty in panels[len(every) :]:
        empty.set_axis_off()
    return figure, panels[: len(every)]


def draw_curves(ax: Axes, curves: Curves) -> Axes:
    """Draw the lines of one panel, with units and, if there are several, their names."""
    single = len(curves.lines) == 1
    for number, (name, values) in enumerate(curves.lines.items()):
        colour = INK if single else COLOURS[number % len(COLOURS)]
        dash = _DASHES[number % len(_DASHES)]
        ax.plot(curves.at, values, lw=1.4, color=colour, ls=dash, label=name)
    label_axis(
        ax.xaxis, curves.along, [float(curves.at.min()), float(curves.at.max())], curves.along_unit
    )
    called = next(iter(curves.lines)) if single else curves.title.lower()
    if curves.logarithmic:
        ax.set_yscale("log")
        ax.set_ylabel(f"{called} ({curves.unit})" if curves.unit else called, fontsize=9)
        ax.tick_params(labelsize=8)
    else:
        every = np.concatenate(list(curves.lines.values()))
        label_axis(ax.yaxis, called, [float(every.min()), float(every.max())], curves.unit)
        ax.axhline(0.0, color=FAINT, lw=0.6, zorder=0)
    ax.grid(color=LINE, lw=0.4)
    for spine in ax.spines.values():
        spine.set_color(LINE)
    if not single:
        ax.legend(fontsize=8, frameon=False, loc="best")
    caption(ax, curves.title, [])
    return ax
