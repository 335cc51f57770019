"""Compute the true answers that the tests of spawning compare with: energy and displacement.

Finite elements that share nothing with spawning: triangles of order 4, graded to every
singular point, and bricks of order 2, graded to every singular edge. Each answer is computed
on two meshes; what they differ by is printed and goes into the source. Needs scikit-fem and
pyamg. Run it with

    python benchmarks/spawning_truth.py            # all; some minutes
    python benchmarks/spawning_truth.py rubber     # one body
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import skfem
from peers.graded_bricks import solve_bricks

from kaju.model.reference import Reference
from kaju.model.validation.graded_elements import solve_graded

ROOT = Path(__file__).parent.parent
sys.path.append(str(ROOT / "tests"))

from spawning_bodies import BODIES, PLANE, middles  # noqa: E402

LEVELS = (8, 14)
"""Halvings of the triangles around singular points, on the two meshes."""
PARTS = {"cube": (4, 6), "cube-rubber": (3, 4), "cube-inclusion": (4, 6)}
"""Bricks along a cell of the body."""
PLANES = {"cube": ((1, 4), (1, 4), (0, 4)), "cube-rubber": ((1, 4), (1, 4), (0, 4))}
PLANES["cube-inclusion"] = ((1, 2, 4), (1, 2, 4), (0, 1, 2, 4))
"""Grid planes that hold singular edges, along x, y and z."""


def truth(name: str) -> Reference:
    """Return energy and displacement of a body, and how far they may be trusted."""
    scene = BODIES[name]()
    if name in PLANE:
        kind = f"triangles of order 4, halved {LEVELS[1]} times at singular points"
        coarse, fine = (solve_graded(scene, levels) for levels in LEVELS)
    else:
        kind = f"bricks of order 2, {PARTS[name][1]} along a graded cell"
        coarse, fine = (solve_bricks(scene, PLANES[name], parts) for parts in PARTS[name])
    points = middles(scene)
    moved, before = fine.displacement_at(points), coarse.displacement_at(points)
    gap = np.abs(moved - before).max() / np.abs(moved).max()
    source = (
        f"finite elements: {kind}, {fine.unknowns} unknowns (scikit-fem {skfem.__version__}); "
        f"displacement within {gap:.0e}, energy within {abs(fine.energy / coarse.energy - 1):.0e} "
        f"of a coarser mesh's, {coarse.unknowns} unknowns"
    )
    return Reference(points, moved, None, fine.energy, source)


def main() -> None:
    folder = ROOT / "tests" / "data" / "spawning"
    folder.mkdir(exist_ok=True)
    for name in sys.argv[1:] or BODIES:
        found = truth(name)
        print(found.save(folder / f"{name}.npz").name, found.strain_energy)
        print("   ", found.source, flush=True)


if __name__ == "__main__":
    main()
