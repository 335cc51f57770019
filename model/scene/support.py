"""Is there a body, and is every part of it held? Asked once, when a scene is made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags
from kaju.errors import SceneError, SupportError
from kaju.model.scene import cell_types

from .resolved_body import CellBox, ResolvedBody, count, sample, slabs

MOST_EXAMINED = 10_000_000
"""Up to this many cells a body is examined cell by cell, above by samples."""

_HOLDS = (cell_types.RIGID, cell_types.ROLLER, cell_types.FOUNDATION, cell_types.DISPLACED)
_REMEDY = (
    'hold it by a rigid cell or region, or by [sides] such as bottom = "rigid" (to watch a '
    "prescribed rule alone, which needs no support, set body.allow_floating = true)"
)


def check_body(resolved: ResolvedBody, allow_floating: bool) -> None:
    """Refuse a body that is not there or floats; parts are sought up to `MOST_EXAMINED` cells."""
    if resolved.uniform or resolved.lattice.size > MOST_EXAMINED:
        _check_samples(resolved, allow_floating)
    else:
        _check_parts(resolved, allow_floating)


def _check_samples(resolved: ResolvedBody, allow_floating: bool) -> None:
    boxes = [resolved.box] + [resolved.cells_of(region.shape) for region in resolved.regions]
    if not any(_has_body(resolved, box) for box in boxes):
        raise _nothing_there(resolved)
    inside = [resolved.base, *(part.kind for part in resolved.regions)]
    if allow_floating or any(bool(np.isin(np.asarray(kind), _HOLDS).any()) for kind in inside):
        return
    for side in np.flatnonzero(np.isin(resolved.beyond, _HOLDS)):
        if any(_has_body(resolved, resolved.layer(box, int(side))) for box in boxes):
            return
    raise SupportError(f"sides: nothing holds the body; {_REMEDY}")


def _has_body(resolved: ResolvedBody, box: CellBox) -> bool:
    """Tell whether a box holds a cell of body; of large boxes only samples are looked at."""
    if count(box) == 0:
        return False
    if np.any(resolved.kinds(sample(box)) >= 0):
        return True
    small = count(box) <= MOST_EXAMINED
    return small and any(np.any(resolved.kinds(cells) >= 0) for cells in slabs(box))


def _check_parts(resolved: ResolvedBody, allow_floating: bool) -> None:
    raster = resolved.rasterise()
    if not (raster >= 0).any():
        raise _nothing_there(resolved)
    if allow_floating:
        return
    framed = _framed(resolved, raster)
    parts, held = _parts_of_boxes(framed) if resolved.lattice.boxes else _parts(resolved, framed)
    loose = np.flatnonzero(~held[1:]) + 1
    if len(loose) == len(held) - 1:
        raise SupportError(f"sides: nothing holds the body; {_REMEDY}")
    if len(loose):
        raise SupportError(
            f"body: {len(loose)} of its {len(held) - 1} parts touch nothing that holds them, "
            f"first the one with cell {np.argwhere(parts == loose[0])[0].tolist()} (cells that "
            f"touch only at a corner do not hold each other); {_REMEDY}"
        )


Parts = tuple[NDArray[np.integer], Flags]
"""The number of each cell's part, from 1 (0: no body), and which numbers something holds."""


def _framed(resolved: ResolvedBody, raster: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the kinds of all cells in a frame of what lies beyond the sides."""
    framed = np.pad(raster, 1, constant_values=cell_types.AIR)
    for side, kind in enumerate(resolved.beyond):
        axis, upper_end = divmod(side, 2)
        rim = [slice(None)] * raster.ndim
        rim[axis] = slice(-1, None) if upper_end else slice(0, 1)
        framed[tuple(rim)] = kind
    return framed


def _parts_of_boxes(framed: NDArray[np.int16]) -> Parts:
    """Return the connected parts of squares or cubes."""
    from scipy.ndimage import label

    parts, number = label(framed >= 0)
    held = np.zeros(number + 1, dtype=np.bool_)
    holds = np.isin(framed, _HOLDS)
    for axis in range(framed.ndim):
        below = tuple(slice(None, -1) if a == axis else slice(None) for a in range(framed.ndim))
        above = tuple(slice(1, None) if a == axis else slice(None) for a in range(framed.ndim))
        held[parts[below][holds[above]]] = True
        held[parts[above][holds[below]]] = True
    return parts[(slice(1, -1),) * framed.ndim], held


def _parts(resolved: ResolvedBody, framed: NDArray[np.int16]) -> Parts:
    """Return the connected parts of any cells, from face to face."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    lattice, kind = resolved.lattice, framed.ravel()  # a cell's key is its place in the frame
    body = np.flatnonzero(kind >= 0)
    form, count = lattice.form(lattice.cells(body)), len(body)
    number = np.zeros(len(kind), dtype=np.int32)
    number[body] = np.arange(count)
    touching, links = np.zeros(count, dtype=np.bool_), []
    for arm in range(lattice.directions):
        reached = body + lattice.key_steps[form, arm]
        beyond = kind[reached]
        touching |= np.isin(beyond, _HOLDS)
        if arm < lattice.opposite[arm]:  # each face once
            inside = beyond >= 0
            links.append(np.stack([number[body[inside]], number[reached[inside]]]))
    pairs = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(pairs.shape[1], dtype=np.bool_), tuple(pairs)), (count, count))
    some, part = connected_components(graph, directed=False)
    parts = np.zeros(len(kind), dtype=np.int32)
    parts[body] = part + 1
    held = np.zeros(some + 1, dtype=np.bool_)
    held[part[touching] + 1] = True
    return parts.reshape(framed.shape)[1:-1, 1:-1], held


def _nothing_there(resolved: ResolvedBody) -> SceneError:
    shape = " x ".join(map(str, resolved.lattice.shape))
    return SceneError(
        f"body: none of the {shape} cells is body; at least one must be of a material"
    )
