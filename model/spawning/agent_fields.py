"""Strains, stresses and displacements of the agents of a composite grid; scaled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from kaju.model.elasticity.staggered import Pair

from .balance import Balance
from .composite import Floats
from .field import interpolation
from .leaves import Index


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
        found = {}
        for pair, edges in self.balance.grid.edges.items():
            strain = sum(g.matrix @ self.u + g.constant for g in edges.gradients)
            found[pair] = edges.modulus * strain + self.balance.surface_shear[pair]
        return found

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
        sides = (self.balance.grid.mean @ self.u).reshape(len(self.stress), -1, 2)
        return np.asarray(sides.mean(axis=2))

    def displacement_at(self, points: Floats, leaf: Index) -> Floats:
        """Return displacements at points (units) in leaves, shape (n, dimension)."""
        columns = []
        for axis in range(self.balance.grid.dimension):
            matrix, constant = interpolation(self.balance.grid, points, leaf, axis)
            columns.append(matrix @ self.u + constant)
        return np.stack(columns, axis=1)

    def stress_at(self, points: Floats, leaf: Index) -> Floats:
        """Return stress tensors at points (units) in leaves.

        Normal stresses run by the differences to neighbours of the same material, shear
        stresses between the leaf's edges.
        """
        grid, d = self.balance.grid, self.balance.grid.dimension
        local = (points - grid.leaves.lower[leaf]) / grid.leaves.size[leaf, None]
        tensor = np.zeros((len(leaf), d, d))
        for a in range(d):
            tensor[:, a, a] = self._along_slopes(self.normal_stress[a], leaf, local)
        for (a, b), shear in self.edge_shear.items():
            around, total = grid.edges[a, b].of_leaf[leaf], np.zeros(len(leaf))
            for first, second in product((0, 1), repeat=2):
                share = np.where(first, local[:, a], 1 - local[:, a])
                share = share * np.where(second, local[:, b], 1 - local[:, b])
                total += share * shear[around[:, first, second]]
            tensor[:, a, b] = tensor[:, b, a] = total
        return tensor

    def _along_slopes(self, value: Floats, leaf: Index, local: Floats) -> Floats:
        grid = self.balance.grid
        kind, h, total = grid.leaves.kind, grid.length, value[leaf].copy()
        for axis in range(grid.dimension):
            slope, count = np.zeros(len(leaf)), np.zeros(len(leaf))
            for side in (2 * axis, 2 * axis + 1):
                other = grid.beside[leaf, side]
                alike = (other >= 0) & (kind[other] == kind[leaf])
                rise = (value[other] - value[leaf]) / (0.5 * (h[other] + h[leaf]))
                slope += np.where(alike, (2 * (side % 2) - 1) * rise, 0.0)
                count += alike
            total += (local[:, axis] - 0.5) * h[leaf] * slope / np.maximum(count, 1)
        return np.asarray(total)
