"""What load transfer costs: a giant plate, a million loads, and a cold start.

Every figure is taken in a fresh process, so that memory peaks belong to one job. Run it with

    python benchmarks/load_transfer.py
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

REPEATS = 3
PLATE = Path(__file__).parent.parent / "examples" / "plate.toml"


def giant_plate() -> None:
    """Put the worked load on 10⁶ × 10⁶ cells, γ = 1e-6 N."""
    from kaju import LoadModel, Scene

    scene = Scene(
        body={"cell_size": 0.01, "cells": [10**6, 10**6], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [500_000, 999_999], "force": [0.0, -2.0], "steps": 20}],
        rule={"kind": "prescribed", "threshold": 1e-6},
    )
    measure(lambda: LoadModel(scene).run())


def million_loads() -> None:
    """Press on each of the 10⁶ top cells of 1000 × 1000 × 100 cubes, γ = 1 % of each."""
    from kaju import LoadModel, Scene

    scene = Scene(
        body={"cell_size": 0.01, "cells": [1000, 1000, 100], "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, 0.0, -2e6]}],
        rule={"kind": "prescribed", "threshold": 0.02},
    )
    measure(lambda: LoadModel(scene).run())


def measure(job) -> None:
    """Run a job and print its time, that of its summary, and the memory beyond the imports."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.perf_counter()
    result = job()
    ran = time.perf_counter()
    summary = result.summary()
    told = time.perf_counter()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    agents = summary["material_agents"]
    print(f"{ran - began:.3f} {told - ran:.3f} {(peak - before) / 1000:.0f} {agents}")


def in_a_fresh_process(job: str) -> list[float]:
    """Return the medians of what a job prints."""
    runs = []
    for _ in range(REPEATS):
        done = subprocess.run(
            [sys.executable, __file__, job], capture_output=True, text=True, check=True
        )
        runs.append([float(number) for number in done.stdout.split()])
    return [statistics.median(column) for column in zip(*runs, strict=True)]


def seconds(command: list[str]) -> float:
    """Return the median wall time of a command."""
    taken = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


JOBS = {"giant_plate": giant_plate, "million_loads": million_loads}


def main() -> None:
    """Print one line per figure."""
    print(f"{'job':16} {'run (s)':>8} {'summary (s)':>12} {'memory (MB)':>12} {'agents':>9}")
    for name in JOBS:
        run, summary, memory, agents = in_a_fresh_process(name)
        print(f"{name:16} {run:8.2f} {summary:12.2f} {memory:12.0f} {agents:9.0f}")
    python = sys.executable
    print(f"import kaju: {seconds([python, '-c', 'import kaju']):.2f} s")
    with TemporaryDirectory() as out:
        run = [python, "-m", "kaju", "run", str(PLATE), "--no-pictures", "--force", "--out", out]
        print(f"kaju run plate.toml, cold: {seconds(run):.2f} s")


if __name__ == "__main__":
    JOBS[sys.argv[1]]() if len(sys.argv) > 1 else main()
