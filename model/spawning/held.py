"""Whether supports hold every part of a body, and whether its members can carry shear."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from kaju.errors import SupportError
from kaju.model.elasticity.problem import FIXED
from kaju.model.scene.kinds import DISPLACED, RIGID

from .balance import Balance
from .composite import Composite, Floats
from .field import oriented
from .leaves import Flags, Index

FREE = 1e-10
"""A motion that costs less than this share of the stiffest is free."""


def check_held(balance: Balance) -> None:
    """Refuse a body of which a part could move without straining.

    Raises
    ------
    SupportError
        Naming a cell of the part and how it could move.
    """
    grid = balance.grid
    modes = rigid_motions(grid)
    modes[grid.state == FIXED] = 0.0
    answer = balance.stiffness() @ modes
    part = _parts(grid)
    of_face = part[grid.owner]
    d, count = grid.dimension, int(part.max()) + 1
    order = np.argsort(of_face, kind="stable")
    ends = np.searchsorted(of_face[order], np.arange(count + 1))
    for number in range(count):
        rows = order[ends[number] : ends[number + 1]]
        motion = _free_motion(modes[rows], answer[rows], grid.axis[rows], d)
        if motion:
            leaf = np.flatnonzero(part == number)[0]
            place = ", ".join(str(int(i)) for i in grid.leaves.lower[leaf] // grid.ground.cell)
            raise SupportError(
                f"sides: the supports do not hold the part of the body with cell ({place}): it "
                f"could {motion}; hold it by a rigid cell or side, or join it to the rest by a "
                "face (cells that touch at a corner are not joined)"
            )


def rigid_motions(grid: Composite) -> Floats:
    """Return the faces' displacements in every rigid motion, one column each."""
    d = grid.dimension
    place = grid.place / grid.ground.cell
    place = (place - place.mean(axis=0)) / max(float(np.ptp(place, axis=0).max()), 1.0)
    columns = [(grid.axis == a).astype(np.float64) for a in range(d)]
    for a, b in grid.edges:
        turn = np.where(grid.axis == a, -place[:, b], 0.0)
        columns.append(np.where(grid.axis == b, place[:, a], turn))
    return np.stack(columns, axis=1)


def _parts(grid: Composite) -> NDArray[np.int32]:
    """Return the part of the body that each leaf belongs to: leaves joined by faces."""
    leaf, side = np.nonzero(grid.beside >= 0)
    links = sp.coo_array(
        (np.ones(len(leaf)), (leaf, grid.beside[leaf, side])), shape=(len(grid.leaves),) * 2
    )
    # A large leaf names only one small neighbour, but each of these names it in turn.
    return np.asarray(connected_components(links, directed=False)[1])


def _free_motion(modes: Floats, answer: Floats, axis: Index, dimension: int) -> str:
    """Return in words a rigid motion that nothing resists, "" if there is none."""
    scale = np.sqrt(np.maximum((modes**2).sum(axis=0), 1e-300))
    gram = (modes.T @ answer) / np.outer(scale, scale)
    values = np.linalg.eigvalsh(0.5 * (gram + gram.T))
    if values[-1] <= 0:
        return "move anywhere"
    if values[0] > FREE * values[-1]:
        return ""
    for a in range(dimension):
        if gram[a, a] <= FREE * values[-1]:
            return f"move along {'xyz'[a]}"
    return "turn"


def slender(grid: Composite) -> Flags:
    """Tell which leaves can slide past a neighbour because no edge between them carries shear."""
    n, d = len(grid.leaves), grid.dimension
    loose = np.zeros(n, dtype=np.bool_)
    rigid = np.zeros((n, 2 * d), dtype=np.bool_)
    pinned = np.zeros((n, d), dtype=np.bool_)
    for side in range(2 * d):
        bare = np.flatnonzero(grid.beside[:, side] < 0)
        kind = grid.ground.kinds_at(grid.beyond(side, bare))
        rigid[bare, side] = (kind == RIGID) | (kind == DISPLACED)
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
            sliding = smooth & ((other >= 0) | rigid[:, side]) & ~held
            loose |= sliding
            loose[other[sliding & (other >= 0)]] = True
    return loose
