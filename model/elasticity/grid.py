"""The grid that a scene is solved on: its own cells, or as many smaller ones as it takes."""

from __future__ import annotations

from typing import NamedTuple

from kaju.errors import SceneError
from kaju.model.scene import Scene

from .from_scene import Origin, problem_of_scene
from .prepared import same_body
from .problem import ElasticProblem
from .supports import slender_cell


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
    """Return the grid of a scene; members one cell wide are halved, so that they carry shear.

    The members of a body that is `known` need no look.

    Raises
    ------
    SceneError
        If a member is one cell wide even then.
    """
    grid, narrow = _refined(scene, stage, division, known)
    if not narrow:
        return grid
    finer, still_narrow = _refined(scene, stage, 2 * division, known)
    if still_narrow:
        raise SceneError(
            f"body: a member is one cell wide at cell {still_narrow} of the grid refined by "
            f"{2 * division} and carries no shear; widen it, or give a larger resolution"
        )
    return finer._replace(notes=(f"a member is one cell wide at {narrow}: the cells were halved",))


def _refined(
    scene: Scene, stage: int | None, division: int, known: ElasticProblem | None
) -> tuple[Grid, str]:
    """Return the grid, and where a member is one cell wide (empty if none is)."""
    fine = scene if division == 1 else scene.refine(division)
    problem, origin = problem_of_scene(fine, stage)
    seen = known is not None and same_body(problem, known)
    cell = None if seen else slender_cell(problem)
    narrow = ""
    if cell is not None:
        narrow = f"({', '.join(str(a + b) for a, b in zip(cell, origin, strict=True))})"
    return Grid(fine, problem, origin, division), narrow
