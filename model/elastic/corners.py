"""Where stresses have no limit: re-entrant corners, and ends of what holds a body.

Round a point the body is a wedge of one to three quarters between two sides. Stresses grow without
limit towards its tip if both sides are free, or both held, and it is wider than half a turn; or if
one is free and the other held, from a quarter turn on (M. L. Williams, *Journal of Applied
Mechanics* 19, 1952). Corners between materials are not looked for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, DISPLACED, RIGID

MOST_CELLS = 1_000_000
"""Larger arrays, and solids, are not looked through."""


def sharp_corners(scene: Scene) -> NDArray[np.float64]:
    """Return the points (m) at which stresses grow without limit, shape (n, 2)."""
    lattice = scene.lattice
    if lattice.dimension != 2 or lattice.kind != "square" or lattice.size > MOST_CELLS:
        return np.empty((0, 2))
    ranges = [np.arange(-1, n + 1) for n in lattice.shape]
    cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1)
    kinds = scene.kinds(cells.reshape(-1, 2)).reshape(cells.shape[:-1])
    around = np.stack([kinds[:-1, :-1], kinds[1:, :-1], kinds[1:, 1:], kinds[:-1, 1:]])
    free, held, body = around == AIR, np.isin(around, (RIGID, DISPLACED)), around >= 0
    sharp = np.zeros(around.shape[1:], dtype=np.bool_)
    for first in range(4):
        for quarters in (1, 2, 3):
            before, after = (first - 1) % 4, (first + quarters) % 4
            wedge = np.all([body[(first + k) % 4] for k in range(quarters)], axis=0)
            mixed = (free[before] & held[after]) | (held[before] & free[after])
            alike = (free[before] & free[after]) | (held[before] & held[after])
            sharp |= wedge & (mixed | (alike if quarters == 3 else False))
    return np.asarray(np.argwhere(sharp) * lattice.cell_size, dtype=np.float64)
