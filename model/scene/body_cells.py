"""Which cell of the body a point lies in."""

from __future__ import annotations

from itertools import product

import numpy as np

from kaju.arrays import Flags, Floats, Ints

from .scene import Scene


def body_cells(scene: Scene, points: Floats) -> tuple[Ints, Flags]:
    """Return the body cell that each point (m) lies in or on, and whether there is one."""
    lattice = scene.lattice
    cells = lattice.locate(points)
    outside = scene.kinds(cells) < 0
    # A point on the surface belongs to the body, on whichever side rounding has put it.
    corners = np.array(list(product((-1.0, 1.0), repeat=lattice.dimension)))
    for shift in np.concatenate([lattice.normals, corners]):
        moved = lattice.locate(points[outside] + 1e-6 * lattice.cell_size * shift)
        inside = scene.kinds(moved) >= 0
        place = np.flatnonzero(outside)[inside]
        cells[place] = moved[inside]
        outside[place] = False
    return cells, ~outside
