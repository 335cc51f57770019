"""Whether what holds a body stops all its rigid motions."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.errors import SupportError
from kaju.model.elastic.corners import ON_EDGE


def free_motion(rows: Floats, dimension: int) -> str:
    """Return in words a rigid motion that the rows do not stop, "" if there is none."""
    if not len(rows):
        return "move anywhere"
    # What is left of every motion (by a cell) when those before it are stopped: a strain, in cells.
    square = np.concatenate([rows, np.zeros((rows.shape[1],) * 2)])
    free = np.abs(np.diag(np.linalg.qr(square, mode="r"))) < ON_EDGE
    for axis in range(dimension):
        if free[axis]:
            return f"move along {'xyz'[axis]}"
    return "turn" if free.any() else ""


def unheld(cell: Ints, motion: str, touched: bool = True) -> SupportError:
    """Return what is to be said of a body of which the part with a cell could move freely."""
    place = ", ".join(str(int(i)) for i in cell)
    held_by = "the supports do not hold" if touched else "nothing holds"
    return SupportError(
        f"sides: {held_by} the part of the body with cell ({place}): it could {motion}; hold it by "
        "a rigid cell or side, or join it to the rest by a face (cells that touch at a corner are "
        "not joined)"
    )
