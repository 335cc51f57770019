"""Time and memory against error, for kaju and for finite elements: measured, drawn and quoted.

The peers need scikit-fem (the mesh of quadratic elements), pyamg and pypardiso; what is
not installed is named in its rows.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from shutil import copyfile
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from peers.measure import Measurement, in_a_fresh_process, jobs
from peers.methods import METHODS
from peers.problems import PROBLEMS

from kaju.errors import ResultFileError
from kaju.files import check_writable
from kaju.view.style import FAINT, INK, new_figure, save

PACKAGES = ("kaju", "numpy", "scipy", "numba", "mesa", "scikit-fem", "pyamg", "pypardiso")

TARGETS = (1e-2, 1e-3, 2e-4)  # Largest errors at which times are compared


def environment() -> dict[str, str]:
    """Return the machine and the versions that figures depend on."""
    found = {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "system": platform.platform(),
        "load when it ended": f"{os.getloadavg()[0]:.1f}",
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


EQUAL = ("superlu", "pardiso", "pyamg")
"""Solvers of equal bilinear elements."""
QUOTED = (
    ("README.md", r"\| largest error \| `solve`.*?(?=\n\n## )"),
    ("docs/work-precision.md", r"\| body \| largest error.*?(?=\n\n)"),
)
"""Where the record is quoted, and what stands there."""
MACHINE = ("docs/work-precision.md", r"Measured on: .*?(?=\n\n)")


def publish(folder: Path, said: Sequence[str]) -> None:
    """Make what a folder holds the record, and let the documents say so."""
    root = Path(__file__).parents[1]
    docs = root / "docs"
    copyfile(folder / "work_precision.csv", docs / "work_precision.csv")
    copyfile(folder / "work_precision.png", docs / "pictures" / "work_precision.png")
    for (name, pattern), words in zip([*QUOTED, MACHINE], said, strict=True):
        text = (root / name).read_text(encoding="utf-8")
        text = re.sub(pattern, lambda _, words=words: words, text, count=1, flags=re.DOTALL)
        (root / name).write_text(text, encoding="utf-8")


def quotations(found: Sequence[Measurement], processor: str) -> tuple[str, str]:
    """Return what README and docs/work-precision.md say of the measurements."""
    rows = ratios(found)
    equal = [row[name] for row in rows for name in EQUAL if name in row]
    adaptive = [row["quadratic"] for row in rows if "quadratic" in row]
    readme = "| largest error | `solve` | adaptive finite elements, second order "
    readme += "| equal finite elements, first order |\n|---|---|---|---|\n"
    for row in rows:
        if row["body"] == "plate":
            quickest = min([row[name] for name in EQUAL if name in row], default=0.0)
            slower = (1.0, row.get("quadratic", 0.0), quickest)
            times = (f"{1e3 * row['seconds'] * k:.0f} ms" if k else "–" for k in slower)
            readme += f"| {100 * row['error']:g} % | {' | '.join(times)} |\n"
    readme += (
        "\nOn this plate, a block and a body of pixels, equal elements took "
        f"{min(equal):.2g} to {max(equal):.2g} times\nas long as `solve`, adaptive ones "
        f"{min(adaptive):.2g} to {max(adaptive):.2g} times (one thread, {processor})."
    )
    others = [name for name in METHODS if name != "multigrid" and any(name in row for row in rows)]
    titles = " | ".join(METHODS[name].title for name in others)
    lines = [f"| body | largest error | kaju.solve, equal cells (s) | {titles} |"]
    lines.append("|---" * (3 + len(others)) + "|")
    for row in rows:
        times = " | ".join(f"{row[name]:.3g} ×" if name in row else "" for name in others)
        lines.append(f"| {row['body']} | {row['error']:g} | {row['seconds']:.3g} | {times} |")
    return readme, "\n".join(lines)


def measured_on(conditions: dict[str, str]) -> str:
    """Name the machine and the versions."""
    pairs = "; ".join(f"{name} {value}" for name, value in conditions.items())
    return fill(f"Measured on: {pairs}.", 100, break_on_hyphens=False)


def ratios(found: Sequence[Measurement]) -> list[dict[str, Any]]:
    """Return by body and error how much longer others take than `kaju.solve` on equal cells."""
    rows = []
    for body, error in product(PROBLEMS, TARGETS):
        mine = [measurement for measurement in found if measurement.problem == body]
        costs = {name: cost_at(error, [m for m in mine if m.method == name]) for name in METHODS}
        if ours := costs.pop("multigrid"):
            slower = {name: cost / ours for name, cost in costs.items() if cost}
            rows.append({"body": body, "error": error, "seconds": ours, **slower})
    return rows


def cost_at(target: float, found: Sequence[Measurement]) -> float | None:
    """Return the cost at an error, on log axes; None below what was reached."""
    # A mesh that is coarser than all measured ones costs no more than these.
    pairs = sorted((float(m.max_error or 0.0), float(m.seconds or 0.0)) for m in found)
    error, spent = np.array([p for p in pairs if min(p) > 0.0]).reshape(-1, 2).T
    if not len(error) or target < error[0]:
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
                    fill = "none" if line == "--" else "full"
                    look = {"color": colour, "fillstyle": fill, "lw": 1.2, "ms": 5}
                    (handles[method],) = ax.loglog(*np.transpose(points), marker + line, **look)
            ax.grid(True, which="major", color="#e4e4e4", linewidth=0.6)
            ax.tick_params(labelsize=8, color=FAINT)
            if column == 0:
                ax.set_ylabel(label, fontsize=9)
        grid[0][column].set_title(name, loc="left", fontsize=11, fontweight="bold", color=INK)
        grid[-1][column].set_xlabel("largest error: smaller to the right", fontsize=9)
        grid[-1][column].invert_xaxis()
    titles, where = [METHODS[method].title for method in handles], "outside lower center"
    columns = min(4, len(handles))
    figure.legend([*handles.values()], titles, loc=where, ncols=columns, fontsize=8, frameon=False)
    return save(figure, path)


def run(folder: Path, quick: bool, record: bool) -> None:
    """Measure all jobs, or small ones, and write table, picture and words into a folder.

    `record`: let the documents quote them.
    """
    check_writable(folder, ResultFileError)
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "work_precision.csv"
    found: list[Measurement] = []
    for job in jobs(quick):
        found.append(m := in_a_fresh_process(*job))
        pd.DataFrame(map(asdict, found)).to_csv(table, index=False)  # as far as it has come
        told = f"{m.problem:7} {m.method:14} {m.cells:9d} cells  {m.failure}"
        if m.seconds is not None:
            told += f"{m.seconds:9.4f} s  {m.memory:7.0f} MB  largest error {m.max_error:.1e}, "
            told += f"r.m.s. {m.l2_error:.1e}"
        print(told)
    conditions = environment()
    said = [*quotations(found, conditions["processor"]), measured_on(conditions)]
    (folder / "work_precision.md").write_text("\n\n".join(said[1:]) + "\n", encoding="utf-8")
    draw(found, folder / "work_precision.png")
    if record:
        publish(folder, said)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--quick", action="store_true", help="some minutes")
    parser.add_argument(
        "--publish", action="store_true", help="make it the record in docs, which README quotes"
    )
    told = parser.parse_args()
    run(told.folder, told.quick, told.publish)
