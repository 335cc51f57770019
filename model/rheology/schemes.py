"""Time steps of three-element materials, one or millions at once.

Seen over one implicit step of length h, a damper D is a spring of stiffness D/h with a
memory. A three-element spring is then *an elastic spring with another stiffness and another
rest length* (`as_spring`), which any elastic solver can handle; the force it finds moves the
element on (`rates`). Both schemes are made of such steps:

- ``backward_euler``: one step of length h. First order.
- ``sdirk2``: three steps of length γh, each followed by going on at its rate up to h/√6 from
  where it began, γ = 1 - √(2/3). Second order.

Both multiply a decaying part by a number in [0, 1) that goes to 0 for long steps: 1/(1 + x)
and (1 - (a - γ) x)²/(1 + γx)³, a = 1/√6, where x is the step over the decay time. Hence an
element never overshoots or rings, however long the step (A- and L-stable, monotone). The
usual two-stage second-order schemes (TR-BDF2, SDIRK2 with γ = 1 - 1/√2) become negative at
x > 2.4. Three equal weights followed by γ are one of the strong-stability-preserving forms
studied by L. Ferracina and M. N. Spijker, Appl. Numer. Math. 58 (2008) 1675; for L-stability
see E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, section IV.6.

Energy. With weights b (a, a, γ; backward Euler: 1) a step does work Σ b h F ė, of which
Σ b h (D_f q̇² + F²/D_d), never negative, goes into the dampers and K_f q²/2 is stored. The
rest is the scheme's own, ½ Σ b (2γ - b) K_f (h q̇)²: never negative for backward Euler, of
either sign for sdirk2, where it falls as h³ over a fixed time. The balance holds to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError

Metric = Callable[[Floats], Floats]
"""Turns strains into stresses of unit modulus: energies of a cell couple its axes by it."""


class Laws(NamedTuple):
    """Many three-element materials: arrays that broadcast against the state's."""

    K_f: Floats
    D_f: Floats
    D_d: Floats


class Stretch(NamedTuple):
    """State of elements: displacement of the Voigt parts, and of the dampers in series (m)."""

    q: Floats
    d: Floats


class Energy(NamedTuple):
    """Energies of one step, summed over the elements (J)."""

    work: float
    dissipated: float
    numerical: float


@dataclass(frozen=True)
class Scheme:
    """A chain of equal implicit steps: length γh each, beginning a·h after one another."""

    name: str
    order: int
    stages: int
    gamma: float
    spacing: float

    @property
    def ends(self) -> tuple[float, ...]:
        """Where each stage ends, as a share of the step; the last at 1."""
        inner = [self.gamma + i * self.spacing for i in range(self.stages - 1)]
        return (*inner, 1.0)

    @property
    def weights(self) -> tuple[float, ...]:
        """Share of the step for which each stage's rate counts; they add up to 1."""
        return (*[self.spacing] * (self.stages - 1), self.gamma)

    def log_factor(self, x: ArrayLike) -> Floats:
        """Return ln of the share of a decay that a step leaves, x = step/decay time."""
        pace = np.asarray(x, dtype=np.float64)
        left = -np.log1p(self.gamma * pace)
        if self.stages == 1:
            return np.asarray(left)
        with np.errstate(divide="ignore"):  # -inf where a step leaves nothing
            gone = self.spacing / (1.0 / pace + self.gamma)
            inner = np.where(
                gone < 1.0, np.log1p(-np.minimum(gone, 1.0)), np.log(np.abs(gone - 1.0))
            )
        return np.asarray(left + (self.stages - 1) * inner)


BACKWARD_EULER = Scheme("backward_euler", 1, 1, 1.0, 0.0)
SDIRK2 = Scheme("sdirk2", 2, 3, 1.0 - sqrt(2.0 / 3.0), 1.0 / sqrt(6.0))
SCHEMES = {method.name: method for method in (BACKWARD_EULER, SDIRK2)}


def scheme(name: str) -> Scheme:
    """Return the scheme of that name."""
    if name not in SCHEMES:
        raise ParameterError(f"scheme: {name!r} is unknown; there are {', '.join(SCHEMES)}")
    return SCHEMES[name]


class SubStep(NamedTuple):
    """One implicit step of a scheme."""

    method: Scheme
    step: float  # length of the whole step (s)
    weight: float  # share of the whole step for which the rates count
    factor: float  # of the forces, at the end of the implicit step
    displacement_factor: float  # of the given displacements, there

    @property
    def length(self) -> float:
        """Length of the implicit step (s)."""
        return self.method.gamma * self.step

    @property
    def duration(self) -> float:
        """How long the rates count (s)."""
        return self.weight * self.step

    def numerical(self, energy_at_rates: float) -> float:
        """Return the scheme's own part of an energy Σ k x²/2, from Σ k ẋ² of the rates."""
        own = 0.5 * self.weight * (2.0 * self.method.gamma - self.weight)
        return own * self.step**2 * energy_at_rates


def as_spring(law: Laws, length: float, state: Stretch) -> tuple[Floats, Floats]:
    """Return stiffness and rest of the spring that an element is over an implicit step (s).

    Its stiffness is 1/(C h) with C = 1/D_d + 1/(K_f h + D_f).
    """
    voigt = law.K_f + law.D_f / length
    stiffness = voigt / (1.0 + voigt * (length / law.D_d))
    rest = state.d + state.q * (law.D_f / length / voigt)
    return np.asarray(stiffness), np.asarray(rest)


def force_at_rate(law: Laws, length: float, state: Stretch, rate: ArrayLike) -> Floats:
    """Return the force at the end of an implicit step with a given rate of elongation.

    The same as `as_spring`, written without the elongation, so that no digits are lost when
    the step is very short.
    """
    voigt = law.K_f + law.D_f / length
    stiffness = voigt / (1.0 + voigt * (length / law.D_d))
    return np.asarray(stiffness * (length * np.asarray(rate) + state.q * (law.K_f / voigt)))


def rates(law: Laws, length: float, state: Stretch, force: Floats) -> Stretch:
    """Return the rates of both parts in an implicit step that ends under `force`."""
    return Stretch(
        np.asarray((force - law.K_f * state.q) / (law.K_f * length + law.D_f)),
        np.asarray(force / law.D_d),
    )


def stored_energy(law: Laws, q: Floats, metric: Metric = np.asarray) -> float:
    """Return Σ K_f q²/2 (J), the energy that the springs can give back."""
    return 0.5 * float(np.sum(law.K_f * (q * metric(q))))


def stage_energy(
    law: Laws, substep: SubStep, force: Floats, rate: Stretch, metric: Metric = np.asarray
) -> Energy:
    """Return what one implicit step adds to the balance."""
    stress, voigt = metric(force), rate.q * metric(rate.q)
    return Energy(
        substep.duration * float(np.sum((rate.q + rate.d) * stress)),
        substep.duration * float(np.sum(law.D_f * voigt + stress * (force / law.D_d))),
        substep.numerical(float(np.sum(law.K_f * voigt))),
    )
