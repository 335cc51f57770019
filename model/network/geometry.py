"""How springs lie in a state of their network, and what they do to the nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .springs import Floats, SpringNetwork


class Geometry(NamedTuple):
    """Where the springs are in one state of the network."""

    length: Floats
    """Lengths (m), shape (m,)."""
    direction: Floats
    """Unit vectors from the second node to the first, shape (m, dimension)."""
    elongation: Floats
    """Length minus the length before any load (m), shape (m,), exact for tiny displacements."""


def along_springs(network: SpringNetwork, field: Floats) -> Floats:
    """Return the difference of a field over the nodes along every spring, (m, dimension)."""
    difference: Floats = field[network.springs[:, 0]] - field[network.springs[:, 1]]
    return difference


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
    """Add forces (m, dimension) on the springs' first nodes, and their opposites on the second.

    Shape (n, dimension).
    """
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
