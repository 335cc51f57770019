"""The error estimator: second differences of the displacement between neighbouring cells.

A displacement prolonged to children linearly has none of the solution's curvature: the change of
stress from one cell to the next is the load that they leave unbalanced. Linear interpolation over
an edge h of a displacement with the second derivative u″ has a strain error of mean square
(h u″)²/12. So

    η² = V h²/12 · (2μ Σ u_a,aa² + λ Σ (div u),a² + μ Σ u_a,bb²)

is the squared error of one cell in the energy norm, and √(Σ η² / 2U) the relative error of the
answer (U: strain energy).
"""

from __future__ import annotations

from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid, Gradient
from kaju.model.elastic.cells.interpolation import defined_slopes, oriented, slope_weights

SINGULAR = 6.0
"""Factor of η² for cells at a point where stress is singular: second differences underestimate it
there by 4 to 25, by comparison with bounds."""


class Ahead(NamedTuple):
    """Pairs of neighbours along an axis, of the same material; small ones share a side equally."""

    leaf: Ints  # Shape (pairs,)
    beyond: Ints  # Its neighbour, of the same size or larger. Shape (pairs,)
    distance: Floats  # Between their middles. Shape (pairs,)
    own: Floats  # Weight of the pair in the mean over the leaf's neighbours. Shape (pairs,)
    other: Floats  # The same for the neighbour's. Shape (pairs,)

    @classmethod
    def of(cls, grid: CompositeGrid, axis: int) -> Ahead:
        """Return the pairs of a grid along an axis."""
        kind, h, n = grid.leaves.kind, grid.length, len(grid.leaves)
        leaves, others, counts = [], [], np.zeros(n)
        share = 0.5 ** (grid.dimension - 1)
        for side in (2 * axis, 2 * axis + 1):
            other = grid.beside[:, side]
            # A large leaf lists one of its small neighbours only, but each of these lists it.
            leaf = np.flatnonzero((other >= 0) & (kind[other] == kind) & (h[other] >= h))
            leaves.append(leaf)
            others.append(other[leaf])
            counts += np.bincount(leaf, minlength=n)
            counts += np.bincount(other[leaf], share * (h[other[leaf]] > h[leaf]), n)
        leaf, beyond = np.concatenate(leaves), np.concatenate(others)
        large = share * (h[beyond] > h[leaf])
        distance = 0.5 * (h[beyond] + h[leaf])
        return cls(leaf, beyond, distance, 1.0 / counts[leaf], large / counts[beyond])

    def slopes(self, value: Floats) -> Floats:
        """Return the slopes of a value of the leaves, shape (pairs,)."""
        return np.asarray((value[self.beyond] - value[self.leaf]) / self.distance)

    def mean(self, square: Floats, count: int) -> Floats:
        """Return the means of values of the pairs for every leaf, shape (leaves,)."""
        total = np.bincount(self.leaf, self.own * square, count)
        return np.asarray(total + np.bincount(self.beyond, self.other * square, count))

    def adjoint(self, slope: Floats, weight: Floats) -> Floats:
        """Return half the derivative of ``weight · mean(slope²)`` by the value of the leaves."""
        whole = self.own * weight[self.leaf] + self.other * weight[self.beyond]
        flux = whole * slope / self.distance
        n = len(weight)
        return np.asarray(np.bincount(self.beyond, flux, n) - np.bincount(self.leaf, flux, n))


class CurvatureAcross(NamedTuple):
    """∂²u_a/∂b² of the leaves, as a sum over the slopes at their edges."""

    axes: tuple[int, int]  # a and b
    gradients: tuple[Gradient, Gradient]  # ∂u_a/∂b and ∂u_b/∂a
    edge: Ints  # Shape (4, leaves)
    weight: Floats  # Of either gradient at each edge. Shape (2, 4, leaves)

    @classmethod
    def of(cls, grid: CompositeGrid, a: int, b: int) -> CurvatureAcross:
        """Return ∂²u_a/∂b² of a grid's leaves; zero where a slope at an end is undefined."""
        edges = grid.edges[min(a, b), max(a, b)]
        gradients, table = oriented(edges, a < b)
        ends = list(product((0, 1), repeat=2))
        edge = np.stack([table[:, end, far] for end, far in ends])
        defined = defined_slopes(gradients, edge)
        counts = defined.reshape(2, 2, -1).sum(axis=0)
        inside = (counts > 0).all(axis=0) / grid.length
        weight = np.empty((2, *edge.shape))
        for row, (_, far) in enumerate(ends):
            share = (2.0 * far - 1.0) * inside * defined[row] / np.maximum(counts[far], 1)
            for part, slope in enumerate(
                slope_weights(edges, gradients, edge[row], grid.law.shear)
            ):
                weight[part, row] = share * slope
        return cls((a, b), gradients, edge, weight)

    def of_displacement(self, u: Floats, walls: Floats | None) -> Floats:
        """Return ∂²u_a/∂b², shape (leaves,); for `walls` see `Curvature.of`."""
        total = np.zeros(self.edge.shape[1])
        for axis, gradient, weight in zip(self.axes, self.gradients, self.weight, strict=True):
            constant = gradient.constant
            if walls is not None:
                constant = np.where(gradient.wall >= 0, walls[gradient.wall, axis], 0.0)
                constant *= gradient.pull
            slope = gradient.matrix @ u + constant
            total += (weight * slope[self.edge]).sum(axis=0)
        return np.asarray(total)

    def adjoint(self, curvature: Floats, weight: Floats) -> Floats:
        """Return half the derivative of ``weight · curvature²`` by the faces' displacements."""
        by_slope = self.weight * (weight * curvature)
        total = np.zeros(self.gradients[0].matrix.shape[1])
        for gradient, part in zip(self.gradients, by_slope, strict=True):
            at_edge = np.bincount(self.edge.ravel(), part.ravel(), len(gradient.valid))
            total += gradient.matrix.T @ at_edge
        return np.asarray(total)


