"""The grid that a scene is solved on: its own cells, or as many smaller ones as it takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ParameterError, SceneError, SupportError
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, RIGID
from kaju.model.scene.lattices import check_boxes

from .problem import CellLoads, ElasticProblem, Side, problem_of, rim_layer
from .solver import held_alike
from .supports import check_supports, slender_cell

Origin = tuple[int, ...]


def problem_of_scene(
    scene: Scene, stage: int | None = None, stiffness: Floats | None = None
) -> tuple[ElasticProblem, Origin]:
    """Return the problem that a scene poses, cut to the box around its body.

    With it comes the scene's cell that is the problem's first. `stiffness` is what the materials'
    moduli are multiplied by, cell by cell: every cell of material is a kind of its own then,
    numbered row by row.
    """
    lattice = scene.lattice
    check_boxes(lattice)
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    # All cells with what lies beyond the sides, and the sides that need a number.
    rim = np.pad(scene.rasterise().astype(np.int32), 1, constant_values=AIR)
    sides: dict[str, Side] = {}
    for index, name in enumerate(lattice.sides):
        condition = scene.side_condition(name)
        axis, upper_end = divmod(index, 2)
        layer = rim_layer(lattice.dimension, index)
        rim[layer] = RIGID if condition.code == DISPLACED else condition.code
        reached = upper[axis] == lattice.shape[axis] if upper_end else lower[axis] == 0
        if reached and condition.stiffness is not None:
            sides[name] = ("foundation", condition.stiffness)
        elif reached and condition.displacement is not None:
            sides[name] = ("displacement", condition.displacement)
    box = tuple(slice(int(a), int(b) + 2) for a, b in zip(lower, upper, strict=True))
    applied = scene.applied(stage)
    inside = np.all((applied.cells >= lower) & (applied.cells < upper), axis=1)
    loads = CellLoads(
        applied.cells[inside] - lower,
        applied.direction[inside],
        applied.force[inside],
        applied.uneven and applied.uneven.within(inside),
    )
    constants = np.array([(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials])
    kinds = np.ascontiguousarray(rim[box])
    if stiffness is not None:
        body = kinds >= 0
        constants = constants[kinds[body]]
        constants[:, 0] *= np.pad(stiffness, 1)[box][body]
        kinds[body] = np.arange(len(constants))
    try:
        problem = problem_of(
            kinds,
            constants,
            lattice.cell_size,
            plane=scene.plane,
            thickness=scene.thickness,
            sides=sides,
            loads=loads,
        )
    except ParameterError as error:
        names = ", ".join(material.name for material in scene.cell_materials)
        raise ParameterError(f"materials ({names}): {error}") from error
    return problem, tuple(int(i) for i in lower)


class Grid(NamedTuple):
    """A scene on the cells on which it is solved."""

    scene: Scene  # The scene, refined
    problem: ElasticProblem  # Its arrays
    origin: Origin  # Cell of the scene at which the arrays start
    division: int  # Cells per cell of the scene that was asked about, along every axis
    notes: tuple[str, ...] = ()  # What was changed by itself, in words


def grid_of(
    scene: Scene,
    stage: int | None,
    division: int = 1,
    known: ElasticProblem | None = None,
    stiffness: Floats | None = None,
) -> Grid:
    """Return the grid of a scene, with a relative stiffness of each of its cells if given.

    Its cells are halved where a member, or what holds the body against turning, is one cell wide:
    neither resists on this grid. A body that is `known`, of whatever stiffness, needs no look.
    """
    grid = _refined(scene, stage, division, stiffness)
    if known is not None and held_alike(grid.problem, known):
        return grid
    narrow, loose = _narrow(grid), None
    if not narrow:
        try:
            check_supports(grid.problem, grid.origin, division)
            return grid
        except SupportError as error:
            if "could turn" not in str(error):
                raise
            loose = error
    finer = _refined(scene, stage, 2 * division, stiffness)
    if narrow and _narrow(finer):
        raise SceneError(
            f"body: a member is one cell wide at cell {_narrow(finer)} of the grid refined by "
            f"{2 * division} and carries no shear; widen it, or give a larger resolution"
        )
    try:
        check_supports(finer.problem, finer.origin, 2 * division)
    except SupportError as error:
        raise loose or error from None
    reason = "a single rigid cell holds no turn"
    if narrow:
        reason = f"a member is one cell wide at {narrow}"
    return finer._replace(notes=(f"{reason}: the cells were halved",))


def _refined(scene: Scene, stage: int | None, division: int, stiffness: Floats | None) -> Grid:
    fine = scene if division == 1 else scene.refine(division)
    return Grid(fine, *problem_of_scene(fine, stage, repeated(stiffness, division)), division)


def repeated(stiffness: Floats | None, division: int) -> Floats | None:
    """Return a field of stiffness on cells so many times smaller."""
    if stiffness is not None:
        for axis in range(stiffness.ndim):
            stiffness = np.repeat(stiffness, division, axis)
    return stiffness


def _narrow(grid: Grid) -> str:
    """Return where a member is one cell wide, "" if none is."""
    cell = slender_cell(grid.problem)
    if cell is None:
        return ""
    return f"({', '.join(str(a + b) for a, b in zip(cell, grid.origin, strict=True))})"
