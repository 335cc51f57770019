"""Round holes, whose edge a grid of squares makes a stair.

A quarter of the plate is solved: symmetry holds it left and below, and on the outer cuts
the exact traction acts. Cells belong to the hole if their centre does, so the hole's radius
is off by a share of a cell that changes from one resolution to the next: the error away
from the hole falls with about the first power of the cell size, unsteadily.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Any, ClassVar

import numpy as np

from kaju.model.scene import Scene

from .boundary import Floats
from .potentials import Complex, PlaneProblem, Potentials, polar_points
from .problem import Quantity

STAIR: dict[Quantity, tuple[float, float]] = {
    "displacement": (0.7, 1.4),
    "stress": (0.7, 1.5),
}
RADIUS = 1.0


@dataclass(frozen=True)
class _Hole(PlaneProblem):
    """A quarter of a plate, 3 m wide, with a hole of radius 1 m in its middle."""

    orders = STAIR
    resolutions: ClassVar[tuple[int, ...]] = (8, 12, 16, 20, 24, 32, 48)
    loaded_sides: ClassVar[tuple[str, ...]] = ("right", "top")

    def scene(self, resolution: int) -> Scene:
        """Return the plate, `resolution` cells per radius."""
        hole = {"material": "air", "disk": {"centre": [0.0, 0.0], "radius": RADIUS}}
        sides = {"left": "roller", "bottom": "roller"}
        scene = self._scene([3.0, 3.0], 1.0 / resolution, sides=sides, regions=[hole])
        inner = self._inner_loads(scene, resolution)
        return scene.replace(loads=[*inner, *scene.loads]) if inner else scene

    def _inner_loads(self, scene: Scene, resolution: int) -> list[dict[str, Any]]:
        """Return the loads on the hole's edge: none."""
        return []

    def points(self) -> Floats:
        """Return points on arcs half a radius and more away from the hole."""
        return polar_points((1.5, 2.0, 2.5), (0.0, 20.0, 45.0, 70.0, 90.0))


@dataclass(frozen=True)
class Kirsch(_Hole):
    """A plate with a free hole under tension S along x.

    φ = S/4 (z + 2a²/z), ψ = -S/2 (z + a²/z - a⁴/z³)
    (Kirsch 1898; Muskhelishvili, §56; Timoshenko & Goodier, §35).

    Attributes
    ----------
    tension : float
        S far from the hole (Pa).
    """

    tension: float = 1e6

    title: ClassVar[str] = "Kirsch's hole under tension"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §35"

    def potentials(self, z: Complex) -> Potentials:
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
    """A thick tube, 1 m to 4.24 m in radius, under pressure from inside; 3 m each way of it.

    φ = Az, ψ = B/z with 2A = pa²/(b² - a²) and B = -2Ab²
    (Lamé 1852; Muskhelishvili, §59; Timoshenko & Goodier, §28). The pressure acts on
    every step of the stair.

    Attributes
    ----------
    pressure : float
        Pa.
    """

    pressure: float = 1e6
    outer: ClassVar[float] = hypot(3.0, 3.0)

    title: ClassVar[str] = "Lamé's tube under pressure"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §28"

    def potentials(self, z: Complex) -> Potentials:
        """Return a uniform and a radial part."""
        pull = self.pressure * RADIUS**2 / (2 * (self.outer**2 - RADIUS**2))
        core = -2 * pull * self.outer**2
        return Potentials(
            phi=pull * z,
            phi_1=pull + 0 * z,
            phi_2=0 * z,
            psi=core / z,
            psi_1=-core / z**2,
        )

    def _inner_loads(self, scene: Scene, resolution: int) -> list[dict[str, Any]]:
        """Return the pressure on every face between the body and the hole."""
        kinds = scene.rasterise()[: resolution + 1, : resolution + 1]
        push = self.pressure / resolution
        loads = []
        for axis, side, force in ((0, "left", [push, 0.0]), (1, "bottom", [0.0, push])):
            solid = np.moveaxis(kinds, axis, 0) >= 0
            steps = np.argwhere(solid[1:] & ~solid[:-1])
            cells = steps[:, ::-1] if axis else steps
            cells[:, axis] += 1
            loads += [{"cell": cell.tolist(), "side": side, "force": force} for cell in cells]
        return loads
