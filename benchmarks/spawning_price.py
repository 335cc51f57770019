"""What agents that spawn cost, beside an earlier commit, in one run.

Every question is put to both in turn, each time in a process of its own after a smaller one
of the same kind has been asked, so that nothing is compiled on the clock. Written are the
least processor times, the memory, and the estimated errors. Run:

    python benchmarks/spawning_price.py [--before 2493de2] [--runs 2] [names ...]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
CHILD = """
import json, resource, sys, time
import numpy as np
from kaju import Scene, solve

def plate(cells=20, width=0.2, x=0.1, size=None):
    h = width / cells
    load = {"region": {"box": [[x, width], [x + (size or 0.01), width]]}, "force": [0.0, -2.0]}
    return Scene(body={"size": [width, width], "cells": [cells, cells], "thickness": 2e-3,
                       "material": "steel"}, sides={"bottom": "rigid"}, loads=[load])

def corner():
    body = {"size": [0.2, 0.2], "cells": [20, 20], "plane": "strain", "material": "steel",
            "regions": [{"material": "air", "box": [[0.1, 0.1], [0.2, 0.2]]}]}
    load = {"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [0.0, -2.0]}
    return Scene(body=body, sides={"bottom": "rigid"}, loads=[load])

def cube():
    load = {"region": {"box": [[0.25, 0.25, 1.0], [0.75, 0.75, 1.0]]}, "force": [0.0, 0.0, -1.0]}
    return Scene(body={"size": [1.0] * 3, "cells": [4] * 3, "material": "steel"},
                 sides={"bottom": "rigid"}, loads=[load])

def ask(scene, tolerance, **how):
    start = time.process_time()
    result = solve(scene, tolerance=tolerance, strategy="spawning", **how)
    energy, agents = result.strain_energy, result.summary()["agents"]
    return result, time.process_time() - start

QUESTIONS = {
    "plate, 2.65e-3": (plate, 2.9e-3),
    "plate, 1.6e-3": (plate, 1.75e-3),
    "plate, 1e-3": (plate, 1e-3),
    "plate, small": (plate, 0.05),
    "L, 3e-3": (corner, 3.2e-3),
    "cube, 0.044": (cube, 0.047),
    "cube, 0.022": (cube, 0.024),
    "area x 64": (lambda: plate(160, 1.6, 0.8), 0.01),
    "area x 1": (plate, 0.01),
    "moved by 1 mm": (plate, 6e-3),
    "moved by 40 mm": (plate, 6e-3),
}
scene, tolerance = QUESTIONS[sys.argv[1]]
MOVED = {"moved by 1 mm": 0.001, "moved by 40 mm": 0.04}
ask(scene(), min(4 * tolerance, 0.5) if sys.argv[1] != "plate, small" else tolerance)
ask(scene(), min(2 * tolerance, 0.01) if scene().lattice.dimension == 2 else 0.1)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
if sys.argv[1] in MOVED:
    cells = 400
    first, _ = ask(plate(cells), tolerance)
    result, seconds = ask(plate(cells, x=0.1 + MOVED[sys.argv[1]]), tolerance, previous=first)
else:
    result, seconds = ask(scene(), tolerance)
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
agents = result.summary()["agents"]
print(json.dumps({"seconds": seconds, "agents": agents, "error": result.error_estimate,
                  "bytes": 1024 * (memory - before) / agents, "GB": memory / 2**20}))
"""
NAMES = (
    "plate, small", "plate, 2.65e-3", "plate, 1.6e-3", "plate, 1e-3", "L, 3e-3", "cube, 0.044",
    "cube, 0.022", "area x 1", "area x 64", "moved by 1 mm", "moved by 40 mm",
)  # fmt: skip


def asked(source: Path, name: str) -> dict[str, float] | None:
    """Put a question to the sources in a folder; None if they cannot answer."""
    path = {"PYTHONPATH": str(source / "src"), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", CHILD, name]
    run = subprocess.run(command, env=os.environ | path, capture_output=True, text=True)
    if run.returncode:
        print(f"{name}: {run.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    answer: dict[str, float] = json.loads(run.stdout.splitlines()[-1])
    return answer


def main() -> None:
    """Write a table of what both cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", default="2493de2", help="commit to compare with")
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("names", nargs="*", default=NAMES)
    given = parser.parse_args()
    print(f"{'question':16} {'who':7} {'agents':>9} {'estimate':>9} {'s':>7} {'B':>6} {'GB':>5}")
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "before"
        git = ["git", "-C", str(HERE), "worktree"]
        subprocess.run([*git, "add", "--detach", str(old), given.before], check=True)
        try:
            for name in given.names:
                for source, who in ((old, "before"), (HERE, "now")):
                    found = [asked(source, name) for _ in range(given.runs)]
                    answers = [a for a in found if a is not None]
                    if not answers:
                        continue
                    best = min(answers, key=lambda a: a["seconds"])
                    print(
                        f"{name:16} {who:7} {best['agents']:9,.0f} {best['error']:9.2e} "
                        f"{best['seconds']:7.2f} {best['bytes']:6.0f} {best['GB']:5.2f}",
                        flush=True,
                    )
        finally:
            subprocess.run([*git, "remove", "--force", str(old)], check=True)


if __name__ == "__main__":
    main()
