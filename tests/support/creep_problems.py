"""Problems in time whose answer is known, each a class that states it.

Each has `subject` and `history` for `creep`, the times (s) that matter, and `exact` with what
`measured` picks from the result: a displacement (m) under given forces, a force (N) under given
displacements. Sources: W. Flügge, *Viscoelasticity*, Springer 1975, chapter 1; the discrete
formula follows from backward Euler by summing a geometric series.
"""

from dataclasses import dataclass
from math import exp, expm1, log1p

import numpy as np

from kaju import History, ThreeElement

ELEMENT = ThreeElement(K_f=2.0, D_f=3.0, D_d=5.0)


@dataclass(frozen=True)
class Problem:
    subject: ThreeElement = ELEMENT

    drive = "forces"

    def measured(self, result):
        return result.displacement if self.drive == "forces" else result.force


@dataclass(frozen=True)
class CreepUnderForce(Problem):
    """A force F held from time 0: q = F/K_f (1 - e^(-t K_f/D_f)) + F t/D_d."""

    force: float = 7.0

    @property
    def history(self):
        return History.step(self.force)

    @property
    def times(self):
        """Up to five retardation times."""
        return np.linspace(0.5, 5.0, 10) * self.subject.retardation_time

    def exact(self, times):
        law = self.subject
        given = -np.expm1(-times * law.K_f / law.D_f) / law.K_f
        return self.force * (given + times / law.D_d)

    def after_steps(self, step, steps):
        """Return what backward Euler gives after equal steps: F[n h/D_d + (1-(1+hK/D)^-n)/K]."""
        law = self.subject
        given = -expm1(-steps * log1p(step * law.K_f / law.D_f)) / law.K_f
        return self.force * (steps * step / law.D_d + given)


@dataclass(frozen=True)
class Recovery(Problem):
    """A force F held until t₁: later, F/K_f (e^(-(t-t₁)K/D) - e^(-tK/D)) + F t₁/D_d."""

    force: float = 7.0
    unloaded: float = 4.0

    @property
    def history(self):
        return History.step(self.force).hold(self.unloaded).release().hold(6.0 * self.unloaded)

    @property
    def times(self):
        """After the force has gone."""
        return self.unloaded * np.array([1.1, 1.5, 2.0, 4.0, 7.0])

    def exact(self, times):
        law = self.subject
        pace = law.K_f / law.D_f
        left = np.exp(-(times - self.unloaded) * pace) - np.exp(-times * pace)
        return self.force * (left / law.K_f + self.unloaded / law.D_d)


@dataclass(frozen=True)
class RampAndHold(Problem):
    """A displacement that grows at speed w until T and then stays.

    Growing: F = D_d w [1 - D_d/(D_d+D_f) e^(-t/τ)], τ = (D_d+D_f)/K_f. Held: F drops by
    D_d D_f w/(D_d+D_f) and goes on as D_d² w/(D_d+D_f) (1 - e^(-T/τ)) e^(-(t-T)/τ).
    """

    speed: float = 0.7
    end: float = 3.0

    drive = "displacements"

    @property
    def history(self):
        return History().ramp(self.speed * self.end, self.end).hold(4.0 * self.end)

    @property
    def times(self):
        """On the way, at its end (before the drop), and in the hold."""
        return self.end * np.array([0.05, 0.5, 1.0, 1.2, 2.0, 5.0])

    def exact(self, times):
        law, end = self.subject, self.end
        share, fade = law.D_d / (law.D_d + law.D_f), law.relaxation_time
        growing = law.D_d * self.speed * (1.0 - share * np.exp(-times / fade))
        top = law.D_d * share * self.speed * (1.0 - exp(-end / fade))
        held = top * np.exp(-(times - end) / fade)
        return np.where(times <= end, growing, held)


@dataclass(frozen=True)
class Cyclic(Problem):
    """Any history on any element, by superposition of its jumps and bends (Boltzmann)."""

    count: int = 3
    period: float = 2.0

    @property
    def history(self):
        """Triangles of force, and a rest."""
        return History().cycles(self.count, self.period).hold(2.0 * self.period)

    @property
    def times(self):
        """Eighths of a period."""
        return np.arange(1, 8 * (self.count + 2) + 1) * self.period / 8

    def exact(self, times):
        return self.subject.creep(force=self.history, times=times, scheme="exact")


PROBLEMS = {
    "creep": CreepUnderForce,
    "recovery": Recovery,
    "ramp and hold": RampAndHold,
    "cycles": Cyclic,
}
