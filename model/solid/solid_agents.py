"""Solids with true outlines, solved: cells count by the share of them that is body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import permutations, product
from math import sqrt
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import Grid, problem_of_scene
from kaju.model.elastic.equal.staggered import axis_pairs, edge_modulus, padded
from kaju.model.elastic.equal.supports import check_supports, slender_cell
from kaju.model.scene import AppliedLoads, Body, Scene
from kaju.model.scene.cell_types import NOT_BODY
from kaju.model.scene.pictures import check_size
from kaju.model.scene.shapes import Points, Shape

SLIVER = 1e-4  # cells of which less is body are taken as empty
STRAIGHT = 0.02  # by which shares may differ along the normal of a side that outlines meet
EMPTY, CUT, WHOLE = 0, 1, 2
PARTS = 4  # parts of a cut cell along every axis, on whose tetrahedra the level is taken as linear
_PATHS = np.array(
    [
        np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(way)]], 0)
        for way in permutations(range(3))
    ]
)
"""Corners of the six tetrahedra of a cube: all the ways along its edges to the opposite corner."""


@dataclass(eq=False)
class SolidAgents(CellAgents):
    """Agents of one size, whole or cut by outlines."""

    storage: ClassVar[Literal["cells", "solid"]] = "solid"
    no_bound: ClassVar[str] = "in space there are no bounds within true outlines"

    def _posed(self) -> Grid:
        """Return the grid of a stored answer."""
        posed, self.factor = grid_of_solid(self.scene, self.division)
        return posed


def grid_of_solid(scene: Scene, resolution: int) -> tuple[Grid, Floats]:
    """Return the cells of a solid, and what share of each is body, 1 beyond it."""
    adds = [region.material not in NOT_BODY for region in scene.body.regions]
    shapes = [*zip(scene.region_shapes, adds, strict=True)]
    shape = tuple(resolution * count for count in scene.lattice.shape)
    edge, filled = scene.lattice.cell_size / resolution, scene.body.material not in NOT_BODY
    solid = SolidBody(shape, edge, filled, shapes)
    check_size(solid.shape, "resolution")
    sorts = solid.cells()
    eighths = solid.shares(sorts)
    share = reduce(_pairwise, range(3), eighths)
    body = thick(share >= SLIVER)
    if not body.any():
        raise SceneError(
            f"body.regions: nothing of the body is two cells of {solid.edge:.3g} m thick; give a "
            "larger resolution"
        )
    # The same scene of the cells that are body: held and loaded as it is.
    (material,) = scene.cell_materials
    cells = Body(array=body.astype(np.int16), cell_size=solid.edge)
    grid = scene.replace(body=cells, legend={"0": "air", "1": material.name})
    like, origin = problem_of_scene(grid)
    left_out = 1.0 - float(share[body].sum() / share.sum())
    # More than 5 % are refused, and more than 0.01 % noted.
    if left_out > 0.05 or slender_cell(like) is not None:
        raise SceneError(
            f"body.regions: {left_out:.0%} of the body, or what joins its parts, is thinner than "
            f"two cells of {solid.edge:.3g} m, which carry no shear; give a larger resolution"
        )
    loads = _loads(grid, eighths)
    check_supports(like, origin)
    share = np.where(body, share, 1.0)
    problem, _ = problem_of_scene(grid, None, share, loads)
    box = tuple(slice(2 * a, 2 * (a + n)) for a, n in zip(origin, problem.shape, strict=True))
    edges = {
        pair: edge_modulus(like, pair)
        * np.pad(np.maximum(edge_shares(eighths[box], pair), SLIVER), 1)
        for pair in axis_pairs(3)
    }
    notes = (f"{left_out:.1g} of the body is too thin for the cells, and left out",)
    problem = replace(problem, edges=edges)
    return Grid(grid, problem, origin, resolution, notes if left_out > 1e-4 else ()), share


def _loads(grid: Scene, eighths: Floats) -> AppliedLoads:
    """Return the loads, each force spread over what share of the cells' faces is body."""
    found = []
    for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
        axis, upper = divmod(grid.lattice.sides.index(str(load.side)), 2)
        outer, inner = np.moveaxis(eighths, axis, 0)[[-1, -2] if upper else [0, 1]]
        share = _pairwise(_pairwise(outer, 0), 1)
        beside = tuple(np.delete(chosen.cells, axis, 1).T)
        other = np.array(share)
        other[beside] -= 1.0
        # What lies along the side, or a pressure on a part of a face, would be a guess.
        wrong = np.abs(outer - inner).reshape(len(share), 2, -1, 2).max(axis=(1, 3)) > STRAIGHT
        wrong |= (load.force is None) & (other != 0.0)
        if wrong.any():
            row = np.argwhere(wrong)[0].tolist()
            row.insert(axis, (grid.lattice.shape[axis] - 1) * upper)
            raise SceneError(
                f"loads.{number}: an outline meets the side it acts on, at cell {row}; load a side "
                "that none meets (by a force one that it meets at a right angle), or take outline "
                '= "cells" for the regions that do'
            )
        own = share[beside]
        force = chosen.forces(load, grid.lattice, 1.0)
        if load.force is not None:
            force = np.outer(own / own.sum(), force.sum(axis=0))
        found.append((chosen.cells, chosen.direction, force))
    if not found:  # sides are moved
        return grid.applied()
    cells, direction, force = (np.concatenate(one) for one in zip(*found, strict=True))
    return AppliedLoads(cells, direction, force)


