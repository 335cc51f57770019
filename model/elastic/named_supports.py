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


def regions_that_hold(scene: Scene) -> dict[int, str]:
    """Return which regions hold the body, and what they are called: the one without name "rigid".

    Or "roller"; of several each by its number.
    """
    found = {k: region for k, region in enumerate(scene.body.regions) if holds(region)}
    alone = sum(not region.name for region in found.values()) == 1
    kinds = {RIGID: INSIDE, ROLLER: "roller"}
    return {
        k: region.name or (kinds[NOT_BODY[region.material]] if alone else f"region {k}")
        for k, region in found.items()
    }


def support_names(scene: Scene) -> list[str]:
    """Return the sides' names, that of cells inside the array, and those of regions of such."""
    return list(dict.fromkeys([*scene.lattice.sides, INSIDE, *regions_that_hold(scene).values()]))


def supports_inside(scene: Scene, cells: Cells) -> Ints:
    """Return which of `support_names` cells inside the array are, if they hold the body."""
    names = support_names(scene)
    found = np.full(len(cells), names.index(INSIDE), dtype=np.int64)
    if names[-1] == INSIDE:
        return found
    centres = scene.lattice.centres(cells)
    for number, name in regions_that_hold(scene).items():
        found[scene.region_shapes[number].contains(centres)] = names.index(name)
    return found
