"""Compute the true answers of the benchmark's problems, the worked plate and the tests of spawning.

Plane bodies: triangles of order 4, graded geometrically towards every point where the
solution is singular (re-entrant corners, ends of the ground, ends of the load). Others: bricks
of order 2 graded towards singular edges; of the benchmark's block a quarter. Each answer is
computed on two meshes; what they differ by is printed and goes into the source.
Needs scikit-fem and pyamg. Run it with

    python benchmarks/finite_element_truth.py            # all; minutes, and 6 GB of memory
    python benchmarks/finite_element_truth.py block      # the block only, "plates", or a body of
                                                         # spawning_bodies.py by its name
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import skfem
from peers.graded_bricks import solve_bricks
from peers.problems import BLOCK, PIXELS, PLATE, Problem
from shared import TESTS, of_tests

from kaju import Scene, finite_elements
from kaju.model.study.reference import Reference

PEERS = Path(__file__).parent / "peers"
SPAWNING = of_tests("spawning_bodies")
LEVELS, FEWER = (10, 16), (8, 14)
"""Halvings of the triangles around singular points, on the two meshes (FEWER: spawning)."""
PARTS = {"cube": (4, 6), "cube-rubber": (3, 4), "cube-inclusion": (4, 6)}
"""Bricks along a cell of the body, on the two meshes."""
PLANES = {"cube": ((1, 4), (1, 4), (0, 4)), "cube-rubber": ((1, 4), (1, 4), (0, 4))}
PLANES["cube-inclusion"] = ((1, 2, 4), (1, 2, 4), (0, 1, 2, 4))
"""Grid planes that hold singular edges, along x, y and z."""
LOADED_CELL = ((0.10, 0.2), (0.11, 0.2))
"""The worked example presses on cell 10 of 20: x from 100 to 110 mm."""


def quarter() -> Scene:
    """Return the quarter x, y < ½ of the block, on rollers where it was cut."""
    patch = [list(BLOCK.patch[0]), [0.5, 0.5, 1.0]]
    body = {"cells": [4, 4, 8], "cell_size": BLOCK.edge, "material": "solid"}
    law = {"youngs_modulus": BLOCK.youngs_modulus, "poissons_ratio": BLOCK.poissons_ratio}
    return Scene(
        body=body,
        materials={"solid": law},
        sides={"bottom": "rigid", "right": "roller", "back": "roller"},
        loads=[{"region": {"box": patch}, "force": [0.0, 0.0, -BLOCK.force / 4]}],
    )


def on_two(kind: str, solve, sizes, points):
    """Return the finer of two answers, its displacement at points, and where it comes from."""
    coarse, fine = (solve(size) for size in sizes)
    before, moved = (answer.at(points)[0] for answer in (coarse, fine))
    gap = np.abs(moved - before).max() / np.abs(moved).max()
    return (
        fine,
        moved,
        f"finite elements: {kind}, {fine.unknowns} unknowns (scikit-fem {skfem.__version__}); "
        f"displacement within {gap:.0e}, energy within {abs(fine.energy / coarse.energy - 1):.0e} "
        f"of a coarser mesh's, {coarse.unknowns} unknowns",
    )


def write(path: Path, points, displacement, stress, energy, source: str) -> None:
    path.parent.mkdir(exist_ok=True)
    print(Reference(points, displacement, stress, energy, source).save(path))
    print("   ", source, flush=True)


def triangles(scene: Scene, levels, points):
    """Answer a plane scene; see `on_two`."""
    kind = f"triangles of order 4, halved {levels[1]} times at singular points"
    return on_two(
        kind, lambda number: finite_elements(scene, order=4, levels=number).field, levels, points
    )


def plane_truth(problem: Problem, patch, points, path: Path, stressed: bool) -> None:
    """Compute a plane problem on two meshes and store the finer answer."""
    load = {"region": {"box": [list(p) for p in patch]}, "force": [0.0, -problem.force]}
    scene = problem.scene(1).replace(loads=[load])
    fine, moved, source = triangles(scene, LEVELS, points)
    stress = fine.at(points)[2] if stressed else None
    write(path, points, moved, stress, fine.energy, source)


def worked_plate_points() -> np.ndarray:
    """Return the middles of the cells, and points along the loaded column and three rows."""
    middles = 0.005 + 0.01 * np.stack(np.meshgrid(*[np.arange(20)] * 2), axis=-1).reshape(-1, 2)
    every = 0.0025 * np.arange(1, 80)
    lines = [np.stack([np.full(79, 0.105), every], axis=1)]
    lines += [np.stack([every, np.full(79, height)], axis=1) for height in (0.195, 0.155, 0.105)]
    points = np.concatenate([middles, *lines])
    _, first = np.unique(np.rint(points / 1e-6).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]


def plates() -> None:
    """Write the references of the plane problems."""
    data = TESTS / "data"
    cells = worked_plate_points()
    plane_truth(PLATE, LOADED_CELL, cells, data / "plate_finite_elements.npz", True)
    corners = PLATE.edge * np.argwhere(np.ones((21, 21)))
    plane_truth(PLATE, LOADED_CELL, corners, data / "plate_finite_elements_corners.npz", False)
    for problem in (PLATE, PIXELS):
        path = PEERS / f"truth_{problem.name}.npz"
        plane_truth(problem, problem.patch, problem.points, path, False)


def block() -> None:
    """Write the reference of the block: a quarter of it is solved, and mirrored."""
    planes = ((0, 1, 3), (0, 1, 3), (0, 8))
    points = BLOCK.points
    folded = np.minimum(points, [0.5, 0.5, 1.0])
    mirrored = points[:, :2] > 0.5
    folded[:, :2] = np.where(mirrored, 1.0 - points[:, :2], points[:, :2])
    scene, kind = quarter(), "graded bricks of order 2 on a quarter"
    fine, moved, source = on_two(
        kind, lambda parts: solve_bricks(scene, planes, parts), PARTS["cube"], folded
    )
    moved[:, :2] *= np.where(mirrored, -1.0, 1.0)
    write(PEERS / "truth_block.npz", points, moved, None, 4.0 * fine.energy, source)


def of_spawning(name: str) -> None:
    """Write the reference of a body that agents spawn in."""
    scene = SPAWNING.BODIES[name]()
    points = SPAWNING.middles(scene)
    if name in SPAWNING.PLANE:
        fine, moved, source = triangles(scene, FEWER, points)
    else:
        kind = f"bricks of order 2, {PARTS[name][1]} along a graded cell"
        fine, moved, source = on_two(
            kind, lambda parts: solve_bricks(scene, PLANES[name], parts), PARTS[name], points
        )
    write(TESTS / "data" / "spawning" / f"{name}.npz", points, moved, None, fine.energy, source)


if __name__ == "__main__":
    others = {"plates": plates, "block": block}
    for name in sys.argv[1:] or [*others, *SPAWNING.BODIES]:
        others[name]() if name in others else of_spawning(name)
