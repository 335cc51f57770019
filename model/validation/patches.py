"""Linear displacement fields: the patch tests, and a rotation.

MacNeal & Harder (1985) deform a patch of skew elements. Cells of a pixel grid are squares,
so what remains of their test are its fields, its constants and its two ways to impose them:
displacements on the whole outline, or tractions. Tractions alone leave three (six) rigid
motions free, which they stop at single nodes; a face carries its normal displacement only,
so here tractions act on half of the outline and the other half is held where it belongs.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar, Literal

import numpy as np

from kaju.arrays import Floats
from kaju.model.scene import Scene

from .problem import Quantity, ValidationProblem
from .uniform import EXACT

Matrix = tuple[tuple[float, ...], ...]
MACNEAL_HARDER = "MacNeal & Harder 1985, Finite Elements in Analysis and Design 1, 3-20"


@dataclass(frozen=True)
class LinearField(ValidationProblem):
    """A block in which the displacement is G·x, given on the whole outline.

    Attributes
    ----------
    gradient : tuple of tuples
        G, dimension × dimension.
    size : tuple of float
        Edges of the block (m).
    """

    youngs_modulus: float = 1e6
    poissons_ratio: float = 0.25
    plane: Literal["stress", "strain"] | None = "stress"
    gradient: Matrix = ((1e-3, 5e-4), (5e-4, 1e-3))
    size: tuple[float, ...] = (0.24, 0.12)

    title: ClassVar[str] = "Linear displacement"
    source: ClassVar[str] = MACNEAL_HARDER
    orders = EXACT
    resolutions: ClassVar[tuple[int, ...]] = (4, 6)
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

    title: ClassVar[str] = "Patch test, displacements"


@dataclass(frozen=True)
class ForcePatch(LinearField):
    """The same patch under its tractions on the right and above."""

    title: ClassVar[str] = "Patch test, tractions"
    given_sides: ClassVar[tuple[str, ...]] = ("left", "bottom")
    loaded_sides: ClassVar[tuple[str, ...]] = ("right", "top")


@dataclass(frozen=True)
class SolidDisplacementPatch(LinearField):
    """Solid patch: u = 10⁻³(x + y/2 + z/2) and so on: σ_xx = 2000 and σ_xy = 400 each."""

    plane: Literal["stress", "strain"] | None = None
    gradient: Matrix = ((1e-3, 5e-4, 5e-4), (5e-4, 1e-3, 5e-4), (5e-4, 5e-4, 1e-3))
    size: tuple[float, ...] = (1.0, 1.0, 1.0)

    title: ClassVar[str] = "Solid patch test, displacements"
    given_sides: ClassVar[tuple[str, ...]] = ("left", "right", "front", "back", "bottom", "top")


@dataclass(frozen=True)
class SolidForcePatch(SolidDisplacementPatch):
    """The solid patch under its tractions on the right, behind and above."""

    title: ClassVar[str] = "Solid patch test, tractions"
    given_sides: ClassVar[tuple[str, ...]] = ("left", "front", "bottom")
    loaded_sides: ClassVar[tuple[str, ...]] = ("right", "back", "top")


@dataclass(frozen=True)
class RigidRotation(LinearField):
    """A small turn of the outline, u = θ(-y, x): no strain, no energy.

    The linear strain measures turns to first order only: the finite turn by θ, which
    `finite` imposes, shows as a uniform shortening by 1 - cos θ (Timoshenko & Goodier, ch. 7).

    Attributes
    ----------
    angle : float
        θ in radians.
    finite : bool
        Whether points move on arcs, (R - 1)·x, instead of on tangents.
    """

    angle: float = 1e-2
    finite: bool = False

    title: ClassVar[str] = "Rigid rotation"
    source: ClassVar[str] = "Timoshenko & Goodier, Theory of Elasticity, ch. 7"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {"displacement": (inf, inf)}

    def __post_init__(self) -> None:
        sine, shortening = self.angle, 0.0
        if self.finite:
            sine, shortening = float(np.sin(self.angle)), float(np.cos(self.angle) - 1.0)
        object.__setattr__(self, "gradient", ((shortening, -sine), (sine, shortening)))
