"""Strains, stresses and displacements of the agents of a composite grid; scaled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaju.model.elastic.staggered import Pair

from .balance import Balance
from .composite import Floats


@dataclass(frozen=True, eq=False)
class AgentFields:
    """What follows from the faces' displacements.

    Attributes
    ----------
    balance : Balance
    u : array, shape (faces,)
        Displacements of the faces.
    """

    balance: Balance
    u: Floats

    @cached_property
    def stretch(self) -> Floats:
        """Normal strains of the agents, shape (dimension, agents)."""
        d, n = self.balance.grid.dimension, len(self.balance.grid.leaves)
        return np.asarray((self.balance.strains[: n * d] @ self.u).reshape(d, n))

    @cached_property
    def normal_stress(self) -> Floats:
        """Normal stresses of the agents, shape (dimension, agents)."""
        grid = self.balance.grid
        moduli, kind = grid.ground.moduli, grid.leaves.kind
        lateral = moduli.lateral[kind]
        shear = moduli.stretch[kind] - lateral
        return np.asarray(lateral * self.stretch.sum(axis=0) + shear * self.stretch)

    @cached_property
    def edge_shear(self) -> dict[Pair, Floats]:
        """Shear stresses of the edges, with the tractions on loaded surfaces."""
        return {
            pair: edges.modulus * sum(self.slopes[pair]) + self.balance.surface_shear[pair]
            for pair, edges in self.balance.grid.edges.items()
        }

    @cached_property
    def slopes(self) -> dict[Pair, tuple[Floats, Floats]]:
        """∂u_a/∂b and ∂u_b/∂a at the edges of every pair of axes (a, b)."""
        gradients = {pair: edges.gradients for pair, edges in self.balance.grid.edges.items()}
        return {
            pair: (first.matrix @ self.u + first.constant, second.matrix @ self.u + second.constant)
            for pair, (first, second) in gradients.items()
        }

    @cached_property
    def sides(self) -> Floats:
        """Normal displacements of the agents' sides, shape (agents, 2·dimension)."""
        grid = self.balance.grid
        return np.asarray(grid.mean @ self.u).reshape(len(grid.leaves), 2 * grid.dimension)

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors of the agents, shape (agents, dimension, dimension)."""
        grid, d = self.balance.grid, self.balance.grid.dimension
        tensor = np.zeros((len(grid.leaves), d, d))
        for a in range(d):
            tensor[:, a, a] = self.normal_stress[a]
        for (a, b), shear in self.edge_shear.items():
            mean = shear[grid.edges[a, b].of_leaf].mean(axis=(1, 2))
            tensor[:, a, b] = tensor[:, b, a] = mean
        return tensor

    @cached_property
    def displacement(self) -> Floats:
        """Displacement of the agents' middles, shape (agents, dimension)."""
        return np.asarray(self.sides.reshape(len(self.sides), -1, 2).mean(axis=2))
