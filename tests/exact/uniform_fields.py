"""Fields that the grid represents exactly: uniform stress, the patch tests, and a rotation.

Of the patch test of MacNeal & Harder (1985) its fields, its constants, and displacements on the
whole outline, or tractions on half of it: a face carries its normal displacement only.
"""

from dataclasses import dataclass
from math import inf

import numpy as np

from .known_problem import KnownProblem, grid_points, moduli_of

EXACT = {"displacement": (inf, inf), "stress": (inf, inf)}
DISPLACEMENT = {"displacement": (inf, inf)}


@dataclass(frozen=True)
class UniformCompression(KnownProblem):
    """A block between frictionless walls below and behind, pressed (Pa) from above, free beside.

    Stress is -p along the load and zero across it; the block widens by Poisson's ratio
    (Timoshenko & Goodier, §6). In plane strain ν is ν/(1-ν) and E is E/(1-ν²).
    """

    dimension: int = 2
    pressure: float = 1e6

    source = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions = (4, 7)

    def __post_init__(self):
        if self.dimension == 3:
            object.__setattr__(self, "plane", None)

    def scene(self, resolution):
        """Return a square or cube of 1 m, `resolution` cells wide."""
        size = [1.0] * self.dimension
        pressed = {"side": "top", "pressure": self.pressure}
        sides = dict.fromkeys(self._held(), "roller")
        return self._scene(size, 1.0 / resolution, sides=sides, loads=[pressed])

    def _held(self):
        return ("left", "bottom") if self.dimension == 2 else ("left", "front", "bottom")

    def points(self):
        """Return points all over the block, its surface included."""
        return grid_points(*[[0.0, 0.3, 0.55, 1.0]] * self.dimension)

    def exact_displacement(self, points):
        return points * self._stretch()

    def _stretch(self):
        """Return the strains along the axes."""
        stiffness, ratio = self.youngs_modulus, self.poissons_ratio
        if self.plane == "strain":
            stiffness, ratio = stiffness / (1 - ratio**2), ratio / (1 - ratio)
        strain = np.full(self.dimension, ratio)
        strain[-1] = -1.0
        return strain * self.pressure / stiffness

    def exact_stress(self, points):
        stress = self.hooke(np.diag(self._stretch())[None])
        return np.broadcast_to(stress, (len(points), self.dimension, self.dimension))


@dataclass(frozen=True)
class ConfinedCompression(UniformCompression):
    """The same block between frictionless walls on every side: the oedometer.

    Strain is -p/C₁₁ along the load and zero across it; the walls bear p·C₁₂/C₁₁
    (Timoshenko & Goodier, §6).
    """

    def _held(self):
        beside = ("left", "right") if self.dimension == 2 else ("left", "right", "front", "back")
        return (*beside, "bottom")

    def _stretch(self):
        stretch, _ = moduli_of(self.youngs_modulus, self.poissons_ratio, self.plane)
        strain = np.zeros(self.dimension)
        strain[-1] = -self.pressure / stretch
        return strain


@dataclass(frozen=True)
class LinearField(KnownProblem):
    """A block in which the displacement is G·x, given on the whole outline."""

    youngs_modulus: float = 1e6
    poissons_ratio: float = 0.25
    plane: str | None = "stress"
    gradient: tuple = ((1e-3, 5e-4), (5e-4, 1e-3))
    """G, dimension × dimension."""
    size: tuple[float, ...] = (0.24, 0.12)
    """Edges of the block (m)."""

    source = "MacNeal & Harder 1985, Finite Elements in Analysis and Design 1, 3-20"
    orders = EXACT
    resolutions = (4, 6)
    given_sides = ("left", "right", "bottom", "top")

    def scene(self, resolution):
        """Return the block, `resolution` cells along its shortest edge."""
        return self._scene(self.size, min(self.size) / resolution)

    def points(self):
        """Return points inside the block; on its outline the answer is given."""
        return grid_points(*[[0.3, 0.55, 0.7]] * len(self.size)) * self.size

    def exact_displacement(self, points):
        return points @ np.asarray(self.gradient).T

    def exact_stress(self, points):
        gradient = np.asarray(self.gradient)
        stress = self.hooke(0.5 * (gradient + gradient.T)[None])
        return np.broadcast_to(stress, (len(points), *gradient.shape))


@dataclass(frozen=True)
class DisplacementPatch(LinearField):
    """Membrane patch: u = 10⁻³(x + y/2), v = 10⁻³(y + x/2) on the whole outline.

    With E = 10⁶ and ν = 1/4 in plane stress: σ_xx = σ_yy = 1333.3 and σ_xy = 400.
    """


@dataclass(frozen=True)
class ForcePatch(LinearField):
    """The same patch under its tractions on the right and above."""

    given_sides = ("left", "bottom")
    loaded_sides = ("right", "top")


@dataclass(frozen=True)
class SolidDisplacementPatch(LinearField):
    """Solid patch: u = 10⁻³(x + y/2 + z/2) and so on: σ_xx = 2000 and σ_xy = 400 each."""

    plane: str | None = None
    gradient: tuple = ((1e-3, 5e-4, 5e-4), (5e-4, 1e-3, 5e-4), (5e-4, 5e-4, 1e-3))
    size: tuple[float, ...] = (1.0, 1.0, 1.0)

    given_sides = ("left", "right", "front", "back", "bottom", "top")


@dataclass(frozen=True)
class SolidForcePatch(SolidDisplacementPatch):
    """The solid patch under its tractions on the right, behind and above."""

    given_sides = ("left", "front", "bottom")
    loaded_sides = ("right", "back", "top")


@dataclass(frozen=True)
class RigidRotation(LinearField):
    """A small turn of the outline, u = θ(-y, x): no strain, no energy.

    The linear strain measures turns to first order only: the finite turn by θ, which
    `finite` imposes, shows as a uniform shortening by 1 - cos θ (Timoshenko & Goodier, ch. 7).
    """

    angle: float = 1e-2
    """θ in radians."""
    finite: bool = False
    """Whether points move on arcs, (R - 1)·x, instead of on tangents."""

    source = "Timoshenko & Goodier, Theory of Elasticity, ch. 7"
    orders = DISPLACEMENT

    def __post_init__(self):
        sine, shortening = self.angle, 0.0
        if self.finite:
            sine, shortening = float(np.sin(self.angle)), float(np.cos(self.angle) - 1.0)
        object.__setattr__(self, "gradient", ((shortening, -sine), (sine, shortening)))
