"""What bodies, changes and tolerances cost, in processor time on one core.

python benchmarks/prices.py                           # everything, some minutes
python benchmarks/prices.py bodies --cells 64 --dimension 3 --runs 1
python benchmarks/prices.py again                     # solving again after a change
python benchmarks/prices.py proofs                    # what is proved of agents
python benchmarks/prices.py growth                    # larger and larger bodies
python benchmarks/prices.py largest                   # the largest error anywhere
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import resource
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shared import by_name, in_turn, timed

from kaju import Scene, solve
from kaju.model.elastic.bounds.energy_bounds import bracket_of

SIDE = 0.2
MATERIALS = {
    "plain": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
    "stiff": {"youngs_modulus": 1e15, "poissons_ratio": 0.3},
    "soft": {"youngs_modulus": 1e3, "poissons_ratio": 0.3},
    "mild": {"youngs_modulus": 1e11, "poissons_ratio": 0.3},
}
LEGEND = {0: "plain", 1: "air", 2: "stiff", 3: "soft", 4: "mild"}
BODIES = ("plain", "hole", "L", "stiff", "soft", "both", "random")


def press(
    start: float, width: float, force: tuple[float, ...] = (0.0, -2.0), top: float = SIDE
) -> list[Any]:
    """Return a load on a part of a plate's top (m, N)."""
    return [{"region": {"box": [[start, top], [start + width, top]]}, "force": list(force)}]


def plate(cells: int, start: float = 0.09, width: float = 0.02, side: float = SIDE) -> Scene:
    """Return a plate, clamped below and pressed on a part of its top."""
    body = {"size": [side] * 2, "cells": [cells] * 2, "thickness": 2e-3, "material": "steel"}
    return Scene(body=body, sides={"bottom": "rigid"}, loads=press(start, width, top=side))


def priced(scene: Scene, runs: int, **how: Any) -> tuple[Any, float]:
    """Return an answer, and the least seconds that it took."""
    return in_turn(runs, lambda: solve(scene, **how))[0]


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


def bodies(cells: int = 512, dimension: int = 2, runs: int = 3) -> Iterator[str]:
    """Yield what a cell costs beside one of a plain plate or cube, and its bound."""
    patch = [[0.04, 0.2], [0.06, 0.2]]
    if dimension == 3:
        patch = [[0.075, 0.075, 0.2], [0.125, 0.125, 0.2]]

    def scene(name: str, cells: int) -> Scene:
        return Scene.from_array(
            kinds_of(name, cells, dimension),
            legend=LEGEND,
            cell_size=SIDE / cells,
            materials=MATERIALS,
            sides={"bottom": "rigid"},
            loads=[{"region": {"box": patch}, "force": [0.0] * (dimension - 1) + [-2.0]}],
        )

    def answer(name: str) -> Callable[[], Any]:
        body = scene(name, cells)
        return lambda: solve(body, strategy="uniform")

    def proof(name: str) -> float:
        result = answer(name)()
        return timed(lambda: result.energy_bounds)[1]

    assert solve(scene("hole", 16), strategy="uniform").error_bound  # compiles
    found = in_turn(runs, *map(answer, BODIES))
    bounds = np.min([[proof(name) for name in BODIES] for _ in range(runs)], axis=0)
    yield f"{'body':8} {'µs a cell':>9} {'ratio':>6} {'halved':>6} {'bound':>6}  method"
    first = None
    for name, (result, seconds), more in zip(BODIES, found, bounds, strict=True):
        price = 1e6 * seconds / (cells * result.subdivision) ** dimension
        bound, first = more / seconds, first or price
        halved = "yes" if result.subdivision > 1 else "no"
        row = f"{name:8} {price:9.3f} {price / first:6.2f} {halved:>6} {bound:6.2f}"
        yield f"{row}  {result.summary()['method']}"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    yield f"at most {peak:.2f} GB held"


CHANGES: dict[str, Callable[[Scene], Scene]] = {
    "force × 1.5": lambda scene: scene.replace(loads=press(0.09, 0.02, (0.0, -3.0))),
    "force turned": lambda scene: scene.replace(loads=press(0.09, 0.02, (0.4, -2.0))),
    "moved by a cell": lambda scene: scene.replace(loads=press(0.09 + SIDE / 320, 0.02)),
    "moved by 10 mm": lambda scene: scene.replace(loads=press(0.1, 0.02)),
    "moved by 70 mm": lambda scene: scene.replace(loads=press(0.16, 0.02)),
    "a hole cut": lambda scene: scene.with_region(disk={"centre": [0.06, 0.14], "radius": 0.01}),
}


