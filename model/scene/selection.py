"""Where loads act: from a description to the cells and faces that take the force.

A selection is made of integer ranges and of the cells in them; the body is never
rasterised for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import suggestion
from kaju.errors import SceneError

from . import kinds
from .filling import Filling
from .lattice import Cells, Lattice
from .loads import Load

MOST_FACES = 50_000_000
"""A load acts on at most this many faces or cells."""

_HEXAGON_ARMS = {"left": [3], "right": [0], "bottom": [4, 5], "top": [1, 2]}


@dataclass(frozen=True, eq=False)
class AppliedLoads:
    """Forces on cells.

    Attributes
    ----------
    cells : ndarray of int, shape (n, dimension)
        The cells that take the forces; a cell may occur more than once.
    direction : ndarray of int, shape (n,)
        Index of the face by which the force enters, -1 for the cell's middle.
    force : ndarray of float, shape (n, dimension)
        The forces (N).
    """

    cells: Cells
    direction: NDArray[np.int64]
    force: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Selection:
    """The faces (or, with direction -1, cells) on which one load acts.

    Attributes
    ----------
    cells, direction
        As in `AppliedLoads`.
    share : ndarray of float, shape (n,)
        Part of each face (cell) that the load covers, up to 1.
    """

    cells: Cells
    direction: NDArray[np.int64]
    share: NDArray[np.float64]

    def forces(self, load: Load, lattice: Lattice, thickness: float) -> NDArray[np.float64]:
        """Return the force (N) on each face or cell, shape (n, dimension)."""
        if load.force is not None:
            return np.outer(self.share / self.share.sum(), np.asarray(load.force))
        assert load.pressure is not None
        area = self.share * lattice.face_area(thickness)
        return -load.pressure * area[:, None] * lattice.normals[self.direction]


def select(filling: Filling, load: Load, where: str) -> Selection:
    """Return what a load acts on.

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
        If there is no body at the load's place.
    """
    dimension = filling.lattice.dimension
    if load.force is not None and len(load.force) != dimension:
        raise SceneError(f"{where}.force: {dimension} components are needed, got {load.force}")
    if load.side is not None and load.side not in filling.lattice.sides:
        raise SceneError(
            f"{where}.side: there is no side {load.side!r}"
            f"{suggestion(load.side, filling.lattice.sides)}; there is "
            f"{', '.join(filling.lattice.sides)}"
        )
    if load.cell is not None:
        return _cell(filling, load, where)
    raise SceneError(f"{where}: not yet")


def _cell(filling: Filling, load: Load, where: str) -> Selection:
    assert load.cell is not None
    lattice = filling.lattice
    if len(load.cell) != lattice.dimension:
        raise SceneError(f"{where}.cell: {lattice.dimension} numbers are needed, got {load.cell}")
    cells = np.array([load.cell], dtype=np.int64)
    if not lattice.contains(cells)[0]:
        raise SceneError(
            f"{where}.cell: {list(load.cell)} lies outside the array of "
            f"{' x '.join(map(str, lattice.shape))} cells, which count from 0"
        )
    kind = int(filling.kinds(cells)[0])
    if kind < 0:
        raise SceneError(
            f"{where}.cell: {list(load.cell)} is {kinds.NAMES[kind]}, not body; choose a cell of "
            "material"
        )
    return _into(filling, cells, load, where)


def _into(filling: Filling, cells: Cells, load: Load, where: str) -> Selection:
    """Return the faces by which a load enters single cells."""
    if load.side is not None:
        arms = arms_of_side(filling.lattice, load.side)
    elif load.force is None:
        raise SceneError(f"{where}.side: a pressure on a cell needs a side")
    else:
        arms = [_entering(filling, cells[0], np.asarray(load.force))]
    chosen = np.repeat(cells, len(arms), axis=0)
    return Selection(chosen, np.tile(arms, len(cells)), np.full(len(chosen), 1.0))


def arms_of_side(lattice: Lattice, side: str) -> list[int]:
    """Return the faces of a cell that look towards a side of the array."""
    return _HEXAGON_ARMS[side] if lattice.kind == "hexagon" else [lattice.sides.index(side)]


def _entering(filling: Filling, cell: NDArray[np.int64], force: NDArray[np.float64]) -> int:
    """Return the face whose outward normal is most opposed to a force.

    Of two equally opposed faces the one on the surface counts; if that does not settle it,
    the force enters in the middle (-1), so that a mirrored scene stays mirrored.
    """
    lattice = filling.lattice
    along = lattice.normals @ force
    faces = np.flatnonzero(along <= along.min() + 1e-9 * np.abs(force).max())
    if len(faces) > 1:
        beyond = np.concatenate([lattice.neighbours(cell[None], face) for face in faces])
        exposed = faces[filling.kinds(beyond) < 0]
        faces = exposed if len(exposed) else faces
    return int(faces[0]) if len(faces) == 1 else -1
