"""How far the estimated displacement error is from the true one: the factor, body by body.

The true error is the largest difference from an answer with a fifth of the estimated error (or
as many agents as are allowed), at corners and middles of its agents. Run:

    python benchmarks/displacement_error.py            # some minutes
    python benchmarks/displacement_error.py plate      # one body
"""

import sys
from pathlib import Path

import numpy as np

from kaju import solve
from kaju.errors import ConvergenceError

ROOT = Path(__file__).parent.parent
sys.path.append(str(ROOT / "tests"))

from goal_bodies import FLAT, SOLID  # noqa: E402
from spawning_bodies import BODIES  # noqa: E402

MADE = {body.__name__: body for body in FLAT + SOLID}
MADE |= {f"{name}-2" if name in MADE else name: body for name, body in BODIES.items()}
TOLERANCES = {2: (0.3, 0.2, 0.1, 0.05, 0.025), 3: (0.4, 0.3, 0.2, 0.12)}
"""In the energy norm."""


def finest(scene, tolerance):
    """Return the answer that stands for the truth."""
    try:
        return solve(scene, tolerance=tolerance, tolerance_at="displacement", most_agents=500_000)
    except ConvergenceError as error:
        return error.best


def factors(scene):
    """Yield agents, true error and estimate over it, for every tolerance."""
    results = [
        solve(scene, strategy="spawning", tolerance=tolerance)
        for tolerance in TOLERANCES[scene.lattice.dimension]
    ]
    least = min(result.displacement_error_estimate for result in results)
    fine = finest(scene, 0.2 * least)
    points = np.concatenate([fine.lower + c * fine.size[:, None] for c in (0.0, 0.5, 1.0)])
    points = points[:: max(1, fine.agents // 20_000)]
    truth = fine.displacement_at(points)
    for result in results:
        off = np.linalg.norm(result.displacement_at(points) - truth, axis=1).max()
        error = off / fine.max_displacement
        yield result.agents, error, result.displacement_error_estimate / error


def main():
    for name in sys.argv[1:] or MADE:
        row = [f"{n:7,} {e:8.1e} {f:5.2f}" for n, e, f in factors(MADE[name]())]
        print(f"{name:16}", " |".join(row), flush=True)


if __name__ == "__main__":
    main()
