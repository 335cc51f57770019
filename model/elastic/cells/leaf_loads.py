"""Forces on cells of many sizes as loads of faces; for equal cells see `model.elastic.cell_loads`.

Couples load the gradients of the displacement at edges. These are exact for rotations of the whole
body whatever the sizes of the cells, so that no moment is lost.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import oriented
from kaju.model.elastic.problem import ACTIVE
from kaju.model.elastic.staggered import Pair
from kaju.model.scene.cell_types import AIR, DISPLACED, FOUNDATION, RIGID, ROLLER

ROUNDING = 1e-9


class FaceLoads(NamedTuple):
    """The scene's loads on a composite grid; scaled."""

    face: Floats  # External force on every face; shape (faces,)
    # Force on walls directly: the sides of the array, then rigid cells inside it; shape
    # (2·dimension + 1, dimension)
    wall: Floats
    surface_shear: dict[Pair, Floats]  # Tangential traction at edges; shape (edges,)


def face_loads(grid: CompositeGrid) -> FaceLoads:
    """Return the scene's loads on the faces of a grid."""
    entering = _Entering(grid)
    forces = grid.ground.forces(grid.leaves)
    leaf, direction = forces.leaf, forces.direction
    for axis in range(grid.dimension):
        value = forces.force[:, axis]
        middle = (direction < 0) & (value != 0)
        normal = (direction >= 0) & (direction // 2 == axis) & (value != 0)
        along = (value != 0) & ~middle & ~normal
        for end in (0, 1):
            entering.push(leaf[middle], 2 * axis + end, 0.5 * value[middle])
        entering.push(leaf[normal], direction[normal], value[normal])
        for side in np.unique(direction[along]):
            here = along & (direction == side)
            entering.drag(axis, int(side), leaf[here], value[here])
    uneven = forces.uneven or Portions.none(grid.dimension)
    for side in np.unique(uneven.side):
        here = uneven.side == side
        entering.turn(int(side), uneven.box[here], uneven.moment[here])
    return entering.loads()


class _Dragged(NamedTuple):
    """Leaves with tangential forces, or couples, on a side."""

    axis: int  # axis, normal: Axis of the forces, and normal of the side
    normal: int
    upper: int  # Whether it is the upper one of the two sides
    leaf: Ints  # Shape (n,)
    # Couples of the forces about the leaves' middles, positive from `normal` to `axis`; shape (n,)
    moment: Floats
    # outer, inner: Edges of the side, and of the opposite one, at the lower and upper end along
    # `axis`; shape (2, n)
    outer: Ints
    inner: Ints

    @property
    def opposite(self) -> int:
        """Side of the leaves across from the dragged one."""
        return 2 * self.normal + 1 - self.upper

    def only(self, some: Flags) -> _Dragged:
        """Return some of the leaves."""
        return self._replace(
            leaf=self.leaf[some],
            moment=self.moment[some],
            outer=self.outer[:, some],
            inner=self.inner[:, some],
        )


class _Entering:
    """Sums of forces on sides of leaves, and of couples at edges."""

    def __init__(self, grid: CompositeGrid) -> None:
        self.grid = grid
        d = grid.dimension
        self._share = np.zeros(len(grid.leaves) * 2 * d)
        self._wall = np.zeros((2 * d + 1, d))
        self._turn = {p: np.zeros((2, len(e.modulus))) for p, e in grid.edges.items()}
        self._shear = {p: np.zeros(len(e.modulus)) for p, e in grid.edges.items()}

    def loads(self) -> FaceLoads:
        """Return the sums as loads of faces."""
        force = self.grid.mean.T @ self._share
        for pair, edges in self.grid.edges.items():
            for gradient, weight in zip(edges.gradients, self._turn[pair], strict=True):
                if weight.any():
                    force = force + gradient.matrix.T @ weight
        return FaceLoads(np.asarray(force), self._wall, self._shear)

    def push(self, leaf: Ints, side: Ints | int, value: Floats) -> None:
        """Enter forces normal to sides of leaves."""
        np.add.at(self._share, leaf * 2 * self.grid.dimension + side, value)

    def drag(self, axis: int, side: int, leaf: Ints, value: Floats) -> None:
        """Enter forces along `axis` by the side `side`, which is normal to another axis."""
        # The loaded faces lie half a leaf below the side, so a couple comes with the force.
        normal, upper = divmod(side, 2)
        kind = self.grid.kinds[leaf, side]
        held, inside = _holds(kind), kind >= 0
        for end in (0, 1):
            self.push(leaf, 2 * axis + end, np.where(held, 0.0, 0.5) * value)
        self._into_wall(leaf[held], side, axis, value[held])
        moment = (upper - 0.5) * self.grid.length[leaf] * value
        dragged = self._dragged(axis, normal, upper, leaf, moment)
        for edge in dragged.outer:
            self._slope(dragged, edge, np.where(inside, 0.5 * moment, 0.0))
        # Frictionless supports take no shear, like a free surface: the body carries all of it.
        self._drag_surface(dragged.only(np.isin(kind, (AIR, ROLLER, FOUNDATION))))

    def turn(self, side: int, leaf: Ints, moment: Floats) -> None:
        """Enter the first moments, shape (n, d, d), of forces on a side of leaves."""
        normal, upper = divmod(side, 2)
        axes = [axis for axis in range(self.grid.dimension) if axis != normal]
        for axis in axes:
            dragged = self._dragged(axis, normal, upper, leaf, -moment[:, normal, axis])
            free = [self._free(dragged, edge, normal) for edge in dragged.outer]
            for edge, runs_on in zip(dragged.outer, free, strict=True):
                self._tilt(dragged, edge, np.where(runs_on, -0.5 * dragged.moment, 0.0))
            self._make_up_at_ends(dragged, (2 - np.sum(free, axis=0)) * 0.5 * dragged.moment, free)
        for first, second in combinations(axes, 2):
            twist = 0.5 * (moment[:, first, second] - moment[:, second, first])
            for end in (0, 1):
                self._make_up(self._dragged(first, second, end, leaf, twist))

    def _dragged(self, axis: int, normal: int, upper: int, leaf: Ints, moment: Floats) -> _Dragged:
        table = oriented(self.grid.edges[_pair(axis, normal)], axis < normal)[1][leaf]
        ends = table[:, :, upper].T, table[:, :, 1 - upper].T
        return _Dragged(axis, normal, upper, leaf, moment, *ends)

    def _make_up_at_ends(self, dragged: _Dragged, lost: Floats, running: list[Flags]) -> None:
        """Enter couples missing where a surface ends; those that do not fit load the surface."""
        ended = lost != 0.0
        remaining = self._make_up(dragged.only(ended)._replace(moment=lost[ended]))
        for edge, runs_on in zip(dragged.outer, running, strict=True):
            self._tilt(dragged, edge[ended], np.where(runs_on[ended], -remaining, 0.0))

    def _drag_surface(self, dragged: _Dragged) -> None:
        """Add the traction of a free surface, and the load -moment·∂u_n/∂s along it."""
        axis, normal, upper, leaf, moment, outer, _ = dragged
        length = self.grid.length[leaf]
        stress = moment / length**self.grid.dimension
        lost, running = np.zeros_like(moment), []
        for end, edge in enumerate(outer):
            np.add.at(self._shear[_pair(axis, normal)], edge, stress)
            runs_on = self._free(dragged, edge, normal)
            walled = ~runs_on & _holds(self.grid.kinds[leaf, 2 * axis + end])
            self._tilt(dragged, edge, np.where(runs_on, -0.5 * moment, 0.0))
            pull = np.where(walled, (2 * end - 1) * moment / length, 0.0)
            self.push(leaf, 2 * normal + upper, pull)
            self._into_wall(leaf, 2 * axis + end, normal, -pull)
            lost += np.where(runs_on | walled, 0.0, 0.5 * moment)
            running.append(runs_on)
            # The force on the wall acts half a leaf from it: one more couple.
            held = dragged.only(walled)
            both = self._two_sided(held, held.inner[end], axis)
            there = both | _holds(self.grid.kinds[held.leaf, held.opposite])
            self._lift(held, held.inner[end], np.where(there, -0.5 * held.moment, 0.0))
        self._make_up_at_ends(dragged, lost, running)

    def _make_up(self, dragged: _Dragged) -> Floats:
        """Enter couples at the opposite side; return those that do not fit."""
        axis, normal, moment = dragged.axis, dragged.normal, dragged.moment
        turns = np.stack(
            [self._free(dragged, e, axis) & self._free(dragged, e, normal) for e in dragged.inner]
        )
        kind = self.grid.kinds[dragged.leaf, dragged.opposite]
        lifts = ~turns.any(axis=0) & (_holds(kind) | (kind >= 0))
        for edge, turn in zip(dragged.inner, turns, strict=True):
            share = turn / np.maximum(2 * turns.sum(axis=0), 1) * moment
            self._slope(dragged, edge, share)
            self._tilt(dragged, edge, -share)
            self._lift(dragged, edge, np.where(lifts, 0.5 * moment, 0.0))
        return np.where(lifts | turns.any(axis=0), 0.0, moment)

    def _lift(self, dragged: _Dragged, edge: Ints, weight: Floats) -> None:
        """Load ∂u/∂n at edges of the opposite side, beyond which a wall may lie."""
        self._slope(dragged, edge, weight)
        side = dragged.opposite
        held = _holds(self.grid.kinds[dragged.leaf, side])
        pull = np.where(held, self._sums(dragged, edge, dragged.axis)[0] * weight, 0.0)
        self._into_wall(dragged.leaf, side, dragged.axis, -pull)

    def _slope(self, dragged: _Dragged, edge: Ints, weight: Floats) -> None:
        """Load ∂u/∂n, u along the forces, with couples at edges."""
        turn = self._turn[_pair(dragged.axis, dragged.normal)]
        np.add.at(turn[int(dragged.axis > dragged.normal)], edge, weight)

    def _tilt(self, dragged: _Dragged, edge: Ints, weight: Floats) -> None:
        """Load ∂u_n/∂s, along the surface, with couples at edges."""
        turn = self._turn[_pair(dragged.axis, dragged.normal)]
        np.add.at(turn[int(dragged.axis < dragged.normal)], edge, weight)

    def _rows(self, dragged: _Dragged, edge: Ints, component: int) -> sp.csr_array:
        """Return the gradient of one component at edges."""
        pair = _pair(dragged.axis, dragged.normal)
        return sp.csr_array(self.grid.edges[pair].gradients[pair.index(component)].matrix[edge])

    def _sums(self, dragged: _Dragged, edge: Ints, component: int) -> tuple[Floats, Floats]:
        """Return the sums of a gradient's weights (0 if two-sided), and of their sizes."""
        rows = self._rows(dragged, edge, component)
        return np.asarray(rows.sum(axis=1)), np.asarray(abs(rows).sum(axis=1))

    def _two_sided(self, dragged: _Dragged, edge: Ints, component: int) -> Flags:
        """Tell at which edges a component has faces on both sides."""
        sums, size = self._sums(dragged, edge, component)
        return np.asarray((size > 0) & (np.abs(sums) < ROUNDING * size))

    def _free(self, dragged: _Dragged, edge: Ints, component: int) -> Flags:
        """Tell at which edges a component has faces on both sides that are free to move."""
        held = abs(self._rows(dragged, edge, component)) @ (self.grid.state != ACTIVE)
        return np.asarray(self._two_sided(dragged, edge, component) & (held == 0))

    def _into_wall(self, leaf: Ints, side: int, axis: int, value: Floats) -> None:
        """Add forces along an axis to the wall beyond a side of leaves."""
        wall = np.where(self.grid.outer[leaf, side], side, 2 * self.grid.dimension)
        np.add.at(self._wall[:, axis], wall, value)


def _pair(first: int, second: int) -> Pair:
    return min(first, second), max(first, second)


def _holds(kind: Ints) -> Flags:
    return np.isin(kind, (RIGID, DISPLACED))
