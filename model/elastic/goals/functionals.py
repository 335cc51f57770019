"""Quantities of interest as functionals of the displacement: values and derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import product
from typing import NamedTuple

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Flags, Floats
from kaju.errors import ParameterError
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import CellFields, displacement_at, stress_at, touching
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import interpolation
from kaju.model.elastic.equal.problem import FIXED
from kaju.model.elastic.goals.goal_regions import ExactCover, QuadraturePoints, region_of
from kaju.model.elastic.goals.quantities import (
    Deflection,
    Place,
    Quantity,
    Reaction,
    Stress,
    component_of,
    directions_of,
)
from kaju.model.elastic.moduli import moduli_at, normal_stress, von_mises
from kaju.model.elastic.posed_body import LeafForces, PosedBody
from kaju.model.elastic.scales import Scales
from kaju.model.scene.cell_types import INSIDE

NEGLIGIBLE = 0.01  # Of the largest: errors of smaller values are relative to this share


class Value(NamedTuple):
    """A quantity and its derivatives; scaled."""

    value: Floats  # Shape (components,)
    scale: float  # What its error is relative to
    derivatives: Floats  # By the displacement of every face; shape (components, faces)
    sampling_error: float = 0.0  # By how much the mean over large agents may be off
    # The dual solution on the faces that supports hold, if it is not zero; shape
    # (components, faces)
    held: Floats | None = None
    # The same for the sides of the array, and rigid cells inside; shape
    # (components, 2·dimension + 1, dimension)
    walls: Floats | None = None


class Functional(ABC):
    """A quantity of a region, evaluated on one grid after the other."""

    directions: Floats  # A direction for each of its components

    def __init__(self, at: Place, ground: PosedBody) -> None:
        self._name, self._region = f"{at}", region_of(at, ground)

    def coarse(self, grid: CompositeGrid) -> Flags:
        """Tell which leaves are too large for the quantity to be seen."""
        return self._region.coarse(grid)

    def parts(self, grid: CompositeGrid) -> ExactCover | str:
        """Return what covers its region exactly, or why no energy bounds it."""
        return self._region.parts(grid)

    @abstractmethod
    def of(self, fields: CellFields) -> Value:
        """Return the quantity and its derivatives."""

    @abstractmethod
    def loads(self, grid: CompositeGrid, parts: ExactCover) -> list[LeafForces]:
        """Return, for every component, the forces whose work it is."""

    def _points(self, grid: CompositeGrid) -> QuadraturePoints:
        points = self._region.points(grid)
        if not len(points.leaf):
            raise ParameterError(f"goal: there is no body at {self._name}")
        return points


class _Displaced(Functional):
    """The mean displacement of a place, along some directions."""

    def __init__(self, quantity: Deflection, ground: PosedBody) -> None:
        super().__init__(quantity.at, ground)
        self.directions = directions_of(quantity.along, ground.dimension)

    def loads(self, grid: CompositeGrid, parts: ExactCover) -> list[LeafForces]:
        share = parts.share[:, None]
        return [LeafForces(parts.leaf, parts.side, share * along) for along in self.directions]

    def of(self, fields: CellFields) -> Value:
        grid = fields.balance.grid
        points = self._points(grid)
        moved = displacement_at(fields, points.place, points.leaf)
        value = self.directions @ (points.weight @ moved)
        bulge = points.weight @ _bulge(fields, points, moved)
        sampling_error = float(np.linalg.norm(self.directions @ bulge))
        point, leaf = touching(grid, points.place, points.leaf)
        weight = (points.weight / np.bincount(point))[point]
        along = np.stack([
            interpolation(grid, points.place[point], leaf, axis)[0].T @ weight
            for axis in range(grid.dimension)
        ])  # fmt: skip
        largest = float(np.linalg.norm(fields.displacement, axis=1).max())
        return Value(value, _scale(value, largest), self.directions @ along, sampling_error)


class _Stressed(Functional):
    """The mean stress of a place: a component, or the equivalent stress."""

    def __init__(self, quantity: Stress, ground: PosedBody) -> None:
        super().__init__(quantity.at, ground)
        self._component = component_of(quantity.component, ground.dimension)
        self.directions = np.ones((1, 1))

    def parts(self, grid: CompositeGrid) -> ExactCover | str:
        if self._component is None:
            return "the equivalent stress is no linear quantity, and only such are bounded"
        found = super().parts(grid)
        if not isinstance(found, str) and (found.side >= 0).any():
            return "no energy bounds the stress of a surface; ask for the mean of a box at it"
        return found

    def loads(self, grid: CompositeGrid, parts: ExactCover) -> list[LeafForces]:
        """Return the tractions on the sides of leaves whose work is their mean stress."""
        # By Gauss's theorem, those of the stress that a unit strain would cause.
        assert self._component is not None
        a, b = self._component
        law, d = moduli_at(grid.law, parts.leaf), grid.dimension
        stress = np.zeros((d, d, len(parts.leaf)))
        if a == b:
            stress[range(d), range(d)] = law.lateral
            stress[a, a] = law.stretch
        else:
            stress[a, b] = stress[b, a] = law.shear
        each = stress * parts.share / grid.length[parts.leaf]
        within = np.zeros(len(grid.leaves), dtype=np.bool_)
        within[parts.leaf] = True
        # Between two of one material and size the tractions would only cancel.
        other = grid.beside[parts.leaf].T
        alike = (other >= 0) & within[other]
        for column in (grid.leaves.kind, grid.leaves.size):
            alike &= column[other] == column[parts.leaf]
        side, row = np.nonzero(~alike)
        force = (2.0 * (side % 2) - 1.0)[:, None] * each[side // 2, :, row]
        return [LeafForces(parts.leaf[row], side, force)]

    def of(self, fields: CellFields) -> Value:
        balance = fields.balance
        points = self._points(balance.grid)
        stress = stress_at(fields, points.place, points.leaf)
        found, slope = self._measured(stress, balance.grid, points)
        value = np.array([points.weight @ found])
        largest = float(np.sqrt((fields.stress**2).sum(axis=(1, 2)).max()))
        row = _pulled(balance, points, points.weight[:, None, None] * slope)
        return Value(value, _scale(value, largest), row[None])

    def _measured(
        self, stress: Floats, grid: CompositeGrid, points: QuadraturePoints
    ) -> tuple[Floats, Floats]:
        """Return what is wanted of stress tensors, and its derivative by each of them."""
        if self._component is not None:
            a, b = self._component
            slope = np.zeros_like(stress)
            slope[:, a, b] = 1.0
            return stress[:, a, b], slope
        d, across = grid.dimension, np.zeros(len(stress))
        if grid.ground.scene.plane == "strain":
            _, lateral, shear = moduli_at(grid.law, points.leaf)
            across = lateral / (2 * (lateral + shear))
        trace = np.trace(stress, axis1=1, axis2=2)
        found = von_mises(stress, across * trace)
        pressure = (1.0 + across) * trace / 3.0
        own = stress - pressure[:, None, None] * np.eye(d)
        own = own + (across * (across * trace - pressure))[:, None, None] * np.eye(d)
        return found, 1.5 * own / np.maximum(found, 1e-300)[:, None, None]


class _Supported(Functional):
    """The force of a support on the body."""

    def __init__(self, quantity: Reaction, ground: PosedBody) -> None:
        names = [*ground.scene.lattice.sides, INSIDE]
        if quantity.side not in names:
            raise ParameterError(
                f"goal: there is no support {quantity.side!r}"
                f"{suggestion(quantity.side, names)}; there may be {', '.join(names)}"
            )
        self._name, self._side = quantity.side, names.index(quantity.side)
        self.directions = directions_of(quantity.along, ground.dimension)

    def coarse(self, grid: CompositeGrid) -> Flags:
        return np.zeros(len(grid.leaves), dtype=np.bool_)

    def parts(self, grid: CompositeGrid) -> str:
        return "the force of a support is not bounded yet"

    def loads(self, grid: CompositeGrid, parts: ExactCover) -> list[LeafForces]:
        return []

    def of(self, fields: CellFields) -> Value:
        """Return the reaction: the energy's derivative by the support's own displacement."""
        # The dual solution is how the body follows the support, moved against its axis.
        balance, grid = fields.balance, fields.balance.grid
        reactions = balance.reactions(fields.u)
        if self._name not in reactions:
            raise ParameterError(
                f"goal: nothing holds the body at {self._name!r}; supports are "
                f"{', '.join(reactions) or 'missing'}"
            )
        d = grid.dimension
        here = grid.support == self._side
        rows, held, walls = [], [], np.zeros((d, 2 * d + 1, d))
        for axis in range(d):
            mine = here & (grid.axis == axis)
            moved = (mine & (grid.state == FIXED)).astype(np.float64)
            walls[axis, self._side, axis] = -1.0
            strain = balance.strains @ moved + _wall_strain(balance, self._side, axis)
            rows.append(balance.strains.T @ balance.stress(strain) - mine * grid.spring)
            held.append(-moved)
        value = self.directions @ reactions[self._name]
        largest = max(float(np.linalg.norm(force)) for force in reactions.values())
        turned = np.tensordot(self.directions, walls, 1)
        scale = _scale(value, largest)
        return Value(value, scale, self.directions @ rows, 0.0, self.directions @ held, turned)


def functional_of(quantity: Quantity, ground: PosedBody) -> Functional:
    """Return a quantity of a body as a functional."""
    if isinstance(quantity, Deflection):
        return _Displaced(quantity, ground)
    if isinstance(quantity, Stress):
        return _Stressed(quantity, ground)
    return _Supported(quantity, ground)


def unit_of(quantity: Quantity, scales: Scales) -> float:
    """Return the unit of a quantity's scaled value: m, Pa or N."""
    units = {Deflection: scales.displacement, Stress: scales.stress, Reaction: scales.force}
    return units[type(quantity)]


