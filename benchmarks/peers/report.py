"""What the benchmark found, for people: table, picture, ratios at equal error, the machine."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from shutil import copyfile
from textwrap import fill

import numpy as np
import pandas as pd

from kaju.view.picture_files import save
from kaju.view.style import FAINT, INK, new_figure

from .measure import Measurement
from .methods import METHODS
from .problems import PROBLEMS

PACKAGES = ("kaju", "numpy", "scipy", "numba", "mesa", "scikit-fem", "pyamg", "pypardiso")

HEADER = "| method | cells | time (s) | memory (MB) | largest error | r.m.s. error |"


def environment() -> dict[str, str]:
    """Return the machine and the versions that figures depend on."""
    found = {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "system": platform.platform(),
        "load when it ended": f"{os.getloadavg()[0]:.1f}"
        if hasattr(os, "getloadavg")
        else "unknown",
        "python": platform.python_version(),
    }
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _processor() -> str:
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
            names = [line.partition(":")[2].strip() for line in lines if "model name" in line]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or "unknown"


def write_csv(path: Path, found: Sequence[Measurement]) -> None:
    """Write all measurements as comma-separated values."""
    pd.DataFrame(map(asdict, found)).to_csv(path, index=False)


def read_csv(path: Path) -> list[Measurement]:
    """Read what `write_csv` wrote."""
    absent = dict.fromkeys(("seconds", "memory", "max_error", "l2_error"), "")
    table = pd.read_csv(path, keep_default_na=False, na_values=absent).astype(object)
    rows = table.where(table.notna(), None).to_dict("records")
    return [Measurement(**{str(name): value for name, value in row.items()}) for row in rows]


PAGE = """# Work and precision: all rows

Time, memory beyond the imports, and error of every run behind the picture in
[comparison](comparison.md), as `make bench` writes them. What is measured is said there, and on
which machine at the end. The same rows as a table: `work_precision.csv`.

"""


PEERS = {
    "superlu": "bilinear elements with SuperLU",
    "pardiso": "with PARDISO",
    "pyamg": "with pyamg",
    "quadratic": "adaptive quadratic triangles",
}
QUOTED = (
    ("README.md", r"On that plate, with the load spread.*?\n\n"),
    ("docs/comparison.md", r"- \*\*Steel plate.*?\n\n"),
)
"""Where the record is quoted, and what stands there."""


def publish(folder: Path, root: Path) -> None:
    """Make what a folder holds the record, and let the documents quote it."""
    docs, found = root / "docs", read_csv(folder / "work_precision.csv")
    (docs / "work-precision.md").write_text(
        PAGE + (folder / "work_precision.md").read_text(encoding="utf-8"), encoding="utf-8"
    )
    copyfile(folder / "work_precision.csv", docs / "work_precision.csv")
    copyfile(folder / "work_precision.png", docs / "pictures" / "work_precision.png")
    for (name, pattern), said in zip(QUOTED, quotations(found), strict=True):
        text = (root / name).read_text(encoding="utf-8")
        text = re.sub(pattern, lambda _, said=said: f"{said}\n\n", text, count=1, flags=re.DOTALL)
        (root / name).write_text(text, encoding="utf-8")


def quotations(found: Sequence[Measurement]) -> tuple[str, str]:
    """Return what README and docs/comparison.md say of the measurements."""
    plate = [measurement for measurement in found if measurement.problem == "plate"]
    target = 2e-4
    ours = cost_at(target, _of(plate, "multigrid"))
    theirs = {words: cost_at(target, _of(plate, name)) for name, words in PEERS.items()}
    told = [f"{w} {t / ours:.2g} times as long" for w, t in theirs.items() if ours and t]
    readme = (
        "On that plate, with the load spread over 20 mm, at a largest error of 2e-4, `solve` took "
        f"{1e3 * (ours or 0.0):.0f} ms; {', '.join(told)} "
        "([how it was measured](docs/comparison.md))."
    )
    bullets = [
        f"- **{problem.title[0].upper()}{problem.title[1:]}.** {' '.join(ratios(mine))}"
        for name, problem in PROBLEMS.items()
        if (mine := [measurement for measurement in found if measurement.problem == name])
    ]
    return fill(readme, 100, break_on_hyphens=False), "\n".join(bullets)


def markdown(found: Sequence[Measurement], conditions: dict[str, str]) -> str:
    """Return tables of all problems, ratios at equal error, and the conditions."""
    parts = []
    for name, problem in PROBLEMS.items():
        mine = [measurement for measurement in found if measurement.problem == name]
        if mine:
            rows = [HEADER, "|---|---|---|---|---|---|", *map(_row, mine)]
            parts.append("\n".join([f"## {problem.title}", "", *rows, "", *ratios(mine)]))
    told = "\n".join(f"- {name}: {value}" for name, value in conditions.items())
    parts.append(
        "Times are the processor's, medians of three runs (of one, if it takes over 10 s), warm: "
        "imports and compilation excluded; mesh or cells, assembly, set-up and solution included, "
        "of adaptive elements all meshes on the way. Every job had a process of its own with one "
        "thread; memory is its peak above what was in use before. Errors are taken in the middles "
        "of the picture's cells, as shares of the largest true "
        f"displacement.\n\n{told}"
    )
    return "\n\n".join(parts) + "\n"


def _row(measurement: Measurement) -> str:
    title = METHODS[measurement.method].title
    if measurement.seconds is None:
        return f"| {title} | {measurement.cells} | {measurement.failure} | | | |"
    return (
        f"| {title} | {measurement.cells} | {measurement.seconds:.3g} | {measurement.memory:.0f} "
        f"| {measurement.max_error:.1e} | {measurement.l2_error:.1e} |"
    )


def ratios(found: Sequence[Measurement]) -> list[str]:
    """Say how much longer each method takes than `kaju.solve` for the same error."""
    lines = []
    for target in (1e-2, 1e-3, 2e-4):
        ours = cost_at(target, _of(found, "multigrid"))
        told = []
        for name, method in METHODS.items():
            theirs = cost_at(target, _of(found, name))
            if name != "multigrid" and ours and theirs:
                told.append(f"{method.title} {theirs / ours:.3g} times as long")
        if ours and told:
            lines.append(
                f"For a largest error of {target:g}, `kaju.solve` takes {ours:.3g} s; "
                f"{', '.join(told)}."
            )
    return lines


def _of(found: Iterable[Measurement], method: str) -> list[Measurement]:
    return [m for m in found if m.method == method and m.seconds is not None]


def cost_at(target: float, found: Sequence[Measurement]) -> float | None:
    """Return the cost at an error, on straight lines between measurements, both axes log.

    None if the error is outside of what was measured; nothing is extrapolated.
    """
    pairs = sorted((float(m.max_error or 0.0), float(m.seconds or 0.0)) for m in found)
    error, spent = np.array([p for p in pairs if min(p) > 0.0]).reshape(-1, 2).T
    if not len(error) or not error[0] <= target <= error[-1]:
        return None
    return float(np.exp(np.interp(np.log(target), np.log(error), np.log(spent))))


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
                    colour, marker, line = METHODS[method].style
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
