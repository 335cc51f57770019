"""How far the estimated displacement error is from the true one: the factor, body by body.

The true error is the largest difference from an answer with a fifth of the estimated error (or
as many agents as are allowed), at corners and middles of its agents. Run:

    python benchmarks/displacement_error.py bodies               # some minutes
    python benchmarks/displacement_error.py bodies --name plate  # one body
    python benchmarks/displacement_error.py random --first 80    # 60 random plane bodies

Of random bodies the truth is that of elements of order 2 graded into every corner.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from bounds import body_of
from shared import by_name, nearest, of_tests

from kaju import Scene, finite_elements, solve
from kaju.errors import KajuError

GOALS, SPAWNING = of_tests("goal_bodies"), of_tests("spawning_bodies").BODIES
MADE = {body.__name__: body for body in GOALS.FLAT + GOALS.SOLID}
MADE |= {f"{name}-2" if name in MADE else name: body for name, body in SPAWNING.items()}
TOLERANCES = {2: (0.3, 0.2, 0.1, 0.05, 0.025), 3: (0.4, 0.3, 0.2, 0.12)}
"""In the energy norm."""


def factors(scene: Scene) -> Iterator[tuple[int, float, float]]:
    """Yield agents, true error and estimate over it, for every tolerance."""
    results = [
        solve(scene, strategy="spawning", tolerance=tolerance)
        for tolerance in TOLERANCES[scene.lattice.dimension]
    ]
    least = min(result.displacement_error_estimate for result in results)
    asked = {"tolerance": 0.2 * least, "tolerance_at": "displacement", "most_agents": 500_000}
    fine = nearest(scene, **asked)
    points = np.concatenate([fine.lower + c * fine.size[:, None] for c in (0.0, 0.5, 1.0)])
    points = points[:: max(1, fine.agents // 20_000)]
    truth = fine.displacement_at(points)
    for result in results:
        off = np.linalg.norm(result.displacement_at(points) - truth, axis=1).max()
        error = off / fine.max_displacement
        yield result.agents, error, result.displacement_error_estimate / error


def bodies(name: str = "") -> Iterator[str]:
    """Tell the factors of bodies of the tests."""
    for each in [name] if name else MADE:
        row = [f"{n:7,} {e:8.1e} {f:5.2f}" for n, e, f in factors(MADE[each]())]
        yield f"{each:16} {' |'.join(row)}"


def random(first: int = 80, count: int = 60) -> Iterator[str]:
    """Tell the factors of random bodies."""
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
    by_name(__doc__, bodies, random, usual=(bodies,))
