"""Strains, stresses and displacements on a composite grid: of its cells, and at points; scaled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import (
    defined_slopes,
    nearest_defined,
    oriented,
    slope_weights,
)
from kaju.model.elastic.equal.fields import SURFACE_SHARE, between_corners
from kaju.model.elastic.equal.staggered import Pair
from kaju.model.elastic.moduli import normal_stress
from kaju.model.scene.cell_types import DISPLACED, RIGID

NEAR = 1e-6  # Points nearer to a face than this share of a cell lie on it


@dataclass(frozen=True, eq=False)
class CellFields:
    """Fields that follow from the displacements of the faces."""

    balance: Equilibrium
    u: Floats  # Displacements of the faces. Shape (faces,)

    @cached_property
    def stretch(self) -> Floats:
        """Normal strains of the agents, shape (dimension, agents)."""
        d, n = self.balance.grid.dimension, len(self.balance.grid.leaves)
        return np.asarray((self.balance.strains[: n * d] @ self.u).reshape(d, n))

    @cached_property
    def normal_stress(self) -> Floats:
        """Normal stresses of the agents, shape (dimension, agents)."""
        return normal_stress(self.balance.grid.law, self.stretch)

    @cached_property
    def edge_shear(self) -> dict[Pair, Floats]:
        """Shear stresses of the edges, with the tractions on loaded surfaces."""
        return {
            pair: edges.modulus * sum(self.slopes[pair]) + self.balance.entered.surface_shear[pair]
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


def displacement_at(fields: CellFields, points: Floats, leaf: Ints) -> Floats:
    """Return displacements at points (units), shape (n, dimension)."""
    # Along its axis a displacement is linear between the leaf's two sides, across it linear with
    # the slope at the nearest edge. On a wall it is the wall's. At a point on several leaves, of
    # which `leaf` is one, it is the mean of theirs.
    grid = fields.balance.grid
    point, leaf = touching(grid, points, leaf)
    walls = walls_beside(grid, leaf)
    local = (points[point] - grid.leaves.lower[leaf]) / grid.leaves.size[leaf, None]
    touched = np.abs(np.stack([local, 1.0 - local], axis=2).reshape(walls.shape[:2])) < NEAR
    on_wall = (touched & ~np.isnan(walls[..., 0])).any(axis=1)
    # Leaves round the corner of a wall have no side on it: those that have one count alone.
    counts = on_wall | ~np.isin(point, point[on_wall])
    point, leaf, local, walls = point[counts], leaf[counts], local[counts], walls[counts]
    columns = [component(fields, leaf, local, walls, axis) for axis in range(grid.dimension)]
    return means(point, np.stack(columns, axis=1))


def component(fields: CellFields, leaf: Ints, local: Floats, walls: Floats, axis: int) -> Floats:
    """Return u_axis in leaves at local coordinates, 0 to 1 along each axis."""
    grid, every = fields.balance.grid, np.arange(len(leaf))
    low, high = (fields.sides[leaf, 2 * axis + end] for end in (0, 1))
    value = np.asarray((1.0 - local[:, axis]) * low + local[:, axis] * high)
    others = [a for a in range(grid.dimension) if a != axis]
    # Displacement of the wall on the nearer side across each other axis, NaN without one.
    wall = {a: walls[every, 2 * a + (local[:, a] > 0.5), axis] for a in others}
    for across, end in product(others, (0, 1)):
        unheld = np.isnan(wall[across]) & np.isnan(walls[:, 2 * axis + end, axis])
        along = local[:, axis] if end else 1.0 - local[:, axis]
        some = np.flatnonzero(unheld & (local[:, across] != 0.5) & (along != 0.0))
        distance = (local[some, across] - 0.5) * grid.length[leaf[some]]
        slope = _slope(fields, leaf[some], axis, across, end, (distance > 0).astype(np.int64))
        value[some] += along[some] * distance * slope
    for across, given in wall.items():
        held = np.flatnonzero(~np.isnan(given))
        # Linear from the wall, where the distance is 0, to the middle of the leaf, where it is 1.
        distance = 1.0 - np.abs(2.0 * local[held, across] - 1.0)
        value[held] = given[held] + distance * (value[held] - given[held])
    return value


def corner_values(fields: CellFields) -> Floats:
    """Return displacements at the leaves' corners (`corner_ends`), shape (2^d, d, leaves)."""
    grid, d = fields.balance.grid, fields.balance.grid.dimension
    # Where the slopes at a corner are plain they are summed in arrays, elsewhere one by one.
    held, slopes = np.zeros(len(grid.leaves), dtype=np.bool_), {}
    for side in range(2 * d):
        held |= np.isin(grid.kinds[:, side], (RIGID, DISPLACED))
    for pair, edges in grid.edges.items():
        for axis, across, first in ((*pair, True), (*pair[::-1], False)):
            gradients, table = oriented(edges, first)
            own, single = fields.slopes[pair][not first], gradients[0].one_sided
            unusual = ~gradients[0].valid | (gradients[0].jump & (edges.modulus > 0))
            slopes[axis, across] = single * own, unusual, table
    ends, walls = corner_ends(d), walls_beside(grid, np.arange(len(held)))
    found = np.empty((len(ends), d, len(grid.leaves)))
    for values, end in zip(found, ends, strict=True):
        for axis, value in enumerate(values):
            value[:], irregular = fields.sides[:, 2 * axis + end[axis]], held.copy()
            for across in (a for a in range(d) if a != axis):
                slope, unusual, table = slopes[axis, across]
                edge = table[:, end[axis], end[across]]
                value += (end[across] - 0.5) * grid.length * slope[edge]
                irregular |= unusual[edge]
            some = np.flatnonzero(irregular)
            local = np.broadcast_to(end.astype(np.float64), (len(some), d))
            value[some] = component(fields, some, local, walls[some], axis)
    return found


