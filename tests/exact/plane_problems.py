"""Plane problems by two potentials: a beam, a pressed edge, holes, and a corner that opens.

The bodies are cut out of larger ones; on the cuts the exact displacement or traction acts. Where
an edge is round, the grid makes a stair of it, whose radius is off by a share of a cell.

Kolosov's formulas (Muskhelishvili, Some Basic Problems of the Mathematical Theory of
Elasticity, §32; Timoshenko & Goodier, Theory of Elasticity, 3rd ed., ch. 6)::

    σ_xx + σ_yy          = 4 Re φ'
    σ_yy - σ_xx + 2i σ_xy = 2 (z̄ φ'' + ψ')
    2μ (u + iv)          = κ φ - z φ̄' - ψ̄

with κ = 3 - 4ν in plane strain and (3 - ν)/(1 + ν) in plane stress.
"""

from abc import abstractmethod
from dataclasses import dataclass
from math import hypot, pi
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .known_problem import SECOND_ORDER, KnownProblem, grid_points


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


BEAM_ORDERS = {"displacement": (1.8, 2.2), "stress": (1.8, 2.3)}


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


@dataclass(frozen=True)
class StripLoad(PlaneProblem):
    """Uniform pressure (Pa) on a strip 2 m wide; the right half of a block 6 m wide and 3 m deep.

    Potentials are those of point forces, summed over the strip: φ' = (ip/2π) ln((z+a)/(z-a)),
    ψ = φ - zφ' (Timoshenko & Goodier, §37, by other means).
    """

    pressure: float = 1e6

    source = "Timoshenko & Goodier, Theory of Elasticity, §37"
    orders = SECOND_ORDER
    resolutions = (8, 16, 32)

    given_sides = ("bottom",)
    loaded_sides = ("right",)
    origin = (0.0, 3.0)

    def scene(self, resolution):
        """Return the block, `resolution` cells per metre."""
        load = {"region": {"box": [[0.0, 3.0], [1.0, 3.0]]}, "pressure": self.pressure}
        return self._scene([3.0, 3.0], 1.0 / resolution, sides={"left": "roller"}, loads=[load])

    def points(self):
        """Return points below the strip and beside it."""
        return grid_points([0.0, 0.5, 1.0, 1.5, 2.0], [1.0, 1.5, 2.0, 2.5])

    def potentials(self, z):
        """Return the potentials of the strip."""
        unit = 1j * self.pressure / (2 * pi)
        right, left = z + 1.0, z - 1.0
        phi = unit * (right * _log_below(right) - left * _log_below(left))
        phi_1 = unit * (_log_below(right) - _log_below(left))
        phi_2 = unit * (1 / right - 1 / left)
        return Potentials(phi, phi_1, phi_2, phi - z * phi_1, -z * phi_2)


def _log_below(z):
    """Return ln iz, continuous on the closed lower half plane and real below the origin."""
    return np.log(1j * z)


STAIR = {"displacement": (0.7, 1.4), "stress": (0.7, 1.5)}
RADIUS = 1.0


@dataclass(frozen=True)
class _Hole(PlaneProblem):
    """A quarter of a plate, 3 m wide, with a hole of radius 1 m in its middle."""

    orders = STAIR
    resolutions = (8, 12, 16, 20, 24, 32, 48)
    loaded_sides = ("right", "top")

    def scene(self, resolution):
        """Return the plate, `resolution` cells per radius."""
        hole = {"material": "air", "disk": {"centre": [0.0, 0.0], "radius": RADIUS}}
        sides = {"left": "roller", "bottom": "roller"}
        return self._scene([3.0, 3.0], 1.0 / resolution, sides=sides, regions=[hole])

    def points(self):
        """Return points on arcs half a radius and more away from the hole."""
        return polar_points((1.5, 2.0, 2.5), (0.0, 20.0, 45.0, 70.0, 90.0))


@dataclass(frozen=True)
class Kirsch(_Hole):
    """A plate with a free hole under tension S along x.

    φ = S/4 (z + 2a²/z), ψ = -S/2 (z + a²/z - a⁴/z³)
    (Kirsch 1898; Muskhelishvili, §56; Timoshenko & Goodier, §35).
    """

    tension: float = 1e6
    """S far from the hole (Pa)."""

    source = "Timoshenko & Goodier, Theory of Elasticity, §35"

    def potentials(self, z):
        """Return the potentials of the tension and of the hole's disturbance."""
        a, unit = RADIUS, self.tension / 4
        return Potentials(
            phi=unit * (z + 2 * a**2 / z),
            phi_1=unit * (1 - 2 * a**2 / z**2),
            phi_2=unit * 4 * a**2 / z**3,
            psi=-2 * unit * (z + a**2 / z - a**4 / z**3),
            psi_1=-2 * unit * (1 - a**2 / z**2 + 3 * a**4 / z**4),
        )


