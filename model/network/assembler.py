"""From the springs to forces and stiffness of the nodes, with the pattern computed once.

Everything that changes from one state to the next comes in as arrays over the springs: their
tension and their stiffness. So elastic springs, and springs that creep for one time step,
are assembled by the same code with other numbers.

The tangent is the sum of the springs' own matrices. Only their numbers change; which of them is
added where in the sparse matrix does not. Nodes are eliminated by nested dissection: cut
in two halves across their longest side, again and again, those along the cut after both halves.
For a lattice in the plane the factors then hold O(n log n) numbers.

References
----------
A. George, "Nested dissection of a regular finite element mesh", SIAM Journal on Numerical
Analysis 10 (1973) 345-363.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from kaju.arrays import Floats, Ints

from .springs import SpringNetwork


class Geometry(NamedTuple):
    """Where the springs are in one state of the network."""

    length: Floats  # (m)
    direction: Floats  # unit vectors from the second node to the first, shape (m, dimension)
    elongation: Floats  # length minus that before any load (m), exact for tiny displacements


def along_springs(network: SpringNetwork, field: Floats) -> Floats:
    """Return the difference of a field over the nodes along every spring, (m, dimension)."""
    return field[network.springs[:, 0]] - field[network.springs[:, 1]]


def spring_geometry(network: SpringNetwork, displacement: Floats) -> Geometry:
    """Return lengths, directions and elongations under a displacement (n, dimension)."""
    initial = along_springs(network, network.positions)
    moved = along_springs(network, displacement)
    ends = initial + moved
    length = np.sqrt(np.einsum("ij,ij->i", ends, ends))
    # L² − L₀² = (2 e₀ + Δ)·Δ: the plain difference L − L₀ would lose the digits of Δ.
    elongation = np.einsum("ij,ij->i", ends + initial, moved) / (length + network.initial_length)
    with np.errstate(invalid="ignore", divide="ignore"):
        return Geometry(length, ends / length[:, None], elongation)


def nodal_forces(network: SpringNetwork, pull: Floats) -> Floats:
    """Add forces on the springs' first nodes, and their opposites on the second."""
    first, second = network.springs.T
    nodes = len(network.positions)
    columns = [
        np.bincount(first, along, minlength=nodes) - np.bincount(second, along, minlength=nodes)
        for along in pull.T
    ]
    return np.stack(columns, axis=1)


def spring_forces(network: SpringNetwork, geometry: Geometry, tension: Floats) -> Floats:
    """Return the force of the springs on the nodes (N), shape (n, dimension)."""
    return nodal_forces(network, -tension[:, None] * geometry.direction)


def elimination_order(positions: Floats, springs: Ints) -> Ints:
    """Return the node numbers in the order in which to eliminate them, shape (n,)."""
    order: list[Ints] = []
    upper, separator = np.zeros((2, len(positions)), dtype=np.bool_)

    def dissect(nodes: Ints, springs: Ints) -> None:
        if len(nodes) <= 24 or not len(springs):
            order.append(nodes)
            return
        place = positions[nodes]
        along = place[:, np.argmax(np.ptp(place, axis=0))]
        upper[nodes] = False
        upper[nodes[np.argsort(along, kind="stable")[len(nodes) // 2 :]]] = True
        # The lower ends of the springs that cross the cut separate the two halves.
        first, second = springs.T
        crossing = upper[first] != upper[second]
        cut = np.unique(np.where(upper[first], second, first)[crossing])
        separator[cut] = True
        inside = springs[~(crossing | separator[first] | separator[second])]
        halves = [
            (nodes[(upper[nodes] == half) & ~separator[nodes]], inside[upper[inside[:, 0]] == half])
            for half in (False, True)
        ]
        for half in halves:
            dissect(*half)
        order.append(cut)

    dissect(np.arange(len(positions)), springs)
    return np.concatenate(order)


class Pattern(NamedTuple):
    """The tangent of a network but for its numbers."""

    indices: NDArray[np.int32]  # rows of the entries, column by column
    pointer: NDArray[np.int32]  # where each column starts
    number: NDArray[np.intp]  # which numbers of the springs' own matrices, all in a row, count
    entry: NDArray[np.intp]  # to which entry each of them is added

    def fill(self, blocks: Floats) -> csc_array:
        """Return the tangent whose springs have the blocks (m, dimension, dimension)."""
        signs = np.array([[1.0, -1.0], [-1.0, 1.0]])  # of the two ends
        own = signs[:, None, :, None] * blocks[:, None, :, None, :]
        data = np.bincount(self.entry, own.ravel()[self.number], len(self.indices))
        size = len(self.pointer) - 1
        return csc_array((data, self.indices, self.pointer), shape=(size, size))


def tangent_pattern(network: SpringNetwork, free: Ints) -> Pattern:
    """Work out the pattern for free coordinates in an order."""
    # Row of the tangent, -1 where held, of every coordinate at the two ends of every spring.
    row = np.full(network.positions.size, -1)
    row[free] = np.arange(len(free))
    ends = row.reshape(network.positions.shape)[network.springs].reshape(len(network.springs), -1)
    column = np.broadcast_to(ends[:, None, :], (*ends.shape, ends.shape[1]))
    across = np.broadcast_to(ends[:, :, None], column.shape)
    number = np.flatnonzero((column >= 0) & (across >= 0))
    # Entries of the tangent by column, then row; several springs may add to one.
    place = (column.ravel()[number] * len(free)) + across.ravel()[number]
    filled, entry = np.unique(place, return_inverse=True)
    pointer = np.searchsorted(filled, len(free) * np.arange(len(free) + 1))
    indices = filled % max(len(free), 1)
    return Pattern(indices.astype(np.int32), pointer.astype(np.int32), number, entry.ravel())


class Assembler:
    """Sums springs up to what the nodes feel; of the network, forces and stiffness are not used.

    `free`, shape (f,): the coordinates that answer to forces, in the order of the rows of the
    tangent, as indices into ``positions.ravel()``. The order keeps the tangent's factors sparse.
    """

    def __init__(self, network: SpringNetwork) -> None:
        self.network = network
        dimension = network.dimension
        order = elimination_order(network.positions, network.springs)
        coordinates = (dimension * order[:, None] + np.arange(dimension)).ravel()
        self.free: Ints = coordinates[~network.held.ravel()[coordinates]]
        self._pattern = tangent_pattern(network, self.free)

    def tangent(self, geometry: Geometry, tension: Floats, stiffness: Floats) -> csc_array:
        """Return how the free nodes resist small displacements (N/m), shape (f, f)."""
        return self._pattern.fill(self._blocks(geometry, tension, stiffness))

    def force_change(
        self, geometry: Geometry, tension: Floats, stiffness: Floats, displacement: Floats
    ) -> Floats:
        """Return how the springs' force changes with a small displacement, on held nodes too."""
        moved = along_springs(self.network, displacement)
        blocks = self._blocks(geometry, tension, stiffness)
        return nodal_forces(self.network, -np.einsum("iab,ib->ia", blocks, moved))

    def resistance(
        self, geometry: Geometry, tension: Floats, stiffness: Floats, displacement: Floats
    ) -> float:
        """Return uᵀ A u of the tangent A and a small displacement u (n, dimension), in J."""
        moved = along_springs(self.network, displacement)
        along = np.einsum("ij,ij->i", moved, geometry.direction) ** 2
        across = np.einsum("ij,ij->i", moved, moved) - along
        return float(stiffness @ along + (tension / geometry.length) @ across)

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
