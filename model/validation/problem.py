"""What a validation problem is: a body with a known answer, and the distance to it.

A problem builds its own scene at any resolution, says where it is to be looked at, and
knows displacement and stress there. Tests, documentation and benchmarks share it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import moduli_of
from kaju.model.elastic.solve import solve
from kaju.model.scene import Scene

from .boundary import solve_with_given_displacement, traction_loads

Quantity = Literal["displacement", "stress"]
MATERIAL = "elastic"


@dataclass(frozen=True)
class ValidationProblem(ABC):
    """A body whose displacement and stress are known.

    Attributes
    ----------
    title : str
        Name of the problem.
    source : str
        Where the solution is derived.
    orders : dict from "displacement" or "stress" to (float, float)
        What is compared, and between which bounds the error's power of the cell size must
        lie. Empty bounds, (inf, inf), mark answers that the grid represents exactly.
    resolutions : tuple of int
        Cells per unit of the problem at which the order is observed.
    given_sides : tuple of str
        Sides on which the exact displacement is prescribed, point by point. A scene knows
        one displacement a side only, so these are filled in after the scene is read.
    loaded_sides : tuple of str
        Sides on which the exact traction acts, face by face.
    """

    youngs_modulus: float = 1e9
    poissons_ratio: float = 0.3
    plane: Literal["stress", "strain"] | None = "strain"

    title: ClassVar[str]
    source: ClassVar[str]
    orders: ClassVar[dict[Quantity, tuple[float, float]]]
    resolutions: ClassVar[tuple[int, ...]]
    given_sides: ClassVar[tuple[str, ...]] = ()
    loaded_sides: ClassVar[tuple[str, ...]] = ()

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
    """Errors over resolutions, and the power of the cell size by which they fall.

    Attributes
    ----------
    resolutions : tuple of int
    errors : tuple of float
    order : float
        Slope of log(error) over log(1/resolution), by least squares.
    """

    resolutions: tuple[int, ...]
    errors: tuple[float, ...]
    order: float


def convergence(
    problem: ValidationProblem, resolutions: Sequence[int] | None = None
) -> dict[Quantity, Study]:
    """Solve a problem at several resolutions and fit the order of what it compares.

    Parameters
    ----------
    problem : ValidationProblem
    resolutions : sequence of int, optional
        By default the problem's own.
    """
    counts = tuple(resolutions or problem.resolutions)
    results = [problem.solve(count) for count in counts]
    studies: dict[Quantity, Study] = {}
    for quantity in problem.orders:
        errors = tuple(problem.error(result, quantity) for result in results)
        slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
        studies[quantity] = Study(counts, errors, -float(slope))
    return studies
