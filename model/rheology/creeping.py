"""Creep of elements, networks and bodies over time.

One call for all of them::

    bite = History().ramp(1.0, duration=0.2).hold(5.0).release(duration=0.1).hold(20.0)
    result = creep(network, bite, rheology=ThreeElement(K_f, D_f, D_d), tolerance=1e-3)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite
from time import perf_counter
from typing import Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.elastic.solve import solve
from kaju.model.network.springs import SpringNetwork
from kaju.model.rheology import schemes
from kaju.model.rheology.element import ThreeElement, laws_of
from kaju.model.rheology.integrate import Creeping, Drives, Integrator, Loading, StepControl
from kaju.model.rheology.load_history import History
from kaju.model.scene import Scene
from kaju.model.transfer.load_model import LoadModel
from kaju.stopping import NOTE, interrupt_requested, interruptible

from .creep_result import CreepResult, CreepState
from .creeping_elastic import ElasticCreepResult, elastic_body
from .creeping_elements import CreepingAgents, Elements, TransferCreepResult
from .creeping_network import CreepingNetwork, NetworkCreepResult

Subject = ThreeElement | SpringNetwork | Scene
SchemeName = Literal["sdirk2", "backward_euler"]
Rheology = ThreeElement | Sequence[ThreeElement] | None
AnyTimeResult = CreepResult | NetworkCreepResult | TransferCreepResult | ElasticCreepResult

_STATIC_TOLERANCE = 1e-10
"""Accuracy (energy norm) of the elastic answer that the correspondence principle scales."""
_NO_EQUILIBRIUM = (
    "the prescribed rule keeps no equilibrium: its displacements may be hardly closer to those of "
    'the body than no answer at all; rule = { kind = "elastic" } gives these'
)
_JUMPS_NOTED_FROM = 0.01
"""Share of the work that is set free at jumps from which on a note says so."""


# The overloads only say which subject gives which result; options are checked by name below.
@overload
def creep(
    subject: ThreeElement, history: History | None = ..., duration: float | None = ..., **how: Any
) -> CreepResult: ...
@overload
def creep(
    subject: SpringNetwork, history: History | None = ..., duration: float | None = ..., **how: Any
) -> NetworkCreepResult: ...
@overload
def creep(
    subject: Scene, history: History | None = ..., duration: float | None = ..., **how: Any
) -> TransferCreepResult | ElasticCreepResult: ...
def creep(  # type: ignore[misc]
    subject: Subject,
    history: History | None = None,
    duration: float | None = None,
    *,
    step: float | None = None,
    tolerance: float = 1e-3,
    times: ArrayLike | None = None,
    scheme: SchemeName = "sdirk2",
    rheology: Rheology = None,
    drive: Drives = "both",
    resume: CreepState | None = None,
    most_steps: int = 100_000,
) -> AnyTimeResult:
    """Let a body creep under a history of loads or displacements.

    Parameters
    ----------
    subject : ThreeElement, SpringNetwork or Scene
        An element takes the history as its force (N), or as its elongation (m) with
        ``drive="displacements"``. A network has the forces and given displacements of its
        last stage multiplied by the history, a scene its loads.
    history : History, optional
        Factor over time; of a scene, its own `history` unless given.
    duration : float, optional
        How long (s); by default as long as the history.
    step : float, optional
        Longest step (s): steps are equal between corners of the history and times asked for.
        By default steps are chosen by `tolerance`.
    tolerance : float
        Error that may come up in an e-fold of time, as a share of the largest stretch, in
        quarters; see `kaju.model.rheology.integrate`. Ignored if `step` is given.
    times : array_like, optional
        Times at which the result is wanted (s), rising, up to `duration`; by default 101,
        evenly spread, and the corners of the history.
    scheme : {"sdirk2", "backward_euler"}
        Time stepping, of second or first order.
    rheology : ThreeElement or sequence of them
        Networks: the material of the springs; one element is scaled to the stiffness of each
        spring, a sequence is taken as it is.
    drive : {"both", "forces", "displacements"}
        What the history multiplies; what it does not multiply stays 0.
    resume : CreepState, optional
        Where an earlier run ended. If that end was among the times of an unbroken run, the
        numbers that follow are the same (to rounding, if supports move).
    most_steps : int
        Steps after which a run that keeps a tolerance gives up.

    Returns
    -------
    CreepResult
        Of an element.
    NetworkCreepResult
        Of a network.
    TransferCreepResult
        Of a scene with a prescribed rule.
    ElasticCreepResult
        Of a scene with an elastic rule. Large bodies of several materials keep arrays for
        every time asked for, so ask for few.

    Raises
    ------
    ParameterError
        If an argument is outside its rule.
    ConvergenceError
        If the tolerance cannot be kept or a time step finds no balance.
    TangentError
        If the network buckles or is a mechanism.

    Examples
    --------
    >>> from kaju import History, ThreeElement, creep
    >>> noodle = ThreeElement(K_f=2.0, D_f=1.0, D_d=10.0)
    >>> result = creep(noodle, History.step().hold(4.0), times=[1.0, 4.0])
    >>> print(f"{result.displacement[-1]:.2f}")
    0.90
    """
    task = TimeTask(
        subject,
        history,
        duration,
        times=times,
        control=StepControl(step, tolerance, most_steps),
        scheme=scheme,
        rheology=rheology,
        drive=drive,
        resume=resume,
    )

    def run() -> AnyTimeResult:
        moments, state = [], task.first
        for state in task.states(task.first):
            moments.append(task.moment(state))
        return task.result(moments, state, perf_counter() - began)

    began = perf_counter()
    return interruptible(run)


class Moment(NamedTuple):
    """What the result keeps of a time asked for."""

    time: float
    energies: tuple[float, ...]  # work, stored, dissipated, numerical, at jumps (J)
    record: dict[str, Floats]


class TimeTask:
    """What creeps, under which history, from where, and when (s) it is looked at: see `creep`."""

    def __init__(
        self,
        subject: Subject,
        history: History | None,
        duration: float | None,
        *,
        times: ArrayLike | None,
        control: StepControl,
        scheme: SchemeName,
        rheology: Rheology,
        drive: Drives,
        resume: CreepState | None = None,
    ) -> None:
        if history is None and isinstance(subject, Scene):
            history = subject.history
        if not isinstance(history, History):
            raise ParameterError(
                f"history: a History is needed, got {history!r}; such as "
                "History.step().hold(10.0). A scene may bring its own, as [history] with times "
                "and factors"
            )
        self.history = history
        by_rule = isinstance(subject, Scene) and subject.rule.kind == "prescribed"
        self._rule = (_NO_EQUILIBRIUM,) if by_rule else ()
        self.asked = _asked_times(history, duration, times, resume)
        method, loading = schemes.scheme(scheme), Loading.of(history, drive)
        last = history.duration if duration is None else duration
        self.system = _system(subject, rheology, drive)
        self._integrator = Integrator(self.system, method, loading, replace(control, end=last))
        start = self.system.start()
        self._stored_first = self.system.stored(start)
        self.first = resume or CreepState(start)
        expected = [part.shape for part in start]
        found = [part.shape for part in self.first.fields]
        if found != expected:
            raise ParameterError(
                f"resume: the state is of something else: its arrays have shapes {found}, "
                f"but {expected} are needed"
            )

    def states(self, state: CreepState) -> Iterator[CreepState]:
        """Yield the states at the times asked for, from a state on."""
        if isinstance(self.system, CreepingNetwork):
            factor = float(self._integrator.loading.displacements.at(state.time))
            self.system.begin(state.fields, factor)
        yield from self._integrator.states(state, self.asked)

    def moment(self, state: CreepState) -> Moment:
        """Return what the result keeps of a state."""
        stored = self.system.stored(state.fields) - self._stored_first
        energies = (state.work, stored, state.dissipated, state.numerical, state.at_jumps)
        record = {name: part.copy() for name, part in self.system.record(state.fields).items()}
        return Moment(state.time, energies, record)

    def result(self, moments: Sequence[Moment], state: CreepState, seconds: float) -> AnyTimeResult:
        """Put the result together, whose run stands at a state."""
        times = np.array([moment.time for moment in moments])
        work, stored, dissipated, numerical, at_jumps = np.array([m.energies for m in moments]).T
        found: Any = self.system.result(
            times=times,
            factors=self.history.at(times),
            work=work,
            stored=stored,
            dissipated=dissipated,
            numerical=numerical,
            at_jumps=at_jumps,
            state=state,
            seconds=seconds,
            notes=(*self._rule, *_notes(float(np.abs(work).max()), float(at_jumps[-1]))),
            **self.system.parts,
            **{name: np.stack([m.record[name] for m in moments]) for name in moments[0].record},
        )
        return found  # type: ignore[no-any-return]


def _system(subject: Subject, rheology: Rheology, drive: Drives) -> Creeping:
    """Return what is integrated over time."""
    if isinstance(subject, SpringNetwork):
        if rheology is None:
            raise ParameterError(
                "rheology: a spring network says nothing about time; give a ThreeElement"
            )
        return CreepingNetwork(subject, rheology)
    if rheology is not None:
        raise ParameterError(
            "rheology: is for spring networks; the cells of a scene have that of their material"
        )
    if isinstance(subject, Scene):
        if subject.rule.kind == "prescribed":
            return CreepingAgents(LoadModel(subject).run())
        return elastic_body(solve(subject, tolerance=_STATIC_TOLERANCE))
    stretched = drive == "displacements"
    return Elements(laws_of([subject]), np.ones(1), stretched=stretched)


def _notes(work: float, at_jumps: float) -> tuple[str, ...]:
    notes = [NOTE] if interrupt_requested() else []
    if at_jumps > _JUMPS_NOTED_FROM * work:
        notes.append(
            f"{at_jumps:.3g} J were set free where the load jumps: a load put on at once does "
            "twice the work that springs store, and no damper beside them takes up the rest; a "
            "ramp, History().ramp(1.0, duration), leaves it out"
        )
    return tuple(notes)


def _asked_times(
    history: History, duration: float | None, times: ArrayLike | None, resume: CreepState | None
) -> Floats:
    """Return the times at which the result is wanted."""
    last = history.duration if duration is None else duration
    start = 0.0 if resume is None else resume.time
    if not (isfinite(last) and last > start):
        raise ParameterError(
            f"duration: must be later than the start at {start} s, got {last}; "
            "a history that only jumps needs a duration"
        )
    if times is None:
        corners = [time for time in history.times if start <= time <= last]
        return np.union1d(np.linspace(start, last, 101), corners)
    asked = np.atleast_1d(np.asarray(times, dtype=np.float64))
    fits = asked.ndim == 1 and asked.size and np.all(np.isfinite(asked))
    if not (fits and asked[0] >= start and asked[-1] <= last and np.all(np.diff(asked) > 0.0)):
        raise ParameterError(
            f"times: must rise from {start} s or later to {last} s (the duration) at most"
        )
    return asked
