"""Pictures of what was measured, from the rows that `benchmarks/spawning_beside.py` wrote."""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from kaju.view.files import save
from kaju.view.style import FAINT, INK, new_figure

from .measure import METHODS
from .scenes import cases

STYLES = {
    "spawning": ("#0b5394", "o", "-"),
    "aimed": ("#0b5394", "o", ":"),
    "equal": ("#5fa8d3", "s", "-"),
    "uniform": ("#7a7a7a", "x", "-"),
    "adaptive": ("#b2340b", "+", "-"),
    "adaptive 2": ("#c8963e", "+", "--"),
}
AXES = {
    ("seconds", "energy_error"): ("time (s)", "error in the energy norm"),
    ("unknowns", "energy_error"): ("unknowns", "error in the energy norm"),
    ("seconds", "max_error"): ("time (s)", "largest displacement error"),
    ("unknowns", "max_error"): ("unknowns", "largest displacement error"),
}


def read_rows(path: Path):
    """Return what `write_rows` wrote, numbers as numbers; nothing if there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [
            SimpleNamespace(**{k: _value(v) for k, v in r.items()}) for r in csv.DictReader(file)
        ]


def _value(text):
    try:
        return float(text)
    except ValueError:
        return text


def draw(folder: Path) -> list[Path]:
    """Draw all pictures whose rows are there."""
    found = []
    bodies = {name: read_rows(folder / f"{name}.csv") for name in cases()}
    bodies = {name: rows for name, rows in bodies.items() if rows}
    if bodies:
        for error in ("energy_error", "max_error"):
            found.append(save(work_figure(bodies, error), folder / f"work_{error}.png"))
    for name, figure in (("order", order_figure), ("effectivity", effectivity_figure)):
        rows = read_rows(folder / f"{name}.csv")
        if rows:
            found.append(save(figure(rows), folder / f"{name}.png"))
    return found


def _bare(ax, title):
    ax.set_title(title, loc="left", fontsize=10, fontweight="bold", color=INK)
    ax.grid(True, which="major", color="#e4e4e4", linewidth=0.6)
    ax.tick_params(labelsize=8, color=FAINT)


def work_figure(bodies, error):
    """Return error against time and against unknowns, a column for each body."""
    figure = new_figure((2.6 * len(bodies) + 0.8, 5.6))
    grid = figure.subplots(2, len(bodies), squeeze=False, sharey="row")
    handles = {}
    for column, (name, rows) in enumerate(bodies.items()):
        for row, cost in enumerate(("seconds", "unknowns")):
            ax = grid[row][column]
            for method, (colour, marker, line) in STYLES.items():
                points = [(getattr(r, cost), getattr(r, error)) for r in rows if r.method == method]
                if points:
                    (handles[method],) = ax.loglog(
                        *zip(*points, strict=True),
                        color=colour,
                        marker=marker,
                        linestyle=line,
                        linewidth=1.2,
                        markersize=4,
                    )
            label, vertical = AXES[cost, error]
            _bare(ax, name if row == 0 else "")
            ax.set_xlabel(label, fontsize=9)
            if column == 0:
                ax.set_ylabel(vertical, fontsize=9)
    figure.legend(
        list(handles.values()),
        [METHODS[method] for method in handles],
        loc="outside lower center",
        ncols=min(3, len(handles)),
        fontsize=8,
        frameon=False,
    )
    return figure


def order_figure(rows):
    """Return the errors on the L against the number of cells, with the slopes of theory."""
    figure = new_figure((5.2, 4.2))
    ax = figure.subplots()
    for strategy, colour in (("spawning", "#0b5394"), ("uniform", "#5fa8d3")):
        some = [r for r in rows if r.strategy == strategy]
        for name, marker, line in (
            ("stress", "o", "-"),
            ("energy", "x", ":"),
            ("estimate", "", "--"),
        ):
            ax.loglog(
                [r.cells for r in some],
                [getattr(r, name) for r in some],
                color=colour,
                marker=marker,
                linestyle=line,
                linewidth=1.2,
                markersize=4,
                label=f"{'agents' if strategy == 'spawning' else 'equal cells'}, {name}",
            )
    cells = np.array([400.0, 4e4])
    for power, start in ((-0.5, 0.045), (-0.272, 0.16)):
        ax.loglog(cells, start * (cells / cells[0]) ** power, color=FAINT, linewidth=0.8)
        ax.annotate(f"{power:g}", (cells[1], start * (cells[1] / cells[0]) ** power), fontsize=8)
    _bare(ax, "L-shaped body")
    ax.set_xlabel("cells", fontsize=9)
    ax.set_ylabel("error in the energy norm", fontsize=9)
    ax.legend(fontsize=7, frameon=False)
    return figure


def effectivity_figure(rows):
    """Return the estimated over the true error of all bodies, against the tolerance."""
    figure = new_figure((5.2, 3.6))
    ax = figure.subplots()
    for name in dict.fromkeys(r.case for r in rows):
        some = [r for r in rows if r.case == name]
        factors = [r.estimate / r.energy_error for r in some]
        ax.semilogx([r.setting for r in some], factors, marker="o", markersize=4, label=name)
    ax.axhspan(0.5, 3.0, color="#eef3f8", zorder=0)
    ax.axhline(1.0, color=FAINT, linewidth=0.8)
    ax.set_ylim(0.0, 3.2)
    ax.invert_xaxis()
    _bare(ax, "estimate / true error")
    ax.set_xlabel("tolerance", fontsize=9)
    ax.legend(fontsize=8, frameon=False, ncols=2)
    return figure
