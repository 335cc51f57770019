"""A narrow beam, bent by a shear force at its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from kaju.model.scene import Scene

from .boundary import Floats
from .potentials import Complex, PlaneProblem, Potentials
from .problem import Quantity


@dataclass(frozen=True)
class TimoshenkoCantilever(PlaneProblem):
    """Cantilever of 4 m by 1 m under a parabolic shear traction at its left end.

    σ_xx = -Pxy/I and σ_xy = -P(c² - y²)/2I, with x from the loaded end, y from the axis,
    c half the height and I = 2c³/3. The right end is held as this solution moves: fixed in
    its middle, free to warp (Augarde & Deeks 2008, Finite Elements in Analysis and Design
    44, 595-601, warn that a fully clamped end has another, singular solution).

    Attributes
    ----------
    load : float
        P per unit thickness (N/m).
    """

    plane: Literal["stress", "strain"] | None = "stress"
    load: float = 1e3

    title: ClassVar[str] = "Timoshenko cantilever"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §21"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {
        "displacement": (1.8, 2.2),
        "stress": (1.8, 2.3),
    }
    resolutions: ClassVar[tuple[int, ...]] = (8, 16, 32)
    given_sides: ClassVar[tuple[str, ...]] = ("right",)
    loaded_sides: ClassVar[tuple[str, ...]] = ("left",)
    origin: ClassVar[tuple[float, float]] = (0.0, 0.5)
    length: ClassVar[float] = 4.0

    def scene(self, resolution: int) -> Scene:
        """Return the beam, `resolution` cells high."""
        return self._scene([self.length, 1.0], 1.0 / resolution, sides={})

    def points(self) -> Floats:
        """Return points on the axis and off it, along the whole beam."""
        x, y = np.meshgrid([0.5, 1.0, 2.0, 3.0, 3.5], [0.125, 0.25, 0.5, 0.75, 0.875])
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def potentials(self, z: Complex) -> Potentials:
        """Return cubic potentials, and the rigid motion that holds the axis at the right end."""
        c, length, k = 0.5, self.length, self.kappa
        unit = 1j * self.load / (24 * (2 * c**3 / 3))
        turn = -unit * (3 * length**2 - 12 * c**2 / (k + 1))
        shift = -(unit * ((k + 1) * length**3 - 12 * c**2 * length) + turn * length * (k + 1)) / k
        return Potentials(
            phi=unit * z**3 + turn * z + shift,
            phi_1=3 * unit * z**2 + turn,
            phi_2=6 * unit * z,
            psi=-unit * (12 * c**2 * z + 2 * z**3),
            psi_1=-unit * (12 * c**2 + 6 * z**2),
        )
