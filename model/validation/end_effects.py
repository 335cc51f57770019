"""How fast a load that is in balance with itself dies away along a strip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.scene import Scene

from .potentials import Complex, PlaneProblem, Potentials
from .problem import Quantity

DECAY = 2.1061961155 + 1.1253643056j
"""First root γ of sin 2γ + 2γ = 0: stresses go as Re exp(-γx/c), c half the strip's width."""


@dataclass(frozen=True)
class SaintVenantDecay(PlaneProblem):
    """The slowest self-balanced end load of a strip 2 m wide; its upper half, 3 m long.

    φ = Re-symmetric sum of ae^(-γz) and its conjugate partner; freedom from traction at
    y = ±1 gives ψ and sin 2γ + 2γ = 0 (Papkovich 1940, Fadle 1940; Timoshenko & Goodier,
    §26; Horgan & Knowles 1983, Advances in Applied Mechanics 23, 179-269).

    Attributes
    ----------
    load : float
        Scale of the end's traction (Pa).
    """

    load: float = 1e6

    title: ClassVar[str] = "Saint-Venant decay"
    source: ClassVar[str] = "Horgan & Knowles 1983, Advances in Applied Mechanics 23, 179-269"
    orders: ClassVar[dict[Quantity, tuple[float, float]]] = {
        "displacement": (1.8, 2.3),
        "stress": (1.8, 2.3),
    }
    resolutions: ClassVar[tuple[int, ...]] = (8, 16, 32)
    given_sides: ClassVar[tuple[str, ...]] = ("right",)
    loaded_sides: ClassVar[tuple[str, ...]] = ("left",)

    def scene(self, resolution: int) -> Scene:
        """Return the strip, `resolution` cells across its upper half."""
        return self._scene([3.0, 1.0], 1.0 / resolution, sides={"bottom": "roller"})

    def points(self) -> Floats:
        """Return points from a quarter to twice the half-width away from the end."""
        x, y = np.meshgrid([0.25, 0.5, 1.0, 1.5, 2.0], [0.0, 0.25, 0.5, 0.75])
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def potentials(self, z: Complex) -> Potentials:
        """Return the sum over the root and its conjugate."""
        terms = [self._term(z, DECAY), self._term(z, np.conj(DECAY))]
        return Potentials(*(first + second for first, second in zip(*terms, strict=True)))

    def _term(self, z: Complex, root: complex) -> Potentials:
        wave = np.asarray(0.5 * self.load * np.exp(-root * z), dtype=np.complex128)
        shift: Complex = np.exp(2j * root) - root * (z - 2j)
        return Potentials(
            phi=wave / root,
            phi_1=-wave,
            phi_2=root * wave,
            psi=-wave / root * shift,
            psi_1=wave * (shift + 1),
        )

    def decay(self, result: ElasticResult) -> complex:
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
