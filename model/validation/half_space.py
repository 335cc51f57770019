"""Point forces on the surface of a half space, seen from far away.

The body is a block cut out of the half space; where symmetry does not hold its sides, they
move as the exact solution does. z points out of the body.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene import Scene

from .boundary import Floats
from .problem import Quantity, ValidationProblem

_STEP = 1e-30


@dataclass(frozen=True)
class _HalfSpace(ValidationProblem):
    """A block below the surface of a half space.

    Attributes
    ----------
    load : float
        Point force (N).
    """

    plane: Literal["stress", "strain"] | None = None
    load: float = 1e6

    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {
        "displacement": (1.7, 2.4),
        "stress": (1.5, 2.6),
    }
    resolutions: ClassVar[tuple[int, ...]] = (8, 12, 16)
    size: ClassVar[tuple[float, float, float]]
    origin: ClassVar[tuple[float, float, float]]

    @abstractmethod
    def _displacement(self, place: NDArray[Any]) -> NDArray[Any]:
        """Return 4πμ u for z into the body, shape (3, n); analytic in the place (3, n)."""

    def exact_displacement(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, 3)."""
        return np.asarray(self._moved(np.asarray(points, dtype=np.float64)))

    def _moved(self, points: NDArray[Any]) -> NDArray[Any]:
        flip = np.array([1.0, 1.0, -1.0])
        modulus = self.youngs_modulus / (2 * (1 + self.poissons_ratio))
        place = (flip * (points - np.asarray(self.origin))).T
        return np.asarray(flip * self._displacement(place).T / (4 * pi * modulus))

    def exact_stress(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) by Hooke's law.

        Derivatives are those of a step into the imaginary, which loses no digits
        (Squire & Trapp 1998, SIAM Review 40, 110-112).
        """
        gradient = np.empty((len(points), 3, 3))
        for axis in range(3):
            moved = np.asarray(points, dtype=np.complex128)
            moved[:, axis] += 1j * _STEP
            gradient[:, :, axis] = self._moved(moved).imag / _STEP
        return self.hooke(0.5 * (gradient + gradient.transpose(0, 2, 1)))


@dataclass(frozen=True)
class Boussinesq(_HalfSpace):
    """A force into the half space; a quarter of the body, 1 m each way.

    4πμ u_r = F[rz/ρ³ - (1-2ν) r/(ρ(ρ+z))], 4πμ u_z = F[z²/ρ³ + 2(1-ν)/ρ]
    (Johnson, Contact Mechanics, eq. 3.18).
    """

    title: ClassVar[str] = "Boussinesq's point force"
    source: ClassVar[str] = "Johnson, Contact Mechanics, §3.2"
    given_sides: ClassVar[tuple[str, ...]] = ("right", "back", "bottom")
    size: ClassVar[tuple[float, float, float]] = (1.0, 1.0, 1.0)
    origin: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)

    def scene(self, resolution: int) -> Scene:
        """Return the block, `resolution` cells along every edge."""
        load = {
            "cell": [0, 0, resolution - 1],
            "side": "top",
            "force": [0.0, 0.0, -self.load / 4],
        }
        sides = {"left": "roller", "front": "roller"}
        return self._scene(self.size, 1.0 / resolution, sides=sides, loads=[load])

    def points(self) -> Floats:
        """Return points at least half the block's depth away from the force."""
        return np.array(
            [
                [0.0, 0.0, 0.4],
                [0.5, 0.0, 0.75],
                [0.5, 0.5, 0.75],
                [0.25, 0.5, 0.25],
                [0.6, 0.6, 0.5],
            ]
        )

    def _displacement(self, place: NDArray[Any]) -> NDArray[Any]:
        x, y, z = place
        rho, ratio = np.sqrt(x**2 + y**2 + z**2), self.poissons_ratio
        radial = z / rho**3 - (1 - 2 * ratio) / (rho * (rho + z))
        down = z**2 / rho**3 + 2 * (1 - ratio) / rho
        return self.load * np.stack([x * radial, y * radial, down])


@dataclass(frozen=True)
class Cerruti(_HalfSpace):
    """A force along the surface, towards +x; half of the body, 2 m by 1 m by 1 m.

    Displacements of Johnson, Contact Mechanics, eq. 3.75.
    """

    title: ClassVar[str] = "Cerruti's point force"
    source: ClassVar[str] = "Johnson, Contact Mechanics, §3.6"
    given_sides: ClassVar[tuple[str, ...]] = ("left", "right", "back", "bottom")
    size: ClassVar[tuple[float, float, float]] = (2.0, 1.0, 1.0)
    origin: ClassVar[tuple[float, float, float]] = (1.0, 0.0, 1.0)

    def scene(self, resolution: int) -> Scene:
        """Return the block, `resolution` cells per metre."""
        loads = [
            {"cell": [column, 0, resolution - 1], "side": "top", "force": [self.load / 4, 0.0, 0.0]}
            for column in (resolution - 1, resolution)
        ]
        return self._scene(self.size, 1.0 / resolution, sides={"front": "roller"}, loads=loads)

    def points(self) -> Floats:
        """Return points at least half the block's depth away from the force."""
        return np.array(
            [
                [1.0, 0.0, 0.4],
                [1.5, 0.0, 0.75],
                [1.5, 0.5, 0.75],
                [0.75, 0.5, 0.25],
                [0.4, 0.6, 0.5],
            ]
        )

    def _displacement(self, place: NDArray[Any]) -> NDArray[Any]:
        x, y, z = place
        rho, free = np.sqrt(x**2 + y**2 + z**2), 1 - 2 * self.poissons_ratio
        deep = rho + z
        along = 1 / rho + x**2 / rho**3 + free * (1 / deep - x**2 / (rho * deep**2))
        across = x * y / rho**3 - free * x * y / (rho * deep**2)
        down = x * z / rho**3 + free * x / (rho * deep)
        return self.load * np.stack([along, across, down])
