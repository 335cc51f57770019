"""March whatever creeps through time: by equal steps, or by steps that keep a tolerance.

What creeps (a single element, a spring network, a body) shows itself here only as a few
arrays and an answer to one question: *from here, over this implicit step, up to this load, at
which rates do you move?* Both time schemes are made of that question, so every kind of body
has both, with and without mass.

Steps end on every corner of the history and at every time asked for. With a tolerance each
step is made once whole and once as two halves; the halves are kept. Their difference, over
2 - 1 or 2² - 1, estimates the step's error, which may be tolerance · (largest stretch so
far) · h / 4(t + h), t counted since the last corner: the same share for every e-fold of time,
so that a fast and a slow process are both followed. Creep forgets errors rather than amplify
them, so the sum of the estimates, which is reported, stands above the error at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, inf, isfinite
from typing import NamedTuple, Protocol

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, KajuError, TangentError
from kaju.model.rheology.creep_result import CreepState
from kaju.model.rheology.load_history import History
from kaju.model.rheology.schemes import Energy, Scheme
from kaju.stopping import interrupt_requested

Fields = tuple[Floats, ...]

_SAME_MOMENT = 1e-12
"""Share of a time by which two may differ and still be one (0.1 + 0.2 and 0.3)."""
SHORTEST = 1e-30
"""Share of the time to the next corner: no process that a step can follow is quicker."""
CRAWL = 1e-10
"""The same of the time since the last corner: what is as quick has ended by then, unless the
body moves ever faster."""
LEAPS = 40
"""Steps that gave way, without one as long that held: over so many the least fault grows by
more than there are digits."""


class SubStep(NamedTuple):
    """One implicit step of a scheme, as the body is asked about it."""

    method: Scheme
    step: float
    """Length of the whole step (s)."""
    weight: float
    """Share of the whole step for which the rates count."""
    factor: float
    """Factor of the forces at the end of the implicit step."""
    displacement_factor: float
    """Factor of the given displacements at the end of the implicit step."""

    @property
    def substep(self) -> float:
        """Length of the implicit step (s)."""
        return self.method.gamma * self.step


class Creeping(Protocol):
    """What can be marched through time."""

    def start(self) -> Fields:
        """Return the state at time 0."""

    def rates(self, fields: Fields, push: SubStep) -> tuple[Fields, Energy]:
        """Return the rates in an implicit step from `fields`, and what it adds to the balance."""

    def gauge(self, fields: Fields) -> Floats:
        """Return the stretches on which errors are measured."""

    def stored(self, fields: Fields) -> float:
        """Return the energy that can be given back (J)."""

    def record(self, fields: Fields) -> tuple[Floats, ...]:
        """Return what is kept at a time asked for."""


class Loading(NamedTuple):
    """What drives the body: the factors of the forces and of the given displacements."""

    forces: History
    displacements: History

    def jumps_at(self, time: float) -> bool:
        """Tell whether one of them jumps at a time."""
        return any(float(h.at(time)) != float(h.after(time)) for h in self)

    def between(self, start: float, end: float) -> Floats:
        """Return both factors just after `start` and at `end`, shape (2, 2)."""
        return np.array([[float(h.after(start)), float(h.at(end))] for h in self])


@dataclass
class TimeRecorder:
    """What has been seen at the times asked for."""

    times: list[float] = field(default_factory=list)
    records: list[tuple[Floats, ...]] = field(default_factory=list)
    energies: list[tuple[float, float, float, float, float]] = field(default_factory=list)

    def note(self, system: Creeping, state: CreepState) -> None:
        """Write down where the body is."""
        self.times.append(state.time)
        self.records.append(tuple(np.array(part) for part in system.record(state.fields)))
        stored = system.stored(state.fields)
        booked = (state.work, stored, state.dissipated, state.numerical, state.at_jumps)
        self.energies.append(booked)


@dataclass(frozen=True)
class StepControl:
    """How long steps are: at most `step`, or such that each keeps the tolerance."""

    step: float | None
    tolerance: float
    most_steps: int


def stops(
    system: Creeping,
    method: Scheme,
    drive: Loading,
    state: CreepState,
    asked: Floats,
    pace: StepControl,
) -> Iterator[CreepState]:
    """March over the drive's corners; yield the state at each time `asked`, and where it stops."""
    corners = np.union1d(drive.forces.times, drive.displacements.times)
    nodes = np.union1d(asked, corners)
    nodes = nodes[(nodes > state.time) & (nodes <= asked[-1])]
    wanted = set(asked.tolist())
    if state.time in wanted:
        yield state
    for node in nodes.tolist():
        if node - state.time <= _SAME_MOMENT * node:
            state = replace(state, time=node)
        elif pace.step is None:
            corner = float(corners[corners <= state.time].max(initial=0.0))
            if state.scale == 0.0:
                later = corners[corners > state.time]
                end = float(later[0]) if later.size else float(asked[-1])
                state = _expect_scale(system, method, drive, state, end)
            state = _keep_tolerance(system, method, drive, state, node, corner, pace)
        else:
            state = _go_evenly(system, method, drive, state, node, pace.step)
        ended = interrupt_requested()
        if node in wanted or ended:
            yield state
        if ended:
            break


def take_step(
    system: Creeping, method: Scheme, fields: Fields, step: float, factors: Floats
) -> tuple[Fields, Floats]:
    """Return the state after a step (s), and its work, dissipation and the scheme's own part."""
    booked = np.zeros(3)
    for end, weight in zip(method.ends, method.weights, strict=True):
        force, displacement = factors[:, 0] + end * (factors[:, 1] - factors[:, 0])
        push = SubStep(method, step, weight, float(force), float(displacement))
        rates, energy = system.rates(fields, push)
        lasting = weight * step
        fields = tuple(part + lasting * rate for part, rate in zip(fields, rates, strict=True))
        booked += energy
    return fields, booked


