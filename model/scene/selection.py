"""Where loads act: from a description to the cells and faces that take the force.

A selection is made of integer ranges and of the cells in them; the body is never
rasterised for it.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import suggestion
from kaju.errors import SceneError

from . import kinds
from .filling import Filling
from .lattice import Cells, Lattice
from .loads import Load
from .shapes import Box
from .surfaces import (
    Corners,
    Selection,
    cells_in_box,
    cells_in_shape,
    faces_in_shape,
    faces_on_plane,
    faces_on_side,
)

_NUDGE = 1e-6  # of a cell: a point this near to a neighbour belongs to both


def select(filling: Filling, load: Load, where: str) -> Selection:
    """Return the faces and cells that a load acts on.

    Parameters
    ----------
    filling : Filling
        What is where.
    load : Load
        The load.
    where : str
        Key path of the load, for errors.

    Raises
    ------
    SceneError
        If there is no body at the load's place, or the load does not fit the lattice.
    """
    lattice = filling.lattice
    if load.force is not None:
        _check_axes(load.force, lattice, f"{where}.force")
    if load.pressure_slope is not None:
        _check_axes(load.pressure_slope, lattice, f"{where}.pressure_slope")
    if load.couple is not None and np.size(load.couple) != 2 * lattice.dimension - 3:
        needed = "three numbers" if lattice.dimension == 3 else "one number"
        raise SceneError(f"{where}.couple: {needed} (N m) are needed, got {load.couple}")
    if load.side is not None and load.side not in lattice.sides:
        raise SceneError(
            f"{where}.side: there is no side {load.side!r}{suggestion(load.side, lattice.sides)}; "
            f"there is {', '.join(lattice.sides)}"
        )
    if load.cell is not None:
        return _into(filling, _named_cell(filling, load.cell, f"{where}.cell"), load, where)
    if load.point is not None:
        return _into(filling, _cells_at(filling, load.point, f"{where}.point"), load, where)
    if load.region is None:
        assert load.side is not None
        return faces_on_side(filling, load.side, f"{where}.side")
    if load.region.box is None:
        shape = load.region.shape_in(lattice.dimension, f"{where}.region")
        if load.force is None:
            return faces_in_shape(filling, shape, f"{where}.region")
        return cells_in_shape(filling, shape, f"{where}.region")
    return _in_region(filling, load, load.region.box, f"{where}.region.box")


def _in_region(filling: Filling, load: Load, box: Corners, where: str) -> Selection:
    assert load.region is not None
    region = load.region
    for corner in box:
        _check_axes(corner, filling.lattice, where)
    flat = region.flat_axis(filling.lattice.cell_size, where)
    if flat is not None:
        return faces_on_plane(filling, box, flat, where)
    if load.force is None:
        what = "couple" if load.pressure is None else "pressure"
        raise SceneError(
            f"{where}: a {what} acts on a surface; give the box no thickness along one axis, or "
            "take another shape"
        )
    if not filling.lattice.boxes:
        lower, upper = (tuple(corner) for corner in box)
        return cells_in_shape(filling, Box(lower, upper), where)
    return cells_in_box(filling, box, where)


def _check_axes(numbers: tuple[float, ...], lattice: Lattice, where: str) -> None:
    if len(numbers) != lattice.dimension:
        raise SceneError(
            f"{where}: {list(numbers)} should have {lattice.dimension} numbers, one for each "
            "axis of the cells"
        )


def _named_cell(filling: Filling, cell: tuple[int, ...], where: str) -> Cells:
    lattice = filling.lattice
    _check_axes(cell, lattice, where)
    cells = np.array([cell], dtype=np.int64)
    if not lattice.contains(cells)[0]:
        raise SceneError(
            f"{where}: {list(cell)} lies outside the array of "
            f"{' x '.join(map(str, lattice.shape))} cells, which count from 0"
        )
    kind = int(filling.kinds(cells)[0])
    if kind < 0:
        raise SceneError(
            f"{where}: {list(cell)} is {kinds.NAMES[kind]}, not body; choose a cell of material"
        )
    return cells


def _cells_at(filling: Filling, point: tuple[float, ...], where: str) -> Cells:
    """Return the body cells that a point lies in or on: several if it lies between them."""
    lattice = filling.lattice
    _check_axes(point, lattice, where)
    if not all(
        -_NUDGE <= x / edge <= 1.0 + _NUDGE for x, edge in zip(point, lattice.extent, strict=True)
    ):
        raise SceneError(
            f"{where}: {list(point)} m lies outside the array, which goes from 0 to "
            f"{list(lattice.extent)} m"
        )
    around = np.array(list(product((-1.0, 1.0), repeat=lattice.dimension)))
    if not lattice.boxes:
        around = np.concatenate([around, lattice.normals])
    nearby = np.asarray(point) + _NUDGE * lattice.cell_size * around
    cells = np.unique(lattice.locate(nearby), axis=0)
    found = filling.kinds(cells)
    if not np.any(found >= 0):
        named = " and ".join(sorted({kinds.NAMES[int(kind)] for kind in found}))
        raise SceneError(
            f"{where}: {list(point)} m lies in cell {cells[0].tolist()}, where there is {named}, "
            "not body; choose a point in or on the body"
        )
    return cells[found >= 0]


def _into(filling: Filling, cells: Cells, load: Load, where: str) -> Selection:
    """Return the faces by which a load enters single cells."""
    if load.side is not None:
        lattice = filling.lattice
        arms = [lattice.arms_of_side(load.side, form) for form in lattice.form(cells)]
        direction = np.array([arm for some in arms for arm in some], dtype=np.int64)
        cells = np.repeat(cells, [len(some) for some in arms], axis=0)
    elif load.force is not None:
        force = np.asarray(load.force)
        entries = [_entering(filling, cell, force) for cell in cells]
        direction = np.array(entries, dtype=np.int64)
    else:
        raise SceneError(f"{where}.side: is needed to press on a single cell with a pressure")
    return Selection(cells, direction, np.ones(len(cells)))


def _entering(filling: Filling, cell: NDArray[np.int64], force: NDArray[np.float64]) -> int:
    """Return the face whose outward normal is most opposed to a force.

    Of two equally opposed faces the one on the surface counts; if that does not settle it,
    the force enters in the middle (-1), so that a mirrored scene stays mirrored.
    """
    lattice = filling.lattice
    arms = np.array(lattice.arms[int(lattice.form(cell[None])[0])])
    along = lattice.normals[arms] @ (force / np.abs(force).max())
    faces = arms[along <= along.min() + 1e-9]
    if len(faces) > 1:
        beyond = [lattice.neighbours(cell[None], int(face)) for face in faces]
        exposed = faces[filling.kinds(np.concatenate(beyond)) < 0]
        faces = exposed if len(exposed) else faces
    return int(faces[0]) if len(faces) == 1 else -1
