"""Fields that the grid represents exactly: uniform stress, the patch tests, and a rotation.

MacNeal & Harder (1985) deform a patch of skew elements. Cells of a pixel grid are squares,
so what remains of their test are its fields, its constants and its two ways to impose them:
displacements on the whole outline, or tractions. Tractions alone leave three (six) rigid
motions free, which they stop at single nodes; a face carries its normal displacement only,
so here tractions act on half of the outline and the other half is held where it belongs.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar, Literal

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.moduli import moduli_of
from kaju.model.scene import Scene

from .known_problem import KnownProblem, Orders

EXACT: Orders = {"displacement": (inf, inf), "stress": (inf, inf)}


@dataclass(frozen=True)
class UniformCompression(KnownProblem):
    """A block between frictionless walls below and behind, pressed from above, free beside.

    Stress is -p along the load and zero across it; the block widens by Poisson's ratio
    (Timoshenko & Goodier, §6). In plane strain ν is ν/(1-ν) and E is E/(1-ν²).
    """

    dimension: int = 2
    pressure: float = 1e6
    """Pa."""

    title = "Uniform compression"
    source = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions = (4, 7)

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

    title = "Confined compression"
    source = "Timoshenko & Goodier, Theory of Elasticity, §6"

    def _sides(self) -> dict[str, Any]:
        beside = ("left", "right") if self.dimension == 2 else ("left", "right", "front", "back")
        return dict.fromkeys((*beside, "bottom"), "roller")

    def _stretch(self) -> Floats:
        constants = np.array([self.youngs_modulus]), np.array([self.poissons_ratio])
        strain = np.zeros(self.dimension)
        strain[-1] = -self.pressure / float(moduli_of(*constants, self.plane).stretch[0])
        return strain


@dataclass(frozen=True)
class PureShear(KnownProblem):
    """A square glued to the ground with the same shear traction on its other sides.

    u_x = τy/μ and u_y = 0, so the ground's displacement is met as well
    (Timoshenko & Goodier, §6).
    """

    traction: float = 1e6
    """Pa."""

    title = "Pure shear"
    source = "Timoshenko & Goodier, Theory of Elasticity, §6"
    orders = EXACT
    resolutions = (4, 7)

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


Matrix = tuple[tuple[float, ...], ...]
MACNEAL_HARDER = "MacNeal & Harder 1985, Finite Elements in Analysis and Design 1, 3-20"


@dataclass(frozen=True)
class LinearField(KnownProblem):
    """A block in which the displacement is G·x, given on the whole outline."""

    youngs_modulus: float = 1e6
    poissons_ratio: float = 0.25
    plane: Literal["stress", "strain"] | None = "stress"
    gradient: Matrix = ((1e-3, 5e-4), (5e-4, 1e-3))
    """G, dimension × dimension."""
    size: tuple[float, ...] = (0.24, 0.12)
    """Edges of the block (m)."""

    title = "Linear displacement"
    source = MACNEAL_HARDER
    orders = EXACT
    resolutions = (4, 6)
    given_sides: ClassVar[tuple[str, ...]] = ("left", "right", "bottom", "top")

    def scene(self, resolution: int) -> Scene:
        """Return the block, `resolution` cells along its shortest edge."""
        return self._scene(self.size, min(self.size) / resolution, sides={})

    def points(self) -> Floats:
        """Return points inside the block; on its outline the answer is given."""
        places = np.meshgrid(*[[0.3, 0.55, 0.7]] * len(self.size))
        shares = np.stack([place.ravel() for place in places], axis=1)
        return np.asarray(shares * np.asarray(self.size))

    def exact_displacement(self, points: Floats) -> Floats:
        """Return the displacement (m), G·x."""
        return np.asarray(points @ np.asarray(self.gradient).T)

    def exact_stress(self, points: Floats) -> Floats:
        """Return stress tensors (Pa), the same everywhere."""
        gradient = np.asarray(self.gradient)
        stress = self.hooke(0.5 * (gradient + gradient.T)[None])
        return np.broadcast_to(stress, (len(points), *gradient.shape))


@dataclass(frozen=True)
class DisplacementPatch(LinearField):
    """Membrane patch: u = 10⁻³(x + y/2), v = 10⁻³(y + x/2) on the whole outline.

    With E = 10⁶ and ν = 1/4 in plane stress: σ_xx = σ_yy = 1333.3 and σ_xy = 400.
    """

    title = "Patch test, displacements"


@dataclass(frozen=True)
class ForcePatch(LinearField):
    """The same patch under its tractions on the right and above."""

    title = "Patch test, tractions"
    given_sides = ("left", "bottom")
    loaded_sides = ("right", "top")


@dataclass(frozen=True)
class SolidDisplacementPatch(LinearField):
    """Solid patch: u = 10⁻³(x + y/2 + z/2) and so on: σ_xx = 2000 and σ_xy = 400 each."""

    plane: Literal["stress", "strain"] | None = None
    gradient: Matrix = ((1e-3, 5e-4, 5e-4), (5e-4, 1e-3, 5e-4), (5e-4, 5e-4, 1e-3))
    size: tuple[float, ...] = (1.0, 1.0, 1.0)

    title = "Solid patch test, displacements"
    given_sides: ClassVar[tuple[str, ...]] = ("left", "right", "front", "back", "bottom", "top")


@dataclass(frozen=True)
class SolidForcePatch(SolidDisplacementPatch):
    """The solid patch under its tractions on the right, behind and above."""

    title = "Solid patch test, tractions"
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

    title = "Rigid rotation"
    source = "Timoshenko & Goodier, Theory of Elasticity, ch. 7"
    orders: ClassVar[Orders] = {"displacement": (inf, inf)}

    def __post_init__(self) -> None:
        sine, shortening = self.angle, 0.0
        if self.finite:
            sine, shortening = float(np.sin(self.angle)), float(np.cos(self.angle) - 1.0)
        object.__setattr__(self, "gradient", ((shortening, -sine), (sine, shortening)))
