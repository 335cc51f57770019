"""A bar of two materials, one behind the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kaju.model.elastic.moduli import moduli_of
from kaju.model.scene import Scene

from .boundary import Floats
from .problem import MATERIAL, ValidationProblem
from .uniform import EXACT

SECOND = "second"


@dataclass(frozen=True)
class BimaterialBar(ValidationProblem):
    """Two materials in a frictionless sleeve, pressed together by a pressure at the end.

    The stress along the bar is -p in both; each part shortens by p/C₁₁ of its own, so the
    displacement is linear with a kink where they meet (Timoshenko & Goodier, §6). Across
    the bar each presses on the sleeve by p·C₁₂/C₁₁.

    Attributes
    ----------
    contrast : float
        Young's modulus of the second material over that of the first.
    second_ratio : float
        Poisson's ratio of the second material.
    pressure : float
        Pa.
    """

    contrast: float = 1e3
    second_ratio: float = 0.1
    pressure: float = 1e6

    title: ClassVar[str] = "Bimaterial bar"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions: ClassVar[tuple[int, ...]] = (4, 10)

    def scene(self, resolution: int) -> Scene:
        """Return a bar of 2 m by 1/2 m, `resolution` (even) cells per metre."""
        body = {
            "cell_size": 1.0 / resolution,
            "cells": [2 * resolution, resolution // 2],
            "material": MATERIAL,
            "plane": self.plane,
            "thickness": 1.0,
            "regions": [{"material": SECOND, "box": [[1.0, 0.0], [2.0, 0.5]]}],
        }
        (first, second), ratios = self._constants()
        return Scene(
            body=body,
            materials={
                MATERIAL: {"youngs_modulus": first, "poissons_ratio": ratios[0]},
                SECOND: {"youngs_modulus": second, "poissons_ratio": ratios[1]},
            },
            sides={"left": "roller", "bottom": "roller", "top": "roller"},
            loads=[{"side": "right", "pressure": self.pressure}],
        )

    def _constants(self) -> tuple[Floats, Floats]:
        moduli = np.array([1.0, self.contrast]) * self.youngs_modulus
        return moduli, np.array([self.poissons_ratio, self.second_ratio])

    def points(self) -> Floats:
        """Return points in both materials and where they meet."""
        x, y = np.meshgrid([0.0, 0.3, 0.9, 1.1, 1.55, 2.0], [0.0, 0.2, 0.5])
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def exact_displacement(self, points: Floats) -> Floats:
        """Return the displacement (m), linear in each material."""
        stiff = moduli_of(*self._constants(), self.plane).stretch
        first, second = np.minimum(points[:, 0], 1.0), np.maximum(points[:, 0] - 1.0, 0.0)
        along = -self.pressure * (first / stiff[0] + second / stiff[1])
        return np.stack([along, np.zeros(len(points))], axis=1)

    def exact_stress(self, points: Floats) -> Floats:
        """Return stress tensors (Pa), uniform in each material."""
        stretch, lateral, _ = moduli_of(*self._constants(), self.plane)
        across = (lateral / stretch)[(points[:, 0] > 1.0).astype(int)]
        stress = np.zeros((len(points), 2, 2))
        stress[:, 0, 0] = -self.pressure
        stress[:, 1, 1] = -self.pressure * across
        return stress
