"""Time and memory against error, for kaju and for finite elements.

The peers need scikit-fem (the mesh of quadratic elements), pyamg and pypardiso; what is
not installed is named in its rows.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from peers.measure import Measurement, in_a_fresh_process, jobs
from peers.report import draw, environment, measured_on, publish, ratios, read_csv, write_csv

from kaju.errors import ResultFileError
from kaju.files import check_writable


def run(folder: Path, quick: bool, resume: bool) -> None:
    """Measure all jobs and write table, picture and environment into a folder, row by row.

    `quick`: small sizes only; `resume`: keep the rows that the folder has, and measure the others.
    """
    check_writable(folder, ResultFileError)
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "work_precision.csv"
    found = read_csv(table) if resume and table.exists() else []
    done = {(m.problem, m.method, m.division) for m in found}
    for job in jobs(quick):
        if job not in done:
            found.append(in_a_fresh_process(*job))
            write_csv(table, found)
            print(_line(found[-1]))
    conditions = environment()
    words = f"{ratios(found)}\n\n{measured_on(conditions)}\n"
    (folder / "work_precision.md").write_text(words, encoding="utf-8")
    (folder / "environment.json").write_text(json.dumps(conditions, indent=2) + "\n", "utf-8")
    draw(found, folder / "work_precision.png")


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
    parser.add_argument(
        "--publish", action="store_true", help="make it the record in docs, which README quotes"
    )
    told = parser.parse_args()
    run(told.folder, told.quick, told.resume)
    if told.publish:
        publish(told.folder, Path(__file__).parents[1])
