"""The singular field of a re-entrant right angle."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.scene import Scene

from .potentials import Complex, PlaneProblem, Potentials, polar_points
from .problem import Quantity

EXPONENT = 0.5444837367824639
"""Smallest positive root λ of sin(3πλ/2) = λ, the opening mode of a corner of 270°."""

BISECTOR = -135.0
"""Direction from the corner into the body (degrees)."""


@dataclass(frozen=True)
class LCorner(PlaneProblem):
    """An L of 2 m whose inner corner opens: u ~ r^λ, σ ~ r^(λ-1), λ = 0.5445.

    φ = Az^λ, ψ = Bz^λ about the bisector, free on both faces of the corner, with the exact
    displacement left and below and the exact traction at the two ends of the L
    (Williams 1952, J. Applied Mechanics 19, 526-528; Szabó & Babuška 1991, Finite
    Element Analysis). The singularity is felt everywhere: errors fall like
    h^2λ, power 1.09, in the end, and a little faster on coarse cells.

    Attributes
    ----------
    strength : float
        A (Pa·m^(1-λ)).
    """

    strength: float = 1e6

    title: ClassVar[str] = "L-corner"
    source: ClassVar[str] = "Williams 1952, J. Applied Mechanics 19, 526-528"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {
        "displacement": (1.0, 1.8),
        "stress": (1.0, 1.9),
    }
    resolutions: ClassVar[tuple[int, ...]] = (16, 32, 64, 128)
    given_sides: ClassVar[tuple[str, ...]] = ("left", "bottom")
    loaded_sides: ClassVar[tuple[str, ...]] = ("right", "top")
    origin: ClassVar[tuple[float, float]] = (1.0, 1.0)

    def scene(self, resolution: int) -> Scene:
        """Return the L, `resolution` cells per metre."""
        missing = {"material": "air", "box": [[1.0, 1.0], [2.0, 2.0]]}
        return self._scene([2.0, 2.0], 1.0 / resolution, sides={}, regions=[missing])

    def points(self) -> Floats:
        """Return points on arcs round the corner."""
        angles = (BISECTOR, BISECTOR + 45.0, BISECTOR - 45.0, BISECTOR + 90.0, BISECTOR - 90.0)
        return polar_points((0.3, 0.5, 0.7), angles, self.origin)

    def potentials(self, z: Complex) -> Potentials:
        """Return powers of z, turned so that the bisector leads into the body."""
        power, turn = EXPONENT, np.exp(1j * np.deg2rad(BISECTOR))
        other = -self.strength * np.cos(1.5 * pi * power)
        with np.errstate(divide="ignore", invalid="ignore"):  # the corner itself is singular
            along = z / turn
            first, second = power * along ** (power - 1), power * (power - 1) * along ** (power - 2)
        return Potentials(
            phi=self.strength * turn * along**power,
            phi_1=self.strength * first,
            phi_2=self.strength * second / turn,
            psi=other * along**power / turn,
            psi_1=other * first / turn**2,
        )

    def exponent(self, result: ElasticResult, near: float = 0.1, far: float = 0.5) -> float:
        """Return the λ observed: one more than the power of r by which stresses fall."""
        radii = np.geomspace(near, far, 12)
        points = polar_points(tuple(radii), (BISECTOR,), self.origin)
        size = np.linalg.norm(result.stress_at(points).reshape(len(points), -1), axis=1)
        return 1.0 + float(np.polyfit(np.log(radii), np.log(size), 1)[0])
