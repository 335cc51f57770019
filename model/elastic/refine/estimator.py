"""Second differences of displacements, from agent to agent, and the errors they stand for.

Children that take their parents' displacements by interpolation feel none of its
curvature: the stress that changes from one agent to the next, ahead and beside, is the load
that they leave unbalanced. Interpolated linearly over an edge h, a displacement with the
second derivative u″ is off by a strain whose mean square is (h u″)²/12. So

    η² = V h²/12 · (2μ Σ u_a,aa² + λ Σ (div u),a² + μ Σ u_a,bb²)

is the square of the error of one agent in the energy norm, and √(Σ η² / 2U) the relative
error of all (U: strain energy).
"""

from __future__ import annotations

from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid, Gradient
from kaju.model.elastic.cells.interpolation import known_slopes, oriented, slope_weights

SINGULAR = 6.0
"""Where stress grows without limit towards a point, the agents round it are off by more than their
curvature tells: bounds say by 4 to 25 times its square."""


class Ahead(NamedTuple):
    """Leaves and their neighbours along an axis, of the same material.

    Of the small neighbours on one side all count alike, each by its share of that side.
    """

    leaf: Ints
    beyond: Ints
    """A leaf, and its neighbour of the same size or larger. Shape (pairs,)."""
    distance: Floats  # Shape (pairs,)
    own: Floats
    other: Floats
    """Weight of the pair in the mean over the leaf's neighbours, and over the neighbour's. Shape
    (pairs,)."""

    @classmethod
    def of(cls, grid: CompositeGrid, axis: int) -> Ahead:
        """Return the pairs of a grid along an axis."""
        kind, h, n = grid.leaves.kind, grid.length, len(grid.leaves)
        leaves, others, counts = [], [], np.zeros(n)
        share = 0.5 ** (grid.dimension - 1)
        for side in (2 * axis, 2 * axis + 1):
            other = grid.beside[:, side]
            # A large leaf names one of its small neighbours only, but each of these names it.
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
        """Return the means of something of the pairs for every leaf, shape (leaves,)."""
        total = np.bincount(self.leaf, self.own * square, count)
        return np.asarray(total + np.bincount(self.beyond, self.other * square, count))

    def back(self, slope: Floats, weight: Floats) -> Floats:
        """Return half the derivative of ``weight · mean(slope²)`` by the value of the leaves."""
        whole = self.own * weight[self.leaf] + self.other * weight[self.beyond]
        push = whole * slope / self.distance
        n = len(weight)
        return np.asarray(np.bincount(self.beyond, push, n) - np.bincount(self.leaf, push, n))


class CurvatureAcross(NamedTuple):
    """∂²u_a/∂b² of the leaves, as a sum over the slopes at their edges."""

    axes: tuple[int, int]  # a and b
    gradients: tuple[Gradient, Gradient]  # ∂u_a/∂b and ∂u_b/∂a
    edge: Ints  # Shape (4, leaves)
    weight: Floats  # Of either gradient at each edge. Shape (2, 4, leaves)

    @classmethod
    def of(cls, grid: CompositeGrid, a: int, b: int) -> CurvatureAcross:
        """Return the edges of a grid that tell ∂²u_a/∂b²; where some are unknown it is zero."""
        edges = grid.edges[min(a, b), max(a, b)]
        gradients, table = oriented(edges, a < b)
        ends = list(product((0, 1), repeat=2))
        edge = np.stack([table[:, end, far] for end, far in ends])
        known = known_slopes(gradients, edge)
        counts = known.reshape(2, 2, -1).sum(axis=0)
        inside = (counts > 0).all(axis=0) / grid.length
        weight = np.empty((2, *edge.shape))
        for row, (_, far) in enumerate(ends):
            share = (2.0 * far - 1.0) * inside * known[row] / np.maximum(counts[far], 1)
            for part, slope in enumerate(
                slope_weights(edges, gradients, edge[row], grid.law.shear)
            ):
                weight[part, row] = share * slope
        return cls((a, b), gradients, edge, weight)

    def bend(self, u: Floats, walls: Floats | None) -> Floats:
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

    def back(self, bend: Floats, weight: Floats) -> Floats:
        """Return half the derivative of ``weight · bend²`` by the displacements of the faces."""
        push = self.weight * (weight * bend)
        total = np.zeros(self.gradients[0].matrix.shape[1])
        for gradient, part in zip(self.gradients, push, strict=True):
            at_edge = np.bincount(self.edge.ravel(), part.ravel(), len(gradient.valid))
            total += gradient.matrix.T @ at_edge
        return np.asarray(total)


