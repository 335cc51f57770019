"""Exact boundary values: tractions face by face, displacements point by point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.engine import solve_problem
from kaju.model.elastic.grid import problem_of_scene
from kaju.model.elastic.problem import ElasticProblem, FaceFields
from kaju.model.scene import Scene

Field = Callable[[Floats], Floats]
"""Values at points (m), shape (n, dimension)."""

_GAUSS = np.polynomial.legendre.leggauss(4)


def traction_loads(scene: Scene, side: str, stress: Field) -> list[dict[str, Any]]:
    """Return one load for every face of the body on a side: the traction σ·n of a field.

    Parameters
    ----------
    scene : Scene
        The body; its loads do not matter.
    side : str
        A side of the array.
    stress : callable
        Stress tensors (Pa) at points (m).
    """
    lattice = scene.lattice
    number = lattice.sides.index(side)
    axis, upper = divmod(number, 2)
    counts = [1 if a == axis else n for a, n in enumerate(lattice.shape)]
    cells = np.indices(counts).reshape(lattice.dimension, -1).T
    cells[:, axis] = lattice.shape[axis] - 1 if upper else 0
    cells = cells[scene.kinds(cells) >= 0]
    force = face_means(lambda p: stress(p)[:, :, axis], cells, axis, upper, lattice.cell_size)
    force *= (2 * upper - 1) * lattice.face_area(scene.thickness)
    return [
        {"cell": cell.tolist(), "side": side, "force": pull.tolist()}
        for cell, pull in zip(cells, force, strict=True)
        if pull.any()
    ]


def face_means(
    field: Field, cells: NDArray[np.int64], axis: int, upper: int, cell_size: float
) -> Floats:
    """Return the mean of a field over the lower or upper face of cells, by Gauss's rule."""
    nodes, weights = _GAUSS
    dimension = cells.shape[1]
    corner = cells.astype(np.float64)
    corner[:, axis] += upper
    across = [a for a in range(dimension) if a != axis]
    total: Floats = np.zeros((len(cells), dimension))
    for index in np.ndindex((len(nodes),) * len(across)):
        place, weight = corner.copy(), 1.0
        for a, k in zip(across, index, strict=True):
            place[:, a] += 0.5 + 0.5 * nodes[k]
            weight *= 0.5 * weights[k]
        total += weight * field(place * cell_size)
    return total


def solve_with_given_displacement(
    scene: Scene, sides: tuple[str, ...], displacement: Field, tolerance: float
) -> ElasticResult:
    """Solve a scene whose displaced sides move by a field instead of by one vector each.

    Parameters
    ----------
    scene : Scene
        With a displacement, of whatever value, on the sides named.
    sides : tuple of str
    displacement : callable
        Displacement (m) at points (m).
    tolerance : float
        Relative error of the iteration.
    """
    start = perf_counter()
    problem, origin = problem_of_scene(scene)
    numbers = [scene.lattice.sides.index(side) for side in sides]
    fixed = given_faces(problem, numbers, displacement)
    problem = replace(problem, fixed=fixed)
    solution = solve_problem(problem, tolerance)
    found = CellAgents(scene, None, problem, origin, solution)
    return ElasticResult(scene, None, found, perf_counter() - start)


def given_faces(problem: ElasticProblem, sides: list[int], displacement: Field) -> FaceFields:
    """Return the scaled displacements of the faces on sides, and of the ghosts beyond them.

    A ghost face stands half a cell beyond the side, for what the side does there. Its edges
    carry 2μ(∂u_t/∂n + ∂u_n/∂t) because the distance to the side is half a cell; that doubles
    the second term too, which the ghost therefore takes back: g = u_t ± (h/2) ∂u_n/∂t.
    """
    size, unit = problem.scales.length, problem.scales.displacement
    fixed = tuple(values.copy() for values in problem.fixed)
    for side in sides:
        axis, upper = divmod(side, 2)
        wall = problem.shape[axis] if upper else 0
        for component, values in enumerate(fixed):
            first = 1 if component == axis else 0
            layer = values.shape[axis] - 1 - first if upper else first
            index = np.indices(values.shape).take([layer], axis=axis + 1)
            places = index.reshape(problem.dimension, -1).T.astype(np.float64) - 0.5
            places[:, component] -= 0.5
            places[:, axis] = wall
            given = displacement(places * size)[:, component]
            if component != axis:
                half = 0.5 * np.eye(problem.dimension)[component]
                ends = [displacement((places + s * half) * size)[:, axis] for s in (-1, 1)]
                given += (0.5 - upper) * (ends[1] - ends[0])
            values[tuple(index)] = given.reshape(index.shape[1:]) / unit
    return fixed