def _go_evenly(
    system: Creeping, method: Scheme, drive: Loading, state: CreepState, node: float, most: float
) -> CreepState:
    """Go on to `node` in equal steps of at most `most`."""
    parts = max(1, ceil((node - state.time) / most * (1.0 - 1e-12)))
    length = (node - state.time) / parts
    marks = np.linspace(state.time, node, parts + 1).tolist()
    for start, end in pairwise(marks):
        factors = drive.between(start, end)
        fields, booked = take_step(system, method, state.fields, length, factors)
        scale, jump = _scale(system, state, fields), drive.jumps_at(start)
        state = state.moved(end, fields, booked, scale, jump=jump)
        if interrupt_requested():
            break
    return state


def _keep_tolerance(
    system: Creeping,
    method: Scheme,
    drive: Loading,
    state: CreepState,
    node: float,
    corner: float,
    pace: StepControl,
) -> CreepState:
    """Go on to `node` in steps whose estimated error keeps the tolerance."""
    wish, gave_way, too_long = state.next_step or 1e-3 * (node - state.time), 0, inf
    while state.time < node and not interrupt_requested():
        left = node - state.time
        # Two equal steps to the node rather than a long one and a sliver.
        step = left if wish >= left else min(wish, 0.5 * left)
        end = node if step == left else state.time + step
        tried, error, trouble = _doubled(system, method, drive, state, end)
        since = state.time - corner
        allowed = 0.25 * pace.tolerance * tried.scale * step / (since + step)
        growth = _growth(error, allowed, method.order)
        if error <= allowed:
            # A step cut short by the node says nothing against a longer one after it.
            wish = max(wish, step * growth) if step < wish else step * growth
            state = replace(tried, next_step=wish, error_estimate=state.error_estimate + error)
            gave_way = 0 if step >= too_long else gave_way
        else:
            wish = step * growth
            state = replace(state, rejected=state.rejected + 1)
        if isinstance(trouble, TangentError):
            gave_way, too_long = gave_way + 1, step
        shortest = max(SHORTEST * node, CRAWL * (state.time - corner))
        if gave_way > LEAPS or state.time + wish == state.time or wish < shortest:
            _refuse_to_crawl(state, pace, trouble)
        if state.steps + state.rejected > pace.most_steps:
            raise ConvergenceError(
                f"creep: {pace.most_steps} steps were made and only {state.time:.6g} s reached; "
                "allow a larger tolerance, more steps (most_steps=), or take scheme='sdirk2'"
            )
    return state


def _doubled(
    system: Creeping, method: Scheme, drive: Loading, state: CreepState, end: float
) -> tuple[CreepState, float, KajuError | None]:
    """Make a step whole and in halves; return where the halves lead, their error, and trouble."""
    middle = 0.5 * (state.time + end)
    half = 0.5 * (end - state.time)
    tried = state
    try:
        whole, _ = take_step(
            system, method, state.fields, 2.0 * half, drive.between(state.time, end)
        )
        for start, stop in ((state.time, middle), (middle, end)):
            fields, booked = take_step(
                system, method, tried.fields, half, drive.between(start, stop)
            )
            scale, jump = _scale(system, tried, fields), drive.jumps_at(start)
            tried = tried.moved(stop, fields, booked, scale, jump=jump)
    except (ConvergenceError, TangentError) as trouble:
        return state, inf, trouble  # a shorter step may find what a long one does not
    apart = np.abs(system.gauge(whole) - system.gauge(tried.fields))
    error = float(np.max(apart, initial=0.0)) / (2**method.order - 1)
    return tried, error if isfinite(error) else inf, None


def _growth(error: float, allowed: float, order: int) -> float:
    """Return by which factor the next step is longer: errors grow as its power order + 1."""
    if error <= allowed * 1e-6:
        return 5.0
    if not isfinite(error):
        return 0.1
    return float(min(5.0, max(0.1, 0.9 * (allowed / error) ** (1.0 / order))))


def _expect_scale(
    system: Creeping, method: Scheme, drive: Loading, state: CreepState, end: float
) -> CreepState:
    """Learn the size of the stretches to come from one step to the end of the first piece.

    In the first steps of a ramp stretch and error grow alike, and a tolerance that refers to
    the stretch so far could never be kept.
    """
    try:
        fields, _ = take_step(
            system, method, state.fields, end - state.time, drive.between(state.time, end)
        )
    except (ConvergenceError, TangentError):
        return replace(state, scale=float(np.finfo(np.float64).tiny))
    return replace(state, scale=_scale(system, state, fields))


def _scale(system: Creeping, state: CreepState, fields: Fields) -> float:
    return max(state.scale, float(np.max(np.abs(system.gauge(fields)), initial=0.0)))


def _refuse_to_crawl(state: CreepState, pace: StepControl, trouble: KajuError | None) -> None:
    if isinstance(trouble, TangentError):
        told = f"creep: at {state.time:.6g} s, in every step but the shortest: {trouble}"
        raise type(trouble)(told, trouble.nodes) from trouble
    raise ConvergenceError(
        f"creep: at {state.time:.6g} s no step however short keeps the tolerance "
        f"{pace.tolerance}: there it moves ever faster, as what folds or snaps through does; give "
        "it mass (mass=) to follow it there, end before (duration=), or load it less"
    ) from trouble
