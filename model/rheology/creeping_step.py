"""What creeps over one implicit step, and the scheme that is made of three of them.

Over an implicit step of length h, a damper D is a spring of stiffness D/h with a memory. A
three-element spring is then *an elastic spring with another stiffness and another rest length*,
which any elastic solver can handle; the force it finds moves the element on.

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

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from kaju.arrays import Floats

from .creep_result import TimeResult
from .element import Laws

Fields = tuple[Floats, ...]

ORDER = 2
_GAMMA, _SPACING = 1.0 - sqrt(2.0 / 3.0), 1.0 / sqrt(6.0)
STAGES = ((_GAMMA, _SPACING), (_GAMMA + _SPACING, _SPACING), (1.0, _GAMMA))
"""Where each implicit step ends and for how long its rate counts, as shares of the whole step."""


class Borne(NamedTuple):
    """How a load is borne at the end of an implicit step."""

    force: Floats  # of every element
    fields: Fields  # what else the result keeps, in the order of `Creeping.start`
    work: float | None = None  # done from outside (J), if it is not that on the elements


class Creeping(ABC):
    """Elements that bear a load together. Subclasses say how: `solve`.

    `result`: class of its result; `parts`: fields of that besides its course and its records;
    `laws`: of the elements; `counted`: those whose stretches have errors; `unit`: energy (J) of a
    force 1 on a stretch 1.
    """

    result: type[TimeResult]
    parts: dict[str, Any]
    laws: Laws
    counted: slice = slice(None)
    unit: float = 1.0

    @abstractmethod
    def start(self) -> Fields:
        """Return stretches of both parts of every element at time 0, and the other fields."""

    @abstractmethod
    def solve(self, stiffness: Floats, rest: Floats, factor: float, before: Fields) -> Borne:
        """Return what elastic springs bear at a factor of the loads, from the fields before."""

    @abstractmethod
    def record(self, fields: Fields) -> dict[str, Floats]:
        """Return what the result keeps of a time asked for, by the names of its fields."""

    def metric(self, stretch: Floats) -> Floats:
        """Return the forces of elements of unit stiffness."""
        return stretch

    def stored(self, fields: Fields) -> float:
        """Return the energy that the springs can give back (J): Σ K_f q²/2."""
        q = fields[0]
        return self.unit * 0.5 * float(np.sum(self.laws.K_f * (q * self.metric(q))))

    def largest_stretch(self, fields: Sequence[Floats]) -> float:
        """Return the largest stretch of a part of the elements that count."""
        return max(float(np.abs(part[self.counted]).max(initial=0.0)) for part in fields[:2])

    def stage(
        self, fields: Fields, step: float, weight: float, factor: float
    ) -> tuple[Fields, Floats]:
        """Go on at the rates of one implicit step, which ends at a factor of the loads.

        `step`: length of the whole step (s); `weight`: share of it for which the rates count.
        Return the fields then, and work, dissipation and the scheme's own energy (J).
        """
        law, (q, d, *before), length, lasts = self.laws, fields, _GAMMA * step, weight * step
        voigt = law.K_f + law.D_f / length
        stiffness = voigt / (1.0 + voigt * (length / law.D_d))  # 1/C h, C = 1/D_d + 1/(K_f h + D_f)
        rest = d + q * (law.D_f / length / voigt)
        force, after, work = self.solve(stiffness, rest, factor, tuple(before))
        q_rate = (force - law.K_f * q) / (law.K_f * length + law.D_f)
        d_rate = force / law.D_d
        stress, squared = self.metric(force), q_rate * self.metric(q_rate)
        on_elements = lasts * float(np.sum((q_rate + d_rate) * stress))
        dissipated = lasts * float(np.sum(law.D_f * squared + stress * d_rate))
        own = 0.5 * weight * (2.0 * _GAMMA - weight) * step**2 * float(np.sum(law.K_f * squared))
        work = on_elements if work is None else work * lasts / length
        changes = [(new - old) / length for new, old in zip(after, before, strict=True)]
        rates = (q_rate, d_rate, *changes)
        moved = tuple(part + lasts * rate for part, rate in zip(fields, rates, strict=True))
        return moved, self.unit * np.array([work, dissipated, own + (work - on_elements)])
