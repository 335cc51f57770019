"""The field that belongs to a root: of a re-entrant corner."""

from dataclasses import dataclass
from math import pi

import numpy as np

from .potentials import PlaneProblem, Potentials, polar_points

EXPONENT = 0.5444837367824639
"""Smallest positive root λ of sin(3πλ/2) = λ, the opening mode of a corner of 270°."""

BISECTOR = -135.0
"""Direction from the corner into the body (degrees)."""
CORNER_ORDERS = {"displacement": (1.0, 1.8), "stress": (1.0, 1.9)}


@dataclass(frozen=True)
class LCorner(PlaneProblem):
    """An L of 2 m whose inner corner opens: u ~ r^λ, σ ~ r^(λ-1), λ = 0.5445.

    φ = Az^λ, ψ = Bz^λ about the bisector, free on both faces of the corner, with the exact
    displacement left and below and the exact traction at the two ends of the L
    (Williams 1952, J. Applied Mechanics 19, 526-528; Szabó & Babuška 1991, Finite
    Element Analysis). The singularity is felt everywhere: errors fall like
    h^2λ, power 1.09, in the end, and a little faster on coarse cells.
    """

    strength: float = 1e6
    """A (Pa·m^(1-λ))."""

    title = "L-corner"
    source = "Williams 1952, J. Applied Mechanics 19, 526-528"
    orders = CORNER_ORDERS
    resolutions = (16, 32, 64, 128)
    given_sides = ("left", "bottom")
    loaded_sides = ("right", "top")
    origin = (1.0, 1.0)

    def scene(self, resolution):
        """Return the L, `resolution` cells per metre."""
        missing = {"material": "air", "box": [[1.0, 1.0], [2.0, 2.0]]}
        return self._scene([2.0, 2.0], 1.0 / resolution, regions=[missing])

    def points(self):
        """Return points on arcs round the corner."""
        angles = BISECTOR + np.array([0.0, 45.0, -45.0, 90.0, -90.0])
        return polar_points((0.3, 0.5, 0.7), angles, self.origin)

    def potentials(self, z):
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
