"""The first cells: as large as the body allows, without rigid motions or hinges.

Supports have to resist every rigid motion of each part of the body, and its members to carry shear.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import oriented
from kaju.model.elastic.cells.leaf_cells import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.problem import FIXED
from kaju.model.elastic.supports import unheld
from kaju.model.scene.cell_types import DISPLACED, RIGID

FREE = 1e-13
"""A rigid motion that is resisted less than the most resisted one by this factor is free."""
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
    # With prescribed faces set to rest, a rigid motion strains only the cells at supports.
    grid, d = balance.grid, balance.grid.dimension
    part = _parts(grid)
    modes = rigid_motions(grid, part)
    modes[grid.state == FIXED] = 0.0
    count = int(part.max()) + 1
    of_rows = [part] * d
    for edges in grid.edges.values():
        of_edge = np.zeros(len(edges.modulus), dtype=np.int64)
        of_edge[edges.of_leaf] = part[:, None, None]
        of_rows.append(of_edge)
    founded, of_face = grid.spring > 0, part[grid.owner]
    mass = _products(modes, of_face, count)
    resistance = _products(balance.strains @ modes, np.concatenate(of_rows), count)
    resistance += _products(modes[founded], of_face[founded], count)
    for number in range(count):
        motion = _free_motion(mass[number], resistance[number], d)
        if motion:
            return int(np.flatnonzero(part == number)[0]), motion
    return None


def _products(rows: Floats, part: Ints, count: int) -> Floats:
    """Return the Gram matrix of the columns for every part, shape (count, k, k)."""
    some = rows.any(axis=1)
    rows, part, k = rows[some], part[some], rows.shape[1]
    total = np.zeros((count, k, k))
    for i, j in np.ndindex(k, k):
        total[:, i, j] = np.bincount(part, rows[:, i] * rows[:, j], minlength=count)
    return total


def rigid_motions(grid: CompositeGrid, part: Ints) -> Floats:
    """Return the faces' displacements in every rigid motion, one column each."""
    # Every part turns about its own middle, scaled to a largest displacement of about one.
    d = grid.dimension
    of_face = part[grid.owner]
    place = grid.place / grid.ground.cell
    count = np.bincount(of_face)
    for axis in range(d):
        place[:, axis] -= (np.bincount(of_face, place[:, axis]) / count)[of_face]
    reach = np.ones(len(count))
    np.maximum.at(reach, of_face, np.abs(place).max(axis=1))
    place /= reach[of_face, None]
    columns = [(grid.axis == a).astype(np.float64) for a in range(d)]
    for a, b in grid.edges:
        turn = np.where(grid.axis == a, -place[:, b], 0.0)
        columns.append(np.where(grid.axis == b, place[:, a], turn))
    return np.stack(columns, axis=1)


def _parts(grid: CompositeGrid) -> Ints:
    """Return the part of the body that each leaf belongs to: leaves joined by faces."""
    leaf, side = np.nonzero(grid.beside >= 0)
    links = sp.coo_array(
        (np.ones(len(leaf)), (leaf, grid.beside[leaf, side])), shape=(len(grid.leaves),) * 2
    )
    # A large leaf lists only one small neighbour, but each of these lists it.
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _free_motion(mass: Floats, resistance: Floats, dimension: int) -> str:
    """Return in words a rigid motion that nothing resists, "" if there is none."""
    # Generalised eigenvalues of resistance by mass, over the motions that move a free face.
    size, motion = np.linalg.eigh(mass)
    moves = size > 1e-12 * size[-1]
    if size[-1] <= 0:
        return ""
    motion = motion[:, moves] / np.sqrt(size[moves])
    values = np.linalg.eigvalsh(motion.T @ resistance @ motion)
    if values[-1] <= 0:
        return "move anywhere"
    if values[0] > FREE * values[-1]:
        return ""
    for a in range(dimension):
        if mass[a, a] > 0 and resistance[a, a] <= FREE * values[-1] * mass[a, a]:
            return f"move along {'xyz'[a]}"
    return "turn"


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
