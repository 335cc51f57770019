"""What spawning has to hold: few cells, little time, small bodies in memory, at equal error."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from kaju import Scene, solve

from .measure import (
    Cost,
    by_aim,
    by_equal_cells,
    by_spawning,
    cost_at,
    measured_at,
    timed,
)
from .scenes import STEEL, block, cases, plate
from .tables import WORK_LINE, show
from .truth import truth

LARGEST = 1e-4
"""The largest displacement error at which the plate's costs are compared."""
GIANT = 16384
"""Cells along an edge."""


def told(name, value, bound, holds):
    """Print one target and whether it is held."""
    print(f"  {name}: {value}, asked for {bound}: {'held' if holds else 'MISSED'}", flush=True)


def compared(ours, theirs, target, error):
    """Return how many times our cells and time equal cells take, and whether both were measured."""
    measured = measured_at(target, ours, error) and measured_at(target, theirs, error)
    ratios = [
        cost_at(target, theirs, cost, error) / cost_at(target, ours, cost, error)
        for cost in ("cells", "seconds")
    ]
    return *ratios, "" if measured else " (extrapolated)"


def patch(folder, quick=False):
    """Compare spawning and equal cells at a largest displacement error of 1e-4."""
    case = cases()["plate"]
    true = truth(case, folder)
    print(f"\n{case.title}: largest displacement error {LARGEST:g}\n{WORK_LINE}")
    tolerances = (0.0125,) if quick else (0.02, 0.0125, 0.008, 0.005, 0.003)
    ours = list(by_spawning(case, true, tolerances))
    aims = (0.003, 0.001) if quick else (1e-3, 5e-4, 2e-4, 1e-4, 5e-5)
    aimed = list(by_aim(case, true, aims))
    theirs = list(by_equal_cells(case, true, (4, 8, 16) if quick else (16, 32, 64, 128)))
    for r in (*ours, *aimed, *theirs):
        show(r)
    for name, rows in (("tolerance in the energy norm", ours), ("of the displacement", aimed)):
        if len(rows) > 1:
            cells, seconds, how = compared(rows, theirs, LARGEST, "max_error")
            told(f"{name}: fewer cells{how}", f"{cells:.3g}×", "50×", cells >= 50)
            told(f"{name}: less time{how}", f"{seconds:.3g}×", "10×", seconds >= 10)
    return [*ours, *aimed, *theirs]


def small_patch(folder, quick=False):
    """Compare spawning and equal cells under a small patch in three dimensions."""
    case = cases()["block"]
    true = truth(case, folder)
    print(f"\n{case.title}: equal errors\n{WORK_LINE}")
    ours = list(by_spawning(case, true, (0.15, 0.1) if quick else (0.1, 0.07, 0.05)))
    theirs = list(by_equal_cells(case, true, (2, 4) if quick else (2, 4, 8, 12)))
    for r in (*ours, *theirs):
        show(r)
    for error, name in (("energy_error", "energy norm"), ("max_error", "displacement")):
        target = getattr(ours[-1], error)
        cells, _, how = compared(ours, theirs, target, error)
        told(f"fewer cells at an error of {target:.2g} ({name}){how}", f"{cells:.3g}×", "100×",
             cells >= 100)  # fmt: skip
    return [*ours, *theirs]


def area(folder, quick=False):
    """Compare the times of a plate and of one of 64 times its area, in turns."""
    print("\narea ×64, the same load, tolerance 0.02")
    scenes = [plate(1), plate(8)]
    times = [[], []]
    for _ in range(2 if quick else 9):
        for scene, found in zip(scenes, times, strict=True):
            start = perf_counter()
            agents = solve(scene, strategy="spawning", tolerance=0.02).agents
            found.append(perf_counter() - start)
    first, second = (float(np.median(found[1:])) for found in times)
    told("time", f"{second / first:.2f}×", "2×", second <= 2 * first)
    return [Cost(8, plate(8).lattice.size, agents, second)]


