"""Quantities that a tolerance is about: how far estimates are off, and what they save.

The true value is that of an answer to a twentieth of the smallest tolerance. For every
tolerance: agents, true relative error, the estimate over it, and the agents that the energy
norm takes to come as near, and to stay so. Run:

    python benchmarks/goals.py            # some minutes
    python benchmarks/goals.py plate      # one body
    python benchmarks/goals.py random     # bounds of figures of random bodies: are they kept
"""

import sys
from pathlib import Path

import numpy as np
from bounds import body_of

from kaju import Deflection, Reaction, Stress, solve
from kaju.errors import ConvergenceError, KajuError
from kaju.model.elastic.spawning.quantities import described, quantities_of

sys.path.append(str(Path(__file__).parent.parent / "tests" / "support"))

import goal_bodies as bodies

CASES = {
    "plate": [
        Deflection((0.105, 0.2), "y"),
        (0.1, 0.1),
        (0.2, 0.2),
        Deflection("right", "x"),
        Stress({"box": [[0.09, 0.09], [0.11, 0.11]]}, "yy"),
        Stress({"box": [[0.0, 0.0], [0.02, 0.02]]}, "yy"),
        Stress({"disk": {"centre": [0.12, 0.15], "radius": 0.02}}, "von_mises"),
        Stress((0.105, 0.15), "yy"),
    ],
    "angle": [(0.8, 0.4), (0.2, 0.8), Stress({"box": [[0.3, 0.4], [0.4, 0.5]]}, "yy")],
    "pierced": [
        Deflection("top", "y"),
        (0.1, 0.1625),
        Stress({"box": [[0.15, 0.0875], [0.1625, 0.1125]]}, "yy"),
    ],
    "cantilever": [
        (0.4, 0.025),
        (0.2, 0.025),
        Stress({"box": [[0.0, 0.0375], [0.025, 0.05]]}, "xx"),
        Stress({"box": [[0.2, 0.0], [0.2, 0.05]]}, "xy"),
    ],
    "inclusion": [
        (0.1, 0.1),
        (0.075, 0.2),
        Stress({"box": [[0.075, 0.075], [0.125, 0.125]]}, "yy"),
        Stress((0.1, 0.1), "von_mises"),
    ],
    "rubber": [
        (0.075, 0.2),
        Deflection((0.0, 0.1), "x"),
        Stress({"box": [[0.075, 0.075], [0.125, 0.125]]}, "yy"),
    ],
    "sheared": [
        (0.05, 0.05),
        Reaction("top", "x"),
        Stress({"box": [[0.05, 0.05], [0.15, 0.15]]}, "xy"),
    ],
    "cube": [
        Deflection((0.5, 0.5, 1.0), "z"),
        Deflection((0.5, 0.5, 0.5), "z"),
        Stress({"box": [[0.375, 0.375, 0.375], [0.625, 0.625, 0.625]]}, "zz"),
    ],
    "beam": [
        Deflection((1.0, 0.125, 0.125), "z"),
        Stress({"box": [[0.0, 0.0, 0.1875], [0.125, 0.25, 0.25]]}, "xx"),
    ],
}
TOLERANCES = {2: (0.05, 0.02, 0.01, 0.004), 3: (0.1, 0.05, 0.02)}
ENERGY = {2: tuple(0.5 * 0.8**k for k in range(18)), 3: tuple(0.5 * 0.8**k for k in range(9))}


def finest(scene, quantity, tolerance):
    """Return the value that stands for the truth, and what its error is relative to."""
    try:
        result = solve(scene, tolerance=tolerance, tolerance_at=quantity, most_agents=300_000)
    except ConvergenceError as error:
        result = error.best
    goal = result.goals[0]
    return goal.value, goal.error_estimate / goal.relative_error


def by_energy(scene, quantities):
    """Return agents that the energy norm asks for, and the values of quantities by them."""
    found = []
    for tolerance in ENERGY[scene.lattice.dimension]:
        result = solve(scene, tolerance=tolerance, strategy="spawning")
        found.append((result.agents, [result.value_of(q) for q in quantities]))
    return found


def fewest(runs, number, truth, off):
    """Return how many agents, and any more, have no larger error in a quantity."""
    enough = "more"
    for agents, values in reversed(runs):
        if np.linalg.norm(values[number] - truth) > off:
            break
        enough = f"{agents:,}"
    return enough


def table(name):
    scene = getattr(bodies, name)()
    tolerances = TOLERANCES[scene.lattice.dimension]
    quantities = quantities_of(CASES[name])
    runs = by_energy(scene, quantities)
    print(f"\n{name}")
    for number, quantity in enumerate(quantities):
        truth, scale = finest(scene, quantity, tolerances[-1] / 20)
        row = []
        for tolerance in tolerances:
            result = solve(scene, tolerance=tolerance, tolerance_at=quantity)
            off = np.linalg.norm(result.goal_values[0] - truth)
            factor = result.goal_error_estimate * scale / off
            others = fewest(runs, number, truth, off)
            row.append(f"{result.agents:6,} {off / scale:7.1e} {factor:5.2f} {others:>7}")
        print(f"  {text_of(quantity):44}", " |".join(row), flush=True)


def drawn(seed):
    """Return a random body of `bounds`, and means over a cell, and a figure at a point."""
    scene, rng = body_of(seed), np.random.default_rng([15, seed])
    cells, edge = np.indices(scene.lattice.shape).reshape(2, -1).T, scene.lattice.cell_size
    cells = cells[scene.kinds(cells) >= 0]
    low = edge * cells[rng.integers(len(cells))]
    box = {"box": [low.tolist(), (low + edge).tolist()]}
    component = str(rng.choice(["xx", "yy", "xy"]))
    point = tuple((low + edge * rng.random(2)).tolist())
    return scene, [Deflection(box), Stress(box, component), Deflection(point)]


def random(bodies=30, tolerance=0.05):
    """Tell how often tolerances are kept, and the truth is within the bound."""
    found = {name: [] for name in ("mean deflection", "mean stress", "deflection of a point")}
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
            print(
                seed,
                name,
                f"{off / tolerance:.2f} {own / tolerance:.2f}",
                result.agents,
                flush=True,
            )
    for name, rows in found.items():
        off, own, bound, agents = np.array(rows, dtype=float).T
        off, own, bound = (error / tolerance for error in (off, own, bound))
        print(f"{name}: {len(rows)}, of {np.median(agents):.0f} agents")
        for what, error in (("error", off), ("error without the dual stress", own)):
            print(f"  {what}: kept {np.mean(error <= 1.0):.1%}, worst {error.max():.2f} times")
        outside = np.count_nonzero(off > bound + 0.01)
        print(
            f"  bound: proved {np.mean(bound <= 1.0):.1%}, truth outside {outside} times, median "
            f"{np.median(bound):.1f}, largest {bound.max():.1f} times the tolerance"
        )


def text_of(quantity):
    values = [value for value in described(quantity).values() if value is not None]
    return " ".join(str(value) for value in values)[:44]


def main():
    for name in sys.argv[1:] or CASES:
        random() if name == "random" else table(name)


if __name__ == "__main__":
    main()
