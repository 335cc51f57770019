"""The first agents: as large as the body lets them be, and held."""

from __future__ import annotations

import numpy as np

from kaju.model.elastic.problem import STIFF_PRESSURE

from .balance import Balance
from .composite import Composite
from .ground import Ground
from .held import beside_rigid_cells, check_held, loose_part, slender
from .leaves import Leaves
from .nested import DIRECT

HALVED = "were halved"
"""How the notes end that tell of halved cells."""

RUBBER = {2: 400_000, 3: 15_000}
"""Up to so many faces every generation is factorised if a material is nearly incompressible."""


def first_agents(ground: Ground) -> tuple[Balance, list[str]]:
    """Return the first agents, and what is to be noted.

    Members one agent wide and pins get smaller ones.

    Raises
    ------
    SupportError
        If a part of the body could move without straining.
    """
    leaves, notes = ground.start(), list[str]()
    balance = Balance(_stiff(ground, leaves, notes))
    if loose_part(balance) is not None:
        pinned = beside_rigid_cells(balance.grid)
        leaves = balance.grid.leaves.split(pinned, 0, np.zeros(len(pinned))).balanced(0)
        balance = Balance(_stiff(ground, leaves, notes))
        notes.append(f"a single rigid cell holds no turn: the cells beside {HALVED}")
        check_held(balance)
    return balance, notes


def _stiff(ground: Ground, leaves: Leaves, notes: list[str]) -> Composite:
    """Lay leaves so small that every one is held by its neighbours against sliding."""
    grid = Composite(ground, leaves)
    while True:
        thin = slender(grid)
        if not thin.any():
            return grid
        if not notes and (leaves.size[thin] <= ground.cell).any():
            cell = leaves.lower[thin & (leaves.size <= ground.cell)][0] // ground.cell
            place = ", ".join(str(int(i)) for i in cell)
            notes.append(f"a member is one cell wide at ({place}): its cells {HALVED}")
        leaves = leaves.split(thin, 0, np.zeros(len(leaves))).balanced(0)
        grid = Composite(ground, leaves)


def direct_limit(ground: Ground) -> int:
    """Return up to how many faces a generation is factorised: all, if nearly incompressible."""
    moduli = ground.moduli
    d = ground.dimension
    rubber = np.any(moduli.lateral > STIFF_PRESSURE * moduli.shear)
    return RUBBER[d] if rubber and ground.scene.plane != "stress" else DIRECT[d]
