"""Solids with true outlines, solved: cells count by the share of them that is body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats
from kaju.errors import SceneError
from kaju.model.elastic.arguments import check_numbers
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import Grid, problem_of_scene
from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.elastic.equal.staggered import axis_pairs, edge_modulus
from kaju.model.elastic.equal.supports import check_supports, slender_cell
from kaju.model.scene import Body, Scene
from kaju.model.scene.cell_types import NOT_BODY
from kaju.model.scene.pictures import check_size

from .cut_cells import CUT, WHOLE, SolidBody, edge_shares, thick

SLIVER = 1e-4  # cells of which less is body are taken as empty
FRACTIONS = (
    "true outlines: cells count by the share of them that is body, which is an estimate and proves "
    "nothing; stress and displacement of cut cells are means over all of each"
)
NO_BOUND = "in space there are no bounds within true outlines"


@dataclass(eq=False)
class SolidAgents(CellAgents):
    """Agents of one size, whole or cut by outlines."""

    storage: ClassVar[Literal["cells", "solid"]] = "solid"
    no_bound: ClassVar[str] = NO_BOUND

    def _posed(self) -> Grid:
        """Return the grid of a stored answer."""
        posed, self.factor = grid_of_solid(self.scene, self.division)
        return posed


def solved_agents(scene: Scene, resolution: int | None) -> SolidAgents:
    """Return the agents of a solid with true outlines, equal cells, settled."""
    check_numbers(None, resolution)
    posed, share = grid_of_solid(scene, int(resolution or 1))
    solution = solve_problem(posed.problem)
    solution.notes[:0] = [FRACTIONS, *posed.notes]
    return SolidAgents(scene, None, posed.division, solution, share, posed)


def grid_of_solid(scene: Scene, resolution: int) -> tuple[Grid, Floats]:
    """Return the cells of a solid, and what share of each is body, 1 beyond it."""
    solid = solid_of(scene, resolution)
    check_size(solid.shape, "resolution")
    sorts = solid.cells()
    eighths = solid.shares(sorts)
    two = [part for count in solid.shape for part in (count, 2)]
    share = eighths.reshape(two).mean(axis=(1, 3, 5))
    body = thick(share >= SLIVER)
    if not body.any():
        raise SceneError(
            f"body.regions: nothing of the body is two cells of {solid.edge:.3g} m thick; give a "
            "larger resolution"
        )
    grid = scene_of_cells(scene, body, solid.edge)
    like, origin = problem_of_scene(grid)
    left_out = 1.0 - float(share[body].sum() / share.sum())
    # More than 5 % are refused, and more than 0.01 % noted.
    if left_out > 0.05 or slender_cell(like) is not None:
        raise SceneError(
            f"body.regions: {left_out:.0%} of the body, or what joins its parts, is thinner than "
            f"two cells of {solid.edge:.3g} m, which carry no shear; give a larger resolution"
        )
    _check_loads(scene, body, sorts)
    check_supports(like, origin)
    share = np.where(body, share, 1.0)
    problem, _ = problem_of_scene(grid, None, share)
    box = tuple(slice(2 * a, 2 * (a + n)) for a, n in zip(origin, problem.shape, strict=True))
    edges = {
        pair: edge_modulus(like, pair)
        * np.pad(np.maximum(edge_shares(eighths[box], pair), SLIVER), 1)
        for pair in axis_pairs(3)
    }
    notes = (f"{left_out:.1g} of the body is too thin for the cells, and left out",)
    problem = replace(problem, edges=edges)
    return Grid(grid, problem, origin, resolution, notes if left_out > 1e-4 else ()), share


def solid_of(scene: Scene, resolution: int) -> SolidBody:
    """Return the body that a scene describes, and cells so many times smaller."""
    shapes = tuple(
        (region.shape_in(scene.lattice, f"body.regions.{k}"), region.material not in NOT_BODY)
        for k, region in enumerate(scene.body.regions)
    )
    shape = tuple(resolution * count for count in scene.lattice.shape)
    edge = scene.lattice.cell_size / resolution
    return SolidBody(shape, edge, scene.body.material not in NOT_BODY, shapes)


def scene_of_cells(scene: Scene, cells: Flags, edge: float) -> Scene:
    """Return a scene of cells, held and loaded as the one that is asked about."""
    (material,) = scene.cell_materials
    body = Body(array=cells.astype(np.int16), cell_size=edge)
    return scene.replace(body=body, legend={"0": "air", "1": material.name})


def _check_loads(scene: Scene, body: Flags, sorts: NDArray[np.int8]) -> None:
    """Refuse loads on sides that an outline meets: where they act would be a guess."""
    for number, load in enumerate(scene.loads):
        axis, upper = divmod(scene.lattice.sides.index(str(load.side)), 2)
        own, sort = (np.moveaxis(values, axis, 0)[-upper] for values in (body, sorts))
        unlike = own != (sort == WHOLE)
        if (unlike | (sort == CUT)).any():
            row = np.argwhere(unlike | (sort == CUT))[0].tolist()
            row.insert(axis, (body.shape[axis] - 1) * upper)
            raise SceneError(
                f"loads.{number}: an outline meets the side it acts on, at cell {row}; load a side "
                'that none meets, or take outline = "cells" for the regions that do'
            )