@dataclass(frozen=True)
class Lame(_Hole):
    """A thick tube, 1 m to 4.24 m in radius, under pressure (Pa) from inside; 3 m each way of it.

    φ = Az, ψ = B/z with 2A = pa²/(b² - a²) and B = -2Ab²
    (Lamé 1852; Muskhelishvili, §59; Timoshenko & Goodier, §28). The pressure acts on
    every step of the stair.
    """

    pressure: float = 1e6
    outer = hypot(3.0, 3.0)

    source = "Timoshenko & Goodier, Theory of Elasticity, §28"

    def potentials(self, z):
        """Return a uniform and a radial part."""
        pull = self.pressure * RADIUS**2 / (2 * (self.outer**2 - RADIUS**2))
        core = -2 * pull * self.outer**2
        return Potentials(
            phi=pull * z, phi_1=pull + 0 * z, phi_2=0 * z, psi=core / z, psi_1=-core / z**2
        )

    def scene(self, resolution):
        """Return the plate with the pressure on every face between the body and the hole."""
        scene = super().scene(resolution)
        kinds = scene.rasterise()[: resolution + 1, : resolution + 1]
        push = self.pressure / resolution
        loads = []
        for axis, side, force in ((0, "left", [push, 0.0]), (1, "bottom", [0.0, push])):
            solid = np.moveaxis(kinds, axis, 0) >= 0
            steps = np.argwhere(solid[1:] & ~solid[:-1])
            cells = steps[:, ::-1] if axis else steps
            cells[:, axis] += 1
            loads += [{"cell": cell.tolist(), "side": side, "force": force} for cell in cells]
        return scene.replace(loads=[*loads, *scene.loads])


EXPONENT = 0.5444837367824639
"""Smallest positive root λ of sin(3πλ/2) = λ, the opening mode of a corner of 270°."""

BISECTOR = -135.0
"""Direction from the corner into the body (degrees)."""
CORNER_ORDERS = {"displacement": (1.0, 1.8), "stress": (1.0, 1.9)}


@dataclass(frozen=True)
class LCorner(PlaneProblem):
    """An L of 2 m whose inner corner opens: u ~ r^λ, σ ~ r^(λ-1), λ = 0.5445.

    φ = Az^λ, ψ = Bz^λ about the bisector, free on both faces of the corner, with the exact
    displacement left and below and the exact traction at the two ends of the L
    (Williams 1952, J. Applied Mechanics 19, 526-528; Szabó & Babuška 1991, Finite
    Element Analysis). The singularity is felt everywhere: errors fall like
    h^2λ, power 1.09, in the end, and a little faster on coarse cells.
    """

    strength: float = 1e6
    """A (Pa·m^(1-λ))."""

    source = "Williams 1952, J. Applied Mechanics 19, 526-528"
    orders = CORNER_ORDERS
    resolutions = (16, 32, 64, 128)
    given_sides = ("left", "bottom")
    loaded_sides = ("right", "top")
    origin = (1.0, 1.0)

    def scene(self, resolution):
        """Return the L, `resolution` cells per metre."""
        missing = {"material": "air", "box": [[1.0, 1.0], [2.0, 2.0]]}
        return self._scene([2.0, 2.0], 1.0 / resolution, regions=[missing])

    def points(self):
        """Return points on arcs round the corner."""
        angles = BISECTOR + np.array([0.0, 45.0, -45.0, 90.0, -90.0])
        return polar_points((0.3, 0.5, 0.7), angles, self.origin)

    def potentials(self, z):
        """Return powers of z, turned so that the bisector leads into the body."""
        power, turn = EXPONENT, np.exp(1j * np.deg2rad(BISECTOR))
        other = -self.strength * np.cos(1.5 * pi * power)
        with np.errstate(divide="ignore", invalid="ignore"):  # the corner itself is singular
            along = z / turn
            first, second = power * along ** (power - 1), power * (power - 1) * along ** (power - 2)
        return Potentials(
            phi=self.strength * turn * along**power,
            phi_1=self.strength * first,
            phi_2=self.strength * second / turn,
            psi=other * along**power / turn,
            psi_1=other * first / turn**2,
        )
