"""Loads on the straight edge of a half plane, and what they do far below.

The body is the part of the half plane that lies within 3 m of the load. Symmetry holds the
left side; on the other cuts the exact traction or displacement acts.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar

import numpy as np

from kaju.model.scene import Scene

from .boundary import Floats
from .potentials import Complex, PlaneProblem, Potentials, polar_points
from .problem import Quantity


@dataclass(frozen=True)
class _HalfPlane(PlaneProblem):
    """The right half of a block 6 m wide and 3 m deep, cut out below the edge y = 0."""

    given_sides: ClassVar[tuple[str, ...]] = ("bottom",)
    loaded_sides: ClassVar[tuple[str, ...]] = ("right",)
    origin: ClassVar[tuple[float, float]] = (0.0, 3.0)

    @abstractmethod
    def _load(self, resolution: int) -> dict[str, Any]:
        """Return the load on the edge."""

    def scene(self, resolution: int) -> Scene:
        """Return the block, `resolution` cells per metre."""
        return self._scene(
            [3.0, 3.0],
            1.0 / resolution,
            sides={"left": "roller"},
            loads=[self._load(resolution)],
        )


@dataclass(frozen=True)
class StripLoad(_HalfPlane):
    """Uniform pressure on a strip 2 m wide.

    Potentials are those of point forces, summed over the strip: φ' = (ip/2π) ln((z+a)/(z-a)),
    ψ = φ - zφ' (Timoshenko & Goodier, §37, by other means).

    Attributes
    ----------
    pressure : float
        Pa.
    """

    pressure: float = 1e6

    title: ClassVar[str] = "Strip load on a half plane"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §37"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {
        "displacement": (1.8, 2.3),
        "stress": (1.8, 2.3),
    }
    resolutions: ClassVar[tuple[int, ...]] = (8, 16, 32)

    def _load(self, resolution: int) -> dict[str, Any]:
        return {"region": {"box": [[0.0, 3.0], [1.0, 3.0]]}, "pressure": self.pressure}

    def points(self) -> Floats:
        """Return points below the strip and beside it."""
        x, y = np.meshgrid([0.0, 0.5, 1.0, 1.5, 2.0], [1.0, 1.5, 2.0, 2.5])
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def potentials(self, z: Complex) -> Potentials:
        """Return the potentials of the strip."""
        unit = 1j * self.pressure / (2 * pi)
        right, left = z + 1.0, z - 1.0
        phi = unit * (right * _log_below(right) - left * _log_below(left))
        phi_1 = unit * (_log_below(right) - _log_below(left))
        phi_2 = unit * (1 / right - 1 / left)
        return Potentials(phi, phi_1, phi_2, phi - z * phi_1, -z * phi_2)


@dataclass(frozen=True)
class Flamant(_HalfPlane):
    """A point force on the edge, seen from at least 1.5 m away.

    φ' = -F/2πz and ψ' = F̄/2πz with F = X + iY (Flamant 1892; Timoshenko & Goodier, §36). The grid
    spreads the force over two cells, which is not felt far away but to second order.

    Attributes
    ----------
    load : float
        Force downwards per unit thickness (N/m).
    """

    load: float = 1e6

    title: ClassVar[str] = "Flamant's point force"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §36"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {
        "displacement": (1.8, 2.3),
        "stress": (1.8, 2.3),
    }
    resolutions: ClassVar[tuple[int, ...]] = (8, 16, 32)

    def _load(self, resolution: int) -> dict[str, Any]:
        return {"cell": [0, 3 * resolution - 1], "side": "top", "force": [0.0, -self.load / 2]}

    def points(self) -> Floats:
        """Return points on arcs round the force."""
        return polar_points((1.5, 2.0, 2.5), (-90.0, -70.0, -50.0, -30.0), self.origin)

    def potentials(self, z: Complex) -> Potentials:
        """Return logarithms."""
        unit = 1j * self.load / (2 * pi)
        log = unit * _log_below(z)
        return Potentials(log, unit / z, -unit / z**2, log, unit / z)


def _log_below(z: Complex) -> Complex:
    """Return ln iz, continuous on the closed lower half plane and real below the origin."""
    return np.asarray(np.log(1j * z))
