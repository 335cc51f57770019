"""Agents that a previous answer has left: where others begin as they ended, and who has retired."""

from __future__ import annotations

import numpy as np

from kaju.errors import ParameterError

from .generations import Spawning
from .ground import Ground
from .leaves import Leaves


def check_previous(previous: Ground, ground: Ground) -> None:
    """Refuse agents that stand on other cells."""
    cells = [
        f"{' x '.join(map(str, g.scene.lattice.shape))} cells of {g.scene.lattice.cell_size:g} m"
        for g in (previous, ground)
    ]
    if previous.scene.lattice != ground.scene.lattice:
        raise ParameterError(
            f"previous: its agents stand on {cells[0]}, those of the scene on {cells[1]}; solve "
            "without it, or at the same resolution"
        )


def serves(previous: Spawning, ground: Ground) -> bool:
    """Tell whether agents may begin as those of a previous answer ended."""
    # Where body or places of the loads have changed, others are soon found afresh, and are fewer.
    before, leaves, scene = previous.ground, previous.leaves, ground.scene
    sides = [scene.side_condition(name) for name in scene.lattice.sides]
    moved = any(side.displacement is not None for side in sides)
    return (
        scene.same_body(before.scene)
        and ground.loaded_where(before)
        and not (moved and ground.scales != before.scales)
        and int(leaves.size.min()) >= ground.smallest
        and not ground.unevenly_loaded(leaves).any()
    )


def count_retired(before: Leaves, now: Leaves) -> int:
    """Return for how many agents a larger one stands now."""
    at = np.maximum(np.searchsorted(now.code, before.code, side="right") - 1, 0)
    inside = before.lower - now.lower[at]
    here = np.all((inside >= 0) & (inside < now.size[at, None]), axis=1)
    return int(np.count_nonzero(here & (now.size[at] > before.size)))
