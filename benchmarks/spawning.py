"""Agents and time against error: equal cells and agents that spawn; growth with the body.

The error is √(U/U* − 1), the relative error in the energy norm, U* from a spawning run with
a third of the smallest tolerance, improved by its own estimate. Times are the processor's. Run:

    python benchmarks/spawning.py            # everything, a few minutes
    python benchmarks/spawning.py plate      # one table

The table `beside` sets the same bodies beside adaptive quadratic elements of scikit-fem, every
mesh on the way counted; it needs scikit-fem and pyamg.
"""

import sys
from math import log, sqrt
from time import process_time

import numpy as np

from kaju import Scene, solve

STEEL = {"material": "steel"}


def plate(side=1):
    """Return the worked plate under 2 N over 10 mm, `side` times as wide and high."""
    size, cells = 0.2 * side, 20 * side
    middle = 0.5 * size
    return Scene(
        body={"size": [size] * 2, "cells": [cells] * 2, "thickness": 2e-3, **STEEL},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[middle, size], [middle + 0.01, size]]}, "force": [0, -2.0]}],
    )


def l_shape():
    return Scene(
        body={"cell_size": 0.1, "drawing": "####....\n" * 4 + "########\n" * 4, "plane": "strain"},
        legend={"#": "steel", ".": "air"},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[0, 0.8], [0.4, 0.8]]}, "force": [100.0, 0.0]}],
    )


def hole():
    """Return a plate with a round hole of cells, which stay when they are split."""
    x = (np.arange(32) + 0.5) / 32 - 0.5
    codes = (np.hypot(*np.meshgrid(x, x)) > 0.25).astype(int)
    return Scene.from_array(
        codes,
        legend={0: "air", 1: "steel"},
        cell_size=0.2 / 32,
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "pressure": 1e6}],
    )


def block(cells=16, patch=0.125):
    """Return the unit cube, clamped below, under 1 N on a square in the middle of its top."""
    low, high = 0.5 - patch / 2, 0.5 + patch / 2
    return Scene(
        body={"size": [1.0] * 3, "cells": [cells] * 3, **STEEL},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[low, low, 1.0], [high, high, 1.0]]}, "force": [0, 0, -1.0]}],
    )


