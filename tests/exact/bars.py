"""A bar of two materials, one behind the other, and a narrow beam bent by a force at its end."""

from dataclasses import dataclass

import numpy as np

from kaju import Scene

from .known_problem import MATERIAL, KnownProblem, grid_points, moduli_of
from .potentials import PlaneProblem, Potentials
from .uniform_fields import EXACT

SECOND = "second"
BEAM_ORDERS = {"displacement": (1.8, 2.2), "stress": (1.8, 2.3)}


@dataclass(frozen=True)
class BimaterialBar(KnownProblem):
    """Two materials in a frictionless sleeve, pressed together by a pressure (Pa) at the end.

    The stress along the bar is -p in both; each part shortens by p/C₁₁ of its own, so the
    displacement is linear with a kink where they meet (Timoshenko & Goodier, §6). Across
    the bar each presses on the sleeve by p·C₁₂/C₁₁.
    """

    contrast: float = 1e3
    """Young's modulus of the second material over that of the first."""
    second_ratio: float = 0.1
    """Poisson's ratio of the second material."""
    pressure: float = 1e6

    title = "Bimaterial bar"
    source = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions = (4, 10)

    def scene(self, resolution):
        """Return a bar of 2 m by 1/2 m, `resolution` (even) cells per metre."""
        (first, second), ratios = self._constants()
        return Scene(
            body={
                "cell_size": 1.0 / resolution,
                "cells": [2 * resolution, resolution // 2],
                "material": MATERIAL,
                "plane": self.plane,
                "thickness": 1.0,
                "regions": [{"material": SECOND, "box": [[1.0, 0.0], [2.0, 0.5]]}],
            },
            materials={
                MATERIAL: {"youngs_modulus": first, "poissons_ratio": ratios[0]},
                SECOND: {"youngs_modulus": second, "poissons_ratio": ratios[1]},
            },
            sides={"left": "roller", "bottom": "roller", "top": "roller"},
            loads=[{"side": "right", "pressure": self.pressure}],
        )

    def _constants(self):
        moduli = np.array([1.0, self.contrast]) * self.youngs_modulus
        return moduli, np.array([self.poissons_ratio, self.second_ratio])

    def points(self):
        """Return points in both materials and where they meet."""
        return grid_points([0.0, 0.3, 0.9, 1.1, 1.55, 2.0], [0.0, 0.2, 0.5])

    def exact_displacement(self, points):
        stiff, _ = moduli_of(*self._constants(), self.plane)
        first, second = np.minimum(points[:, 0], 1.0), np.maximum(points[:, 0] - 1.0, 0.0)
        along = -self.pressure * (first / stiff[0] + second / stiff[1])
        return np.stack([along, np.zeros(len(points))], axis=1)

    def exact_stress(self, points):
        stretch, lateral = moduli_of(*self._constants(), self.plane)
        stress = np.zeros((len(points), 2, 2))
        stress[:, 0, 0] = -self.pressure
        stress[:, 1, 1] = -self.pressure * (lateral / stretch)[(points[:, 0] > 1.0).astype(int)]
        return stress


@dataclass(frozen=True)
class TimoshenkoCantilever(PlaneProblem):
    """Cantilever of 4 m by 1 m under a parabolic shear traction at its left end.

    σ_xx = -Pxy/I and σ_xy = -P(c² - y²)/2I, with x from the loaded end, y from the axis,
    c half the height and I = 2c³/3. The right end is held as this solution moves: fixed in
    its middle, free to warp (Augarde & Deeks 2008, Finite Elements in Analysis and Design
    44, 595-601, warn that a fully clamped end has another, singular solution).
    """

    plane: str | None = "stress"
    load: float = 1e3
    """P per unit thickness (N/m)."""

    title = "Timoshenko cantilever"
    source = "Timoshenko & Goodier, Theory of Elasticity, §21"
    orders = BEAM_ORDERS
    resolutions = (8, 16, 32)
    given_sides = ("right",)
    loaded_sides = ("left",)
    origin = (0.0, 0.5)
    length = 4.0

    def scene(self, resolution):
        """Return the beam, `resolution` cells high."""
        return self._scene([self.length, 1.0], 1.0 / resolution)

    def points(self):
        """Return points on the axis and off it, along the whole beam."""
        return grid_points([0.5, 1.0, 2.0, 3.0, 3.5], [0.125, 0.25, 0.5, 0.75, 0.875])

    def potentials(self, z):
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
