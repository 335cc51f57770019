"""Plane elasticity by two analytic functions of z = x + iy.

Kolosov's formulas (Muskhelishvili, Some Basic Problems of the Mathematical Theory of
Elasticity, §32; Timoshenko & Goodier, Theory of Elasticity, 3rd ed., ch. 6)::

    σ_xx + σ_yy          = 4 Re φ'
    σ_yy - σ_xx + 2i σ_xy = 2 (z̄ φ'' + ψ')
    2μ (u + iv)          = κ φ - z φ̄' - ψ̄

with κ = 3 - 4ν in plane strain and (3 - ν)/(1 + ν) in plane stress.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .known_problem import KnownProblem


class Potentials(NamedTuple):
    """Values of φ, φ', φ'', ψ and ψ' at points z."""

    phi: Any
    phi_1: Any
    phi_2: Any
    psi: Any
    psi_1: Any


@dataclass(frozen=True)
class PlaneProblem(KnownProblem):
    """A plane problem that is solved by potentials."""

    origin: ClassVar[tuple[float, float]] = (0.0, 0.0)
    """Where the solution's own origin lies in the scene (m)."""

    @abstractmethod
    def potentials(self, z):
        """Return the potentials at z = x + iy, counted from `origin`."""

    @property
    def kappa(self):
        """Kolosov's constant κ."""
        ratio = self.poissons_ratio
        return 3 - 4 * ratio if self.plane == "strain" else (3 - ratio) / (1 + ratio)

    def exact_displacement(self, points):
        z = self._z(points)
        p = self.potentials(z)
        u = self.kappa * p.phi - z * np.conj(p.phi_1) - np.conj(p.psi)
        u /= 2 * self.shear_modulus
        return np.stack([u.real, u.imag], axis=1)

    def exact_stress(self, points):
        z = self._z(points)
        p = self.potentials(z)
        total = 4 * p.phi_1.real
        deviation = 2 * (np.conj(z) * p.phi_2 + p.psi_1)
        stress = np.empty((len(z), 2, 2))
        stress[:, 0, 0] = 0.5 * (total - deviation.real)
        stress[:, 1, 1] = 0.5 * (total + deviation.real)
        stress[:, 0, 1] = stress[:, 1, 0] = 0.5 * deviation.imag
        return stress

    def _z(self, points):
        x, y = (np.asarray(points, dtype=np.float64) - self.origin).T
        return x + 1j * y


def polar_points(radii, degrees, origin=(0.0, 0.0)):
    """Return points on rays from an origin, shape (n, 2)."""
    radius, angle = np.meshgrid(radii, np.deg2rad(degrees))
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([x.ravel(), y.ravel()], axis=1) + origin