def again(runs: int = 3) -> Iterator[str]:
    """Yield what solving again takes beside solving afresh, and whether agents pile up."""
    pierced = plate(320).with_region(disk={"centre": [0.1, 0.1], "radius": 0.03})
    for title, scene, how in (
        ("equal cells, plate with a hole", pierced, {"strategy": "uniform"}),
        ("agents, 0.02", plate(320), {"strategy": "spawning", "tolerance": 0.02}),
        ("agents, 0.005", plate(320), {"strategy": "spawning", "tolerance": 0.005}),
    ):
        first = solve(scene, **how)
        yield f"\n{title}: {first.summary()['agents']:,} agents\n{'':18} again, afresh (ms)"
        for name, change in CHANGES.items():
            changed = change(scene)
            jobs = [
                lambda previous=previous: solve(changed, previous=previous, **how)  # noqa: B023
                for previous in (first, None)
            ]
            (_, short), (_, long) = in_turn(runs, *jobs)
            yield f"{name:18} {1e3 * short:6.0f} {1e3 * long:6.0f}  {short / long:.2f}"
    random, result, ratio = np.random.default_rng(1), None, []
    how = {"strategy": "spawning", "tolerance": 0.02}
    for _ in range(20):
        start = round(random.uniform(0.0, 0.18) / SIDE * 320) * SIDE / 320
        scene = plate(320).replace(loads=press(start, 0.02, (random.normal(), -2.0)))
        result = solve(scene, previous=result, **how)
        ratio.append(result.agents / solve(scene, **how).agents)
    yield f"agents after each of 20 random moves, against afresh: {np.mean(ratio):.2f} times"


def proofs(runs: int = 3) -> Iterator[str]:
    """Yield what the last proof by agents of many sizes takes of their solution."""
    yield f"\n{'tolerance':>9}{'agents':>10}{'time (s)':>10}{'proof':>8}"
    for tolerance in (2e-2, 1e-2, 3e-3):
        result, whole = priced(plate(20), runs, strategy="spawning", tolerance=tolerance)
        spawning = result.found
        _, proof = in_turn(runs, lambda: bracket_of(spawning.boxes()))[0]  # noqa: B023
        yield f"{tolerance:9g}{result.agents:10,}{whole:10.2f}{proof / whole:8.0%}"


def growth(runs: int = 3) -> Iterator[str]:
    """Yield what a load costs on larger and larger bodies."""
    yield f"\ntolerance 0.02\n{'side':>6}{'cells':>16}{'agents':>10}{'time (s)':>10}"
    for side in (1, 8, 64):
        scene = plate(20 * side, 0.1 * side, 0.01, SIDE * side)
        result, seconds = priced(scene, runs, tolerance=0.02)
        yield f"{side:6}{scene.lattice.size:16,}{result.agents:10,}{seconds:10.2f}"


def largest(runs: int = 3) -> Iterator[str]:
    """Yield the largest error anywhere, also at the load's ends, where the slope is infinite."""
    distance, angle = np.geomspace(1e-6, 5e-3, 40), np.linspace(np.pi, 2 * np.pi, 9)
    around = distance[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [around.reshape(-1, 2) + end for end in ([0.09, SIDE], [0.11, SIDE])]
    inside = np.random.default_rng(0).random((20_000, 2)) * SIDE
    points = np.minimum(np.concatenate([*ends, inside]), SIDE)
    displaced = {"strategy": "spawning", "tolerance_at": "displacement"}
    true = solve(plate(20), tolerance=1.5e-4, **displaced).displacement_at(points)
    yield f"\n{'':10}{'cells':>12}{'time (s)':>10}{'error':>10}"
    settings = [{"tolerance": t, **displaced} for t in (4e-3, 2e-3, 1e-3, 5e-4)]
    settings += [{"strategy": "uniform", "resolution": k} for k in (16, 32, 64)]
    for how in settings:
        result, seconds = priced(plate(20), runs, **how)
        error = np.abs(result.displacement_at(points) - true).max() / np.abs(true).max()
        yield f"{how['strategy']:10}{result.summary()['agents']:12,}{seconds:10.3f}{error:10.2e}"


if __name__ == "__main__":
    by_name(__doc__, bodies, again, proofs, growth, largest)
