"""Round edges, which a grid of squares makes a stair: holes.

A quarter is solved: symmetry holds it left and below, and on the outer cuts of a plate
the exact traction acts. Cells belong to the hole if their centre does, so the hole's radius
is off by a share of a cell that changes from one resolution to the next: the error away
from the hole falls with about the first power of the cell size, unsteadily.
"""

from dataclasses import dataclass
from math import hypot

import numpy as np

from .potentials import PlaneProblem, Potentials, polar_points

STAIR = {"displacement": (0.7, 1.4), "stress": (0.7, 1.5)}
RADIUS = 1.0


@dataclass(frozen=True)
class _Hole(PlaneProblem):
    """A quarter of a plate, 3 m wide, with a hole of radius 1 m in its middle."""

    orders = STAIR
    resolutions = (8, 12, 16, 20, 24, 32, 48)
    loaded_sides = ("right", "top")

    def scene(self, resolution):
        """Return the plate, `resolution` cells per radius."""
        hole = {"material": "air", "disk": {"centre": [0.0, 0.0], "radius": RADIUS}}
        sides = {"left": "roller", "bottom": "roller"}
        return self._scene([3.0, 3.0], 1.0 / resolution, sides=sides, regions=[hole])

    def points(self):
        """Return points on arcs half a radius and more away from the hole."""
        return polar_points((1.5, 2.0, 2.5), (0.0, 20.0, 45.0, 70.0, 90.0))


@dataclass(frozen=True)
class Kirsch(_Hole):
    """A plate with a free hole under tension S along x.

    φ = S/4 (z + 2a²/z), ψ = -S/2 (z + a²/z - a⁴/z³)
    (Kirsch 1898; Muskhelishvili, §56; Timoshenko & Goodier, §35).
    """

    tension: float = 1e6
    """S far from the hole (Pa)."""

    title = "Kirsch's hole under tension"
    source = "Timoshenko & Goodier, Theory of Elasticity, §35"

    def potentials(self, z):
        """Return the potentials of the tension and of the hole's disturbance."""
        a, unit = RADIUS, self.tension / 4
        return Potentials(
            phi=unit * (z + 2 * a**2 / z),
            phi_1=unit * (1 - 2 * a**2 / z**2),
            phi_2=unit * 4 * a**2 / z**3,
            psi=-2 * unit * (z + a**2 / z - a**4 / z**3),
            psi_1=-2 * unit * (1 - a**2 / z**2 + 3 * a**4 / z**4),
        )


@dataclass(frozen=True)
class Lame(_Hole):
    """A thick tube, 1 m to 4.24 m in radius, under pressure (Pa) from inside; 3 m each way of it.

    φ = Az, ψ = B/z with 2A = pa²/(b² - a²) and B = -2Ab²
    (Lamé 1852; Muskhelishvili, §59; Timoshenko & Goodier, §28). The pressure acts on
    every step of the stair.
    """

    pressure: float = 1e6
    outer = hypot(3.0, 3.0)

    title = "Lamé's tube under pressure"
    source = "Timoshenko & Goodier, Theory of Elasticity, §28"

    def potentials(self, z):
        """Return a uniform and a radial part."""
        pull = self.pressure * RADIUS**2 / (2 * (self.outer**2 - RADIUS**2))
        core = -2 * pull * self.outer**2
        return Potentials(
            phi=pull * z, phi_1=pull + 0 * z, phi_2=0 * z, psi=core / z, psi_1=-core / z**2
        )

    def scene(self, resolution):
        """Return the plate with the pressure on every face between the body and the hole."""
        scene = super().scene(resolution)
        kinds = scene.rasterise()[: resolution + 1, : resolution + 1]
        push = self.pressure / resolution
        loads = []
        for axis, side, force in ((0, "left", [push, 0.0]), (1, "bottom", [0.0, push])):
            solid = np.moveaxis(kinds, axis, 0) >= 0
            steps = np.argwhere(solid[1:] & ~solid[:-1])
            cells = steps[:, ::-1] if axis else steps
            cells[:, axis] += 1
            loads += [{"cell": cell.tolist(), "side": side, "force": force} for cell in cells]
        return scene.replace(loads=[*loads, *scene.loads])
