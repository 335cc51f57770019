"""Which process has which cells and faces, on every level of the hierarchy.

The cells of a level are half as many along every axis as those of the finer one, rounded up, and
every level has a layer of cells around the body, as kaju's arrays have. A process keeps the same
part of the body on all levels: parts are cut where cells of the coarsest level end, so no level
needs an even number of cells. PETSc's DMStag numbers the faces and knows the neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ParameterError

Index = NDArray[np.int64]
Box = tuple[Index, Index]
"""Lower corner, included, and upper corner, not included, of cells; the rim begins at -1."""

HALO = 3
"""Layers of cells beyond its own that a process knows on the finest level."""
FEWEST_FACES = 1500
"""A level of fewer is factorised, on every process alike."""


@dataclass(frozen=True)
class Level:
    """The faces of one level.

    Attributes
    ----------
    dm : DMStag
    shape : tuple of int
        Number of cells along each axis, without the rim.
    own : Box
        Cells of this process, with its part of the rim.
    ghosts : Box
        Cells that it knows, with the places of the faces behind the last.
    number : tuple of arrays
        Per axis PETSc's numbers of the faces below the cells of `ghosts`, -1 where there is none.
    """

    dm: Any
    shape: tuple[int, ...]
    own: Box
    ghosts: Box
    number: tuple[Index, ...]

    def owned(self, axis: int) -> Index:
        """Return the faces normal to an axis that belong to this process, by their cell above."""
        lower, upper = (corner.copy() for corner in self.own)
        upper[axis] += upper[axis] == self.shape[axis] + 1
        ranges = [np.arange(a, b) for a, b in zip(lower, upper, strict=True)]
        return np.stack([r.ravel() for r in np.meshgrid(*ranges, indexing="ij")], axis=1)

    def numbers(self, axis: int, faces: Index) -> Index:
        """Return PETSc's numbers of faces that this process knows."""
        return np.asarray(self.number[axis][tuple((faces - self.ghosts[0]).T)])


def levels_of(shape: tuple[int, ...], comm: Any) -> list[Level]:
    """Return the levels of a body's hierarchy, the finest first.

    Parameters
    ----------
    shape : tuple of int
        Cells along each axis, without the rim.
    comm : petsc4py Comm

    Raises
    ------
    ParameterError
        If there are more processes than the body can be cut for.
    """
    size = comm.getSize()
    parts = _processes(shape, size)
    if any(n < (HALO * p if p > 1 else 1) for n, p in zip(shape, parts, strict=True)):
        raise ParameterError(
            f"engine: {' x '.join(map(str, shape))} cells cannot be cut for {size} processes: "
            f"each needs {HALO} or more along every axis; start fewer"
        )
    shapes = [shape]
    while True:
        coarser = tuple(-(-n // 2) for n in shapes[-1])
        enough = all(n >= p for n, p in zip(coarser, parts, strict=True))
        few = len(shape) * np.prod(np.array(shapes[-1]) + 2.0) <= FEWEST_FACES
        if coarser == shapes[-1] or (few and len(shapes) > 1) or not enough:
            break
        shapes.append(coarser)
    cuts = _cuts(shapes, parts)
    return [_level(s, c, parts, comm, HALO if k == 0 else 1) for k, (s, c) in enumerate(cuts)]


def _processes(shape: tuple[int, ...], size: int) -> tuple[int, ...]:
    """Return into how many parts each axis is cut, so that the cuts are small."""
    fits = [
        parts
        for parts in product(range(1, size + 1), repeat=len(shape))
        if int(np.prod(parts)) == size
    ]
    return min(
        fits, key=lambda parts: (sum(p / n for p, n in zip(parts, shape, strict=True)), parts)
    )


def _cuts(
    shapes: list[tuple[int, ...]], parts: tuple[int, ...]
) -> list[tuple[tuple[int, ...], list[Index]]]:
    """Return per level where the parts begin and end, HALO cells apart on the finest."""
    depth = len(shapes) - 1
    found = []
    for level, shape in enumerate(shapes):
        cuts = []
        for n, coarsest, p in zip(shape, shapes[-1], parts, strict=True):
            ends = np.linspace(0, coarsest, p + 1).round().astype(np.int64)
            cuts.append(np.minimum(ends << (depth - level), n))
        found.append((shape, cuts))
    if any((np.diff(c) < (HALO if len(c) > 2 else 1)).any() for c in found[0][1]) and depth:
        # The last part is too thin: cut on a finer level.
        return _cuts(shapes[:-1], parts)
    return found


def _level(
    shape: tuple[int, ...], cuts: list[Index], parts: tuple[int, ...], comm: Any, width: int
) -> Level:
    from petsc4py import PETSc

    dimension = len(shape)
    sizes = [c.copy() for c in cuts]
    for c in sizes:  # the rim belongs to whoever is beside it
        c[0] -= 1
        c[-1] += 1
    dm = PETSc.DMStag().create(
        dimension,
        dofs=(0, 1, 0) if dimension == 2 else (0, 0, 1, 0),
        sizes=tuple(n + 2 for n in shape),
        boundary_types=("none",) * dimension,
        stencil_type="box",
        stencil_width=width,
        proc_sizes=parts,
        comm=comm,
        setUp=False,
    )
    dm.setOwnershipRanges([np.diff(c).astype(PETSc.IntType) for c in sizes])
    dm.setUp()
    start, count = dm.getCorners()[:2]
    ghost_start, ghost_count = (np.array(part, dtype=np.int64) for part in dm.getGhostCorners())
    slots = [dm.getLocationSlot(name, 0) for name in ("left", "down", "back")[:dimension]]
    numbers = np.asarray(dm.getLGMap().getIndices(), dtype=np.int64)
    table = numbers.reshape(*ghost_count[::-1], dm.getEntriesPerElement())
    lower = np.array(start, dtype=np.int64) - 1
    return Level(
        dm,
        shape,
        (lower, lower + np.array(count, dtype=np.int64)),
        (ghost_start - 1, ghost_start - 1 + ghost_count),
        tuple(table[..., slot].T for slot in slots),
    )