class SecondDifferences(NamedTuple):
    """Second differences of a displacement."""

    along: tuple[Floats, ...]  # ∂²u_a/∂a² for every axis a. Shape (pairs,)
    volume: tuple[Floats, ...]  # ∂(div u)/∂a for every axis a. Shape (pairs,)
    across: tuple[Floats, ...]  # ∂²u_a/∂b² for every axis a and every other one b. Shape (leaves,)


class Curvature:
    """Second differences of displacements on a grid, and their energies.

    The energies of an agent's second differences add up to its η²; those of the second
    differences of two displacements, multiplied, to the energy of their errors in each other.
    """

    def __init__(self, balance: Equilibrium) -> None:
        self._balance = balance
        grid = self._grid = balance.grid
        # Walls that do not move.
        self.resting = np.zeros((2 * grid.dimension + 1, grid.dimension))
        axes = range(grid.dimension)
        unit = grid.length ** (grid.dimension + 2) / 12.0
        self._shear = unit * grid.law.shear
        self._lateral = unit * np.maximum(grid.law.lateral, 0.0)
        self._ahead = [Ahead.of(grid, a) for a in axes]
        self._across = [CurvatureAcross.of(grid, a, b) for a, b in permutations(axes, 2)]

    def of(self, u: Floats, walls: Floats | None = None) -> SecondDifferences:
        """Return the second differences of displacements of the faces."""
        # `walls` are displacements of the array's sides, then of rigid cells inside, if not the
        # prescribed ones.
        d, n = self._grid.dimension, len(self._grid.leaves)
        stretch = (self._balance.strains[: n * d] @ u).reshape(d, n)
        change = stretch.sum(axis=0)
        return SecondDifferences(
            tuple(ahead.slopes(row) for ahead, row in zip(self._ahead, stretch, strict=True)),
            tuple(ahead.slopes(change) for ahead in self._ahead),
            tuple(across.of_displacement(u, walls) for across in self._across),
        )

    def energy(self, first: SecondDifferences, second: SecondDifferences) -> Floats:
        """Return the energy of the products of second differences, shape (leaves,)."""
        n = len(self._grid.leaves)
        total = np.zeros(n)
        for a, ahead in enumerate(self._ahead):
            total += 2 * self._shear * ahead.mean(first.along[a] * second.along[a], n)
            total += self._lateral * ahead.mean(first.volume[a] * second.volume[a], n)
        for one, other in zip(first.across, second.across, strict=True):
            total += self._shear * one * other
        return total

    def force(self, second: SecondDifferences) -> Floats:
        """Return half the derivative of all energy by the faces' displacements: C'C u."""
        d, n = self._grid.dimension, len(self._grid.leaves)
        stretch = np.zeros((d, n))
        for a, ahead in enumerate(self._ahead):
            stretch[a] += ahead.adjoint(second.along[a], 2 * self._shear)
            stretch += ahead.adjoint(second.volume[a], self._lateral)
        total = np.asarray(self._balance.strains[: n * d].T @ stretch.ravel())
        for across, curvature in zip(self._across, second.across, strict=True):
            total += across.adjoint(curvature, self._shear)
        return total

    def unbalanced(self, second: SecondDifferences) -> Floats:
        """Return the leaves' largest change of stress per length, shape (leaves,)."""
        grid, n = self._grid, len(self._grid.leaves)
        largest, each = np.zeros(n), grid.dimension - 1
        for a, ahead in enumerate(self._ahead):
            own = 4.0 * ahead.mean(second.along[a] ** 2, n)
            own += sum(part**2 for part in second.across[a * each : (a + 1) * each])
            largest = np.maximum(largest, grid.law.shear * np.sqrt(own))
        return largest


class Indicator(NamedTuple):
    """Squared error (energy norm) and unbalanced load of every leaf; scaled."""

    square: Floats
    load: Floats


def indicate(balance: Equilibrium, u: Floats) -> Indicator:
    """Return the estimated errors of the leaves, and their loads that children would feel."""
    curvature, grid = Curvature(balance), balance.grid
    second = curvature.of(u)
    load = grid.length**grid.dimension * curvature.unbalanced(second)
    square = curvature.energy(second, second)
    square[grid.leaves.holding(grid.ground.sharp)] *= SINGULAR
    return Indicator(square, load)
