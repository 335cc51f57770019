"""The grid that a scene is solved on: its own cells, or as many smaller ones as it takes."""

from __future__ import annotations

from typing import NamedTuple

from kaju.errors import SceneError, SupportError
from kaju.model.scene import Scene

from .from_scene import Origin, problem_of_scene
from .prepared import same_body
from .problem import ElasticProblem
from .supports import check_supports, slender_cell


class Grid(NamedTuple):
    """A scene on the cells on which it is solved.

    Attributes
    ----------
    scene : Scene
        The scene, refined.
    problem : ElasticProblem
        Its arrays.
    origin : tuple of int
        Cell of the scene at which the arrays start.
    division : int
        Cells per cell of the scene that was asked about, along every axis.
    notes : tuple of str
        What was changed by itself, in words.
    """

    scene: Scene
    problem: ElasticProblem
    origin: Origin
    division: int
    notes: tuple[str, ...] = ()


def grid_of(
    scene: Scene, stage: int | None, division: int = 1, known: ElasticProblem | None = None
) -> Grid:
    """Return the grid of a scene.

    Its cells are halved where a member, or what holds the body against turning, is one cell wide:
    neither resists on this grid. A body that is `known` needs no look.

    Raises
    ------
    SceneError
        If a member is one cell wide even then.
    SupportError
        If a part of the body could move without straining.
    """
    grid = _refined(scene, stage, division)
    if known is not None and same_body(grid.problem, known):
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
    finer = _refined(scene, stage, 2 * division)
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


def _refined(scene: Scene, stage: int | None, division: int) -> Grid:
    fine = scene if division == 1 else scene.refine(division)
    return Grid(fine, *problem_of_scene(fine, stage), division)


def _narrow(grid: Grid) -> str:
    """Return where a member is one cell wide, "" if none is."""
    cell = slender_cell(grid.problem)
    if cell is None:
        return ""
    return f"({', '.join(str(a + b) for a, b in zip(cell, grid.origin, strict=True))})"
