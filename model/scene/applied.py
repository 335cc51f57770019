"""The forces on cells, put together from loads and gravity at a stage of loading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError

from .contents import Contents
from .filling import count, slabs
from .lattice import Cells
from .loads import Load
from .selection import MOST_FACES, Selection

PUSH: Final = 1
PULL: Final = -1
BY_SIDE: Final = 0
BY_SURFACE: Final = 2


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
    sense : ndarray of int, shape (n,), optional
        What the scene says of the force: `PUSH`, `PULL`, or nothing. Then its side decides
        (`BY_SIDE`), or, where the scene names none, the surface (`BY_SURFACE`).
    """

    cells: Cells
    direction: NDArray[np.int64]
    force: NDArray[np.float64]
    sense: NDArray[np.int8] | None = None


def at_stage(
    contents: Contents,
    loads: Sequence[Load],
    selections: Sequence[Selection],
    stage: int,
    thickness: float,
    gravity: tuple[float, ...] | None,
) -> AppliedLoads:
    """Return all forces at a stage of loading; gravity acts in full from the first stage."""
    lattice = contents.filling.lattice
    parts = [_nothing(lattice.dimension)]
    for load, chosen in zip(loads, selections, strict=True):
        factor = min(1.0, stage / load.steps)
        force = factor * chosen.forces(load, lattice, thickness)
        sense = np.full(len(force), _said(load), dtype=np.int8)
        parts.append(AppliedLoads(chosen.cells, chosen.direction, force, sense))
    if gravity is not None and any(gravity):
        parts.append(weight(contents, gravity, thickness))
    return AppliedLoads(
        np.concatenate([part.cells for part in parts]),
        np.concatenate([part.direction for part in parts]),
        np.concatenate([part.force for part in parts]),
        np.concatenate([_senses(part) for part in parts]),
    )


def _said(load: Load) -> int:
    """Return what a load's description says of its sense."""
    if load.sense is not None:
        return PUSH if load.sense == "push" else PULL
    return BY_SURFACE if load.side is None and load.region is None else BY_SIDE


def _senses(part: AppliedLoads) -> NDArray[np.int8]:
    return np.full(len(part.force), BY_SIDE, dtype=np.int8) if part.sense is None else part.sense


def _nothing(dimension: int) -> AppliedLoads:
    no_cells = np.empty((0, dimension), dtype=np.int64)
    return AppliedLoads(no_cells, np.empty(0, dtype=np.int64), np.empty((0, dimension)))


def weight(contents: Contents, gravity: tuple[float, ...], thickness: float) -> AppliedLoads:
    """Return the weight of every cell of the body, in the cell's middle."""
    filling = contents.filling
    volume = filling.lattice.cell_volume(thickness)
    mass = np.array([(material.density or 0.0) * volume for material in contents.materials])
    cells, masses = [np.empty((0, filling.lattice.dimension), dtype=np.int64)], [np.empty(0)]
    for slab in slabs(filling.bounds()):
        found = filling.kinds(slab)
        body = found >= 0
        cells.append(slab[body])
        masses.append(mass[found[body]])
    all_cells = np.concatenate(cells)
    middle = np.full(len(all_cells), -1, dtype=np.int64)
    return AppliedLoads(all_cells, middle, np.outer(np.concatenate(masses), gravity))


def check_gravity(contents: Contents, gravity: tuple[float, ...] | None) -> None:
    """Refuse gravity on a body without density or on one too large to be weighed by cells.

    Raises
    ------
    SceneError
        Naming the material without density, or the number of cells.
    """
    if gravity is None:
        return
    dimension = contents.filling.lattice.dimension
    if len(gravity) != dimension:
        raise SceneError(
            f"body.gravity: {dimension} numbers are needed, one for each axis, got {list(gravity)}"
        )
    for material in contents.materials if any(gravity) else ():
        if material.density is None:
            raise SceneError(
                f"materials.{material.name}.density: is needed, for gravity acts (kg/m³)"
            )
    cells = count(contents.filling.bounds())
    if any(gravity) and cells > MOST_FACES:
        raise SceneError(
            f"body.gravity: would load each of up to {cells:.3g} cells, more than "
            f"{MOST_FACES:.0e}; take larger cells or leave gravity out"
        )
