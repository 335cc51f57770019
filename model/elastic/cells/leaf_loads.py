"""Forces on cells of many sizes as loads of faces, and stencils of these for equal cells.

A force *along* a free surface is a shear stress τ on the surface. The face that it drags lies half
a cell below, so that it reaches the surface as a couple: u(surface) = u(below) + (h/2)(γ − ∂u_n/∂s)
with γ given. Couples load the gradients of the displacement at edges. These are exact for rotations
of the whole body whatever the sizes of the cells, so that no moment is lost.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import oriented
from kaju.model.elastic.equal.problem import ACTIVE
from kaju.model.elastic.equal.staggered import Pair
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene.cell_types import AIR, DISPLACED, FOUNDATION, RIGID, ROLLER

ROUNDING = 1e-9
KEPT = 32  # Sets of stencils that are kept: of bodies like those that were loaded before
WIDE = 4  # Neighbourhoods begin so far apart


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


@lru_cache(maxsize=KEPT)
def stencils(
    kinds: bytes, dimension: int, side: int, units: tuple[int, ...]
) -> tuple[Floats, dict[Pair, Floats]]:
    """Return what unit loads on a side of equal cells put on the faces and edges near each."""
    # `kinds` are those of the 3^d cells round each one, 0 for body. Unit loads are a force along
    # every axis, then a moment of every component along every axis. Of faces the shape is (axis,
    # places along each axis, neighbourhoods, units), of edges (2, 2, neighbourhoods, units).
    body = _Neighbourhoods(np.frombuffer(kinds, dtype=np.int8).reshape(-1, *[3] * dimension))
    grid, many = CompositeGrid(body, body.leaves), (len(body.middle), len(units))
    leaf = grid.leaves.find(body.middle)
    place = np.floor(grid.place).astype(np.int64) - 1
    number, place[:, 0] = np.divmod(place[:, 0], WIDE)
    faces = np.zeros((dimension, *[WIDE] * dimension, *many))
    shears = {pair: np.zeros((2, 2, *many)) for pair in grid.edges}
    for column, unit in enumerate(units):
        entering = _Entering(grid)
        if unit < dimension:
            entering.drag(unit, side, leaf, np.ones(len(leaf)))
        else:
            moment = np.zeros((len(leaf), dimension**2))
            moment[:, unit - dimension] = 1.0
            entering.turn(side, leaf, moment.reshape(-1, dimension, dimension))
        found = entering.loads()
        faces[(grid.axis, *place.T, number, column)] = found.face
        for some, wall, axis, value in entering.borne:  # in halves by the ghost's faces
            ghost, at = np.ones(dimension, dtype=np.int64), (grid.leaves.lower[some, 0] - 1) // WIDE
            ghost[wall // 2] += 2 * (wall % 2) - 1
            for end in (0, 1):
                ghost[axis] += end
                np.add.at(faces, (axis, *ghost, at, column), 0.5 * value)
        for pair, shear in found.surface_shear.items():
            shears[pair][..., column] = np.moveaxis(shear[grid.edges[pair].of_leaf[leaf]], 0, -1)
    return faces, shears


class _Neighbourhoods(PosedBody):
    """Equal cells with the 3^d cells round each, side by side along the first axis, in air."""

    def __init__(self, around: NDArray[np.int8]) -> None:
        self.dimension, self.cell = around.ndim - 1, 1
        self.moduli = Moduli(np.ones(1), np.zeros(1), np.ones(1))
        cells = np.full((len(around) + 1, WIDE, *[5] * (self.dimension - 1)), AIR)
        cells[(slice(-1), slice(1, None), *[slice(1, 4)] * (self.dimension - 1))] = around
        self._cells = cells.reshape(-1, *cells.shape[2:])
        self.extent = np.array(self._cells.shape)
        self.middle = np.full((len(around), self.dimension), 2)
        self.middle[:, 0] += WIDE * np.arange(len(around))

    @property
    def leaves(self) -> LeafCells:
        """The cells of body."""
        lower = np.argwhere(self._cells == 0)
        zeros = np.zeros(len(lower), dtype=np.int64)
        return LeafCells.of(lower, zeros + 1, zeros, zeros, zeros.astype(np.float64))

    def kinds_at(self, points: Ints) -> Ints:
        return np.asarray(self._cells[tuple(points.T)])

    def given(self, side: int) -> Floats:
        return np.zeros(self.dimension)

    def foundation(self, side: int) -> float:
        return 0.0


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
        self.borne: list[tuple[Ints, int, int, Floats]] = []
        """Forces on walls: leaves and the side beyond which these are, axis, and values."""
        self._turn = {p: np.zeros((2, len(e.modulus))) for p, e in grid.edges.items()}
        self._shear = {p: np.zeros(len(e.modulus)) for p, e in grid.edges.items()}

    def loads(self) -> FaceLoads:
        """Return the sums as loads of faces."""
        force = self.grid.mean.T @ self._share
        for pair, edges in self.grid.edges.items():
            for gradient, weight in zip(edges.gradients, self._turn[pair], strict=True):
                if weight.any():
                    force = force + gradient.matrix.T @ weight
        d = self.grid.dimension
        wall = np.zeros((2 * d + 1, d))
        for leaf, side, axis, value in self.borne:
            np.add.at(wall[:, axis], np.where(self.grid.outer[leaf, side], side, 2 * d), value)
        return FaceLoads(np.asarray(force), wall, self._shear)

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
        self.borne.append((leaf[held], side, axis, value[held]))
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
            self.borne.append((leaf, 2 * axis + end, normal, -pull))
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
        self.borne.append((dragged.leaf, side, dragged.axis, -pull))

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


def _pair(first: int, second: int) -> Pair:
    return min(first, second), max(first, second)


def _holds(kind: Ints) -> Flags:
    return np.isin(kind, (RIGID, DISPLACED))
