"""What a validation problem is: a body with a known answer, and the distance to it.

A problem builds its own scene at any resolution, says where it is to be looked at, and
knows displacement and stress there; boundary values are exact too, tractions face by face and
displacements point by point. Tests, documentation and benchmarks share it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.grid import problem_of_scene
from kaju.model.elastic.moduli import moduli_of
from kaju.model.elastic.problem import ElasticProblem, FaceFields
from kaju.model.elastic.solve import solve
from kaju.model.elastic.solver import solve_problem
from kaju.model.scene import Scene

Field = Callable[[Floats], Floats]
"""Values at points (m), shape (n, dimension)."""

_GAUSS = np.polynomial.legendre.leggauss(4)


def traction_loads(scene: Scene, side: str, stress: Field) -> list[dict[str, Any]]:
    """Return one load for every face of the body on a side: the traction σ·n (Pa) of a field."""
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


def face_means(field: Field, cells: Ints, axis: int, upper: int, cell_size: float) -> Floats:
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
    """Solve a scene whose displaced sides move by a field (m) instead of by one vector each."""
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


Quantity = Literal["displacement", "stress"]
Orders = dict[Quantity, tuple[float, float]]
MATERIAL = "elastic"


@dataclass(frozen=True)
class KnownProblem(ABC):
    """A body whose displacement and stress are known."""

    youngs_modulus: float = 1e9
    poissons_ratio: float = 0.3
    plane: Literal["stress", "strain"] | None = "strain"

    title: ClassVar[str]
    """Name of the problem."""
    source: ClassVar[str]
    """Where the solution is derived."""
    orders: ClassVar[Orders]
    """What is compared, and between which bounds the error's power of the cell size must lie. Empty
    bounds, (inf, inf), mark answers that the grid represents exactly."""
    resolutions: ClassVar[tuple[int, ...]]
    """Cells per unit of the problem at which the order is observed."""
    given_sides: ClassVar[tuple[str, ...]] = ()
    """Sides on which the exact displacement is prescribed, point by point. A scene knows one
    displacement a side only, so these are filled in after the scene is read."""
    loaded_sides: ClassVar[tuple[str, ...]] = ()
    """Sides on which the exact traction acts, face by face."""

    @abstractmethod
    def scene(self, resolution: int) -> Scene:
        """Return the scene with `resolution` cells per unit length of the problem."""

    @abstractmethod
    def points(self) -> Floats:
        """Return the points (m) at which results are compared, shape (n, dimension)."""

    @abstractmethod
    def exact_displacement(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""

    @abstractmethod
    def exact_stress(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""

    def solve(self, resolution: int, tolerance: float = 1e-10) -> ElasticResult:
        """Return the solver's answer at a resolution."""
        scene = self.scene(resolution)
        if not self.given_sides:
            return solve(scene, tolerance=tolerance)
        return solve_with_given_displacement(
            scene, self.given_sides, self.exact_displacement, tolerance
        )

    def error(self, result: ElasticResult, of: Quantity = "displacement") -> float:
        """Return the largest error at `points`, relative to the largest exact value there."""
        points = self.points()
        if of == "displacement":
            exact, found = self.exact_displacement(points), result.displacement_at(points)
        else:
            exact, found = self.exact_stress(points), result.stress_at(points)
        flat = (len(points), -1)
        distance = np.linalg.norm((found - exact).reshape(flat), axis=1)
        return float(distance.max() / np.linalg.norm(exact.reshape(flat), axis=1).max())

    def hooke(self, strain: Floats) -> Floats:
        """Return the stress tensors (Pa) of strain tensors, shape (n, dimension, dimension)."""
        constants = np.array([self.youngs_modulus]), np.array([self.poissons_ratio])
        _, lateral, shear = (float(m[0]) for m in moduli_of(*constants, self.plane))
        trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
        return np.asarray(lateral * trace * np.eye(strain.shape[1]) + 2 * shear * strain)

    def _scene(
        self,
        size: Sequence[float],
        cell_size: float,
        *,
        sides: dict[str, Any],
        loads: Sequence[dict[str, Any]] = (),
        regions: Sequence[dict[str, Any]] = (),
    ) -> Scene:
        """Return a block of one material with holes, its exact boundary values included."""
        dimension = len(size)
        body: dict[str, Any] = {
            "cell_size": cell_size,
            "cells": [round(length / cell_size) for length in size],
            "material": MATERIAL,
            "regions": list(regions),
        }
        if dimension == 2:
            body |= {"plane": self.plane, "thickness": 1.0}
        constants = {"youngs_modulus": self.youngs_modulus, "poissons_ratio": self.poissons_ratio}
        given = {name: {"displacement": [0.0] * dimension} for name in self.given_sides}
        scene = Scene(body=body, materials={MATERIAL: constants}, sides=sides | given)
        exact = [
            load
            for side in self.loaded_sides
            for load in traction_loads(scene, side, self.exact_stress)
        ]
        return scene.replace(loads=[*loads, *exact])


class Study(NamedTuple):
    """Errors over resolutions, and the power of the cell size by which they fall."""

    resolutions: tuple[int, ...]
    errors: tuple[float, ...]
    order: float
    """Slope of log(error) over log(1/resolution), by least squares."""


def convergence(
    problem: KnownProblem, resolutions: Sequence[int] | None = None
) -> dict[Quantity, Study]:
    """Solve a problem at several resolutions, its own by default; fit the order of its errors."""
    counts = tuple(resolutions or problem.resolutions)
    results = [problem.solve(count) for count in counts]
    studies: dict[Quantity, Study] = {}
    for quantity in problem.orders:
        errors = tuple(problem.error(result, quantity) for result in results)
        slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
        studies[quantity] = Study(counts, errors, -float(slope))
    return studies