class SolidBody(NamedTuple):
    """A body in space: what fills an array of cubes, and shapes that cover it one after another."""

    shape: tuple[int, ...]
    edge: float  # Of a cell (m)
    filled: bool  # Whether the array is body where no shape covers it
    shapes: list[tuple[Shape, bool]]  # Each with whether it is body

    def cells(self) -> NDArray[np.int8]:
        """Return of all cells whether they are surely WHOLE, or EMPTY; all others are CUT."""
        found = np.full(self.shape, WHOLE if self.filled else EMPTY, dtype=np.int8)
        for part in _parts(np.argwhere(np.ones(self.shape, dtype=np.bool_))):
            at, low = tuple(part.T), np.asarray(part * self.edge, dtype=np.float64)
            for shape, body in self.shapes:
                own, before = WHOLE if body else EMPTY, found[at]
                inside, apart = shape.relation(low, low + self.edge)
                crossed = np.where(before == own, own, CUT)
                found[at] = np.where(inside, own, np.where(apart, before, crossed))
        return found

    @property
    def reach(self) -> float:
        """How far (m) levels are told: the diagonal of a part of a cut cell."""
        return sqrt(3.0) * self.edge / PARTS

    def level(self, points: Points) -> Floats:
        """Return about how far points lie outside of the body (m), below 0 within."""
        found = np.full(len(points), -np.inf if self.filled else np.inf)
        for shape, body in self.shapes:
            own = shape.level(points, self.reach)
            found = np.minimum(found, own) if body else np.maximum(found, -own)
        return found

    def shares(self, sorts: NDArray[np.int8]) -> Floats:
        """Return what share of the eighths of every cell is body: an array of cells half as large.

        An estimate: the level is taken as linear on small tetrahedra.
        """
        found = np.where(sorts == WHOLE, 1.0, 0.0)
        for axis in range(3):
            found = np.repeat(found, 2, axis)
        half = PARTS // 2
        for cut in _parts(np.argwhere(sorts == CUT)):
            line = np.arange(PARTS + 1) / PARTS
            within = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
            points = ((cut[:, None, None, None] + within) * self.edge).reshape(-1, 3)
            level = self.level(points)
            # Where the body ends with the array the sides go on, so its end is not rounded there.
            ends = np.clip(points, self.reach, np.multiply(self.shape, self.edge) - self.reach)
            cap = (level < 1e-6 * self.edge) & (ends != points).any(axis=1)
            level[cap] = self.level(ends[cap])
            filled = filled_shares(level.reshape(len(cut), *within.shape[:3]))
            eighths = filled.reshape(len(cut), 2, half, 2, half, 2, half).mean(axis=(2, 4, 6))
            for end in product((0, 1), repeat=3):
                found[tuple((2 * cut + end).T)] = eighths[(slice(None), *end)]
        return found


def _parts(places: Ints) -> Sequence[Ints]:
    return np.array_split(places, max(1, -(-len(places) // 20_000)))


def filled_shares(level: Floats) -> Floats:
    """Return the share of small cubes where a level is below 0, linear on six tetrahedra of each.

    `level` has the values at the cubes' corners, shape (n, a + 1, b + 1, c + 1).
    """
    count = [m - 1 for m in level.shape[1:]]

    def at(corner: Ints) -> Floats:
        return level[(slice(None), *(slice(c, c + m) for c, m in zip(corner, count, strict=True)))]

    total = np.zeros((len(level), *count))
    for path in _PATHS:
        total += below_zero(np.stack([at(corner) for corner in path]))
    return np.asarray(total / len(_PATHS))


def below_zero(values: Floats) -> Floats:
    """Return the share of tetrahedra where a linear function of corners (4, ...) is below 0."""
    a, b, c, d = np.sort(values, axis=0)

    def along(low: Floats, high: Floats) -> Floats:
        """Return which share of an edge, from its lower end on, is below 0."""
        return np.asarray(low / np.where(low < high, low - high, -1.0))

    ab, ac, ad, bc, bd = along(a, b), along(a, c), along(a, d), along(b, c), along(b, d)
    one = ab * ac * ad
    two = ac * ad + (1.0 - ac) * bc * bd + ac * (1.0 - ad) * bd
    three = 1.0 - (1.0 - ad) * (1.0 - bd) * (1.0 - along(c, d))
    cases: list[Flags] = [a >= 0.0, b >= 0.0, c >= 0.0, d >= 0.0]
    return np.select(cases, [np.zeros_like(one), one, two, three], 1.0)


def thick(cells: Flags) -> Flags:
    """Return the cells that are part of two by two by two of them: what is thinner turns freely."""
    ends = list(product((slice(None, -1), slice(1, None)), repeat=3))
    found = np.zeros_like(cells)
    if min(cells.shape) > 1:
        blocks = np.logical_and.reduce([cells[end] for end in ends])
        for end in ends:
            found[end] |= blocks
    return found


def edge_shares(eighths: Floats, pair: tuple[int, int]) -> Floats:
    """Return what share of the box round every edge is body, one more along both axes of a pair.

    Beyond the array there is as much as on this side of it.
    """
    (along,) = {0, 1, 2} - set(pair)
    found = _pairwise(eighths, along)
    for axis in pair:
        found = _pairwise(padded(found, (axis,)), axis)
    return found


def _pairwise(values: Floats, axis: int) -> Floats:
    lines = np.moveaxis(values, axis, 0)
    return np.moveaxis(0.5 * (lines[::2] + lines[1::2]), 0, axis)
