"""Spawning beside equal cells and finite elements: errors, costs, growth, and what must hold.

The truth comes from finite elements of high order on graded meshes, which share nothing with
spawning. Needs scikit-fem and pyamg. Run:

    python benchmarks/spawning_beside.py                      # everything; most of an hour
    python benchmarks/spawning_beside.py plate growth         # some tables
    python benchmarks/spawning_beside.py --quick              # small cases only, a few minutes
    python benchmarks/spawning_beside.py --pictures           # and the pictures of the page

Rows are written as comma-separated values into benchmarks/results/spawning, or --out=FOLDER.
Tables: the bodies (plate, off-centre, two-loads, L, hole, drawing, block), effectivity, order,
growth, idle, and what must hold (patch, small-patch, area, giant, calm).
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

from peers.report import environment
from spawning_study import tables, targets
from spawning_study.measure import write_rows
from spawning_study.scenes import cases

from kaju import solve


def jobs():
    """Return what makes each table, by name."""
    found = {name: partial(tables.work, case) for name, case in cases().items()}
    others = (tables.effectivity, tables.order, tables.growth, tables.idle)
    wanted = (targets.patch, targets.small_patch, targets.area, targets.giant, targets.calm)
    for job in (*others, *wanted):
        found[job.__name__.replace("_", "-")] = job
    return found


def warm() -> None:
    """Compile, or load what was compiled."""
    known = cases()
    for name, tolerance in (("plate", 0.05), ("L", 0.05), ("block", 0.3)):
        solve(known[name].scene, strategy="spawning", tolerance=tolerance)
        solve(known[name].scene, strategy="uniform", resolution=2)


def main() -> None:
    words = [word for word in sys.argv[1:] if not word.startswith("-")]
    out = [word.partition("=")[2] for word in sys.argv if word.startswith("--out=")]
    folder = Path(out[0]) if out else Path(__file__).parent / "results" / "spawning"
    known = jobs()
    for word in words:
        if word not in known:
            raise SystemExit(f"{word}: there is no such table; there is {', '.join(known)}")
    print(", ".join(f"{name} {value}" for name, value in environment().items()))
    warm()
    for name in words or known:
        rows = known[name](folder=folder, quick="--quick" in sys.argv)
        write_rows(folder / f"{name}.csv", rows)
    if "--pictures" in sys.argv:
        from spawning_study.picture import draw

        for path in draw(folder):
            print(path)


if __name__ == "__main__":
    main()