def _slope(fields: CellFields, leaf: Ints, axis: int, across: int, end: int, near: Ints) -> Floats:
    """Return ∂u_axis/∂across in leaves, at an end along `axis`, on the near side across it."""
    # At a free surface ∂u_t/∂n follows from the given shear stress and ∂u_n/∂t. The edge on the
    # inner side has another slope; from the leaf's middle to the surface the two are weighted.
    grid, pair = fields.balance.grid, (min(axis, across), max(axis, across))
    edges, first = grid.edges[pair], axis < across
    gradients, table = oriented(edges, first)
    own, other = fields.slopes[pair] if first else fields.slopes[pair][::-1]
    shear = grid.ground.moduli.shear[grid.leaves.kind[leaf]]

    def at(edge: Ints, some: Ints | slice) -> Floats:
        weights = slope_weights(edges, gradients, edge, shear[some])
        return np.asarray(weights[0] * own[edge] + weights[1] * other[edge])

    edge = nearest_defined(gradients, table[leaf], end, near)
    slope = at(edge, slice(None))
    free = np.flatnonzero(gradients[1].valid[edge] & ~gradients[0].valid[edge])
    slope[free] += fields.balance.entered.surface_shear[pair][edge[free]] / shear[free]
    inner = table[leaf[free], end, 1 - near[free]]
    both = (edge[free] == table[leaf[free], end, near[free]]) & gradients[0].valid[inner]
    both &= defined_slopes(gradients, inner)
    free, below = free[both], at(inner[both], free[both])
    slope[free] = SURFACE_SHARE * slope[free] + (1.0 - SURFACE_SHARE) * below
    return slope


def stress_at(fields: CellFields, points: Floats, leaf: Ints) -> Floats:
    """Return stress tensors at points (units), shape (n, dimension, dimension)."""
    # Normal stresses are linear with the mean differences to neighbours of the same material, shear
    # stresses bilinear between the leaf's edges. At a point on several leaves of one material the
    # stress is the mean of theirs.
    grid, d = fields.balance.grid, fields.balance.grid.dimension
    point, leaf = touching_alike(grid, points, leaf)
    local = (points[point] - grid.leaves.lower[leaf]) / grid.leaves.size[leaf, None]
    tensor = np.zeros((len(leaf), d, d))
    for a in range(d):
        tensor[:, a, a] = _along_slopes(grid, fields.normal_stress[a], leaf, local)
    for (a, b), shear in fields.edge_shear.items():
        around = np.moveaxis(shear[grid.edges[a, b].of_leaf[leaf]], 0, -1)
        tensor[:, a, b] = tensor[:, b, a] = between_corners(around, local[:, a], local[:, b])
    return means(point, tensor)


def _along_slopes(grid: CompositeGrid, value: Floats, leaf: Ints, local: Floats) -> Floats:
    """Return values of leaves at local coordinates, linear with the differences to neighbours."""
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


def touching(grid: CompositeGrid, points: Floats, leaf: Ints) -> tuple[Ints, Ints]:
    """Return all pairs of a point (units) and a leaf that it lies in or on, sorted."""
    # `leaf` is one for each point. Others are found in the unit cells diagonally beside the point.
    reach = NEAR * grid.ground.cell
    offset = points - grid.leaves.lower[leaf]
    inner = (offset > reach) & (offset < grid.leaves.size[leaf, None] - reach)
    on_face = np.flatnonzero(~inner.all(axis=1))
    point, touched = [np.arange(len(leaf))], [leaf]
    for diagonal in product((-1, 1), repeat=grid.dimension):
        cells = np.floor(points[on_face] + reach * np.array(diagonal)).astype(np.int64)
        found = grid.leaves.find(cells)
        point.append(on_face[found >= 0])
        touched.append(found[found >= 0])
    pairs = np.unique(np.concatenate(point) * len(grid.leaves) + np.concatenate(touched))
    return np.divmod(pairs, len(grid.leaves))


def touching_alike(grid: CompositeGrid, points: Floats, leaf: Ints) -> tuple[Ints, Ints]:
    """Return those of the pairs (`touching`) whose leaf is of the same material as `leaf`."""
    point, touched = touching(grid, points, leaf)
    alike = grid.leaves.kind[touched] == grid.leaves.kind[leaf[point]]
    return point[alike], touched[alike]


def means(point: Ints, values: Floats) -> Floats:
    """Return the mean of the values of each point; the points are sorted."""
    if not len(point):
        return values
    first = np.flatnonzero(np.append(True, point[1:] != point[:-1]))
    count = np.diff(np.append(first, len(point)))
    total = np.add.reduceat(values, first, axis=0)
    return np.asarray(total / count.reshape(-1, *(1 for _ in values.shape[1:])))


def walls_beside(grid: CompositeGrid, leaf: Ints) -> Floats:
    """Return the displacement of rigid walls, shape (leaf, side, component); NaN without one."""
    d = grid.dimension
    given = np.full((len(leaf), 2 * d, d), np.nan)
    for side in range(2 * d):
        kind = grid.kinds[leaf, side]
        held = (kind == RIGID) | (kind == DISPLACED)
        moved = (kind[held] == DISPLACED) & grid.outer[leaf[held], side]
        given[held, side] = np.where(moved[:, None], grid.ground.given(side), 0.0)
    return given
