"""What is where: the kind of any cell, worked out when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError

from .lattice import Cells, Lattice
from .pictures import MOST_CELLS


def grid(lower: NDArray[np.int64], upper: NDArray[np.int64]) -> Cells:
    """Return all cells with lower <= cell < upper, the last axis running fastest."""
    ranges = [np.arange(a, b, dtype=np.int64) for a, b in zip(lower, upper, strict=True)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*ranges, indexing="ij")], axis=1)


@dataclass(frozen=True, eq=False)
class Filling:
    """The kinds of the cells of an array and of what lies beyond its sides.

    Attributes
    ----------
    lattice : Lattice
        The array.
    base : int or ndarray of int
        Kind of every cell, before the regions: one for all, or one each.
    beyond : ndarray of int
        Kind of what lies beyond each of the lattice's sides.
    """

    lattice: Lattice
    base: int | NDArray[np.integer]
    beyond: NDArray[np.int64]

    def kinds(self, cells: Cells) -> NDArray[np.int64]:
        """Return the kind of each cell, those outside the array included."""
        side = self.lattice.side_beyond(cells)
        if isinstance(self.base, np.ndarray):
            kinds = self.beyond[side]
            inside = side < 0
            kinds[inside] = self.base[tuple(cells[inside].T)]
        else:
            kinds = np.append(self.beyond, self.base)[side]
        return kinds

    def bounds(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return a box outside of which there is no body: lower <= cell < upper."""
        shape = np.asarray(self.lattice.shape, dtype=np.int64)
        if isinstance(self.base, np.ndarray):
            body = self.base >= 0
            lower, upper = np.zeros_like(shape), shape.copy()
            for axis in range(len(shape)):
                others = tuple(other for other in range(len(shape)) if other != axis)
                filled = np.flatnonzero(body.any(axis=others))
                if len(filled):
                    lower[axis], upper[axis] = filled[0], filled[-1] + 1
            return lower, upper
        return np.zeros_like(shape), shape

    def rasterise(self) -> NDArray[np.int64]:
        """Return the kinds of all cells, shape `lattice.shape`."""
        lattice = self.lattice
        if lattice.size > MOST_CELLS:
            raise SceneError(
                f"body.cells: {' x '.join(map(str, lattice.shape))} cells are more than the "
                f"{MOST_CELLS:.0e} that can be held at once; use fewer, larger cells"
            )
        zero = np.zeros(lattice.dimension, dtype=np.int64)
        return self.kinds(grid(zero, np.asarray(lattice.shape))).reshape(lattice.shape)
