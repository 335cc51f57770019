"""From a scene to the solver's arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ParameterError
from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, DISPLACED, RIGID
from kaju.model.scene.lattices import check_boxes

from .problem import CellLoads, ElasticProblem, Side, problem_of, rim_layer

Origin = tuple[int, ...]


def problem_of_scene(scene: Scene, stage: int | None = None) -> tuple[ElasticProblem, Origin]:
    """Return the problem that a scene poses, cut to the box around its body.

    Parameters
    ----------
    scene : Scene
        Of squares or cubes, on the cells that are to be solved.
    stage : int, optional
        Stage of loading; the last one by default.

    Returns
    -------
    problem : ElasticProblem
    origin : tuple of int
        The scene's cell that is the problem's first.

    Raises
    ------
    SceneError
        For cells that are neither squares nor cubes, and bodies too large to rasterise.
    ParameterError
        For moduli that linear elasticity cannot have.
    """
    lattice = scene.lattice
    check_boxes(lattice)
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    rim, sides = _rim_of(scene, lower, upper)
    box = tuple(slice(int(a), int(b) + 2) for a, b in zip(lower, upper, strict=True))
    applied = scene.applied(stage)
    inside = np.all((applied.cells >= lower) & (applied.cells < upper), axis=1)
    loads = CellLoads(
        applied.cells[inside] - lower, applied.direction[inside], applied.force[inside]
    )
    constants = [(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials]
    try:
        problem = problem_of(
            np.ascontiguousarray(rim[box]),
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


def _rim_of(
    scene: Scene, lower: NDArray[np.int64], upper: NDArray[np.int64]
) -> tuple[NDArray[np.int32], dict[str, Side]]:
    """Return all cells with what lies beyond the sides, and the sides that need a number."""
    lattice = scene.lattice
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
    return rim, sides
