"""Work–precision diagrams: cost against error, both axes logarithmic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kaju.view.files import save
from kaju.view.style import FAINT, INK, new_figure

from .measure import Measurement
from .methods import METHODS
from .problems import PROBLEMS

STYLES = {
    "multigrid": ("#0b5394", "o", "-"),
    "spawning": ("#0b5394", "o", "--"),
    "wave": ("#5fa8d3", "^", "-"),
    "largest_first": ("#5fa8d3", "v", "--"),
    "prescribed": ("#c8963e", "s", "-"),
    "fitted": ("#c8963e", "D", "--"),
    "direct": ("#7a7a7a", "x", "-"),
    "algebraic": ("#b2340b", "+", "-"),
    "dolfinx": ("#4d8b57", "*", "-"),
}
COSTS = {"seconds": "time (s)", "memory": "memory (MB)"}


def draw(found: Sequence[Measurement], path: Path) -> Path:
    """Draw time and memory against the largest error, one column for each problem."""
    names = [name for name in PROBLEMS if any(m.problem == name for m in found)]
    figure = new_figure((3.5 * len(names) + 0.6, 6.6))
    grid = figure.subplots(len(COSTS), len(names), squeeze=False, sharex="col", sharey="row")
    handles = {}
    for column, name in enumerate(names):
        for row, (cost, label) in enumerate(COSTS.items()):
            ax = grid[row][column]
            for method in METHODS:
                points = [
                    (m.max_error, getattr(m, cost))
                    for m in found
                    if (m.problem, m.method) == (name, method) and getattr(m, cost)
                ]
                if points:
                    colour, marker, line = STYLES[method]
                    (handles[method],) = ax.loglog(
                        *zip(*points, strict=True),
                        color=colour,
                        marker=marker,
                        linestyle=line,
                        linewidth=1.2,
                        markersize=5,
                        fillstyle="none" if line == "--" else "full",
                    )
            ax.grid(True, which="major", color="#e4e4e4", linewidth=0.6)
            ax.tick_params(labelsize=8, color=FAINT)
            if column == 0:
                ax.set_ylabel(label, fontsize=9)
        grid[0][column].set_title(name, loc="left", fontsize=11, fontweight="bold", color=INK)
        grid[-1][column].set_xlabel("largest error: smaller to the right", fontsize=9)
        grid[-1][column].invert_xaxis()
    figure.legend(
        list(handles.values()),
        [METHODS[method].title for method in handles],
        loc="outside lower center",
        ncols=min(4, len(handles)),
        fontsize=8,
        frameon=False,
    )
    return save(figure, path)
