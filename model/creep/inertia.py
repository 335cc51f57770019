"""Nodes with mass: over one implicit step, inertia is one more spring on every node."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array, diags_array

from kaju.errors import ParameterError
from kaju.model.network.assembler import Assembler
from kaju.model.network.geometry import Geometry
from kaju.model.network.springs import SpringNetwork

Floats = NDArray[np.float64]


class HeavyAssembler(Assembler):
    """Sums up springs and, over one implicit step, the inertia of the nodes.

    Inertia pulls every node to where it would get without forces, as a spring of stiffness
    M/h² in every direction. `geometry` is always asked before `internal_force`, so it notes
    where the nodes are.

    Attributes
    ----------
    mass : (n, 1) floats
        Mass of the nodes (kg).
    pull : (n, dimension) floats
        M/h² (N/m).
    """

    def __init__(self, network: SpringNetwork, mass: ArrayLike) -> None:
        super().__init__(network)
        self.mass = _node_masses(mass, len(network.positions))
        self._aim = np.zeros_like(network.positions)
        self._at = self._aim
        self.pull = np.zeros_like(self._aim)

    def expect(self, aim: Floats, substep: float) -> None:
        """Set where the nodes would be (n, dimension) after a step of length `substep`."""
        self._aim = aim
        self.pull = np.broadcast_to(self.mass / substep**2, aim.shape)

    def geometry(self, displacement: Floats) -> Geometry:
        """Return the springs' geometry, and note where the nodes are."""
        self._at = displacement
        return super().geometry(displacement)

    def internal_force(self, geometry: Geometry, tension: Floats) -> Floats:
        """Return the force of springs and inertia on the nodes (N)."""
        return super().internal_force(geometry, tension) - self.pull * (self._at - self._aim)

    def tangent(self, geometry: Geometry, tension: Floats, stiffness: Floats) -> csc_array:
        """Return how the free nodes resist small displacements (N/m)."""
        springs = super().tangent(geometry, tension, stiffness)
        return csc_array(springs + diags_array(self.restrict(self.pull)))

    def force_change(
        self, geometry: Geometry, tension: Floats, stiffness: Floats, displacement: Floats
    ) -> Floats:
        """Return by how much the force on the nodes changes with a small displacement."""
        change = super().force_change(geometry, tension, stiffness, displacement)
        return change - self.pull * displacement


def _node_masses(mass: ArrayLike, nodes: int) -> Floats:
    """Return the masses as a column (n, 1)."""
    masses = np.broadcast_to(np.asarray(mass, dtype=np.float64), (nodes,))
    if not np.all(np.isfinite(masses) & (masses > 0.0)):
        raise ParameterError("mass: every node needs a mass above 0 kg; leave it out for none")
    return masses[:, None].copy()
