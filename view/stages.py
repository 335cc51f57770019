"""Staged loading: what grows with the load, and why it is no straight line."""

from __future__ import annotations

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.transfer.transfer_result import TransferResult

from .agents import threshold_of
from .style import FAINT, FORCE, INK, frame_curves, label_axis, new_axes, new_figure
from .units import counted, quantity

Growing = Literal["displacement", "agents"]


def applied_loads(result: TransferResult) -> Floats:
    """Return the sum of the applied forces (N) at the end of every stage."""
    every = range(1, len(result.stages) + 1)
    forces = (result.scene.applied(stage).force for stage in every)
    return np.array([np.linalg.norm(force, axis=1).sum() for force in forces])


def loaded_displacements(result: TransferResult) -> Floats:
    """Return by how much the loaded cells gave way (m) at the end of every stage.

    It is the mean of their displacements along the forces, weighted with these.
    """
    applied = result.scene.applied()
    weight = np.linalg.norm(applied.force, axis=1).sum()
    points = result.scene.lattice.centres(applied.cells)
    given = []
    for stage in range(1, len(result.stages) + 1):
        moved = result.at_stage(stage).displacement_at(points)
        given.append(np.einsum("ij,ij->", moved, applied.force) / weight if weight else 0.0)
    return np.array(given)


def plot_stages(
    result: TransferResult, ax: Axes | None = None, *, quantity_shown: Growing = "displacement"
) -> Axes:
    """Draw how far the loaded cells give way, or how many agents there are, against the load."""
    if quantity_shown not in ("displacement", "agents"):
        raise ParameterError(f"quantity_shown: 'displacement' or 'agents', got {quantity_shown!r}")
    ax = new_axes(ax, (6.4, 4.2))
    load = np.append(0.0, applied_loads(result))
    gamma = threshold_of(result)
    if quantity_shown == "displacement":
        values = np.append(0.0, loaded_displacements(result))
        label_axis(ax.yaxis, "displacement of the loaded cells", list(values), "m")
        ax.plot(load[[0, -1]], values[[0, -1]], ls="--", lw=1.0, color=FAINT, label="proportional")
        ax.plot(load, values, marker="o", ms=4, lw=1.4, color=INK, label="load transfer")
    else:
        values = np.append(0, [len(stage.cells) for stage in result.stages])
        boundary = np.append(0, [len(stage.boundary_cells) for stage in result.stages])
        label_axis(ax.yaxis, "number of agents", [1.0], "")
        ax.plot(load, values, marker="s", ms=4, lw=1.4, color=INK, label="material agents")
        ax.plot(load, boundary, marker="o", ms=4, lw=1.2, mfc="white", color=FORCE,
                label="boundary agents")  # fmt: skip
    # The band alone could not be seen where γ is a hundredth of the load; its edge can.
    ax.axvspan(0.0, gamma, color="#e6e6e6", lw=0.0)
    ax.axvline(gamma, color=FAINT, lw=1.0, ls=":", label=f"γ = {quantity(gamma, 'N')}")
    label_axis(ax.xaxis, "sum of the applied loads", list(load), "N")
    ax.set_xlim(0.0, 1.04 * float(load.max(initial=0.0)) or 1.0)
    grown = float(values.max(initial=0.0))
    ax.set_ylim(0.0, 1.06 * grown or 1.0)
    quiet = "no load exceeds γ: nothing happens"
    notes = [] if grown else [quiet]
    return frame_curves(ax, _TITLES[quantity_shown], notes, loc="upper left")


_TITLES = {"displacement": "Displacement against load", "agents": "Agents against load"}


def plot_both(result: TransferResult) -> Figure:
    """Draw displacement and number of agents against the load, side by side."""
    figure = new_figure((9.6, 4.2))
    left, right = figure.subplots(1, 2)
    plot_stages(result, left)
    plot_stages(result, right, quantity_shown="agents")
    about = f"{counted(len(result.stages), 'stage')} of loading, each run from the start"
    figure.suptitle(about, x=0.01, ha="left", fontsize=9, color=FAINT)
    return figure
