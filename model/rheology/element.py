"""The three-element material: a spring and a damper side by side, a second damper in series.

::

            +--- spring K_f ---+
       o----|                  |----[ damper D_d ]----o
            +--- damper D_f ---+

Under a lasting force the left (Voigt) part gives up to F/K_f and recovers when the force
goes; the right damper flows on and what it flowed stays. The same element is the material of
a spring (K in N/m, D in N s/m) and, tensor-wise, of a cell (K in Pa, D in Pa s).

Sources: W. Flügge, *Viscoelasticity*, Springer 1975, chapter 1; R. M. Christensen, *Theory
of Viscoelasticity*, Academic Press 1982, chapter 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import require

from .load_history import History

_LEAST, _MOST = 1e-100, 1e100
"""So large are stiffness and damping if they are not 0: times and ratios of them have digits."""


@dataclass(frozen=True)
class ThreeElement:
    """A Voigt element (K_f, D_f) in series with a damper D_d.

    Raises
    ------
    ParameterError
        If a number is outside its range, or K_f and D_f are both 0.

    Examples
    --------
    >>> from kaju import History, ThreeElement, creep
    >>> noodle = ThreeElement(K_f=2.0, D_f=1.0, D_d=10.0)
    >>> creep(noodle, History.step().hold(4.0), times=[4.0]).displacement.round(4)  # m, under 1 N
    array([0.8998])
    """

    K_f: float
    """Stiffness of the spring (N/m for a spring, Pa for a cell), 0 or more."""
    D_f: float = 0.0
    """Damper beside the spring (N s/m or Pa s), 0 or more; not both may be 0."""
    D_d: float = inf
    """Damper in series (N s/m or Pa s), above 0; infinite means that nothing flows."""

    def __post_init__(self) -> None:
        span = f"from {_LEAST:g} to {_MOST:g}"
        for name, value in (("K_f", self.K_f), ("D_f", self.D_f)):
            right = value == 0.0 or _LEAST <= value <= _MOST
            require(right, f"{name}: must be 0, or {span}, got {value}")
        require(
            _LEAST <= self.D_d <= _MOST or self.D_d == inf,
            f"D_d: must be {span}, or infinite (nothing flows), got {self.D_d}; a damper of 0 "
            "would carry no force at all",
        )
        require(
            self.K_f + self.D_f > 0.0,
            "K_f and D_f: both are 0, so the element would carry no force at all; give it a spring "
            "(K_f) or a damper (D_f)",
        )

    @classmethod
    def spring(cls, stiffness: float) -> ThreeElement:
        """Return an elastic spring: no damper acts."""
        return cls(stiffness, 0.0, inf)

    @property
    def retardation_time(self) -> float:
        """D_f/K_f (s): how long the element takes to give under a held force."""
        return self.D_f / self.K_f if self.K_f else inf

    def creep(self, *, force: float | History, times: ArrayLike) -> Floats:
        """Return the displacement under a force (N or Pa) held from time 0, or a history of it.

        `kaju.creep` chooses its time steps by a tolerance; here the rising `times` (s) are the
        steps, from 0 to the first of them and on to the next, and corners of the history between
        them, by backward Euler.
        """
        return self._step_along(_history(force), _rising(times), stretched=False)

    def relaxation(self, *, displacement: float | History, times: ArrayLike) -> Floats:
        """Return the force at a given displacement; arguments as in `creep`.

        While both dampers act the displacement may not jump: that would need an impulse.
        """
        history = _history(displacement)
        require(
            self.D_f == 0.0 or not history.corners()[1].any(),
            f"displacement: a jump would need an infinite force, because D_f = {self.D_f} resists "
            "every rate; give a ramp, History().ramp(to, duration)",
        )
        return self._step_along(history, _rising(times), stretched=True)

    def _step_along(self, history: History, times: Floats, *, stretched: bool) -> Floats:
        """Step by backward Euler along a history of forces, or of elongations if `stretched`."""
        nodes = np.union1d(times, [0.0, *(c for c in history.times if c < times[-1])])
        before, ends = history.at(nodes[:-1]), history.at(nodes[1:])
        q = d = 0.0
        answers = [0.0]
        for step, given, grown in zip(
            np.diff(nodes).tolist(), ends.tolist(), (ends - before).tolist(), strict=True
        ):
            force, voigt = given, self.K_f + self.D_f / step
            if stretched:  # the force of a spring of this stiffness, and of what is stretched
                stiffness = voigt / (1.0 + voigt * (step / self.D_d))
                force = stiffness * (grown + q * (self.K_f / voigt))
            q += step * ((force - self.K_f * q) / (self.K_f * step + self.D_f))
            d += step * (force / self.D_d)
            answers.append(force if stretched else q + d)
        return np.array(answers)[np.searchsorted(nodes, times)]


class Laws(NamedTuple):
    """Many three-element materials: one number of each in three arrays."""

    K_f: Floats
    D_f: Floats
    D_d: Floats


def laws_of(elements: Iterable[ThreeElement]) -> Laws:
    """Gather single elements."""
    table = np.array([(e.K_f, e.D_f, e.D_d) for e in elements], dtype=np.float64)
    return Laws(*np.ascontiguousarray(table.reshape(-1, 3).T))


def _history(driver: float | History) -> History:
    if isinstance(driver, History):
        return driver
    require(isfinite(driver), f"force or displacement: must be a finite number, got {driver}")
    return History.step(float(driver))


def _rising(times: ArrayLike) -> Floats:
    t = np.atleast_1d(np.asarray(times, dtype=np.float64))
    right = t.ndim == 1 and np.isfinite(t).all() and np.all(np.diff(t, prepend=0.0) >= 0.0)
    require(bool(right), "times: must be one row of finite times from 0 upwards that do not fall")
    return t