class Bends(NamedTuple):
    """Second differences of a displacement."""

    along: tuple[Floats, ...]
    volume: tuple[Floats, ...]
    """Axis by axis, slopes of the strain along it and of the change in volume. Shape (pairs,)."""
    beside: tuple[Floats, ...]  # ∂²u_a/∂b² for every axis a and every other one b. Shape (leaves,)


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
        self._beside = [CurvatureAcross.of(grid, a, b) for a, b in permutations(axes, 2)]

    def of(self, u: Floats, walls: Floats | None = None) -> Bends:
        """Return the second differences of displacements of the faces."""
        # `walls` may tell how those on the sides of the array, and inside, move: by default as
        # given.
        d, n = self._grid.dimension, len(self._grid.leaves)
        stretch = (self._balance.strains[: n * d] @ u).reshape(d, n)
        change = stretch.sum(axis=0)
        return Bends(
            tuple(ahead.slopes(row) for ahead, row in zip(self._ahead, stretch, strict=True)),
            tuple(ahead.slopes(change) for ahead in self._ahead),
            tuple(beside.bend(u, walls) for beside in self._beside),
        )

    def energy(self, first: Bends, second: Bends) -> Floats:
        """Return the energy of the products of second differences, shape (leaves,)."""
        n = len(self._grid.leaves)
        total = np.zeros(n)
        for a, ahead in enumerate(self._ahead):
            total += 2 * self._shear * ahead.mean(first.along[a] * second.along[a], n)
            total += self._lateral * ahead.mean(first.volume[a] * second.volume[a], n)
        for one, other in zip(first.beside, second.beside, strict=True):
            total += self._shear * one * other
        return total

    def force(self, bends: Bends) -> Floats:
        """Return half the derivative of all energy by the faces' displacements: C'C u."""
        d, n = self._grid.dimension, len(self._grid.leaves)
        stretch = np.zeros((d, n))
        for a, ahead in enumerate(self._ahead):
            stretch[a] += ahead.back(bends.along[a], 2 * self._shear)
            stretch += ahead.back(bends.volume[a], self._lateral)
        total = np.asarray(self._balance.strains[: n * d].T @ stretch.ravel())
        for beside, bend in zip(self._beside, bends.beside, strict=True):
            total += beside.back(bend, self._shear)
        return total

    def push(self, bends: Bends) -> Floats:
        """Return the largest change of stress per length that bends a leaf, shape (leaves,)."""
        grid, n = self._grid, len(self._grid.leaves)
        largest, each = np.zeros(n), grid.dimension - 1
        for a, ahead in enumerate(self._ahead):
            own = 4.0 * ahead.mean(bends.along[a] ** 2, n)
            own += sum(bend**2 for bend in bends.beside[a * each : (a + 1) * each])
            largest = np.maximum(largest, grid.law.shear * np.sqrt(own))
        return largest


class Indicator(NamedTuple):
    """Per leaf the square of its error (energy norm) and its unbalanced load; both scaled."""

    square: Floats
    load: Floats


def indicate(balance: Equilibrium, u: Floats) -> Indicator:
    """Return what every agent would leave unbalanced if its children only followed it."""
    curvature, grid = Curvature(balance), balance.grid
    bends = curvature.of(u)
    load = grid.length**grid.dimension * curvature.push(bends)
    square = curvature.energy(bends, bends)
    square[grid.leaves.holding(grid.ground.sharp)] *= SINGULAR
    return Indicator(square, load)