def two_ends():
    """Return the plate under 2 N over 20 mm, and points everywhere and towards the load's ends.

    The displacement's slope is infinite at both ends: equal cells are furthest off there, by a
    share of their edge, and points that are only near do not see it.
    """
    scene = plate()
    load = {"region": {"box": [[0.09, 0.2], [0.11, 0.2]]}, "force": [0, -2.0]}
    distance, angle = np.geomspace(1e-6, 5e-3, 40), np.linspace(np.pi, 2 * np.pi, 9)
    around = distance[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [around.reshape(-1, 2) + end for end in ([0.09, 0.2], [0.11, 0.2])]
    inside = np.random.default_rng(0).random((20_000, 2)) * 0.2
    corners = np.array([[0.0, 0.0], [0.2, 0.0]])
    points = np.minimum(np.concatenate([*ends, inside, corners]), 0.2)
    return scene.replace(loads=[load]), points


def patch():
    """Print the largest displacement error anywhere against agents and time."""
    scene, points = two_ends()
    how = {"tolerance": 1.5e-4, "tolerance_at": "displacement"}
    true = timed(scene, **how)[0].displacement_at(points)
    largest = np.abs(true).max()
    print("\nlargest displacement error anywhere, as a share of the largest displacement")
    print(f"{'':10}{'cells':>12}{'time (s)':>10}{'error':>10}{'estimate':>10}")
    runs = [("spawning", {**how, "tolerance": t}) for t in (4e-3, 2e-3, 1e-3, 5e-4)]
    runs += [("uniform", {"resolution": k, "strategy": "uniform"}) for k in (16, 32, 64, 128)]
    for kind, asked in runs:
        found = [timed(scene, **asked) for _ in range(3)]
        result, seconds = found[0][0], sorted(seconds for _, seconds in found)[1]
        error = np.abs(result.displacement_at(points) - true).max() / largest
        estimate = getattr(result, "displacement_error_estimate", np.nan)
        cells = result.summary()["agents"]
        print(f"{kind:10}{cells:12,}{seconds:10.3f}{error:10.2e}{estimate:10.2e}")


def idle():
    """Print what a long limb costs that no load reaches, of 10 to 10,000 times the plate."""
    print("\na limb beside the loaded plate, held as well, that bears nothing")
    print(f"{'plates':>10}{'agents':>10}{'time (s)':>10}")
    for plates in (0, 10, 100, 1000, 10_000):
        width = 0.2 * (1 + plates)
        scene = Scene(
            body={"size": [width, 0.2], "cells": [20 * (1 + plates), 20], **STEEL},
            sides={"bottom": "rigid"},
            loads=[{"region": {"box": [[0.05, 0.2], [0.07, 0.2]]}, "force": [0, -2.0]}],
        )
        result, seconds = timed(scene, tolerance=0.03)
        print(f"{plates:10,}{result.agents:10,}{seconds:10.2f}")


TABLES = {
    "plate": (plate(), (0.1, 0.05, 0.025, 0.0125), (2, 4, 8, 16, 32)),
    "L": (l_shape(), (0.1, 0.05, 0.025, 0.0125, 0.00625), (2, 4, 8, 16, 32, 64)),
    "hole": (hole(), (0.1, 0.05, 0.025), (1, 2, 4, 8, 16)),
    "block": (block(), (0.4, 0.2, 0.1), (1, 2, 4)),
}


def timed(scene, **how):
    start = process_time()
    result = solve(scene, **{"strategy": "spawning", **how})
    return result, process_time() - start


def table(name):
    scene, tolerances, resolutions = TABLES[name]
    fine = solve(
        scene, strategy="spawning", tolerance=tolerances[-1] / (3 if name != "block" else 2)
    )
    limit = fine.strain_energy * (1 - fine.error_estimate**2)
    print(f"\n{name}: U* = {limit:.7g} J")
    print(f"{'':10}{'agents':>10}{'time (s)':>10}{'error':>10}{'estimate':>10}{'factor':>8}")
    runs = [("spawning", {"tolerance": t}) for t in tolerances]
    runs += [("uniform", {"resolution": k, "strategy": "uniform"}) for k in resolutions]
    found = {"spawning": [], "uniform": []}
    for kind, how in runs:
        result, seconds = timed(scene, **how)
        found[kind].append((result.summary()["agents"], result.error_estimate))
        error = sqrt(abs(result.strain_energy / limit - 1))
        agents = result.summary()["agents"]
        ratio = result.error_estimate / error
        print(
            f"{kind:10}{agents:10,}{seconds:10.2f}{error:10.4f}"
            f"{result.error_estimate:10.4f}{ratio:8.2f}"
        )
    for kind, points in found.items():
        (fewer, before), (more, after) = points[-2:]
        slope = log(after / before) / log(more / fewer)
        print(f"{kind}: at last the estimate falls like the number of agents to the {slope:.2f}")


def beside():
    """Print what adaptive quadratic elements take for the errors of agents."""
    from peers.adaptive_elements import adaptive

    print("\nadaptive quadratic triangles (scikit-fem), all their meshes, and agents")
    print(f"{'':10}{'error':>10}{'elements':>10}{'time (s)':>10}{'agents':>10}{'time (s)':>10}")
    for name, targets in (("plate", (0.02, 0.01, 3e-3)), ("L", (0.02, 0.01, 3e-3))):
        scene = TABLES[name][0]
        fine = solve(scene, strategy="spawning", tolerance=1e-3)
        limit = fine.strain_energy * (1 - fine.error_estimate**2)
        start, meshes = process_time(), []
        for answer, _ in adaptive(scene, order=2):
            error = sqrt(abs(answer.energy / limit - 1))
            meshes.append((error, answer.basis.mesh.nelements, process_time() - start))
            if error < targets[-1] or answer.unknowns > 400_000:
                break
        for target in targets:
            elements = next((row for row in meshes if row[0] <= target), (0, "-", float("nan")))
            result, seconds = timed(scene, tolerance=target)
            told = f"{elements[1]:>10}{elements[2]:10.2f}{result.agents:10,}{seconds:10.2f}"
            print(f"{name:10}{target:10.3g}{told}")


def growth():
    print("\nbody's side times 1 to 64 under the same load, tolerance 0.02")
    print(f"{'side':>6}{'cells':>16}{'agents':>10}{'time (s)':>10}")
    for side in (1, 2, 4, 8, 16, 32, 64):
        result, seconds = timed(plate(side), tolerance=0.02)
        print(f"{side:6}{result.scene.lattice.size:16,}{result.agents:10,}{seconds:10.2f}")


def giant():
    print("\n16,384³ cells under a patch, tolerance 0.1 (1 % of the energy)")
    scene = block(16384, patch=0.02)
    result, seconds = timed(scene, tolerance=0.1)
    print(f"{result.agents:,} agents, estimate {result.error_estimate:.3f}, {seconds:.1f} s")


def main():
    asked = sys.argv[1:] or [*TABLES, "growth", "giant", "patch", "idle", "beside"]
    solve(plate(), strategy="spawning", tolerance=0.03)
    solve(plate(), resolution=2, strategy="uniform")
    for name in asked:
        if name in TABLES:
            table(name)
        else:
            others = {f.__name__: f for f in (growth, giant, patch, idle, beside)}
            others[name]()


if __name__ == "__main__":
    main()
