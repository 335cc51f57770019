"""Time and memory against error, for kaju and for finite elements.

The peers need scikit-fem (the mesh of quadratic elements), pyamg and pypardiso; what is
not installed is named in its rows.
"""

from __future__ import annotations

import argparse
import json
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--quick", action="store_true", help="some minutes")
    parser.add_argument("--resume", action="store_true", help="measure what the folder has not")
    parser.add_argument("--problem", action="append", default=[], help="this body alone")
    parser.add_argument(
        "--publish", action="store_true", help="make it the record in docs, which README quotes"
    )
    told = parser.parse_args()
    run(told.folder, told.quick, tuple(told.problem), print, resume=told.resume)
    if told.publish:
        publish(told.folder, Path(__file__).parents[1])
