"""Fields that belong to a root: of a re-entrant corner, and of a strip in balance with itself."""

from dataclasses import dataclass
from math import pi

import numpy as np

from .known_problem import SECOND_ORDER, grid_points
from .potentials import PlaneProblem, Potentials, polar_points

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

    title = "L-corner"
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

    def exponent(self, result, near=0.1, far=0.5):
        """Return the λ observed: one more than the power of r by which stresses fall."""
        radii = np.geomspace(near, far, 12)
        points = polar_points(tuple(radii), (BISECTOR,), self.origin)
        size = np.linalg.norm(result.stress_at(points).reshape(len(points), -1), axis=1)
        return 1.0 + float(np.polyfit(np.log(radii), np.log(size), 1)[0])


DECAY = 2.1061961155 + 1.1253643056j
"""First root γ of sin 2γ + 2γ = 0: stresses go as Re exp(-γx/c), c half the strip's width."""


@dataclass(frozen=True)
class SaintVenantDecay(PlaneProblem):
    """The slowest self-balanced end load of a strip 2 m wide; its upper half, 3 m long.

    φ = Re-symmetric sum of ae^(-γz) and its conjugate partner; freedom from traction at
    y = ±1 gives ψ and sin 2γ + 2γ = 0 (Papkovich 1940, Fadle 1940; Timoshenko & Goodier,
    §26; Horgan & Knowles 1983, Advances in Applied Mechanics 23, 179-269).
    """

    load: float = 1e6
    """Scale of the end's traction (Pa)."""

    title = "Saint-Venant decay"
    source = "Horgan & Knowles 1983, Advances in Applied Mechanics 23, 179-269"
    orders = SECOND_ORDER
    resolutions = (8, 16, 32)
    given_sides = ("right",)
    loaded_sides = ("left",)

    def scene(self, resolution):
        """Return the strip, `resolution` cells across its upper half."""
        return self._scene([3.0, 1.0], 1.0 / resolution, sides={"bottom": "roller"})

    def points(self):
        """Return points from a quarter to twice the half-width away from the end."""
        return grid_points([0.25, 0.5, 1.0, 1.5, 2.0], [0.0, 0.25, 0.5, 0.75])

    def potentials(self, z):
        """Return the sum over the root and its conjugate."""
        terms = [self._term(z, DECAY), self._term(z, np.conj(DECAY))]
        return Potentials(*(first + second for first, second in zip(*terms, strict=True)))

    def _term(self, z, root):
        wave = 0.5 * self.load * np.exp(-root * z)
        shift = np.exp(2j * root) - root * (z - 2j)
        return Potentials(
            phi=wave / root,
            phi_1=-wave,
            phi_2=root * wave,
            psi=-wave / root * shift,
            psi_1=wave * (shift + 1),
        )

    def decay(self, result):
        """Return the γ observed on the axis, by Prony's method.

        Samples of Re Ce^(-γx) at equal distances d obey s'' = 2 Re(q) s' - |q|² s, with
        q = e^(-γd); both coefficients follow by least squares.
        """
        distance = 0.25
        x = np.arange(0.25, 2.01, distance)
        points = np.stack([x, np.zeros_like(x)], axis=1)
        s = result.stress_at(points)[:, 0, 0] * np.exp(DECAY.real * x)  # even weights
        rows = np.stack([s[1:-1], -s[:-2]], axis=1)
        (double, square), *_ = np.linalg.lstsq(rows, s[2:], rcond=None)
        q = 0.5 * double - 1j * np.sqrt(square - 0.25 * double**2)
        return complex(DECAY.real - np.log(q) / distance)
