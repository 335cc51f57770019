"""From the springs to forces and stiffness of the nodes, with the pattern computed once.

Everything that changes from one state to the next comes in as arrays over the springs: their
tension and their stiffness. So elastic springs, and springs that creep for one time step,
are assembled by the same code with other numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from .dissection import elimination_order
from .geometry import Geometry, along_springs, nodal_forces, spring_forces, spring_geometry
from .springs import Floats, SpringNetwork


class Assembler:
    """Sums springs up to what the nodes feel.

    Parameters
    ----------
    network : SpringNetwork
        Its positions, springs and supports are used; its forces and stiffness are not.

    Attributes
    ----------
    free : (f,) ints
        The coordinates that answer to forces, in the order of the rows of the tangent, as
        indices into ``positions.ravel()``. The order keeps the tangent's factors sparse.
    """

    def __init__(self, network: SpringNetwork) -> None:
        self.network = network
        dimension = network.dimension
        order = elimination_order(network.positions, network.springs)
        coordinates = (dimension * order[:, None] + np.arange(dimension)).ravel()
        self.free: NDArray[np.int64] = coordinates[~network.held.ravel()[coordinates]]
        self._pattern, self._places = self._index_map()

    def geometry(self, displacement: Floats) -> Geometry:
        """Return lengths, directions and elongations under a displacement (n, dimension)."""
        return spring_geometry(self.network, displacement)

    def internal_force(self, geometry: Geometry, tension: Floats) -> Floats:
        """Return the force of the springs on the nodes (N), shape (n, dimension)."""
        return spring_forces(self.network, geometry, tension)

    def tangent(self, geometry: Geometry, tension: Floats, stiffness: Floats) -> csc_array:
        """Return how the free nodes resist small displacements (N/m), shape (f, f).

        Parameters
        ----------
        geometry : Geometry
            State of the springs.
        tension : (m,) floats
            Force in every spring (N), positive when it pulls.
        stiffness : (m,) floats
            Growth of the tension with the length (N/m).
        """
        blocks = self._blocks(geometry, tension, stiffness).ravel()
        indices, pointer = self._pattern
        data = np.zeros(len(indices) + 1)
        for places, sign in zip(self._places, (1.0, 1.0, -1.0, -1.0), strict=True):
            data += sign * np.bincount(places, blocks, minlength=len(data))
        shape = (len(self.free), len(self.free))
        return csc_array((data[:-1], indices, pointer), shape=shape)

    def force_change(
        self, geometry: Geometry, tension: Floats, stiffness: Floats, displacement: Floats
    ) -> Floats:
        """Return by how much the springs' force on the nodes changes with a small displacement.

        The same as minus the tangent times the displacement, but for held nodes too.
        """
        moved = along_springs(self.network, displacement)
        blocks = self._blocks(geometry, tension, stiffness)
        return nodal_forces(self.network, -np.einsum("iab,ib->ia", blocks, moved))

    def restrict(self, field: Floats) -> Floats:
        """Pick the free coordinates of a field over the nodes, in the tangent's order."""
        return field.ravel()[self.free]

    def expand(self, values: Floats) -> Floats:
        """Spread values over the free coordinates to a field (n, dimension), 0 where held."""
        field = np.zeros(self.network.positions.size)
        field[self.free] = values
        return field.reshape(self.network.positions.shape)

    def _blocks(self, geometry: Geometry, tension: Floats, stiffness: Floats) -> Floats:
        """B = k d dᵀ + (T/L)(1 − d dᵀ) for every spring, shape (m, dimension, dimension)."""
        across = tension / geometry.length
        direction = geometry.direction
        blocks = (stiffness - across)[:, None, None] * (
            direction[:, :, None] * direction[:, None, :]
        )
        diagonal = np.arange(self.network.dimension)
        blocks[:, diagonal, diagonal] += across[:, None]
        return blocks

    def _index_map(
        self,
    ) -> tuple[tuple[NDArray[np.int32], NDArray[np.int32]], list[NDArray[np.intp]]]:
        """Find the pattern of the tangent, and where in it each number of each block belongs.

        A number of a held coordinate is sent to a place behind the last, and dropped there.
        """
        free = len(self.free)
        number = np.full(self.network.positions.size, -1, dtype=np.int64)
        number[self.free] = np.arange(free)
        pairs = [self._pairs(number, *ends) for ends in ((0, 0), (1, 1), (0, 1), (1, 0))]
        inside = [(rows >= 0) & (columns >= 0) for rows, columns in pairs]
        rows = np.concatenate([pair[0][keep] for pair, keep in zip(pairs, inside, strict=True)])
        columns = np.concatenate([pair[1][keep] for pair, keep in zip(pairs, inside, strict=True)])
        ones = np.ones(len(rows), dtype=np.int8)
        pattern = coo_array((ones, (rows, columns)), shape=(free, free)).tocsc()
        pattern.sort_indices()
        places = _places_in(pattern, rows, columns)
        found = np.split(places, np.cumsum([int(keep.sum()) for keep in inside])[:-1])
        spread = []
        for keep, place in zip(inside, found, strict=True):
            where = np.full(len(keep), pattern.nnz, dtype=np.intp)
            where[keep] = place
            spread.append(where)
        return (pattern.indices.astype(np.int32), pattern.indptr.astype(np.int32)), spread

    def _pairs(
        self, number: NDArray[np.int64], row_end: int, column_end: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of every number of one of a spring's four blocks."""
        dimension = self.network.dimension
        axes = np.arange(dimension)
        shape = (len(self.network.springs), dimension, dimension)
        ends = number[dimension * self.network.springs[:, :, None] + axes]
        rows = np.broadcast_to(ends[:, row_end, :, None], shape)
        columns = np.broadcast_to(ends[:, column_end, None, :], shape)
        return rows.ravel(), columns.ravel()


def _places_in(
    pattern: csc_array, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> NDArray[np.intp]:
    """Find the position of entries in the data of a sorted sparse matrix."""
    size = pattern.shape[0]
    stored = np.repeat(np.arange(size), np.diff(pattern.indptr)) * size + pattern.indices
    return np.searchsorted(stored, columns * size + rows)
