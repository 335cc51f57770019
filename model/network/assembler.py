"""From the springs to forces and stiffness of the nodes, with the pattern computed once.

Everything that changes from one state to the next comes in as arrays over the springs: their
tension and their stiffness. So elastic springs, and springs that creep for one time step,
are assembled by the same code with other numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from .dissection import elimination_order
from .geometry import Geometry, along_springs, nodal_forces, spring_forces, spring_geometry
from .pattern import tangent_pattern
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
        self._pattern = tangent_pattern(network, order)

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
        return self._pattern.fill(self.network, self._blocks(geometry, tension, stiffness))

    def force_change(
        self, geometry: Geometry, tension: Floats, stiffness: Floats, displacement: Floats
    ) -> Floats:
        """Return by how much the springs' force on the nodes changes with a small displacement.

        The same as minus the tangent times the displacement, but for held nodes too.
        """
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
