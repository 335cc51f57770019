"""How far the estimated displacement error is from the true one: random plane bodies.

    python benchmarks/displacement_error.py random --first 80 --count 60

The truth is that of elements of order 2 graded into every corner.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from bounds import body_of
from shared import by_name

from kaju import finite_elements, solve
from kaju.errors import KajuError


def random(first: int = 80, count: int = 60) -> Iterator[str]:
    """Yield the factors of random bodies."""
    found: list[float] = []
    seed = first - 1
    while len(found) < count:
        seed += 1
        try:
            scene = body_of(seed)
            truth, less = (finite_elements(scene, levels=levels) for levels in (8, 6))
            result = solve(scene, strategy="spawning", tolerance=(0.05, 0.2)[seed % 2])
        except KajuError:
            continue
        corners = [result.lower + c * result.size[:, None] for c in (0.001, 0.5, 0.999)]
        points = np.concatenate(corners)
        points = points[:: max(1, len(points) // 3_000)]
        there = truth.displacement_at(points)
        unit = 1.0 / np.linalg.norm(there, axis=1).max()
        fields = (result.displacement_at(points), less.displacement_at(points))
        error, doubt = (unit * np.linalg.norm(u - there, axis=1).max() for u in fields)
        if doubt > 0.2 * error:
            continue
        found.append(result.displacement_error_estimate / error)
        contrast = np.ptp(np.log10([m.youngs_modulus for m in scene.cell_materials]))
        yield f"{seed} {result.agents:7,} {error:8.1e} {found[-1]:5.2f} contrast 1e{contrast:.1f}"
    low, middle, high = np.quantile(found, (0.0, 0.5, 1.0))
    small = np.mean(np.array(found) < 0.8)
    yield f"factors {low:.2f} to {high:.2f}, median {middle:.2f}; below 0.8: {small:.1%}"


if __name__ == "__main__":
    by_name(__doc__, random)
