"""Whether what holds a body stops all its rigid motions."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.errors import SupportError
from kaju.model.elastic.corners import ON_EDGE

ROUNDED = 1e-11
"""Share of the loads by which their sum may differ from zero where nothing bears it."""


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


def balanced(rows: Floats, motions: Floats, force: Floats) -> bool:
    """Tell whether forces do no work on the rigid motions that the rows do not stop."""
    square = np.concatenate([rows, np.zeros((rows.shape[1],) * 2)])
    _, stopped, every = np.linalg.svd(square, full_matrices=False)
    free = every[stopped < ON_EDGE]
    works, most = free @ (motions.T @ force), np.abs(motions).T @ np.abs(force)
    return bool(np.all(np.abs(works) <= ROUNDED * most.max()))


def unheld(cell: Ints, motion: str, touched: bool = True, pushed: bool = False) -> SupportError:
    """Return what is to be said of a body of which the part with a cell could move freely."""
    place = ", ".join(str(int(i)) for i in cell)
    held_by = "the supports do not hold" if touched else "nothing holds"
    if pushed:
        return SupportError(
            f"sides: the loads push the part of the body with cell ({place}) where its bed, which "
            "presses across only, does not hold it; along the bed let them sum to zero, force "
            "and couple, or hold the body there by a rigid or roller cell or side"
        )
    return SupportError(
        f"sides: {held_by} the part of the body with cell ({place}): it could {motion}; hold it by "
        "a rigid cell or side, or join it to the rest by a face (cells that touch at a corner are "
        "not joined)"
    )
