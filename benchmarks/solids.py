"""Solids with true outlines: fractions against staircases, and the truth within its bounds.

python benchmarks/solids.py ball | tube | random [--many 20]
"""

from __future__ import annotations

from collections.abc import Iterator
from math import log2
from time import perf_counter
from typing import Any

import numpy as np
from shared import by_name

import kaju

STEEL = {"steel": {"youngs_modulus": 206e9, "poissons_ratio": 0.3}}
SYMMETRIC = {"left": "roller", "front": "roller", "bottom": "roller"}
PULLED = [{"side": "top", "force": [0.0, 0.0, 1.0]}]


def block(cells: int, *regions: dict[str, Any], outline: str = "true", **asked: Any) -> kaju.Scene:
    """Return a cube of 1 m with regions cut out, pulled at its top."""
    drawn = [{"material": "air", "outline": outline} | region for region in regions]
    body = {"size": [1, 1, 1], "cells": [cells] * 3, "material": "steel", "regions": drawn}
    return kaju.Scene(body=body, materials=STEEL, **({"sides": SYMMETRIC, "loads": PULLED} | asked))


SIZES = (8, 16, 32)  # Cells along an edge


def both(region: dict[str, Any], **asked: Any) -> list[tuple[Any, Any]]:
    """Return the answers of fractions and of the staircase, size by size."""
    return [
        (
            kaju.solve(block(cells, region, **asked)),
            kaju.solve(block(cells, region, outline="cells", **asked)),
        )
        for cells in SIZES
    ]


def ball() -> Iterator[str]:
    """Yield energies of cells, and of fractions with their bounds (pJ)."""
    answers = both({"ball": {"centre": [0, 0, 0], "radius": 0.62}})
    coarse, middle, fine = (1e12 * cut.strain_energy for cut, _ in answers)
    order = log2((middle - coarse) / (fine - middle))
    truth = fine + (fine - middle) / (2.0**order - 1.0)
    yield f"ball: {truth:.5f} pJ, continued by the order seen, {order:.1f}"
    for cells, (cut, steps) in zip(SIZES, answers, strict=True):
        energy, stepped = (1e12 * one.strain_energy for one in (cut, steps))
        lower, upper = (1e12 * bound for bound in cut.energy_bounds or (0.0, np.inf))
        yield (
            f"{cells:4d}  staircase {stepped:.4f} ({abs(stepped / truth - 1):.1e})  fractions "
            f"{energy:.5f} ({abs(energy / truth - 1):.1e})  bounds {lower:.4f} {upper:.4f}"
        )


def tube() -> Iterator[str]:
    """Compare a hole through a block, held in front and behind, with the plane's proved answer."""
    hole = {"disk": {"centre": [0, 0], "radius": 0.37}, "material": "air", "outline": "true"}
    body = {"size": [1, 1], "cells": [8, 8], "material": "steel", "plane": "strain"}
    plane = kaju.Scene(
        body=body | {"regions": [hole]},
        materials=STEEL,
        sides={"left": "roller", "bottom": "roller"},
        loads=[{"side": "top", "force": [0.0, 1.0]}],
    )
    bounds = kaju.solve(plane, tolerance=0.01).energy_bounds
    yield "plane: {:.5f} to {:.5f} pJ".format(*(1e12 * bound for bound in bounds))
    middle = 0.5 * sum(bounds)
    through = {"cylinder": {"ends": [[0, -1, 0], [0, 2, 0]], "radius": 0.37}}
    answers = both(through, sides=SYMMETRIC | {"back": "roller"})
    for cells, (cut, steps) in zip(SIZES, answers, strict=True):
        off, stepped = (one.strain_energy / middle - 1.0 for one in (cut, steps))
        low, high = (1e12 * bound for bound in cut.energy_bounds)
        yield (
            f"{cells:4d}  staircase {stepped:+.1e}  fractions {off:+.1e}  bounds "
            f"{low:.4f} {high:.4f}"
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


def random(many: int = 20) -> Iterator[str]:
    """Hold the bounds of random solids on several grids against each other."""
    held = within = 0
    for seed in range(many):
        start = perf_counter()
        region = random_region(np.random.default_rng(seed))
        answers = [kaju.solve(block(cells, region)) for cells in (8, 12, 16)]
        lower, upper = np.transpose([answer.energy_bounds for answer in answers])
        energy = np.array([answer.strain_energy for answer in answers])
        held += lower.max() <= upper.min()
        within += np.all((lower <= energy) & (energy <= upper))
        gaps = " ".join(f"{gap:.2f}" for gap in upper / lower - 1.0)
        off = " ".join(f"{share:+.1e}" for share in energy[:-1] / energy[-1] - 1.0)
        seconds = perf_counter() - start
        yield f"{seed:3d} {next(iter(region)):8s} gaps {gaps}  off {off}  {seconds:.0f} s"
    yield f"{held} of {many} hold one energy on all grids; fractions lie within of {within}"


if __name__ == "__main__":
    by_name(__doc__, ball, tube, random)
