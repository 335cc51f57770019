"""Arrows as polygons: thousands at once, each as long and as broad as its load says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Corners of an arrow: how far along it from the head backwards, in head lengths (-1: at the
# tail), and how far aside, in shaft widths.
_BACK = np.array([0.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
_ASIDE = np.array([0.0, 1.6, 0.5, 0.5, -0.5, -0.5, -1.6])


def arrow_polygons(tail: Floats, head: Floats, width: Floats) -> Floats:
    """Return the outlines of straight arrows, shape (n, 7, 2).

    Parameters
    ----------
    tail, head : arrays, shape (n, 2)
        Where the arrows begin and end.
    width : array, shape (n,)
        Width of the shafts. A head is 3.2 shafts broad and 3.4 long, at most 0.6 of the arrow.
    """
    along = head - tail
    length = np.linalg.norm(along, axis=1)
    safe = np.where(length > 0.0, length, 1.0)
    unit = along / safe[:, None]
    aside = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    head_length = np.minimum(3.4 * width, 0.6 * length)
    back = np.where(_BACK < 0.0, length[:, None], head_length[:, None] * _BACK)
    outline: Floats = (
        head[:, None]
        - back[:, :, None] * unit[:, None]
        + (width[:, None] * _ASIDE)[:, :, None] * aside[:, None]
    )
    return outline
