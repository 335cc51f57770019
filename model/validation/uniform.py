"""Bodies in a uniform state of stress, which the grid represents exactly."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.moduli import moduli_of
from kaju.model.scene import Scene

from .problem import Quantity, ValidationProblem

EXACT: dict[Quantity, tuple[float, float]] = {
    "displacement": (inf, inf),
    "stress": (inf, inf),
}


@dataclass(frozen=True)
class UniformCompression(ValidationProblem):
    """A block between frictionless walls below and behind, pressed from above, free beside.

    Stress is -p along the load and zero across it; the block widens by Poisson's ratio
    (Timoshenko & Goodier, §6). In plane strain ν is ν/(1-ν) and E is E/(1-ν²).

    Attributes
    ----------
    dimension : {2, 3}
    pressure : float
        Pa.
    """

    dimension: int = 2
    pressure: float = 1e6

    title: ClassVar[str] = "Uniform compression"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions: ClassVar[tuple[int, ...]] = (4, 7)

    def __post_init__(self) -> None:
        if self.dimension == 3:
            object.__setattr__(self, "plane", None)

    def scene(self, resolution: int) -> Scene:
        """Return a square or cube of 1 m, `resolution` cells wide."""
        size = [1.0] * self.dimension
        pressed = {"side": "top", "pressure": self.pressure}
        return self._scene(size, 1.0 / resolution, sides=self._sides(), loads=[pressed])

    def _sides(self) -> dict[str, Any]:
        names = ("left", "bottom") if self.dimension == 2 else ("left", "front", "bottom")
        return dict.fromkeys(names, "roller")

    def points(self) -> Floats:
        """Return points all over the block, its surface included."""
        places = np.meshgrid(*[[0.0, 0.3, 0.55, 1.0]] * self.dimension)
        return np.stack([place.ravel() for place in places], axis=1)

    def exact_displacement(self, points: Floats) -> Floats:
        """Return the displacement (m), linear in the coordinates."""
        return np.asarray(points * self._stretch())

    def _stretch(self) -> Floats:
        """Return the strains along the axes."""
        stiffness, ratio = self.youngs_modulus, self.poissons_ratio
        if self.plane == "strain":
            stiffness, ratio = stiffness / (1 - ratio**2), ratio / (1 - ratio)
        strain = np.full(self.dimension, ratio)
        strain[-1] = -1.0
        return strain * self.pressure / stiffness

    def exact_stress(self, points: Floats) -> Floats:
        """Return stress tensors (Pa), the same everywhere."""
        return np.broadcast_to(
            self.hooke(np.diag(self._stretch())[None]),
            (len(points), self.dimension, self.dimension),
        )


@dataclass(frozen=True)
class ConfinedCompression(UniformCompression):
    """The same block between frictionless walls on every side: the oedometer.

    Strain is -p/C₁₁ along the load and zero across it; the walls bear p·C₁₂/C₁₁
    (Timoshenko & Goodier, §6).
    """

    title: ClassVar[str] = "Confined compression"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §6"

    def _sides(self) -> dict[str, Any]:
        beside = ("left", "right") if self.dimension == 2 else ("left", "right", "front", "back")
        return dict.fromkeys((*beside, "bottom"), "roller")

    def _stretch(self) -> Floats:
        constants = np.array([self.youngs_modulus]), np.array([self.poissons_ratio])
        strain = np.zeros(self.dimension)
        strain[-1] = -self.pressure / float(moduli_of(*constants, self.plane).stretch[0])
        return strain


@dataclass(frozen=True)
class PureShear(ValidationProblem):
    """A square glued to the ground with the same shear traction on its other sides.

    u_x = τy/μ and u_y = 0, so the ground's displacement is met as well
    (Timoshenko & Goodier, §6).

    Attributes
    ----------
    traction : float
        Pa.
    """

    traction: float = 1e6

    title: ClassVar[str] = "Pure shear"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions: ClassVar[tuple[int, ...]] = (4, 7)

    def scene(self, resolution: int) -> Scene:
        """Return a square of 1 m, `resolution` cells wide."""
        drag = self.traction
        loads = [
            {"side": "top", "force": [drag, 0.0]},
            {"side": "right", "force": [0.0, drag]},
            {"side": "left", "force": [0.0, -drag]},
        ]
        return self._scene([1.0, 1.0], 1.0 / resolution, sides={"bottom": "rigid"}, loads=loads)

    def points(self) -> Floats:
        """Return points inside the square and on its free sides."""
        x, y = np.meshgrid([0.0, 0.3, 0.55, 1.0], [0.3, 0.55, 1.0])
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def exact_displacement(self, points: Floats) -> Floats:
        """Return the displacement (m): planes that slide over each other."""
        modulus = self.youngs_modulus / (2 * (1 + self.poissons_ratio))
        return np.stack([self.traction / modulus * points[:, 1], 0 * points[:, 1]], axis=1)

    def exact_stress(self, points: Floats) -> Floats:
        """Return stress tensors (Pa), the same everywhere."""
        tensor = np.array([[0.0, self.traction], [self.traction, 0.0]])
        return np.broadcast_to(tensor, (len(points), 2, 2))
