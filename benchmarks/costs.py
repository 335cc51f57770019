"""What a cell and an agent cost: the figures by which `kaju.solve` chooses between them.

Prints, for equal cells by each method and for agents that spawn, the seconds of a run and of its
bound as a fixed part and a part for each cell (agent), fitted to runs of several sizes by the
smallest relative misfit; `model/elastic/spawning/choice.py` holds rounded ones. Run:

    python benchmarks/costs.py
"""

from statistics import median
from time import perf_counter

import numpy as np

from kaju import Scene, solve

STEEL = {"material": "steel"}
REPEATS = 3


def box(dimension):
    """Return a block, clamped below, under a patch in the middle of its top."""
    n = 16 if dimension == 2 else 8
    low, high = [0.375] * (dimension - 1), [0.625] * (dimension - 1)
    return Scene(
        body={"size": [1.0] * dimension, "cells": [n] * dimension, **STEEL},
        sides={"bottom": "rigid"},
        loads=[
            {
                "region": {"box": [[*low, 1.0], [*high, 1.0]]},
                "force": [*[0.0] * (dimension - 1), -1.0],
            }
        ],
    )


def two_materials(dimension, poissons_ratio=0.3):
    """Return the block with a soft core, which needs assembled matrices."""
    core = {"material": "soft", "box": [[0.25] * dimension, [0.75] * dimension]}
    soft = {"youngs_modulus": 1e10, "poissons_ratio": poissons_ratio}
    scene = box(dimension)
    body = dict(scene.body) | {"regions": [core]}
    if dimension == 2:
        body |= {"plane": "strain"}
    return scene.replace(body=body, materials={"soft": soft})


def timed(scene, **how):
    """Return how many cells or agents a run took, and the median of its seconds."""
    seconds = []
    for _ in range(REPEATS):
        start = perf_counter()
        result = solve(scene, **how)
        _ = result.error_bound if result.provable else None
        seconds.append(perf_counter() - start)
    return result.summary()["agents"], median(seconds)


def fit(runs):
    """Return the fixed part (s) and that for each (s)."""
    count, seconds = np.array(runs).T
    table = np.stack([1.0 / seconds, count / seconds], axis=1)
    fixed, each = np.linalg.lstsq(table, np.ones(len(runs)), rcond=None)[0]
    return fixed, each


CASES = {
    "full multigrid, 2-D": (box(2), "uniform", (4, 8, 16, 32, 64)),
    "full multigrid, 3-D": (box(3), "uniform", (2, 4, 8, 12)),
    "Galerkin multigrid, 2-D": (two_materials(2), "uniform", (2, 4, 8, 16)),
    "Galerkin multigrid, 3-D": (two_materials(3), "uniform", (1, 2, 4)),
    "mixed form, 2-D": (two_materials(2, 0.4999), "uniform", (2, 4, 8)),
    "mixed form, 3-D": (two_materials(3, 0.4999), "uniform", (1, 2)),
    "agents, 2-D": (box(2), "spawning", (0.1, 0.05, 0.02, 0.01)),
    "agents, 3-D": (box(3), "spawning", (0.3, 0.2, 0.1, 0.07)),
    "agents of two materials, 2-D": (two_materials(2), "spawning", (0.1, 0.05, 0.02)),
    "agents of two materials, 3-D": (two_materials(3), "spawning", (0.4, 0.2, 0.12)),
}


def main():
    print(f"{'':32}{'fixed (s)':>12}{'each (µs)':>12}   cells (agents) and seconds")
    for name, (scene, strategy, settings) in CASES.items():
        key = "resolution" if strategy == "uniform" else "tolerance"
        runs = [timed(scene, strategy=strategy, **{key: value}) for value in settings]
        fixed, each = fit(runs)
        table = ", ".join(f"{count:,}: {seconds:.3f}" for count, seconds in runs)
        print(f"{name:32}{fixed:12.3f}{1e6 * each:12.2f}   {table}", flush=True)


if __name__ == "__main__":
    main()
