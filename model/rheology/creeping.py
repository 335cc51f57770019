"""Creep of elements, networks and bodies over time: one call, or step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError, ResultError, brief, by_name, require
from kaju.model.elastic.solve import solve_cells
from kaju.model.network.springs import SpringNetwork
from kaju.model.scene import Scene
from kaju.model.stepper import Stepper
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.transfer_result import NO_EQUILIBRIUM
from kaju.stepping import NOTE, interrupt_requested

from .creep_result import CreepResult
from .creeping_elastic import ElasticCreepResult, elastic_body
from .creeping_elements import Elements, TransferCreepResult, creeping_agents
from .creeping_network import CreepingNetwork, NetworkCreepResult
from .creeping_step import Creeping
from .element import ThreeElement, laws_of
from .integrate import Integrator, Reached
from .load_history import History

Subject = ThreeElement | SpringNetwork | Scene
Rheology = ThreeElement | Sequence[ThreeElement] | None
AnyTimeResult = CreepResult | NetworkCreepResult | TransferCreepResult | ElasticCreepResult


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
def creep(
    subject: Subject, history: History | None = None, duration: float | None = None, **how: Any
) -> AnyTimeResult:
    """Let a body creep under a history of loads and displacements.

    Parameters
    ----------
    subject : ThreeElement, SpringNetwork or Scene
        The history is an element's force (N); it multiplies the forces and given displacements of
        a network's last stage, or a scene's loads and those of its sides.
    history : History, optional
        Factor over time; of a scene, its own `history` unless given.
    duration : float, optional
        How long (s); by default as long as the history.
    times : array_like, optional
        Times at which the result is wanted (s), rising, up to `duration`; by default 101, evenly
        spread, and the corners of the history. Each takes memory, and none changes the time steps.
    tolerance : float
        Error allowed while time grows by the factor e, as a share of the largest stretch.
    rheology : ThreeElement or sequence of them
        Networks: the material of the springs; one element is scaled to the stiffness of each
        spring, a sequence is taken as it is.
    most_steps : int
        Time steps after which a run gives up.

    Returns
    -------
    CreepResult, NetworkCreepResult, TransferCreepResult or ElasticCreepResult
        Displacement and more at each of the times, by the kind of `subject` and of its rule.

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
    return CreepModel(subject, history, duration, **how).run(progress=False)


