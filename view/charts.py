"""Charts: what changes along a run, the ledger, forces through cuts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.arrays import Floats
from kaju.model.results.cuts import Cuts
from kaju.model.results.result import BodyResult, Curves
from kaju.model.transfer.transfer_result import TransferResult

from .films import PER_SECOND, Film
from .load_plots import threshold_of
from .section import check_number
from .style import COLOURS, FAINT, INK, LINE, caption, label_axis, legend, new_axes, new_figure
from .units import counted, quantity

if TYPE_CHECKING:
    from kaju.model.fracture.fracture_result import FractureResult
    from kaju.model.growth.growth_result import GrowthResult
    from kaju.model.network.network_result import NetworkResult
    from kaju.model.rheology.creep_result import TimeResult


def applied_loads(result: TransferResult) -> Floats:
    """Return the sum of the applied forces (N) at the end of every stage."""
    every = range(1, len(result.stages) + 1)
    forces = (result.scene.applied(stage).force for stage in every)
    return np.array([np.linalg.norm(force, axis=1).sum() for force in forces])


def stage_curves(result: TransferResult) -> list[Curves]:
    """Return displacement of the loaded cells, weighted with the forces, and agents over load."""
    applied, count = result.scene.applied(), len(result.stages)
    weight = float(np.linalg.norm(applied.force, axis=1).sum()) or 1.0
    points = result.scene.lattice.centres(applied.cells)
    ended = [result.at_stage(stage).displacement_at(points) for stage in range(1, count + 1)]
    moved = np.append(0.0, [(at * applied.force).sum() / weight for at in ended])
    load = np.append(0.0, applied_loads(result))
    straight = moved[-1] * load / (load[-1] or 1.0)
    over = "sum of the applied loads", "N", load
    agents = {
        "material agents": np.append(0.0, [len(stage.cells) for stage in result.stages]),
        "boundary agents": np.append(0.0, [len(stage.boundary_cells) for stage in result.stages]),
    }
    moves = {"load transfer": moved, "proportional": straight}
    return [
        Curves("Displacement under the load", *over, moves, "m"),
        Curves("Number of agents", *over, agents, ""),
    ]


def network_curves(result: NetworkResult) -> list[Curves]:
    """Return the largest displacement and the largest forces along the load path."""
    moved = np.linalg.norm(result.displacement, axis=2).max(axis=1)
    pull = {"pull": result.tension.max(axis=1), "push": result.tension.min(axis=1)}
    over = "stage", "", result.stage
    return [
        Curves("Displacement", *over, {"largest displacement": moved}, "m"),
        Curves("Largest forces", *over, pull, "N"),
    ]


def growth_curves(result: GrowthResult) -> list[Curves]:
    """Return compliance, volume and how much of it is pulled, after every step."""
    over = ("step", "", np.arange(result.steps + 1.0))
    return [
        Curves("Compliance", *over, {"compliance": result.compliances}, "J"),
        Curves("Volume", *over, {"volume": 100.0 * result.volumes}, "%"),
        Curves("Pulled", *over, {"pulled": 100.0 * result.pulled_shares}, "%"),
    ]


def last_loaded(result: FractureResult) -> int:
    """Return the last break at a fiftieth of the largest load: what bears less moves too far."""
    force = np.append(0.0, result.force)
    return int(np.flatnonzero(force >= 0.02 * force.max())[-1])


def fracture_curves(result: FractureResult) -> list[Curves]:
    """Return load, load over way, avalanches, energies and way at every break."""
    force, way = (np.append(0.0, column) for column in (result.force, result.displacement))
    loaded = 1 + last_loaded(result)
    broken = [0.0, *(k + 1.0 for size in result.avalanche_sizes for k in range(size))]
    energy = {n: np.append(0.0, getattr(result, n)) for n in ("work", "stored", "released")}
    over, course = ("break", "", np.arange(result.breaks + 1.0)), {"load": force[:loaded]}
    moved = "break", "", np.arange(float(loaded))
    return [
        Curves("Load", *over, {"load": force}, "N"),
        Curves("Load over displacement", "displacement", "m", way[:loaded], course, "N"),
        Curves("Breaks of the avalanche", *over, {"size": np.array(broken)}, "", bars=True),
        Curves("Energy", *over, energy, "J"),
        Curves("Displacement", *moved, {"displacement": way[:loaded]}, "m"),
    ]


_CURVES: Any = {
    "load transfer": stage_curves,
    "spring network": network_curves,
    "growth": growth_curves,
    "fracture": fracture_curves,
}


def plot_curves(result: Any, ax: Axes | None = None, *, panel: int = 0) -> Axes | Figure:
    """Draw all curves of a result, or one panel of them on axes that are given."""
    every = _CURVES[result.kind](result) if result.kind in _CURVES else result.curves()
    if ax is not None:
        for curves in every[panel : panel + 1]:
            draw_curves(ax, curves)
        return ax
    rows, across = -(-len(every) // 2), min(2, len(every))
    figure = new_figure((4.9 * across, 3.6 * rows))
    for number, curves in enumerate(every, 1):
        draw_curves(figure.add_subplot(rows, across, number), curves)
    return figure


_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


def draw_curves(ax: Axes, curves: Curves) -> None:
    """Draw the lines of one panel, with units and, if there are several, their names."""
    single = len(curves.lines) == 1
    for number, (name, values) in enumerate(curves.lines.items()):
        colour = INK if single else COLOURS[number % len(COLOURS)]
        dash = _DASHES[number % len(_DASHES)]
        if curves.bars:
            ax.bar(curves.at, values, 0.7, color=colour, label=name)
        else:
            ax.plot(curves.at, values, lw=1.4, color=colour, ls=dash, label=name)
    ends = [float(curves.at.min()), float(curves.at.max())]
    label_axis(ax.xaxis, curves.along, ends, curves.along_unit)
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


def plot_stages(result: TransferResult, ax: Axes | None = None, *, panel: int = 0) -> Axes | Figure:
    """Draw displacement and number of agents against the load, and γ."""
    drawn, gamma = plot_curves(result, ax, panel=panel), threshold_of(result)
    for each in drawn.axes if isinstance(drawn, Figure) else [drawn]:
        label = f"γ = {quantity(gamma, 'N')}"
        each.axvline(gamma, color=FAINT, lw=1.0, ls=":", label=label, gid="threshold")
        each.legend(fontsize=8, frameon=False, loc="best")
        if not len(result.last.cells):
            caption(each, each.get_title(loc="left"), ["no load exceeds γ: nothing happens"])
    if isinstance(drawn, Figure):
        about = f"{counted(len(result.stages), 'stage')} of loading, each run from the start"
        drawn.suptitle(about, x=0.01, ha="left", fontsize=9, color=FAINT)
    return drawn


def from_end(record: int, count: int) -> int:
    """Return the number of a record counted from 0, of one that may count from the end."""
    check_number("record", record + count * (record < 0), count - 1)
    return record % count


def moment_text(course: TimeResult, record: int) -> str:
    """Return a time, and the factor of the history then."""
    return f"time {course.times[record]:.4g} s; history at {course.factors[record]:.3g}"


def plot_curves_in_time(
    course: TimeResult, ax: Axes | None = None, *, panel: int = 0, record: int | None = None
) -> Axes | Figure:
    """Draw all curves of what creeps, with a dot at one of the times if that is asked for."""
    drawn = plot_curves(course, ax, panel=panel)
    if record is None:
        return drawn
    panels = drawn.axes if isinstance(drawn, Figure) else [drawn]
    for each, curves in zip(panels, course.curves()[0 if ax is None else panel :], strict=False):
        now = float(curves.at[from_end(record, len(course.times))])
        reached = [float(values[record]) for values in curves.lines.values()]
        each.axvline(now, color="#9a9a9a", lw=0.8, zorder=1)
        each.plot([now] * len(reached), reached, "o", ms=4, color=INK, zorder=5)
    return drawn


IN_TIME = Film("curves", "record", lambda course: range(len(course.times)), fps=PER_SECOND)
"""The curves of what creeps, and a dot that runs along them."""


KEPT = 1e-6
"""Forces below this share of the load are what rounding and iterations leave."""


def plot_cuts(result: BodyResult, ax: Axes | None = None, *, axis: str | None = None) -> Axes:
    """Draw the force through every cut, a bar where each lies, and what equilibrium needs."""
    cuts = result.cuts(axis)
    ax = new_axes(ax, (6.4, 4.6))
    upright = cuts.axis == "xyz"[result.scene.lattice.dimension - 1]
    thick = np.gradient(cuts.at) if len(cuts.at) > 1 else np.full(1, 0.5 * float(cuts.at[0]))
    draw_bars = ax.barh if upright else ax.bar
    bars = draw_bars(cuts.at, cuts.carried, 0.82 * thick, color="#4f7fa8", label="carried")
    line = (cuts.balance, cuts.at) if upright else (cuts.at, cuts.balance)
    look: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": "--", "marker": "s", "ms": 3.5}
    ax.plot(*line, mfc="white", label="needed for equilibrium", **look)
    ends = frame_cuts(ax, cuts, upright)
    if upright and len(cuts.at) <= 24 and np.isfinite(ends).all():
        seen = np.abs(cuts.carried) > KEPT * np.abs(ends).max()
        told = [f"{n:.4g}" if kept else "" for n, kept in zip(cuts.carried, seen, strict=True)]
        look = {"fontsize": 7, "color": FAINT, "bbox": {"fc": "white", "ec": "none", "pad": 0.5}}
        ax.bar_label(bars, told, padding=6, **look)
        ax.margins(x=0.12)
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
        notes.append("the prescribed rule shows how a pattern emerges; it keeps no equilibrium")
    return notes
