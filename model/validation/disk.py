"""A disk pressed between two points: the Brazilian test."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from kaju.model.scene import Scene

from .boundary import Floats
from .potentials import Complex, PlaneProblem, Potentials
from .problem import Quantity


@dataclass(frozen=True)
class BrazilianDisk(PlaneProblem):
    """A disk of radius 1 m under two opposite point forces, seen near its centre.

    Two point forces on half planes and a uniform tension P/πR that frees the rim:
    at the centre σ_xx = P/πR and σ_yy = -3P/πR (Hertz 1883; Timoshenko & Goodier, §41).
    The rim is a stair, but statics fixes what passes through the middle, and far from the
    rim the stair is felt to second order only.

    Attributes
    ----------
    load : float
        P per unit thickness (N/m).
    """

    load: float = 1e6

    title: ClassVar[str] = "Brazilian disk, centre"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §41"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {"stress": (1.6, 2.3)}
    resolutions: ClassVar[tuple[int, ...]] = (16, 24, 32, 48, 64)

    def scene(self, resolution: int) -> Scene:
        """Return a quarter of the disk, `resolution` cells per radius."""
        n = resolution
        outside = {"material": "air", "box": [[0.0, 0.0], [1.0, 1.0]]}
        disk = {"material": "elastic", "disk": {"centre": [0.0, 0.0], "radius": 1.0}}
        return self._scene(
            [1.0, 1.0],
            1.0 / n,
            sides={"left": "roller", "bottom": "roller"},
            loads=[{"cell": [0, n - 1], "side": "top", "force": [0.0, -self.load / 2]}],
            regions=[outside, disk],
        )

    def points(self) -> Floats:
        """Return the centre and points a quarter of the radius away."""
        return np.array([[0.0, 0.0], [0.25, 0.0], [0.0, 0.25], [0.2, 0.2]])

    def potentials(self, z: Complex) -> Potentials:
        """Return the sum of the two forces and of the uniform tension."""
        tension = self.load / (2 * pi)
        above, below = self._force(z), self._force(-z)
        return Potentials(
            phi=above.phi - below.phi + tension * z,
            phi_1=above.phi_1 + below.phi_1 + tension,
            phi_2=above.phi_2 - below.phi_2,
            psi=above.psi - below.psi,
            psi_1=above.psi_1 + below.psi_1,
        )

    def _force(self, z: Complex) -> Potentials:
        """Return the potentials of the upper force, on the half plane below y = 1."""
        unit, down = 1j * self.load / (2 * pi), z - 1j
        log = unit * np.log(1 + 1j * z)
        return Potentials(
            phi=log,
            phi_1=unit / down,
            phi_2=-unit / down**2,
            psi=log + 1j * unit / down,
            psi_1=unit / down - 1j * unit / down**2,
        )
