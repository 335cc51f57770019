"""What a validation problem is: a body with a known answer, and the distance to it.

A problem builds its own scene at any resolution, says where it is to be looked at, and
knows displacement and stress there; boundary values are exact too, tractions face by face and
displacements point by point. Tests, documentation and benchmarks share it.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from itertools import chain
from time import perf_counter
from typing import ClassVar, NamedTuple

import numpy as np

from kaju import ElasticResult, Scene
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import Grid, problem_of_scene
from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.elastic.solve import solve_cells

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
MATERIAL = "elastic"
SECOND_ORDER = {"displacement": (1.8, 2.3), "stress": (1.8, 2.3)}


def moduli_of(youngs_modulus, poissons_ratio, plane):
    """Return C₁₁ and C₁₂ (Pa)."""
    if plane == "stress":
        stretch = youngs_modulus / (1 - poissons_ratio**2)
        return stretch, poissons_ratio * stretch
    unit = youngs_modulus / ((1 + poissons_ratio) * (1 - 2 * poissons_ratio))
    return (1 - poissons_ratio) * unit, poissons_ratio * unit


def traction_loads(scene, side, stress):
    """Return one load for every face of the body on a side: the traction σ·n (Pa) of a field."""
    lattice = scene.lattice
    axis, upper = divmod(lattice.sides.index(side), 2)
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


def face_means(field, cells, axis, upper, cell_size):
    """Return the mean of a field over the lower or upper face of cells, by Gauss's rule."""
    corner = cells.astype(np.float64)
    corner[:, axis] += upper
    across = [a for a in range(cells.shape[1]) if a != axis]
    total = np.zeros(cells.shape)
    for index in np.ndindex((len(NODES),) * len(across)):
        place, weight = corner.copy(), 1.0
        for a, k in zip(across, index, strict=True):
            place[:, a] += 0.5 + 0.5 * NODES[k]
            weight *= 0.5 * WEIGHTS[k]
        total += weight * field(place * cell_size)
    return total


def given_faces(problem, sides, displacement):
    """Return the scaled displacements of the faces on sides, and of the ghosts beyond them.

    A ghost face stands half a cell beyond the side, for what the side does there. Its edges
    carry 2μ(∂u_t/∂n + ∂u_n/∂t) because the distance to the side is half a cell; that doubles
    the second term too, which the ghost therefore takes back: g = u_t ± (h/2) ∂u_n/∂t.
    """
    size, unit = problem.scales.length, problem.scales.displacement
    fixed = tuple(values.copy() for values in problem.fixed)
    for side in sides:
        axis, upper = divmod(side, 2)
        for component, values in enumerate(fixed):
            first = 1 if component == axis else 0
            layer = values.shape[axis] - 1 - first if upper else first
            index = np.indices(values.shape).take([layer], axis=axis + 1)
            places = index.reshape(problem.dimension, -1).T.astype(np.float64) - 0.5
            places[:, component] -= 0.5
            places[:, axis] = problem.shape[axis] if upper else 0
            given = displacement(places * size)[:, component]
            if component != axis:
                half = 0.5 * np.eye(problem.dimension)[component]
                ends = [displacement((places + s * half) * size)[:, axis] for s in (-1, 1)]
                given += (0.5 - upper) * (ends[1] - ends[0])
            values[tuple(index)] = given.reshape(index.shape[1:]) / unit
    return fixed


@dataclass(frozen=True)
class KnownProblem(ABC):
    """A body whose displacement and stress are known."""

    youngs_modulus: float = 1e9
    poissons_ratio: float = 0.3
    plane: str | None = "strain"

    source: ClassVar[str]
    """Where the solution is derived."""
    orders: ClassVar[dict]
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
    def scene(self, resolution):
        """Return the scene with `resolution` cells per unit length of the problem."""

    @abstractmethod
    def points(self):
        """Return the points (m) at which results are compared, shape (n, dimension)."""

    @abstractmethod
    def exact_displacement(self, points):
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""

    @abstractmethod
    def exact_stress(self, points):
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""

    def solve(self, resolution, tolerance=1e-10):
        """Return the solver's answer at a resolution."""
        scene, t0 = self.scene(resolution), perf_counter()
        if not self.given_sides:
            return solve_cells(scene, tolerance=tolerance)
        problem, origin = problem_of_scene(scene)
        sides = [scene.lattice.sides.index(side) for side in self.given_sides]
        problem = replace(problem, fixed=given_faces(problem, sides, self.exact_displacement))
        solution, posed = solve_problem(problem, tolerance), Grid(scene, problem, origin, 1)
        return ElasticResult(CellAgents(scene, None, 1, solution, known=posed), perf_counter() - t0)

    def error(self, result, of="displacement"):
        """Return the largest error at `points`, relative to the largest exact value there."""
        points = self.points()
        exact = getattr(self, f"exact_{of}")(points)
        found = getattr(result, f"{of}_at")(points)
        flat = (len(points), -1)
        distance = np.linalg.norm((found - exact).reshape(flat), axis=1)
        return float(distance.max() / np.linalg.norm(exact.reshape(flat), axis=1).max())

    @property
    def shear_modulus(self):
        """μ (Pa)."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    def hooke(self, strain):
        """Return the stress tensors (Pa) of strain tensors, shape (n, dimension, dimension)."""
        _, lateral = moduli_of(self.youngs_modulus, self.poissons_ratio, self.plane)
        trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
        return lateral * trace * np.eye(strain.shape[1]) + 2 * self.shear_modulus * strain

    def _scene(self, size, cell_size, *, sides=None, loads=(), regions=()):
        """Return a block of one material with holes, its exact boundary values included."""
        body = {
            "cell_size": cell_size,
            "cells": [round(length / cell_size) for length in size],
            "material": MATERIAL,
            "regions": list(regions),
        }
        if len(size) == 2:
            body |= {"plane": self.plane, "thickness": 1.0}
        constants = {"youngs_modulus": self.youngs_modulus, "poissons_ratio": self.poissons_ratio}
        given = {name: {"displacement": [0.0] * len(size)} for name in self.given_sides}
        scene = Scene(body=body, materials={MATERIAL: constants}, sides=(sides or {}) | given)
        exact = (traction_loads(scene, side, self.exact_stress) for side in self.loaded_sides)
        return scene.replace(loads=[*loads, *chain.from_iterable(exact)])


class Study(NamedTuple):
    """Errors over resolutions, and the power of the cell size by which they fall."""

    resolutions: tuple[int, ...]
    errors: tuple[float, ...]
    order: float
    """Slope of log(error) over log(1/resolution), by least squares."""


def convergence(problem, resolutions=None):
    """Solve a problem at several resolutions, its own by default; fit the order of its errors."""
    counts = tuple(resolutions or problem.resolutions)
    results = [problem.solve(count) for count in counts]
    studies = {}
    for quantity in problem.orders:
        errors = tuple(problem.error(result, quantity) for result in results)
        slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
        studies[quantity] = Study(counts, errors, -float(slope))
    return studies


def grid_points(*axes):
    """Return all points that have these coordinates, shape (n, dimension)."""
    return np.stack([place.ravel() for place in np.meshgrid(*axes)], axis=1)