class CreepModel(Stepper[AnyTimeResult]):
    """Creep, step by step in time.

    Every step goes to the next of the times asked for (`moment`, in s), by as many time steps as
    the tolerance needs. Parameters, errors and numbers are those of `creep`.

    Examples
    --------
    >>> import kaju
    >>> dough = kaju.ThreeElement(K_f=2.0, D_f=1.0, D_d=20.0)
    >>> model = kaju.CreepModel(dough, kaju.History.step().hold(10.0), times=[0, 1, 5, 10])
    >>> model.run(2).displacement.round(3)
    array([0.   , 0.482, 0.75 ])
    >>> model.step()
    >>> model.moment
    10.0
    """

    @by_name
    def __init__(
        self,
        subject: Subject,
        history: History | None = None,
        duration: float | None = None,
        *,
        times: ArrayLike | None = None,
        tolerance: float = 1e-3,
        rheology: Rheology = None,
        most_steps: int = 100_000,
    ) -> None:
        known = isinstance(subject, Scene | SpringNetwork | ThreeElement)
        asked = "subject: a Scene, a SpringNetwork or a ThreeElement is needed"
        require(known, f"{asked}, got {brief(subject)}")
        if history is None and isinstance(subject, Scene):
            history = subject.history
        if not isinstance(history, History):
            raise ParameterError(
                "history: must be a History, such as History.step().hold(10.0), got "
                f"{history!r}. A scene may have its own, [history] with times and factors"
            )
        require(0.0 < tolerance < 1.0, f"tolerance: must lie between 0 and 1, got {tolerance}")
        self.subject, self.history = subject, history
        self.scene = subject if isinstance(subject, Scene) else None
        self.network = subject if isinstance(subject, SpringNetwork) else None
        last = history.duration if duration is None else duration
        self._asked = _asked_times(history, last, times)
        self._system = _system(subject, rheology)
        start = self._system.start()
        self._stored_first = self._system.stored(start)
        self._state = Reached(start)
        # Of every time asked for: the time (s), energies (J), and what the result keeps.
        self._moments: list[tuple[float, tuple[float, ...], dict[str, Floats]]] = []
        integrator = Integrator(self._system, history, last, tolerance, most_steps)
        self._ahead = integrator.states(self._state, self._asked)
        if self._asked[0] == 0.0:
            self.advance()

    @property
    def moment(self) -> float:
        """The time reached (s)."""
        return self._state.time

    def advance(self) -> None:
        """Go on to the next of the times asked for."""
        state = self._state = next(self._ahead)
        stored = self._system.stored(state.fields) - self._stored_first
        energies = (state.work, stored, state.dissipated, state.numerical, state.at_jumps)
        record = {name: part.copy() for name, part in self._system.record(state.fields).items()}
        self._moments.append((state.time, energies, record))
        self.running = self.moment < self._asked[-1]

    def progress(self) -> str:
        """Return the line of progress."""
        return f"{self.moment:.4g} s of {self._asked[-1]:.4g} s"

    def result(self) -> AnyTimeResult:
        """Return what has been computed so far.

        Raises
        ------
        ResultError
            Before the first step, unless the start is among the times asked for.
        """
        if not self._moments:
            raise ResultError("result: no time has passed yet; take a step first")
        state = self._state
        at, energies, records = zip(*self._moments, strict=True)
        times = np.array(at)
        work, stored, dissipated, numerical, at_jumps = np.array(energies).T
        made: Any = self._system.result  # of a class by what creeps
        found: AnyTimeResult = made(
            times=times,
            factors=self.history.at(times),
            work=work,
            stored=stored,
            dissipated=dissipated,
            numerical=numerical,
            at_jumps=at_jumps,
            steps=state.steps,
            steps_rejected=state.rejected,
            error_estimate=state.error / (state.scale or 1.0),
            seconds=self.seconds,
            notes=self._notes(float(np.abs(work).max()), float(at_jumps[-1])),
            **self._system.parts,
            **{name: np.stack([record[name] for record in records]) for name in records[0]},
        )
        if self.scene is None:
            return found
        of_scene = self.scene.notes_on(float(found.largest_displacement().max()))
        return replace(found, notes=(*found.notes, *of_scene))

    def _notes(self, work: float, at_jumps: float) -> tuple[str, ...]:
        notes = []
        if self.scene is not None and self.scene.rule.kind == "prescribed":
            notes.append(NO_EQUILIBRIUM)
            static = self._system.parts["static"]
            notes += [] if static.last.generations else [static.outcome]
        if interrupt_requested():
            notes.append(NOTE)
        if at_jumps > 0.01 * work:
            notes.append(
                f"{at_jumps:.3g} J were released where the load jumps: a load put on at once "
                "does twice the work that springs store, and no damper beside them takes the "
                "rest; a ramp, History().ramp(1.0, duration), avoids it"
            )
        return tuple(notes)


def _system(subject: Subject, rheology: Rheology) -> Creeping:
    """Return what is integrated over time."""
    if isinstance(subject, SpringNetwork):
        if rheology is None:
            raise ParameterError(
                "rheology: is needed, because springs alone do not creep; give a ThreeElement"
            )
        return CreepingNetwork(subject, rheology)
    mine = "rheology: is for spring networks; the cells of a scene have that of their material"
    require(rheology is None, mine)
    if isinstance(subject, ThreeElement):
        return Elements(laws_of([subject]), np.ones(1))
    if subject.rule.kind == "prescribed":
        return creeping_agents(LoadModel(subject).run())
    return elastic_body(solve_cells(subject, tolerance=1e-10))  # correspondence scales it


def _asked_times(history: History, last: float, times: ArrayLike | None) -> Floats:
    """Return the times at which the result is wanted."""
    require(
        isfinite(last) and last > 0.0,
        f"duration: must be above 0 s, got {last}; a history that only jumps needs a duration",
    )
    if times is None:
        corners = [time for time in history.times if time <= last]
        return np.union1d(np.linspace(0.0, last, 101), corners)
    asked = np.atleast_1d(np.asarray(times, dtype=np.float64))
    inside = bool(asked.size) and bool(np.all((asked >= 0.0) & (asked <= last)))
    rises = asked.ndim == 1 and bool(np.all(np.diff(asked) > 0.0))
    require(
        inside and rises, f"times: must rise from 0 s upwards to {last} s (the duration) at most"
    )
    return asked
