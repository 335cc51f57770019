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

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.rheology.load_history import History
from kaju.model.rheology.schemes import Laws, Scheme, Stretch, force_at_rate, rates
from kaju.model.rheology.schemes import scheme as scheme_named

Answer = Callable[[ArrayLike], Floats]


@dataclass(frozen=True)
class ThreeElement:
    """A Voigt element (K_f, D_f) in series with a damper D_d.

    Parameters
    ----------
    K_f : float
        Stiffness of the spring (N/m for a spring, Pa for a cell), 0 or more.
    D_f : float
        Damper beside the spring (N s/m or Pa s), 0 or more; not both may be 0.
    D_d : float
        Damper in series (N s/m or Pa s), above 0; infinite means that nothing flows.

    Raises
    ------
    ParameterError
        If a number is outside its range, or K_f and D_f are both 0.

    Examples
    --------
    >>> from kaju import ThreeElement
    >>> noodle = ThreeElement(K_f=2.0, D_f=1.0, D_d=10.0)
    >>> noodle.K_f / noodle.D_f  # 1/s
    2.0
    """

    K_f: float
    D_f: float = 0.0
    D_d: float = inf

    def __post_init__(self) -> None:
        for name, value in (("K_f", self.K_f), ("D_f", self.D_f)):
            if not (isfinite(value) and value >= 0.0):
                raise ParameterError(f"{name}: must be a finite number from 0 upwards, got {value}")
        if not self.D_d > 0.0:
            raise ParameterError(
                f"D_d: must be above 0 (infinite: nothing flows), got {self.D_d}; "
                "a damper of 0 would carry no force at all"
            )
        if self.K_f == 0.0 and self.D_f == 0.0:
            raise ParameterError(
                "K_f and D_f: both are 0, so the element would carry no force at all; "
                "give it a spring (K_f) or a damper (D_f)"
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
            pace = t * _rate(self.K_f, self.D_f)
            given = self._part_given(t, -np.expm1(-pace), _decay_mean(pace))
        return np.asarray(given + t / self.D_d)

    def _part_given(self, times: Floats, share: Floats, mean: Floats) -> Floats:
        """Return share/K_f, which is t/D_f · mean, in the form that keeps its digits.

        The second holds for K_f = 0 too; it is used while little of 1/K_f has been given.
        """
        early = share < 0.5
        scale = np.divide(times, self.D_f, out=np.zeros_like(times), where=early)
        return np.where(early, scale * mean, share / (self.K_f or 1.0))

    def ramp_compliance(self, times: ArrayLike) -> Floats:
        """Return ∫₀ᵗJ: displacement per rate of a force that has grown since time 0."""
        t = _since(times)
        if self.D_f == 0.0:
            given = t / self.K_f
        else:
            pace = t * _rate(self.K_f, self.D_f)
            mean = _decay_mean_twice(pace)
            given = t * self._part_given(t, pace * mean, mean)
        return np.asarray(given + 0.5 * t * (t / self.D_d))

    def relaxation_modulus(self, times: ArrayLike) -> Floats:
        """Return G(t): force per displacement held since time 0, after its first impulse."""
        t = _since(times)
        fading = (
            self._series_share**2 * self.K_f * np.exp(-t * _rate(self.K_f, self.D_d + self.D_f))
        )
        return np.asarray(np.where(t > 0.0, fading, 0.0))

    def ramp_force(self, times: ArrayLike) -> Floats:
        """Return force per speed of a displacement that has grown since time 0 (N s/m)."""
        t = _since(times)
        share, pace = self._series_share, t * _rate(self.K_f, self.D_d + self.D_f)
        spring = share * self.K_f * t * _decay_mean(pace)
        return np.asarray(np.where(t > 0.0, spring + share * self.D_f * np.exp(-pace), 0.0))

    @property
    def _series_share(self) -> float:
        """D_d/(D_d + D_f): share of a sudden rate that the Voigt part takes."""
        return 1.0 / (1.0 + self.D_f / self.D_d)

    def creep(
        self, *, force: float | History, times: ArrayLike, scheme: str = "backward_euler"
    ) -> Floats:
        """Return the displacement under a force.

        Parameters
        ----------
        force : float or History
            A force held from time 0 (N or Pa), or a history whose factor is the force.
        times : array_like, shape (n,)
            Rising times (s), none negative. The scheme steps from 0 to the first of them and
            on from each to the next, so equal distances are the scheme's own equal steps. A
            corner of the history between two of them is stepped on as well.
        scheme : {"backward_euler", "sdirk2", "exact"}
            How time is stepped; "exact" evaluates the solution itself.

        Returns
        -------
        numpy.ndarray, shape (n,)
            Displacement at `times`; at time 0 it is 0, before anything could give.

        Raises
        ------
        ParameterError
            If the times fall or are negative, or the scheme is unknown.
        """
        t = _rising(times)
        if scheme == "exact":
            return _superpose(_history(force), t, self.creep_compliance, self.ramp_compliance)
        method = scheme_named(scheme)
        if isinstance(force, History):
            return self._step_along(force, t, method, stretched=False)
        return self._held_force(_finite(force), t, method)

    def _held_force(self, force: float, times: Floats, method: Scheme) -> Floats:
        """Step under a constant force: every step multiplies the part that has not given yet."""
        flow = times * (force / self.D_d)
        if self.D_f == 0.0:
            return np.asarray(np.where(times > 0.0, force / self.K_f, 0.0) + flow)
        rate = _rate(self.K_f, self.D_f)
        lengths = np.diff(times, prepend=0.0)
        given = -np.expm1(_running_sum(method.log_factor(lengths * rate)))
        pace = times * rate
        return np.asarray(force * self._part_given(times, given, _mean(given, pace)) + flow)

    def relaxation(
        self, *, displacement: float | History, times: ArrayLike, scheme: str = "backward_euler"
    ) -> Floats:
        """Return the force at a given displacement; arguments as in `creep`.

        Raises
        ------
        ParameterError
            If the displacement jumps while both dampers act: a jump would need an impulse.
        """
        t = _rising(times)
        history = _history(displacement)
        if self.D_f > 0.0 and any(corner.jump for corner in history.corners()):
            raise ParameterError(
                f"displacement: a jump would need an infinite force, because D_f = {self.D_f} "
                "resists every rate; give a ramp, History().ramp(to, duration)"
            )
        if scheme == "exact":
            return _superpose(history, t, self.relaxation_modulus, self.ramp_force)
        return self._step_along(history, t, scheme_named(scheme), stretched=True)

    def _step_along(
        self, history: History, times: Floats, method: Scheme, *, stretched: bool
    ) -> Floats:
        """Step along a history; return displacements under it as force, or forces if `stretched`.

        An elongation is counted from the step's beginning, so that short steps lose no digits.
        """
        law = Laws(*np.array([self.K_f, self.D_f, self.D_d]))
        nodes = np.union1d(times, [0.0, *(c for c in history.times if c < times[-1])])
        starts, ends = history.after(nodes[:-1]), history.at(nodes[1:])
        jumps = starts - history.at(nodes[:-1])
        state = Stretch(np.zeros(()), np.zeros(()))
        answers = np.zeros(len(nodes))
        for n, step in enumerate(np.diff(nodes).tolist()):
            length = method.gamma * step
            elongation = 0.0
            for end, weight in zip(method.ends, method.weights, strict=True):
                growth = end * (ends[n] - starts[n])
                if stretched:
                    speed = (jumps[n] + growth - elongation) / length
                    force = force_at_rate(law, length, state, speed)
                    elongation += weight * step * speed
                else:
                    force = np.asarray(starts[n] + growth)
                rate = rates(law, length, state, force)
                state = Stretch(state.q + weight * step * rate.q, state.d + weight * step * rate.d)
            answers[n + 1] = force if stretched else state.q + state.d
        return np.asarray(answers[np.searchsorted(nodes, times)])


def laws_of(elements: Iterable[ThreeElement]) -> Laws:
    """Gather single elements."""
    table = np.array([(e.K_f, e.D_f, e.D_d) for e in elements], dtype=np.float64)
    return Laws(*np.ascontiguousarray(table.reshape(-1, 3).T))


def _rate(stiffness: float, damping: float) -> float:
    """Return K/D (1/s) within the range of floats: above 0, or 0 where nothing happens."""
    rate = stiffness / damping
    return min(rate, 1e250) if rate >= 1e-250 else 0.0


def _finite(value: float) -> float:
    if not isfinite(value):
        raise ParameterError(f"force or displacement: must be a finite number, got {value}")
    return float(value)


def _history(driver: float | History) -> History:
    return driver if isinstance(driver, History) else History.step(_finite(driver))


def _since(times: ArrayLike) -> Floats:
    return np.maximum(np.asarray(times, dtype=np.float64), 0.0)


def _rising(times: ArrayLike) -> Floats:
    t = np.atleast_1d(np.asarray(times, dtype=np.float64))
    if t.ndim != 1 or not np.all(np.isfinite(t)) or np.any(t < 0.0) or np.any(np.diff(t) < 0.0):
        raise ParameterError(
            "times: must be one row of finite times from 0 upwards that do not fall"
        )
    return t


def _running_sum(values: Floats) -> Floats:
    """Return the cumulative sum, block by block: rounding grows with the root of the length."""
    width = 1024
    blocks = np.zeros((-(-len(values) // width), width))
    blocks.ravel()[: len(values)] = values
    inner = np.cumsum(blocks, axis=1)
    before = np.concatenate([[0.0], np.cumsum(inner[:-1, -1])]) if len(values) else np.zeros(0)
    return np.asarray((inner + before[:, None]).ravel()[: len(values)])


def _mean(share: Floats, x: Floats) -> Floats:
    """Return share/x, and 1 at x = 0."""
    return np.divide(share, x, out=np.ones_like(x), where=x > 0.0)


def _decay_mean(x: Floats) -> Floats:
    """Return (1 - e⁻ˣ)/x, the mean of e⁻ˣ from 0 to x."""
    return _mean(-np.expm1(-x), x)


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
