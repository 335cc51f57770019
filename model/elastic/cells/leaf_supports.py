"""The first cells: as large as the body allows, without rigid motions or hinges.

Supports have to resist every rigid motion of each part of the body, and its members to carry shear.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import rigid_motions
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import oriented
from kaju.model.elastic.equal.problem import FIXED
from kaju.model.elastic.equal.staggered import axis_pairs
from kaju.model.elastic.free_motion import FREE, free_motion, unheld
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene.cell_types import DISPLACED, RIGID

HALVED = "were halved"  # End of notes on halved cells


def check_held(balance: Equilibrium) -> None:
    """Refuse a body if a part of it has a rigid motion that nothing resists."""
    loose = loose_part(balance)
    if loose is not None:
        leaf, motion = loose
        grid = balance.grid
        raise unheld(grid.leaves.lower[leaf] // grid.ground.cell, motion)


def loose_part(balance: Equilibrium) -> tuple[int, str] | None:
    """Return a leaf of a part with a free rigid motion, and the motion in words, or None."""
    part, d = _parts(balance.grid), balance.grid.dimension
    leaves, (owner, stops) = balance.grid.leaves, _stops(balance)
    middle = leaves.lower + 0.5 * leaves.size[:, None]
    for number in range(int(part.max()) + 1):
        own, rows = np.flatnonzero(part == number), stops[part[owner] == number]
        # A turn about the line on which the middles of all leaves lie moves none of their faces.
        still = [not np.ptp(middle[own][:, pair], axis=0).any() for pair in axis_pairs(d)]
        turns = np.eye(stops.shape[1])[d:][still]
        motion = free_motion(np.concatenate([rows, turns]) if len(rows) else rows, d)
        if motion:
            return int(own[0]), motion
    return None


def _stops(balance: Equilibrium) -> tuple[Ints, Floats]:
    """Return what is held: leaves, and how far every rigid motion moves it (in cells)."""
    # These are held faces, springs, and edges that shear when held faces round them stay.
    grid, n = balance.grid, len(balance.grid.leaves)
    modes, fixed = rigid_motions(grid.place / grid.ground.cell, grid.axis), grid.state == FIXED
    held = fixed | (grid.spring > 0)
    owners, rows = [grid.owner[held]], [modes[held]]
    modes[fixed] = 0.0
    strain = balance.strains[n * grid.dimension :] @ modes
    for edges in grid.edges.values():
        owners.append(np.zeros(len(edges.modulus), dtype=np.int64))
        owners[-1][edges.of_leaf] = np.arange(n)[:, None, None]
    owner = np.concatenate(owners)
    rows.append(strain * grid.length[owner[len(rows[0]) :], None])
    stops = np.concatenate(rows)
    some = np.abs(stops).max(axis=1) > FREE
    return owner[some], stops[some]


def _parts(grid: CompositeGrid) -> Ints:
    """Return the part of the body that each leaf belongs to: leaves joined by faces."""
    leaf, side = np.nonzero(grid.beside >= 0)
    links = sp.coo_array(
        (np.ones(len(leaf)), (leaf, grid.beside[leaf, side])), shape=(len(grid.leaves),) * 2
    )
    # A large leaf lists only one small neighbour, but each of these lists it.
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def slender(grid: CompositeGrid) -> Flags:
    """Return leaves that could slide past a neighbour: no edge between them carries shear."""
    n, d = len(grid.leaves), grid.dimension
    loose = np.zeros(n, dtype=np.bool_)
    rigid = np.isin(grid.kinds, (RIGID, DISPLACED))
    pinned = np.zeros((n, d), dtype=np.bool_)
    for side in range(2 * d):
        fixed = (grid.master[:, side] >= 0) & (grid.state[grid.master[:, side]] == FIXED)
        pinned[:, side // 2] |= fixed
    for side in range(2 * d):
        axis, end = divmod(side, 2)
        other = grid.beside[:, side]
        for across in range(d):
            if across == axis:
                continue
            edges = grid.edges[min(axis, across), max(axis, across)]
            table = oriented(edges, axis < across)[1]
            smooth = ~(edges.modulus[table[:, end]] > 0).any(axis=1)
            held = pinned[:, across] & (rigid[:, side] | pinned[other, across])
            # Between a large leaf and small ones the edges of the small ones count.
            divided = (other >= 0) & (grid.length[other] < grid.length)
            sliding = smooth & ((other >= 0) | rigid[:, side]) & ~held & ~divided
            loose |= sliding
            loose[other[sliding & (other >= 0)]] = True
    return loose


def first_agents(ground: PosedBody) -> tuple[Equilibrium, list[str]]:
    """Return the first cells, halved in members one cell wide and at pins, and notes on these."""
    leaves, notes = ground.start(), list[str]()
    balance = Equilibrium(_stiff(ground, leaves, notes))
    if loose_part(balance) is not None:
        # Cells beside rigid ones inside the array are halved, since a single one is a pin.
        pinned = ((balance.grid.kinds == RIGID) & ~balance.grid.outer).any(axis=1)
        leaves = balance.grid.leaves.split(pinned, 0, np.zeros(len(pinned))).balanced(0)
        balance = Equilibrium(_stiff(ground, leaves, notes))
        notes.append(f"a single rigid cell holds no turn: the cells beside {HALVED}")
        check_held(balance)
    return balance, notes


def _stiff(ground: PosedBody, leaves: LeafCells, notes: list[str]) -> CompositeGrid:
    """Return a grid on which no leaf can slide past its neighbours."""
    grid = CompositeGrid(ground, leaves)
    while True:
        thin = slender(grid)
        if not thin.any():
            return grid
        if not notes and (leaves.size[thin] <= ground.cell).any():
            cell = leaves.lower[thin & (leaves.size <= ground.cell)][0] // ground.cell
            place = ", ".join(str(int(i)) for i in cell)
            notes.append(f"a member is one cell wide at ({place}): its cells {HALVED}")
        leaves = leaves.split(thin, 0, np.zeros(len(leaves))).balanced(0)
        grid = CompositeGrid(ground, leaves)
