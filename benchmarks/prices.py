"""What bodies, changes and tolerances cost, in processor time on one core.

    python benchmarks/prices.py                           # everything, some minutes
    python benchmarks/prices.py bodies --cells 64 --dimension 3 --runs 1
    python benchmarks/prices.py again                     # solving again after a change
    python benchmarks/prices.py growth                    # larger and larger bodies
    python benchmarks/prices.py largest                   # the largest error anywhere

Runs that are compared take turns and the least counts, so that a busy machine slows all alike.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import resource
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju import Scene, solve

SIDE = 0.2
STEEL = {"material": "steel"}
MATERIALS = {
    "plain": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
    "stiff": {"youngs_modulus": 1e15, "poissons_ratio": 0.3},
    "soft": {"youngs_modulus": 1e3, "poissons_ratio": 0.3},
    "mild": {"youngs_modulus": 1e11, "poissons_ratio": 0.3},
}
LEGEND = {0: "plain", 1: "air", 2: "stiff", 3: "soft", 4: "mild"}
BODIES = ("plain", "hole", "L", "stiff", "soft", "both", "random")


def press(start: float, width: float, force: tuple[float, ...] = (0.0, -2.0)) -> list[Any]:
    """Return a load on a part of a plate's top (m, N)."""
    return [{"region": {"box": [[start, SIDE], [start + width, SIDE]]}, "force": list(force)}]


def plate(cells: int, start: float = 0.09, width: float = 0.02, side: float = SIDE) -> Scene:
    """Return a plate, clamped below and pressed on a part of its top."""
    load = {"region": {"box": [[start, side], [start + width, side]]}, "force": [0.0, -2.0]}
    body = {"size": [side] * 2, "cells": [cells] * 2, "thickness": 2e-3, **STEEL}
    return Scene(body=body, sides={"bottom": "rigid"}, loads=[load])


def timed(scene: Scene, **how: Any) -> tuple[Any, float]:
    """Return an answer, and the seconds that it took."""
    began = process_time()
    return solve(scene, **how), process_time() - began


def in_turn(runs: int, *ways: Callable[[], tuple[Any, float]]) -> list[tuple[Any, float]]:
    """Return the last answer of every way, and the least of its times."""
    rounds = [[way() for way in ways] for _ in range(runs)]
    return [(own[-1][0], min(seconds for _, seconds in own)) for own in zip(*rounds, strict=True)]


def kinds_of(name: str, cells: int, dimension: int) -> NDArray[np.int8]:
    """Return the kinds of cells of a body."""
    axes = [np.arange(cells, dtype=np.float32) + 0.5 - cells / 2] * dimension
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    kinds = np.zeros((cells,) * dimension, np.int8)
    if name in ("hole", "stiff", "soft"):
        ball = (place**2).sum(axis=-1) < (cells / (5 if dimension == 2 else 4)) ** 2
        kinds[ball] = {"hole": 1, "stiff": 2, "soft": 3}[name]
    elif name == "both":
        for x, y, kind in ((0.3, 0.3, 1), (0.7, 0.6, 1), (0.5, 0.7, 4)):
            middle = (np.array([x, y, 0.5][:dimension]) - 0.5) * cells
            kinds[((place - middle) ** 2).sum(axis=-1) < (0.15 * cells) ** 2] = kind
    elif name == "L":
        kinds[cells // 2 :, cells // 2 :] = 1
    elif name == "random":
        kinds[np.random.default_rng(1).random(kinds.shape) < 0.5] = 4
    return kinds


def bounded(result: Any) -> tuple[Any, float]:
    """Return a result, and how long its bounds take (s)."""
    began = process_time()
    result.energy_bounds  # noqa: B018
    return result, process_time() - began


def bodies(asked: argparse.Namespace) -> None:
    """Print what a cell costs beside one of a plain plate or cube, and its bound."""
    patch = [[0.04, 0.2], [0.06, 0.2]]
    if asked.dimension == 3:
        patch = [[0.075, 0.075, 0.2], [0.125, 0.125, 0.2]]

    def scene(name: str, cells: int) -> Scene:
        return Scene.from_array(
            kinds_of(name, cells, asked.dimension),
            legend=LEGEND,
            cell_size=SIDE / cells,
            materials=MATERIALS,
            sides={"bottom": "rigid"},
            loads=[{"region": {"box": patch}, "force": [0.0] * (asked.dimension - 1) + [-2.0]}],
        )

    def way(body: Scene) -> Callable[[], tuple[Any, float]]:
        return lambda: timed(body, strategy="uniform")

    def proof(body: Scene) -> Callable[[], tuple[Any, float]]:
        return lambda: bounded(solve(body, strategy="uniform"))

    assert solve(scene("hole", 16), strategy="uniform").error_bound  # compiles
    scenes = [scene(name, asked.cells) for name in asked.bodies]
    found = in_turn(asked.runs, *map(way, scenes))
    bounds = in_turn(asked.runs, *map(proof, scenes))
    print(f"{'body':8} {'µs a cell':>9} {'ratio':>6} {'halved':>6} {'bound':>6}  method")
    first = None
    for name, (result, seconds), (_, more) in zip(asked.bodies, found, bounds, strict=True):
        price = 1e6 * seconds / (asked.cells * result.subdivision) ** asked.dimension
        bound, first = more / seconds, first or price
        halved = "yes" if result.subdivision > 1 else "no"
        told = f"{name:8} {price:9.3f} {price / first:6.2f} {halved:>6} {bound:6.2f}"
        print(told, result.summary()["method"])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"at most {peak:.2f} GB held")


