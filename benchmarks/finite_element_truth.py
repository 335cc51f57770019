"""Compute the true answers of the benchmark's problems and of the worked plate.

Plane problems: triangles of order 4, graded geometrically towards every point where the
solution is singular (re-entrant corners, ends of the ground, ends of the load). The block:
a quarter of it, in hexahedra of order 2 graded towards its edges and those of the load. Each
answer is computed on two meshes; what they differ by is printed and goes into the source.
Needs scikit-fem. Run it with

    python benchmarks/finite_element_truth.py            # all; minutes, and 6 GB of memory
    python benchmarks/finite_element_truth.py block      # the block only
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import skfem
from peers.graded_bricks import solve_bricks
from peers.problems import BLOCK, PIXELS, PLATE, Problem

from kaju import Scene
from kaju.model.elastic.moduli import moduli_of
from kaju.model.reference import Reference
from kaju.model.validation.graded_elements import solve_graded
from kaju.model.validation.scene_elements import ElementAnswer

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "kaju" / "bench"
TESTS = ROOT / "tests" / "data"

LEVELS = (10, 16)
"""Halvings of the triangles around singular points, on the two meshes."""
PARTS = (4, 6)
"""Elements along a graded eighth of the block, on its two meshes."""
LOADED_CELL = ((0.10, 0.2), (0.11, 0.2))
"""The worked example presses on cell 10 of 20: x from 100 to 110 mm."""


def stress_at(answer: ElementAnswer, problem: Problem, points) -> np.ndarray:
    """Return the stress (Pa) of plane stress at points."""
    gradient = answer.gradient_at(points)
    strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    law = moduli_of(problem.youngs_modulus, problem.poissons_ratio, "stress")
    volume = law.lateral * np.trace(strain, axis1=1, axis2=2)
    return 2.0 * law.shear * strain + volume[:, None, None] * np.eye(2)


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


def block(parts: int, points) -> tuple[np.ndarray, float, int]:
    """Solve a quarter of the block and mirror it; return displacement and energy."""
    planes = ((0, 1, 3), (0, 1, 3), (0, 8))
    answer = solve_bricks(quarter(), planes, parts)
    folded = np.minimum(points, [0.5, 0.5, 1.0])
    mirrored = points[:, :2] > 0.5
    folded[:, :2] = np.where(mirrored, 1.0 - points[:, :2], points[:, :2])
    moved = answer.displacement_at(folded)
    moved[:, :2] *= np.where(mirrored, -1.0, 1.0)
    return moved, 4.0 * answer.energy, answer.unknowns


def gap(fine: np.ndarray, coarse: np.ndarray) -> float:
    """Return the largest difference as a share of the largest value."""
    return float(np.abs(fine - coarse).max() / np.abs(fine).max())


def write(path: Path, points, displacement, stress, energy, source: str) -> None:
    path.parent.mkdir(exist_ok=True)
    print(Reference(points, displacement, stress, energy, source).save(path))
    print("   ", source)


def plane_truth(problem: Problem, patch, points, path: Path, stressed: bool) -> None:
    """Compute a plane problem on two meshes and store the finer answer."""
    load = {"region": {"box": [list(p) for p in patch]}, "force": [0.0, -problem.force]}
    scene = problem.scene(1).replace(loads=[load])
    coarse, fine = (solve_graded(scene, levels) for levels in LEVELS)
    moved = fine.displacement_at(points)
    source = (
        f"finite elements: graded triangles of order 4, {fine.unknowns} unknowns (scikit-fem "
        f"{skfem.__version__}); displacement within "
        f"{gap(moved, coarse.displacement_at(points)):.0e}, energy within "
        f"{abs(fine.energy / coarse.energy - 1.0):.0e} of the answer with {LEVELS[0]} instead of "
        f"{LEVELS[1]} levels"
    )
    stress = stress_at(fine, problem, points) if stressed else None
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
    name = "plate_finite_elements"
    plane_truth(PLATE, LOADED_CELL, worked_plate_points(), TESTS / f"{name}.npz", True)
    corners = PLATE.edge * np.argwhere(np.ones((21, 21)))
    plane_truth(PLATE, LOADED_CELL, corners, TESTS / f"{name}_corners.npz", False)
    for problem in (PLATE, PIXELS):
        path = PACKAGE / f"truth_{problem.name}.npz"
        plane_truth(problem, problem.patch, problem.points, path, False)


def cube() -> None:
    """Write the reference of the block."""
    points = BLOCK.points
    (coarse, less, _), (fine, energy, unknowns) = (block(n, points) for n in PARTS)
    source = (
        f"finite elements: graded hexahedra of order 2 on a quarter, {unknowns} unknowns "
        f"(scikit-fem {skfem.__version__}); displacement within {gap(fine, coarse):.0e}, energy "
        f"within {abs(energy / less - 1.0):.0e} of the answer with {PARTS[0]} instead of "
        f"{PARTS[1]} elements to a graded eighth"
    )
    write(PACKAGE / "truth_block.npz", points, fine, None, energy, source)


if __name__ == "__main__":
    if "block" not in sys.argv:
        plates()
    cube()
