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

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import inf, isfinite
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import require

from .load_history import History

Answer = Callable[[ArrayLike], Floats]
_LEAST, _MOST = 1e-100, 1e100
"""So large are stiffness and damping if they are not 0: times and ratios of them have digits."""

SchemeName = Literal["backward_euler", "exact"]


@dataclass(frozen=True)
class ThreeElement:
    """A Voigt element (K_f, D_f) in series with a damper D_d.

    Raises `ParameterError` if a number is outside its range, or K_f and D_f are both 0.

    Examples
    --------
    >>> from kaju import ThreeElement
    >>> noodle = ThreeElement(K_f=2.0, D_f=1.0, D_d=10.0)
    >>> noodle.K_f / noodle.D_f  # 1/s
    2.0
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

    @classmethod
    def dashpot(cls, damping: float) -> ThreeElement:
        """Return a damper alone."""
        return cls(0.0, damping, inf)

    @classmethod
    def maxwell(cls, stiffness: float, damping: float) -> ThreeElement:
        """Return a spring and a damper in series."""
        return cls(stiffness, 0.0, damping)

    @classmethod
    def kelvin_voigt(cls, stiffness: float, damping: float) -> ThreeElement:
        """Return a spring and a damper side by side."""
        return cls(stiffness, damping, inf)

    @property
    def retardation_time(self) -> float:
        """D_f/K_f (s): how long the element takes to give under a held force."""
        return self.D_f / self.K_f if self.K_f else inf

    @property
    def relaxation_time(self) -> float:
        """(D_d + D_f)/K_f (s): how long the force takes to fade at a held displacement."""
        return (self.D_d + self.D_f) / self.K_f if self.K_f else inf

    def creep_compliance(self, times: ArrayLike) -> Floats:
        """Return J(t): displacement per force held since time 0 (m/N or 1/Pa)."""
        t = _since(times)
        if self.D_f == 0.0:
            given = np.where(t > 0.0, 1.0 / self.K_f, 0.0)
        else:
            given = t / self.D_f * _exprel(-t * self.K_f / self.D_f)
        return np.asarray(given + t / self.D_d)

    def ramp_compliance(self, times: ArrayLike) -> Floats:
        """Return ∫₀ᵗJ: displacement per rate of a force that has grown since time 0."""
        t = _since(times)
        if self.D_f == 0.0:
            given = t / self.K_f
        else:
            given = t * (t / self.D_f * _decay_mean_twice(t * self.K_f / self.D_f))
        return np.asarray(given + 0.5 * t * (t / self.D_d))

    def relaxation_modulus(self, times: ArrayLike) -> Floats:
        """Return G(t): force per displacement held since time 0, after its first impulse."""
        t = _since(times)
        fading = self._series_share**2 * self.K_f * np.exp(-t / self.relaxation_time)
        return np.asarray(np.where(t > 0.0, fading, 0.0))

    def ramp_force(self, times: ArrayLike) -> Floats:
        """Return force per speed of a displacement that has grown since time 0 (N s/m)."""
        t = _since(times)
        share, pace = self._series_share, t / self.relaxation_time
        spring = share * self.K_f * t * _exprel(-pace)
        return np.asarray(np.where(t > 0.0, spring + share * self.D_f * np.exp(-pace), 0.0))

    @property
    def _series_share(self) -> float:
        """D_d/(D_d + D_f): share of a sudden rate that the Voigt part takes."""
        return 1.0 / (1.0 + self.D_f / self.D_d)

    def creep(
        self, *, force: float | History, times: ArrayLike, scheme: SchemeName = "backward_euler"
    ) -> Floats:
        """Return the displacement under a force (N or Pa) held from time 0, or a history of it.

        `kaju.creep` chooses its time steps by a tolerance; here the rising `times` (s) are the
        steps, from 0 to the first of them and on to the next, and corners of the history between
        them. The scheme "exact" evaluates the solution itself.
        """
        t, history = _rising(times), _history(force)
        if _is_exact(scheme):
            return _superpose(history, t, self.creep_compliance, self.ramp_compliance)
        return self._step_along(history, t, stretched=False)

    def relaxation(
        self,
        *,
        displacement: float | History,
        times: ArrayLike,
        scheme: SchemeName = "backward_euler",
    ) -> Floats:
        """Return the force at a given displacement; arguments as in `creep`.

        While both dampers act the displacement may not jump: that would need an impulse.
        """
        t, history = _rising(times), _history(displacement)
        require(
            self.D_f == 0.0 or not any(corner.jump for corner in history.corners()),
            f"displacement: a jump would need an infinite force, because D_f = {self.D_f} resists "
            "every rate; give a ramp, History().ramp(to, duration)",
        )
        if _is_exact(scheme):
            return _superpose(history, t, self.relaxation_modulus, self.ramp_force)
        return self._step_along(history, t, stretched=True)

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


def _is_exact(scheme: str) -> bool:
    """Tell which of the two schemes is asked for."""
    known = get_args(SchemeName)
    require(scheme in known, f"scheme: {scheme!r} is unknown; there are {', '.join(known)}")
    return scheme == "exact"


def _history(driver: float | History) -> History:
    if isinstance(driver, History):
        return driver
    require(isfinite(driver), f"force or displacement: must be a finite number, got {driver}")
    return History.step(float(driver))


def _since(times: ArrayLike) -> Floats:
    return np.maximum(np.asarray(times, dtype=np.float64), 0.0)


def _rising(times: ArrayLike) -> Floats:
    t = np.atleast_1d(np.asarray(times, dtype=np.float64))
    right = t.ndim == 1 and np.isfinite(t).all() and np.all(np.diff(t, prepend=0.0) >= 0.0)
    require(bool(right), "times: must be one row of finite times from 0 upwards that do not fall")
    return t


def _decay_mean_twice(x: Floats) -> Floats:
    """Return (x - 1 + e⁻ˣ)/x²; the series where the difference would lose digits."""
    near = np.minimum(x, 0.1)
    term = np.full_like(near, 0.5)
    total = term.copy()
    for k in range(3, 12):
        term = term * (-near / k)
        total = total + term
    far = np.maximum(x, 0.1)
    return np.asarray(np.where(x < 0.1, total, (far + np.expm1(-far)) / far / far))


def _superpose(history: History, times: Floats, to_jump: Answer, to_ramp: Answer) -> Floats:
    """Add up the answers to every jump and every change of slope (Boltzmann)."""
    answer = np.zeros_like(times)
    for time, jump, bend in history.corners():
        if jump:
            answer += jump * to_jump(times - time)
        if bend:
            answer += bend * to_ramp(times - time)
    return answer


def _exprel(x: Floats) -> Floats:
    """Return (eˣ - 1)/x, 1 at 0; every material knows this law, and few runs need SciPy."""
    nothing = x == 0.0
    return np.asarray(np.where(nothing, 1.0, np.expm1(x) / np.where(nothing, 1.0, x)))
