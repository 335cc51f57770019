"""Forces on the surface of a half space and on the edge of a half plane, seen from far away.

The body is a block cut out; where symmetry does not hold its sides, they move, or are pressed,
as in the exact solution. In space z points out of the body; of the half plane the part within
3 m of the load is solved.
"""

from abc import abstractmethod
from dataclasses import dataclass
from math import pi

import numpy as np

from .known_problem import SECOND_ORDER, KnownProblem, grid_points
from .potentials import PlaneProblem, Potentials, polar_points

STEP = 1e-30
SPACE_ORDERS = {"displacement": (1.7, 2.4), "stress": (1.5, 2.6)}


@dataclass(frozen=True)
class _HalfPlane(PlaneProblem):
    """The right half of a block 6 m wide and 3 m deep, cut out below the edge y = 0."""

    given_sides = ("bottom",)
    loaded_sides = ("right",)
    origin = (0.0, 3.0)

    @abstractmethod
    def _load(self, resolution):
        """Return the load on the edge."""

    def scene(self, resolution):
        """Return the block, `resolution` cells per metre."""
        return self._scene(
            [3.0, 3.0], 1.0 / resolution, sides={"left": "roller"}, loads=[self._load(resolution)]
        )


@dataclass(frozen=True)
class StripLoad(_HalfPlane):
    """Uniform pressure (Pa) on a strip 2 m wide.

    Potentials are those of point forces, summed over the strip: φ' = (ip/2π) ln((z+a)/(z-a)),
    ψ = φ - zφ' (Timoshenko & Goodier, §37, by other means).
    """

    pressure: float = 1e6

    title = "Strip load on a half plane"
    source = "Timoshenko & Goodier, Theory of Elasticity, §37"
    orders = SECOND_ORDER
    resolutions = (8, 16, 32)

    def _load(self, resolution):
        return {"region": {"box": [[0.0, 3.0], [1.0, 3.0]]}, "pressure": self.pressure}

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


@dataclass(frozen=True)
class Flamant(_HalfPlane):
    """A point force on the edge, seen from at least 1.5 m away.

    φ' = -F/2πz and ψ' = F̄/2πz with F = X + iY (Flamant 1892; Timoshenko & Goodier, §36). The grid
    spreads the force over two cells, which is not felt far away but to second order.
    """

    load: float = 1e6
    """Force downwards per unit thickness (N/m)."""

    title = "Flamant's point force"
    source = "Timoshenko & Goodier, Theory of Elasticity, §36"
    orders = SECOND_ORDER
    resolutions = (8, 16, 32)

    def _load(self, resolution):
        return {"cell": [0, 3 * resolution - 1], "side": "top", "force": [0.0, -self.load / 2]}

    def points(self):
        """Return points on arcs round the force."""
        return polar_points((1.5, 2.0, 2.5), (-90.0, -70.0, -50.0, -30.0), self.origin)

    def potentials(self, z):
        """Return logarithms."""
        unit = 1j * self.load / (2 * pi)
        log = unit * _log_below(z)
        return Potentials(log, unit / z, -unit / z**2, log, unit / z)


def _log_below(z):
    """Return ln iz, continuous on the closed lower half plane and real below the origin."""
    return np.log(1j * z)


@dataclass(frozen=True)
class Boussinesq(KnownProblem):
    """A force (N) into the half space; a quarter of the body, 1 m each way.

    4πμ u_r = F[rz/ρ³ - (1-2ν) r/(ρ(ρ+z))], 4πμ u_z = F[z²/ρ³ + 2(1-ν)/ρ]
    (Johnson, Contact Mechanics, eq. 3.18).
    """

    plane: str | None = None
    load: float = 1e6

    orders = SPACE_ORDERS
    resolutions = (8, 12, 16)
    title = "Boussinesq's point force"
    source = "Johnson, Contact Mechanics, §3.2"
    given_sides = ("right", "back", "bottom")
    size = (1.0, 1.0, 1.0)
    origin = (0.0, 0.0, 1.0)

    def scene(self, resolution):
        """Return the block, `resolution` cells along every edge."""
        load = {"cell": [0, 0, resolution - 1], "side": "top", "force": [0.0, 0.0, -self.load / 4]}
        sides = {"left": "roller", "front": "roller"}
        return self._scene(self.size, 1.0 / resolution, sides=sides, loads=[load])

    def points(self):
        """Return points at least half the block's depth away from the force."""
        last = [[0.25, 0.5, 0.25], [0.6, 0.6, 0.5]]
        return np.array([[0.0, 0.0, 0.4], [0.5, 0.0, 0.75], [0.5, 0.5, 0.75], *last])

    def exact_displacement(self, points):
        flip = np.array([1.0, 1.0, -1.0])
        place = (flip * (points - np.asarray(self.origin))).T
        return flip * self._displacement(place).T / (4 * pi * self.shear_modulus)

    def exact_stress(self, points):
        """Return stress tensors (Pa) by Hooke's law.

        Derivatives are those of a step into the imaginary, which loses no digits
        (Squire & Trapp 1998, SIAM Review 40, 110-112).
        """
        gradient = np.empty((len(points), 3, 3))
        for axis in range(3):
            moved = np.asarray(points, dtype=np.complex128)
            moved[:, axis] += 1j * STEP
            gradient[:, :, axis] = self.exact_displacement(moved).imag / STEP
        return self.hooke(0.5 * (gradient + gradient.transpose(0, 2, 1)))

    def _displacement(self, place):
        """Return 4πμ u for z into the body, shape (3, n); analytic in the place (3, n)."""
        x, y, z = place
        rho, ratio = np.sqrt(x**2 + y**2 + z**2), self.poissons_ratio
        radial = z / rho**3 - (1 - 2 * ratio) / (rho * (rho + z))
        down = z**2 / rho**3 + 2 * (1 - ratio) / rho
        return self.load * np.stack([x * radial, y * radial, down])
