"""Time and memory against error, for kaju and for finite elements.

python benchmarks/work_precision.py [--quick] [--resume] [--problem=plate] [--publish] [FOLDER]

--quick takes some minutes. --resume keeps the rows that the folder has and measures the others.
--publish makes it the record in docs (table, picture) that README and docs/work-precision.md
quote; a test compares them.

The peers need scikit-fem (the mesh of quadratic elements), pyamg and pypardiso; what is
not installed is named in its rows.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from peers.measure import Measurement, in_a_fresh_process, jobs
from peers.problems import PROBLEMS
from peers.report import draw, environment, measured_on, publish, ratios, read_csv, write_csv

from kaju.errors import ParameterError, ResultFileError, suggestion
from kaju.files import check_writable


def run(
    folder: Path,
    quick: bool = False,
    problems: tuple[str, ...] = (),
    tell: Callable[[str], None] = lambda line: None,
    resume: bool = False,
) -> list[Measurement]:
    """Measure all jobs and write table, picture and environment into a folder, row by row.

    `quick`: small sizes only; `tell`: takes a line about each job; `resume`: keep the rows that
    the folder has, and measure the others.
    """
    for name in problems:
        if name not in PROBLEMS:
            raise ParameterError(
                f"problem: there is no {name!r}{suggestion(name, PROBLEMS)}; there is "
                f"{', '.join(PROBLEMS)}"
            )
    check_writable(folder, ResultFileError)
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "work_precision.csv"
    found = read_csv(table) if resume and table.exists() else []
    done = {(m.problem, m.method, m.division) for m in found}
    for job in jobs(quick, problems):
        if job not in done:
            found.append(in_a_fresh_process(*job))
            write_csv(table, found)
            tell(_line(found[-1]))
    conditions = environment()
    words = f"{ratios(found)}\n\n{measured_on(conditions)}\n"
    (folder / "work_precision.md").write_text(words, encoding="utf-8")
    (folder / "environment.json").write_text(json.dumps(conditions, indent=2) + "\n", "utf-8")
    draw(found, folder / "work_precision.png")
    return found


def _line(m: Measurement) -> str:
    what = f"{m.problem:7} {m.method:14} {m.cells:9d} cells  "
    if m.seconds is None:
        return what + m.failure
    return (
        what + f"{m.seconds:9.4f} s  {m.memory:7.0f} MB  largest error {m.max_error:.1e}, "
        f"r.m.s. {m.l2_error:.1e}"
    )


if __name__ == "__main__":
    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    folder = (folders or [Path(__file__).parent / "results"])[0]
    named = [word.removeprefix("--problem=") for word in sys.argv if "--problem=" in word]
    run(folder, "--quick" in sys.argv, tuple(named), print, resume="--resume" in sys.argv)
    if "--publish" in sys.argv:
        publish(folder, Path(__file__).parents[1])
