"""What supports are called: sides of the array, and regions of rigid or roller cells inside it."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Ints
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import INSIDE, NOT_BODY, RIGID, ROLLER
from kaju.model.scene.lattice import Cells
from kaju.model.scene.regions import Region


def holds(region: Region) -> bool:
    """Tell whether a region holds the body."""
    return NOT_BODY.get(region.material) in (RIGID, ROLLER)


def support_names(scene: Scene) -> list[str]:
    """Return the sides' names, that of cells inside the array, and those of regions of such."""
    named = [region.name for region in scene.body.regions if region.name and holds(region)]
    return list(dict.fromkeys([*scene.lattice.sides, INSIDE, *named]))


def supports_inside(scene: Scene, cells: Cells) -> Ints:
    """Return which of `support_names` cells inside the array are, if they hold the body."""
    names = support_names(scene)
    found = np.full(len(cells), names.index(INSIDE), dtype=np.int64)
    if names[-1] == INSIDE:
        return found
    centres = scene.lattice.centres(cells)
    for region, shape in zip(scene.body.regions, scene.region_shapes, strict=True):
        if holds(region):
            found[shape.contains(centres)] = names.index(region.name or INSIDE)
    return found