def plain(value: Floats) -> float | Floats:
    """Return a single component as a number."""
    return value if len(value) > 1 else float(value[0])


def _scale(value: Floats, largest: float) -> float:
    return max(float(np.linalg.norm(value)), NEGLIGIBLE * largest)


def _bulge(fields: CellFields, points: QuadraturePoints, middle: Floats) -> Floats:
    """Return by how much the mean over each spot's part differs from its middle, roughly."""
    # The displacement in the middle is that of a face, which stands for a point as well as for a
    # mean: half-way between them lies h²u″/48 for every axis. The slopes at an agent's edges, taken
    # from its middle on, give six times as much at the quarters.
    total = np.zeros_like(middle)
    if not points.span.any():
        return total
    for axis, end in product(range(middle.shape[1]), (-0.25, 0.25)):
        place = points.place.copy()
        place[:, axis] += end * points.span[:, axis]
        total += displacement_at(fields, place, points.leaf) - middle
    return total / 12.0


def _pulled(balance: Equilibrium, points: QuadraturePoints, weight: Floats) -> Floats:
    """Return the derivative by the faces of stresses that are weighted and added up."""
    grid, d = balance.grid, balance.grid.dimension
    n, kind = len(grid.leaves), grid.leaves.kind
    point, leaf = touching(grid, points.place, points.leaf)
    alike = kind[leaf] == kind[points.leaf[point]]
    point, leaf = point[alike], leaf[alike]
    part = weight[point] / np.bincount(point)[point, None, None]
    normal: Floats = np.stack([np.bincount(leaf, part[:, a, a], n) for a in range(d)])
    pulls = [normal_stress(grid.law, normal).ravel()]
    for (a, b), edges in grid.edges.items():
        shear = part[:, a, b] + part[:, b, a]
        around = edges.of_leaf[leaf].reshape(len(leaf), -1)
        share = np.repeat(shear / around.shape[1], around.shape[1])
        pulls.append(edges.modulus * np.bincount(around.ravel(), share, len(edges.modulus)))
    return np.asarray(balance.strains.T @ np.concatenate(pulls))


def _wall_strain(balance: Equilibrium, side: int, axis: int) -> Floats:
    """Return the strains if what lies beyond a side moved along an axis by 1."""
    grid = balance.grid
    parts = [np.zeros(len(grid.leaves) * grid.dimension)]
    for pair, edges in grid.edges.items():
        strain = np.zeros(len(edges.modulus))
        for a, gradient in zip(pair, edges.gradients, strict=True):
            if a == axis:
                strain += np.where(gradient.wall == side, gradient.pull, 0.0)
        parts.append(np.where(edges.modulus > 0, strain, 0.0))
    return np.concatenate(parts)