def giant(folder, quick=False):
    """Solve a quarter of a block of 16,384³ cells under a small patch, in a process of its own."""
    command = [sys.executable, "-m", "spawning_study.targets"]
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[1]
    )
    agents, estimate, seconds, cold, memory = json.loads(done.stdout)
    print("\n16,384³ cells, pressed on a square of 1/64 of their edge, tolerance 0.1")
    print(f"  {agents:,} agents, estimate {estimate:.3f}")
    print(f"  {cold:.1f} s with compiling or loading, {seconds:.1f} s warm, peak {memory:.2f} GB")
    told("time", f"{seconds:.1f} s", "10 s", seconds < 10)
    told("memory", f"{memory:.2f} GB", "2 GB", memory < 2)
    return [Cost(GIANT, GIANT**3, agents, seconds)]


def giant_scene(cells=GIANT, patch=1 / 64):
    """Return a whole block under a square in the middle of its top."""
    low, high = 0.5 - patch / 2, 0.5 + patch / 2
    return Scene(
        body={"cells": [cells] * 3, "cell_size": 1.0 / cells, **STEEL},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[low, low, 1.0], [high, high, 1.0]]}, "force": [0, 0, -1.0]}],
    )


def calm_scenes():
    """Return bodies where nothing is local, by name."""
    square = {"size": [0.2, 0.2], "cells": [20, 20], "thickness": 2e-3, **STEEL}
    heavy = {"heavy": {"base": "steel"}}
    return {
        "hanging": Scene(
            body=square | {"gravity": [0.0, 9.81], "material": "heavy"},
            materials=heavy,
            sides={"bottom": "rigid"},
        ),
        "beam": Scene(
            body=square | {"size": [0.8, 0.1], "cells": [64, 8]},
            sides={"left": "rigid"},
            loads=[{"side": "right", "force": [0.0, -10.0]}],
        ),
        "pressed": Scene(
            body=square, sides={"bottom": "rigid"}, loads=[{"side": "top", "pressure": 1e6}]
        ),
        "block": Scene(
            body={"cells": [8, 8, 8], "cell_size": 0.125, **STEEL},
            sides={"bottom": "rigid"},
            loads=[{"side": "top", "pressure": 1e6}],
        ),
    }


def calm(folder, quick=False):
    """Compare `kaju.solve(scene, tolerance)` with equal cells where nothing is local."""
    print("\nnothing is local: time by tolerance, and of equal cells of the same error")
    words = ("tolerance", "taken", "cells", "time (s)", "equal (s)")
    print(" " * 10 + "".join(f"{word:>10}" for word in words) + f"{'times':>8}")
    rows = []
    for name, scene in calm_scenes().items():
        for tolerance in (0.1, 0.05) if scene.lattice.dimension == 3 else (0.05, 0.02, 0.01):
            found, seconds, _ = timed(lambda s=scene, t=tolerance: solve(s, tolerance=t))
            k, cells = 1, solve(scene, strategy="uniform", resolution=1)
            while cells.error_estimate > tolerance:
                k += max(1, k // 4)
                cells = solve(scene, strategy="uniform", resolution=k)
            _, equal, _ = timed(lambda s=scene, k=k: solve(s, strategy="uniform", resolution=k))
            summary = found.summary()
            times = seconds / equal
            kind = "agents" if summary["method"] == "spawning" else "cells"
            print(
                f"{name:10}{tolerance:10g}{kind:>10}{summary['agents']:10,}{seconds:10.3f}"
                f"{equal:10.3f}{times:8.2f}",
                flush=True,
            )
            rows.append(Cost(k, scene.lattice.size, summary["agents"], seconds))
    return rows


def _alone() -> None:
    """Print agents, estimate, warm and cold time (s) and peak memory (GB) of the giant."""
    small = block(64, 1)
    solve(small, strategy="spawning", tolerance=0.3)
    times = []
    for _ in range(3):
        start = perf_counter()
        found = solve(giant_scene(), strategy="spawning", tolerance=0.1)
        times.append(perf_counter() - start)
    gigabyte = 1e9 if sys.platform == "darwin" else 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / gigabyte
    sys.stdout.write(
        json.dumps([found.agents, found.error_estimate, float(np.median(times)), times[0], peak])
    )


if __name__ == "__main__":
    _alone()
