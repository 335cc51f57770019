"""Quantities that a tolerance is about: how far estimates are off, and what they save.

The true value is that of an answer to a twentieth of the smallest tolerance. For every
tolerance: agents, true relative error, and the estimate over it. Run:

    python benchmarks/goals.py                        # some minutes
    python benchmarks/goals.py tables --name plate    # one body
    python benchmarks/goals.py random     # bounds of figures of random bodies: are they kept
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from bounds import body_of
from shared import by_name, nearest, of_tests

from kaju import Deflection, Reaction, Scene, Stress, solve
from kaju.errors import KajuError
from kaju.model.elastic.goals.quantities import described, quantities_of


def mean(low: tuple[float, ...], high: tuple[float, ...], component: str) -> Stress:
    """Return the mean of a stress over a box."""
    return Stress({"box": [list(low), list(high)]}, component)


CASES: dict[str, list[Any]] = {
    "plate": [
        Deflection((0.105, 0.2), "y"),
        (0.1, 0.1),
        (0.2, 0.2),
        Deflection("right", "x"),
        mean((0.09, 0.09), (0.11, 0.11), "yy"),
        mean((0.0, 0.0), (0.02, 0.02), "yy"),
        Stress({"disk": {"centre": [0.12, 0.15], "radius": 0.02}}, "von_mises"),
        Stress((0.105, 0.15), "yy"),
    ],
    "angle": [(0.8, 0.4), (0.2, 0.8), mean((0.3, 0.4), (0.4, 0.5), "yy")],
    "pierced": [
        Deflection("top", "y"),
        (0.1, 0.1625),
        mean((0.15, 0.0875), (0.1625, 0.1125), "yy"),
    ],
    "cantilever": [
        (0.4, 0.025),
        (0.2, 0.025),
        mean((0.0, 0.0375), (0.025, 0.05), "xx"),
        mean((0.2, 0.0), (0.2, 0.05), "xy"),
    ],
    "inclusion": [
        (0.1, 0.1),
        (0.075, 0.2),
        mean((0.075, 0.075), (0.125, 0.125), "yy"),
        Stress((0.1, 0.1), "von_mises"),
    ],
    "rubber": [
        (0.075, 0.2),
        Deflection((0.0, 0.1), "x"),
        mean((0.075, 0.075), (0.125, 0.125), "yy"),
    ],
    "sheared": [(0.05, 0.05), Reaction("top", "x"), mean((0.05, 0.05), (0.15, 0.15), "xy")],
    "cube": [
        Deflection((0.5, 0.5, 1.0), "z"),
        Deflection((0.5, 0.5, 0.5), "z"),
        mean((0.375,) * 3, (0.625,) * 3, "zz"),
    ],
    "beam": [
        Deflection((1.0, 0.125, 0.125), "z"),
        mean((0.0, 0.0, 0.1875), (0.125, 0.25, 0.25), "xx"),
    ],
}
TOLERANCES = {2: (0.05, 0.02, 0.01, 0.004), 3: (0.1, 0.05, 0.02)}


def finest(scene: Scene, quantity: Any, tolerance: float) -> tuple[Any, float]:
    """Return the value that stands for the truth, and what its error is relative to."""
    asked = {"tolerance": tolerance, "tolerance_at": quantity, "most_agents": 300_000}
    goal = nearest(scene, **asked).goals[0]
    return goal.value, goal.error_estimate / goal.relative_error


def tables(name: str = "") -> Iterator[str]:
    """Yield a row for every quantity, or for those of one body: a column for each tolerance."""
    for body in [name] if name else CASES:
        scene, quantities = getattr(of_tests("goal_bodies"), body)(), quantities_of(CASES[body])
        tolerances = TOLERANCES[scene.lattice.dimension]
        yield f"\n{body}"
        for quantity in quantities:
            truth, scale = finest(scene, quantity, tolerances[-1] / 20)
            row = []
            for tolerance in tolerances:
                result = solve(scene, tolerance=tolerance, tolerance_at=quantity)
                off = float(np.linalg.norm(result.goal_values[0] - truth))
                factor = result.goal_error_estimate * scale / off
                row.append(f"{result.agents:6,} {off / scale:7.1e} {factor:5.2f}")
            name = " ".join(str(v) for v in described(quantity).values() if v is not None)[:44]
            yield f"  {name:44} {' |'.join(row)}"


def drawn(seed: int) -> tuple[Scene, list[Any]]:
    """Return a random body of `bounds`, and means over a cell, and a figure at a point."""
    scene, rng = body_of(seed), np.random.default_rng([15, seed])
    cells, edge = np.indices(scene.lattice.shape).reshape(2, -1).T, scene.lattice.cell_size
    cells = cells[scene.kinds(cells) >= 0]
    low = edge * cells[rng.integers(len(cells))]
    box = {"box": [low.tolist(), (low + edge).tolist()]}
    component = str(rng.choice(["xx", "yy", "xy"]))
    point = tuple((low + edge * rng.random(2)).tolist())
    return scene, [Deflection(box), Stress(box, component), Deflection(point)]


def random(bodies: int = 30, tolerance: float = 0.05) -> Iterator[str]:
    """Yield how often tolerances are kept, and the truth is within the bound."""
    names = ("mean deflection", "mean stress", "deflection of a point")
    found: dict[str, list[Any]] = {name: [] for name in names}
    seed = -1
    while len(found["mean stress"]) < bodies:
        seed += 1
        try:
            scene, quantities = drawn(seed)
            results = [solve(scene, tolerance=tolerance, tolerance_at=q) for q in quantities]
        except KajuError:
            continue
        moduli = [m.youngs_modulus for m in scene.cell_materials]
        if max(moduli) > 1e4 * min(moduli):
            continue
        for name, quantity, result in zip(found, quantities, results, strict=True):
            truth, scale = finest(scene, quantity, tolerance / 10)
            goal = result.goals[0]
            off = np.linalg.norm(goal.value - truth) / scale
            own = np.linalg.norm(result.value_of(quantity) - truth) / scale
            found[name].append((off, own, goal.relative_bound, result.agents))
            yield f"{seed} {name} {off / tolerance:.2f} {own / tolerance:.2f} {result.agents}"
    for name, rows in found.items():
        *errors, agents = np.array(rows, dtype=float).T
        off, own, bound = (error / tolerance for error in errors)
        yield f"{name}: {len(rows)}, of {np.median(agents):.0f} agents"
        for what, error in (("error", off), ("error without the dual stress", own)):
            yield f"  {what}: kept {np.mean(error <= 1.0):.1%}, worst {error.max():.2f} times"
        outside = np.count_nonzero(off > bound + 0.01)
        yield (
            f"  bound: proved {np.mean(bound <= 1.0):.1%}, truth outside {outside} times, median "
            f"{np.median(bound):.1f}, largest {bound.max():.1f} times the tolerance"
        )


if __name__ == "__main__":
    by_name(__doc__, tables, random, usual=(tables,))
