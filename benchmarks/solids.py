"""Solids with true outlines: fractions against staircases, and the truth within its bounds.

python benchmarks/solids.py ball | tube | random [seeds]
"""

from __future__ import annotations

import sys
from math import log2
from time import perf_counter
from typing import Any

import numpy as np

import kaju

STEEL = {"steel": {"youngs_modulus": 206e9, "poissons_ratio": 0.3}}
SYMMETRIC = {"left": "roller", "front": "roller", "bottom": "roller"}
PULLED = [{"side": "top", "force": [0.0, 0.0, 1.0]}]


def block(cells: int, *regions: dict[str, Any], outline: str = "true", **asked: Any) -> kaju.Scene:
    """Return a cube of 1 m with regions cut out, pulled at its top."""
    drawn = [{"material": "air", "outline": outline} | region for region in regions]
    body = {"size": [1, 1, 1], "cells": [cells] * 3, "material": "steel", "regions": drawn}
    return kaju.Scene(body=body, materials=STEEL, **({"sides": SYMMETRIC, "loads": PULLED} | asked))


def told(name: str, region: dict[str, Any], sizes: tuple[int, ...] = (8, 16, 32)) -> None:
    """Print energies of cells, and of fractions with their bounds (pJ)."""
    rows = []
    for cells in sizes:
        cut = kaju.solve(block(cells, region))
        steps = kaju.solve(block(cells, region, outline="cells"))
        lower, upper = (1e12 * bound for bound in cut.energy_bounds or (0.0, np.inf))
        rows.append((cells, 1e12 * steps.strain_energy, 1e12 * cut.strain_energy, lower, upper))
    coarse, middle, fine = (row[2] for row in rows[-3:])  # of cells half as large each
    order = log2((middle - coarse) / (fine - middle))
    truth = fine + (fine - middle) / (2.0**order - 1.0)
    print(f"{name}: {truth:.5f} pJ, continued by the order seen, {order:.1f}")
    for row in rows:
        off, stepped = (abs(row[k] / truth - 1.0) for k in (2, 1))
        print(
            f"{row[0]:4d}  staircase {row[1]:.4f} ({stepped:.1e})  fractions {row[2]:.5f} "
            f"({off:.1e})  bounds {row[3]:.4f} {row[4]:.4f}",
            flush=True,
        )


def tube(sizes: tuple[int, ...] = (8, 16, 32)) -> None:
    """Compare a hole through a block, held in front and behind, with the plane's proved answer."""
    plane = kaju.Scene(
        body={
            "size": [1, 1],
            "cells": [8, 8],
            "material": "steel",
            "plane": "strain",
            "regions": [
                {"disk": {"centre": [0, 0], "radius": 0.37}, "material": "air", "outline": "true"}
            ],
        },
        materials=STEEL,
        sides={"left": "roller", "bottom": "roller"},
        loads=[{"side": "top", "force": [0.0, 1.0]}],
    )
    lower, upper = kaju.solve(plane, tolerance=0.01).energy_bounds
    print(f"plane: {1e12 * lower:.5f} to {1e12 * upper:.5f} pJ")
    hole = {"cylinder": {"ends": [[0, -1, 0], [0, 2, 0]], "radius": 0.37}}
    kinds = {"sides": SYMMETRIC | {"back": "roller"}}
    for cells in sizes:
        cut = kaju.solve(block(cells, hole, **kinds))
        steps = kaju.solve(block(cells, hole, outline="cells", **kinds))
        middle = 0.5 * (lower + upper)
        off, stepped = (one.strain_energy / middle - 1.0 for one in (cut, steps))
        low, high = cut.energy_bounds
        print(
            f"{cells:4d}  staircase {stepped:+.1e}  fractions {off:+.1e}  bounds "
            f"{1e12 * low:.4f} {1e12 * high:.4f}",
            flush=True,
        )


def random_region(rng: np.random.Generator) -> dict[str, Any]:
    """Return a ball, a slanted cylinder or a turned box somewhere within the block."""
    middle, size = rng.uniform(0.35, 0.6, 3), rng.uniform(0.12, 0.27)
    kind = rng.integers(3)
    if kind == 0:
        return {"ball": {"centre": middle.tolist(), "radius": size}}
    if kind == 1:
        way = rng.normal(size=3)
        way *= 0.2 / np.linalg.norm(way)
        ends = [(middle - way).tolist(), (middle + way).tolist()]
        return {"cylinder": {"ends": ends, "radius": min(size, 0.2)}}
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    half = rng.uniform(0.1, 0.18, 3)

    def distance(points: np.ndarray) -> np.ndarray:
        return (np.abs((points - middle) @ turn) - half).max(axis=1)

    return {"image": kaju.sampled_shape(distance, (0.0,) * 3, (1.0,) * 3, (33,) * 3)}


def random_solids(many: int, sizes: tuple[int, ...] = (8, 12, 16)) -> None:
    """Hold the bounds of random solids on several grids against each other."""
    held = within = 0
    for seed in range(many):
        start = perf_counter()
        region = random_region(np.random.default_rng(seed))
        answers = [kaju.solve(block(cells, region)) for cells in sizes]
        lower, upper = zip(*(answer.energy_bounds for answer in answers), strict=True)
        fine = answers[-1].strain_energy
        held += max(lower) <= min(upper)
        within += all(
            low <= one.strain_energy <= high
            for low, high, one in zip(lower, upper, answers, strict=True)
        )
        gaps = " ".join(f"{high / low - 1.0:.2f}" for low, high in zip(lower, upper, strict=True))
        off = " ".join(f"{one.strain_energy / fine - 1.0:+.1e}" for one in answers[:-1])
        seconds = perf_counter() - start
        print(
            f"{seed:3d} {next(iter(region)):8s} gaps {gaps}  off {off}  {seconds:.0f} s", flush=True
        )
    print(f"{held} of {many} hold one energy on all grids; fractions lie within of {within}")


if __name__ == "__main__":
    if sys.argv[1] == "ball":
        told("ball", {"ball": {"centre": [0, 0, 0], "radius": 0.62}})
    elif sys.argv[1] == "tube":
        tube()
    else:
        random_solids(int(sys.argv[2]) if len(sys.argv) > 2 else 20)