CHANGES: dict[str, Callable[[Scene], Scene]] = {
    "force × 1.5": lambda scene: scene.replace(loads=press(0.09, 0.02, (0.0, -3.0))),
    "force turned": lambda scene: scene.replace(loads=press(0.09, 0.02, (0.4, -2.0))),
    "moved by a cell": lambda scene: scene.replace(loads=press(0.09 + SIDE / 320, 0.02)),
    "moved by 10 mm": lambda scene: scene.replace(loads=press(0.1, 0.02)),
    "moved by 70 mm": lambda scene: scene.replace(loads=press(0.16, 0.02)),
    "a hole cut": lambda scene: scene.with_region(disk={"centre": [0.06, 0.14], "radius": 0.01}),
}


def again(asked: argparse.Namespace) -> None:
    """Print what solving again takes beside solving afresh, and whether agents pile up."""
    pierced = plate(320).with_region(disk={"centre": [0.1, 0.1], "radius": 0.03})
    for title, scene, how in (
        ("equal cells, plate with a hole", pierced, {"strategy": "uniform"}),
        ("agents, 0.02", plate(320), {"strategy": "spawning", "tolerance": 0.02}),
        ("agents, 0.005", plate(320), {"strategy": "spawning", "tolerance": 0.005}),
    ):
        first = solve(scene, **how)
        print(f"\n{title}: {first.summary()['agents']:,} agents\n{'':18} again, afresh (ms)")
        for name, change in CHANGES.items():
            changed = change(scene)
            ways = [
                lambda previous=previous: timed(changed, previous=previous, **how)  # noqa: B023
                for previous in (first, None)
            ]
            (_, short), (_, long) = in_turn(asked.runs, *ways)
            print(f"{name:18} {1e3 * short:6.0f} {1e3 * long:6.0f}  {short / long:.2f}")
    random, result, ratio = np.random.default_rng(1), None, []
    how = {"strategy": "spawning", "tolerance": 0.02}
    for _ in range(20):
        start = round(random.uniform(0.0, 0.18) / SIDE * 320) * SIDE / 320
        scene = plate(320).replace(loads=press(start, 0.02, (random.normal(), -2.0)))
        result = solve(scene, previous=result, **how)
        ratio.append(result.agents / solve(scene, **how).agents)
    print(f"agents after each of 20 random moves, against afresh: {np.mean(ratio):.2f} times")


def growth(asked: argparse.Namespace) -> None:
    """Print what a load costs on larger and larger bodies."""
    print(f"\ntolerance 0.02\n{'side':>6}{'cells':>16}{'agents':>10}{'time (s)':>10}")
    for side in (1, 8, 64):
        scene = plate(20 * side, 0.1 * side, 0.01, SIDE * side)
        ((result, seconds),) = in_turn(asked.runs, lambda: timed(scene, tolerance=0.02))  # noqa: B023
        print(f"{side:6}{scene.lattice.size:16,}{result.agents:10,}{seconds:10.2f}")


def largest(asked: argparse.Namespace) -> None:
    """Print the largest error anywhere, also at the load's ends, where the slope is infinite."""
    distance, angle = np.geomspace(1e-6, 5e-3, 40), np.linspace(np.pi, 2 * np.pi, 9)
    around = distance[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [around.reshape(-1, 2) + end for end in ([0.09, SIDE], [0.11, SIDE])]
    inside = np.random.default_rng(0).random((20_000, 2)) * SIDE
    points = np.minimum(np.concatenate([*ends, inside]), SIDE)
    displaced = {"strategy": "spawning", "tolerance_at": "displacement"}
    true = solve(plate(20), tolerance=1.5e-4, **displaced).displacement_at(points)
    print(f"\n{'':10}{'cells':>12}{'time (s)':>10}{'error':>10}")
    runs = [{"tolerance": t, **displaced} for t in (4e-3, 2e-3, 1e-3, 5e-4)]
    runs += [{"strategy": "uniform", "resolution": k} for k in (16, 32, 64)]
    for how in runs:
        ((result, seconds),) = in_turn(asked.runs, lambda: timed(plate(20), **how))  # noqa: B023
        error = np.abs(result.displacement_at(points) - true).max() / np.abs(true).max()
        print(f"{how['strategy']:10}{result.summary()['agents']:12,}{seconds:10.3f}{error:10.2e}")


PARTS = {part.__name__: part for part in (bodies, again, growth, largest)}


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help=", ".join(PARTS), default=list(PARTS))
    parser.add_argument("--cells", type=int, default=512, help="cells along every axis")
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--bodies", nargs="+", default=BODIES, choices=BODIES)
    asked = parser.parse_args()
    for name in asked.parts:
        PARTS[name](asked)


if __name__ == "__main__":
    main()
