"""The true answers: finite elements of high order, graded to everything singular.

They share nothing with spawning but the scene. Computed once (seconds to minutes) and kept
beside the results, under a name that follows from the scene.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
from peers.graded_bricks import solve_bricks

from kaju.model.reference import Reference
from kaju.model.validation.graded_elements import solve_graded

LEVELS = (9, 12)
"""Halvings of the triangles around singular points, on two meshes."""
PARTS = (4, 6)
"""Bricks along a cell with a singular edge, on two meshes; one along any other."""


def truth(case, folder: Path) -> Reference:
    """Return energy, and displacement at the case's points; how well is in its source."""
    text, arrays = case.scene.to_archive()
    points = case.points
    asked = [text.encode(), *(a.tobytes() for a in arrays.values()), points.tobytes()]
    name = sha256(b"".join(asked) + repr((LEVELS, PARTS)).encode()).hexdigest()[:16]
    path = folder / "truth" / f"{name}.npz"
    if path.exists():
        return Reference.load(path)
    if case.scene.lattice.dimension == 2:
        answers = [solve_graded(case.scene, levels) for levels in LEVELS]
    else:
        answers = [solve_bricks(case.scene, case.singular, parts, 1) for parts in PARTS]
    before, moved = (answer.displacement_at(points) for answer in answers)
    gap = np.abs(moved - before).max() / np.abs(moved).max()
    energies = [answer.energy for answer in answers]
    source = (
        f"finite elements: {answers[1].unknowns} unknowns; displacement within {gap:.0e}, energy "
        f"within {abs(energies[1] / energies[0] - 1):.0e} of a coarser mesh's"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    found = Reference(points, moved, None, energies[1], source)
    found.save(path)
    return found
