"""One implicit step of many three-element materials, and the scheme that is made of three of them.

Over an implicit step of length h, a damper D is a spring of stiffness D/h with a memory. A
three-element spring is then *an elastic spring with another stiffness and another rest length*
(`as_spring`), which any elastic solver can handle; the force it finds moves the element on
(`rates`).

The scheme (SDIRK2) is second order: three implicit steps of length γh, each followed by going on
at its rate up to h/√6 from where it began, γ = 1 - √(2/3). It multiplies a decaying part by
(1 - (a - γ) x)²/(1 + γx)³, a = 1/√6, where x is the step over the decay time: a number in [0, 1)
that goes to 0 for long steps. Hence an element never overshoots or rings, however long the step
(A- and L-stable, monotone). The usual two-stage second-order schemes (TR-BDF2, SDIRK2 with
γ = 1 - 1/√2) become negative at x > 2.4. Three equal weights followed by γ are one of the
strong-stability-preserving forms studied by L. Ferracina and M. N. Spijker, Appl. Numer. Math. 58
(2008) 1675; for L-stability see E. Hairer and G. Wanner, *Solving Ordinary Differential Equations
II*, section IV.6.

Energy. With weights b (a, a, γ) a step does work Σ b h F ė, of which Σ b h (D_f q̇² + F²/D_d),
never negative, goes into the dampers and K_f q²/2 is stored. The rest is the scheme's own,
½ Σ b (2γ - b) K_f (h q̇)², of either sign; over a fixed time it falls as h³. The balance holds to
rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats

ORDER = 2
GAMMA, _SPACING = 1.0 - sqrt(2.0 / 3.0), 1.0 / sqrt(6.0)
STAGES = ((GAMMA, _SPACING), (GAMMA + _SPACING, _SPACING), (1.0, GAMMA))
"""Where each implicit step ends and for how long its rate counts, as shares of the whole step."""

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


class SubStep(NamedTuple):
    """One implicit step of the scheme."""

    step: float  # length of the whole step (s)
    weight: float  # share of the whole step for which the rates count
    factor: float  # of the loads and given displacements, at the end of the implicit step

    @property
    def length(self) -> float:
        """Length of the implicit step (s)."""
        return GAMMA * self.step

    @property
    def duration(self) -> float:
        """How long the rates count (s)."""
        return self.weight * self.step

    def numerical(self, energy_at_rates: float) -> float:
        """Return the scheme's own part of an energy Σ k x²/2, from Σ k ẋ² of the rates."""
        return 0.5 * self.weight * (2.0 * GAMMA - self.weight) * self.step**2 * energy_at_rates


def as_spring(law: Laws, length: float, state: Stretch) -> tuple[Floats, Floats]:
    """Return stiffness and rest of the spring that an element is over an implicit step (s).

    Its stiffness is 1/(C h) with C = 1/D_d + 1/(K_f h + D_f).
    """
    voigt = law.K_f + law.D_f / length
    stiffness = voigt / (1.0 + voigt * (length / law.D_d))
    rest = state.d + state.q * (law.D_f / length / voigt)
    return np.asarray(stiffness), np.asarray(rest)


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
