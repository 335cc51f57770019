"""Creep: what becomes of elements, networks and bodies when time is let in.

One call for all of them::

    bite = History().ramp(1.0, duration=0.2).hold(5.0).release(duration=0.1).hold(20.0)
    result = creep(network, bite, rheology=ThreeElement(K_f, D_f, D_d), tolerance=1e-3)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from time import perf_counter
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.elastic.solve import solve
from kaju.model.network.springs import SpringNetwork
from kaju.model.rheology import schemes
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.integrate import Loading, StepControl, TimeRecorder, stops
from kaju.model.rheology.load_history import History
from kaju.model.scene import Scene
from kaju.model.transfer.load_model import LoadModel
from kaju.stopping import NOTE, interrupt_requested, interruptible

from .creep_result import CreepResult, CreepState
from .creeping_body import CreepingAgents, Elements, TransferCreepResult
from .elastic import CorrespondingBody, ElasticCreepResult, SteppedBody, elastic_body
from .network import CreepingNetwork, NetworkCreepResult

System = Elements | CreepingNetwork | SteppedBody
_STATIC_TOLERANCE = 1e-10
"""Accuracy (energy norm) of the elastic answer that the correspondence principle scales."""

Drives = Literal["both", "forces", "displacements"]


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
    subject: ThreeElement | SpringNetwork | Scene,
    history: History | None = None,
    duration: float | None = None,
    *,
    step: float | None = None,
    tolerance: float = 1e-3,
    times: ArrayLike | None = None,
    scheme: Literal["sdirk2", "backward_euler"] = "sdirk2",
    rheology: ThreeElement | Sequence[ThreeElement] | None = None,
    drive: Drives = "both",
    mass: ArrayLike | None = None,
    resume: CreepState | None = None,
    most_steps: int = 100_000,
) -> CreepResult | NetworkCreepResult | TransferCreepResult | ElasticCreepResult:
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
    mass : float or array_like, optional
        Point mass at the loaded end of the element, or at each node of the network (kg). What
        is pushed then swings, and its kinetic energy is part of `stored`.
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
    options: dict[str, Any] = {"rheology": rheology, "drive": drive, "mass": mass, "resume": resume}
    options |= {"step": step, "tolerance": tolerance, "most_steps": most_steps}
    task = TimeTask(subject, history, duration, times=times, scheme=scheme, **options)

    def run() -> AnyCourse:
        log, state = TimeRecorder(), task.first
        for state in task.stops(task.first):
            log.note(task.system, state)
        return task.course(log, state, perf_counter() - began)

    began = perf_counter()
    return interruptible(run)


AnyCourse = CreepResult | NetworkCreepResult | TransferCreepResult | ElasticCreepResult
JUMPS_SAID_FROM = 0.01
"""Share of the work that is set free at jumps from which on a note says so."""


class TimeTask:
    """What creeps, under which history, from where, and when (s) it is looked at: see `creep`."""

    def __init__(
        self,
        subject: ThreeElement | SpringNetwork | Scene,
        history: History | None = None,
        duration: float | None = None,
        *,
        step: float | None = None,
        tolerance: float = 1e-3,
        times: ArrayLike | None = None,
        scheme: Literal["sdirk2", "backward_euler"] = "sdirk2",
        rheology: ThreeElement | Sequence[ThreeElement] | None = None,
        drive: Drives = "both",
        mass: ArrayLike | None = None,
        resume: CreepState | None = None,
        most_steps: int = 100_000,
    ) -> None:
        self.history = _history_of(subject, history)
        self.asked = _asked_times(self.history, duration, times, resume)
        self._pace = _pace(step, tolerance, most_steps)
        self._method = schemes.scheme(scheme)
        self._drives = _drives(self.history, drive)
        self.system = _system(subject, rheology, drive, mass)
        self.first = resume or CreepState(self.system.start())
        _check_fits(self.first, self.system)

    def stops(self, state: CreepState) -> Iterator[CreepState]:
        """Yield the states at the times asked for, from a state on."""
        if isinstance(self.system, CreepingNetwork):
            self.system.begin(state.fields, float(self._drives.displacements.at(state.time)))
        yield from stops(self.system, self._method, self._drives, state, self.asked, self._pace)

    def course(self, log: TimeRecorder, state: CreepState, seconds: float) -> AnyCourse:
        """Put together what was seen."""
        return _result(self.system, self.history, log, state, seconds)


def _history_of(subject: ThreeElement | SpringNetwork | Scene, history: History | None) -> History:
    """Return what drives the subject."""
    if isinstance(history, History):
        return history
    if isinstance(subject, Scene) and subject.history is not None:
        return subject.history
    raise ParameterError(
        f"history: a History is needed, got {history!r}; such as History.step().hold(10.0). A "
        "scene may bring its own, as [history] with times and factors"
    )


def _system(
    subject: ThreeElement | SpringNetwork | Scene,
    rheology: ThreeElement | Sequence[ThreeElement] | None,
    drive: Drives,
    mass: ArrayLike | None,
) -> System:
    """Make what is marched through time."""
    if isinstance(subject, SpringNetwork):
        if rheology is None:
            raise ParameterError(
                "rheology: a spring network says nothing about time; give a ThreeElement"
            )
        return CreepingNetwork(subject, rheology, mass=mass)
    if rheology is not None:
        raise ParameterError(
            "rheology: is for spring networks; the cells of a scene have that of their material"
        )
    if isinstance(subject, Scene):
        if mass is not None:
            raise ParameterError("mass: the cells of a scene creep without inertia; leave it out")
        if subject.rule.kind == "prescribed":
            return CreepingAgents(LoadModel(subject).run())
        return elastic_body(solve(subject, tolerance=_STATIC_TOLERANCE))
    laws = schemes.Laws.of([subject])
    weight = None if mass is None else np.atleast_1d(np.asarray(mass, dtype=np.float64))
    return Elements(laws, np.ones(1), stretched=drive == "displacements", mass=weight)


def _drives(history: History, drive: Drives) -> Loading:
    if drive not in ("both", "forces", "displacements"):
        raise ParameterError(f"drive: must be 'both', 'forces' or 'displacements', got {drive!r}")
    still = History()
    return Loading(
        still if drive == "displacements" else history, still if drive == "forces" else history
    )


def _result(
    system: System, history: History, log: TimeRecorder, state: CreepState, seconds: float
) -> CreepResult | NetworkCreepResult | TransferCreepResult | ElasticCreepResult:
    """Put together what was seen."""
    records = [np.stack(parts) for parts in zip(*log.records, strict=True)]
    work, stored, dissipated, numerical, at_jumps = np.array(log.energies).T
    course: dict[str, Any] = {
        "times": np.array(log.times),
        "factors": history.at(log.times),
        "work": work,
        "stored": stored - system.stored(system.start()),
        "dissipated": dissipated,
        "numerical": numerical,
        "at_jumps": at_jumps,
        "state": state,
        "seconds": seconds,
        "notes": _notes(float(np.abs(work).max()), float(at_jumps[-1])),
    }
    if isinstance(system, CreepingAgents):
        return TransferCreepResult(**course, static=system.static, growth=records[0])
    if isinstance(system, CorrespondingBody):
        return ElasticCreepResult(**course, static=system.static, growth=records[0][:, 0])
    if isinstance(system, SteppedBody):
        faces, cells, edges = records
        return ElasticCreepResult(
            **course, static=system.static, body=system, faces=faces, cells=cells, edges=edges
        )
    if isinstance(system, CreepingNetwork):
        moved, tension = records
        return NetworkCreepResult(
            **course, displacement=moved, force=tension, network=system.network
        )
    records = [record[:, 0] for record in records]
    return CreepResult(**course, displacement=records[0], force=records[1])


def _notes(work: float, at_jumps: float) -> tuple[str, ...]:
    notes = [NOTE] if interrupt_requested() else []
    if at_jumps > JUMPS_SAID_FROM * work:
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


def _pace(step: float | None, tolerance: float, most_steps: int) -> StepControl:
    if step is not None and not (isfinite(step) and step > 0.0):
        raise ParameterError(f"step: must be above 0 s, got {step}")
    if not 0.0 < tolerance < 1.0:
        raise ParameterError(f"tolerance: must lie between 0 and 1, got {tolerance}")
    return StepControl(step, tolerance, most_steps)


def _check_fits(state: CreepState, system: System) -> None:
    expected = [part.shape for part in system.start()]
    found = [part.shape for part in state.fields]
    if found != expected:
        raise ParameterError(
            f"resume: the state is of something else: its arrays have shapes {found}, "
            f"but {expected} are needed"
        )
