"""Solving again after a change: how long it takes, beside solving afresh.

A plate of 320 × 320 cells (102,400) under 2 N over 20 mm of its top, with and without a round
hole, by equal cells and by spawning agents. Every change starts from the answer to the plate
with the load in its first place; times are the processor's, medians of the calls of `solve`. Run:

    python benchmarks/interactive.py              # everything, some minutes
    python benchmarks/interactive.py plate        # equal cells, no hole
    python benchmarks/interactive.py hole         # equal cells, a hole
    python benchmarks/interactive.py 0.02         # spawning agents, that tolerance
    python benchmarks/interactive.py memory       # what a chain of 50 moves leaves behind
    python benchmarks/interactive.py chain        # whether agents pile up
"""

import gc
import sys
import tracemalloc
from statistics import median
from time import process_time

import numpy as np

from kaju import Scene, solve

CELLS, SIDE, PATCH = 320, 0.2, 0.02
HOLE = {"centre": [0.1, 0.1], "radius": 0.03}
OTHER_HOLE = {"centre": [0.06, 0.14], "radius": 0.01}
FIRST = 0.09
REPEATS = 7


def press(start=FIRST, force=(0.0, -2.0)):
    """Return the load on 20 mm of the top from `start` (m) on."""
    return [{"region": {"box": [[start, SIDE], [start + PATCH, SIDE]]}, "force": list(force)}]


def plate():
    return Scene(
        body={
            "size": [SIDE, SIDE],
            "cells": [CELLS, CELLS],
            "thickness": 2e-3,
            "material": "steel",
        },
        sides={"bottom": "rigid"},
        loads=press(),
    )


CHANGES = {
    "force × 1.5": lambda scene: scene.replace(loads=press(force=(0.0, -3.0))),
    "force turned": lambda scene: scene.replace(loads=press(force=(0.4, -2.0))),
    "moved by a cell": lambda scene: scene.replace(loads=press(FIRST + SIDE / CELLS)),
    "moved by 10 mm": lambda scene: scene.replace(loads=press(FIRST + 0.01)),
    "moved by 70 mm": lambda scene: scene.replace(loads=press(FIRST + 0.07)),
    "a hole cut": lambda scene: scene.with_region(disk=OTHER_HOLE),
}


def timed(scene, first, repeats, **how):
    """Return answers and medians of the times they took (ms), again and afresh in turn."""
    answers, seconds = {}, {"again": [], "afresh": []}
    for _ in range(repeats):
        for kind, previous in (("again", first), ("afresh", None)):
            start = process_time()
            answers[kind] = solve(scene, previous=previous, **how)
            seconds[kind].append(process_time() - start)
    return [(answers[kind], 1e3 * median(seconds[kind])) for kind in ("again", "afresh")]


def table(title, scene, **how):
    first = solve(scene, **how)
    agents = first.summary()["agents"]
    print(f"\n{title}: {agents:,} agents, estimated error {first.error_estimate:.3f}")
    print(f"{'':18}{'agents':>9}{'again':>9}{'agents':>11}{'afresh':>9}{'energies differ':>18}")
    for name, change in CHANGES.items():
        repeats = 3 if agents > 50_000 and how["strategy"] == "spawning" else REPEATS
        (again, short), (fresh, long) = timed(change(scene), first, repeats, **how)
        gap = abs(again.strain_energy / fresh.strain_energy - 1)
        count = [result.summary()["agents"] for result in (again, fresh)]
        print(f"{name:18}{count[0]:9,}{short:6.0f} ms{count[1]:11,}{long:6.0f} ms{gap:18.1e}")


def memory():
    print("\nmemory in use after moves to and fro, each from the answer before (MB)")
    for strategy in ("uniform", "spawning"):
        how = {"strategy": strategy} | ({"tolerance": 0.02} if strategy == "spawning" else {})
        result = solve(plate(), **how)
        tracemalloc.start()
        in_use = []
        for move in range(51):
            place = FIRST + 0.07 * (move % 8) / 8
            result = solve(plate().replace(loads=press(place)), previous=result, **how)
            if move % 10 == 0:
                gc.collect()
                in_use.append(tracemalloc.get_traced_memory()[0] / 1e6)
        tracemalloc.stop()
        print(f"{strategy:10}" + "".join(f"{value:8.1f}" for value in in_use))


def chain():
    """Print how many agents a chain of random moves ends with, against afresh each time."""
    random, result, ratio = np.random.default_rng(1), None, []
    how = {"strategy": "spawning", "tolerance": 0.02}
    for _ in range(20):
        place, along = random.uniform(0.0, SIDE - PATCH), random.normal()
        place = round(place / SIDE * CELLS) * SIDE / CELLS
        scene = plate().replace(loads=press(place, (along, -2.0)))
        result = solve(scene, previous=result, **how)
        ratio.append(result.agents / solve(scene, **how).agents)
    print(f"\nagents after each of 20 random moves, against afresh: {np.mean(ratio):.2f} times")
    print(f"in the mean, at most {max(ratio):.2f} times")


def main():
    asked = sys.argv[1:] or ["plate", "hole", "0.05", "0.02", "0.005", "memory", "chain"]
    for name in asked:
        if name in ("memory", "chain"):
            {"memory": memory, "chain": chain}[name]()
        elif name == "plate":
            solve(plate(), previous=solve(plate()))
            table("equal cells", plate(), strategy="uniform")
        elif name == "hole":
            table("equal cells, with a hole", plate().with_region(disk=HOLE), strategy="uniform")
        else:
            how = {"strategy": "spawning", "tolerance": float(name)}
            solve(plate(), **how | {"tolerance": 0.1})
            table(f"spawning agents, tolerance {name}", plate(), **how)


if __name__ == "__main__":
    main()
