"""Is there a body, and is every part of it held? Asked once, when a scene is made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError, SupportError

from . import kinds
from .filling import CellBox, Filling, count, sample, slabs

MOST_EXAMINED = 10_000_000
"""Up to this many cells a body is examined cell by cell, above by samples."""

_HOLDS = (kinds.RIGID, kinds.ROLLER, kinds.FOUNDATION, kinds.DISPLACED)
_REMEDY = (
    'hold it by a rigid cell or region, or by [sides] such as bottom = "rigid" (to watch a '
    "prescribed rule alone, which needs no support, set body.allow_floating = true)"
)


def check_body(filling: Filling, allow_floating: bool) -> None:
    """Refuse a body that is not there, and one that would float away.

    Bodies of more cells than `MOST_EXAMINED` are not examined for loose parts.

    Raises
    ------
    SceneError
        If no cell is body.
    SupportError
        If a part of the body touches nothing that holds it, and that is not allowed.
    """
    if filling.uniform or filling.lattice.size > MOST_EXAMINED:
        _check_samples(filling, allow_floating)
    else:
        _check_parts(filling, allow_floating)


def _check_samples(filling: Filling, allow_floating: bool) -> None:
    boxes = [filling.box] + [filling.cells_of(region.shape) for region in filling.regions]
    if not any(_has_body(filling, box) for box in boxes):
        raise SceneError(_empty(filling))
    base_holds = np.any(np.asarray(filling.base) == kinds.RIGID)
    if allow_floating or base_holds or any(part.kind == kinds.RIGID for part in filling.regions):
        return
    for side in np.flatnonzero(np.isin(filling.beyond, _HOLDS)):
        axis, upper_end = divmod(int(side), 2)
        edge = filling.lattice.shape[axis] - 1 if upper_end else 0
        if any(_has_body(filling, _layer(box, axis, edge)) for box in boxes):
            return
    raise SupportError(f"sides: nothing holds the body; {_REMEDY}")


def _layer(box: CellBox, axis: int, edge: int) -> CellBox:
    """Return the part of a box that lies in the layer `edge` across an axis."""
    lower, upper = (corner.copy() for corner in box)
    lower[axis], upper[axis] = max(lower[axis], edge), min(upper[axis], edge + 1)
    return lower, np.maximum(lower, upper)


def _has_body(filling: Filling, box: CellBox) -> bool:
    """Tell whether a box holds a cell of body; of large boxes only samples are looked at."""
    if count(box) == 0:
        return False
    if np.any(filling.kinds(sample(box)) >= 0):
        return True
    small = count(box) <= MOST_EXAMINED
    return small and any(np.any(filling.kinds(cells) >= 0) for cells in slabs(box))


def _check_parts(filling: Filling, allow_floating: bool) -> None:
    raster = _bricks(filling)
    body = raster >= 0
    if not body.any():
        raise SceneError(_empty(filling))
    if allow_floating:
        return
    from scipy.ndimage import label

    parts, number = label(body)
    held = np.zeros(number + 1, dtype=np.bool_)
    holds = np.isin(raster, _HOLDS)
    for axis in range(raster.ndim):
        below = tuple(slice(None, -1) if a == axis else slice(None) for a in range(raster.ndim))
        above = tuple(slice(1, None) if a == axis else slice(None) for a in range(raster.ndim))
        held[parts[below][holds[above]]] = True
        held[parts[above][holds[below]]] = True
    loose = np.flatnonzero(~held[1:]) + 1
    if len(loose) == number:
        raise SupportError(f"sides: nothing holds the body; {_REMEDY}")
    if len(loose):
        place = np.argwhere(parts == loose[0])[0]
        raise SupportError(
            f"body: {len(loose)} of its {number} parts touch nothing that holds them, first the "
            f"one with cell {_cell_of(filling, place)} (cells that touch only at a corner do not "
            f"hold each other); {_REMEDY}"
        )


def _bricks(filling: Filling) -> NDArray[np.int16]:
    """Return the kinds of all cells in a frame of what lies beyond the sides.

    Hexagons become bricks two entries wide, odd rows shifted by one: bricks that share an
    edge are hexagons that share a face.
    """
    raster = filling.rasterise()
    if filling.lattice.kind == "hexagon":
        raster = np.pad(np.repeat(raster, 2, axis=0), ((0, 1), (0, 0)))
        raster[-1, 0::2] = filling.beyond[1]
        raster[:, 1::2] = np.roll(raster[:, 1::2], 1, axis=0)
        raster[0, 1::2] = filling.beyond[0]
    framed = np.pad(raster, 1, constant_values=kinds.AIR)
    for side, kind in enumerate(filling.beyond):
        axis, upper_end = divmod(side, 2)
        rim = [slice(1, -1)] * raster.ndim
        rim[axis] = slice(-1, None) if upper_end else slice(0, 1)
        framed[tuple(rim)] = kind
    return framed


def _cell_of(filling: Filling, place: NDArray[np.intp]) -> list[int]:
    cell = [int(index) - 1 for index in place]
    if filling.lattice.kind == "hexagon":
        cell[0] = (cell[0] - cell[1] % 2) // 2
    return cell


def _empty(filling: Filling) -> str:
    shape = " x ".join(map(str, filling.lattice.shape))
    return f"body: none of the {shape} cells is body; at least one must be of a material"
