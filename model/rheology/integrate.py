"""Integration over time of whatever creeps: by equal steps, or by steps that keep a tolerance.

A body (a single element, a spring network, cells) answers one question only: which rates it has
in an implicit step from its present state to a given load. Both time schemes are made of such
steps, so every kind of body has both.

Steps end on every corner of the history. Equal steps also end at every time asked for; where a
tolerance is kept, these times are read between the steps, which do not feel them. With it each
step is made once whole and once as two halves; the halves are kept. Their difference, over
2 - 1 or 2² - 1, estimates the step's error, which may be tolerance · (largest stretch so
far) · h / 4(t + h), t counted since the last corner: the same share for every e-fold of time,
so that a fast and a slow process are both followed. Creep forgets errors rather than amplify
them, so the sum of the estimates, which is reported, stands above the error at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, inf, isfinite
from typing import Any, Literal, Protocol

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, KajuError, ParameterError, TangentError
from kaju.model.rheology.creep_result import CreepState, TimeResult
from kaju.model.rheology.load_history import History
from kaju.model.rheology.schemes import Energy, Scheme, SubStep
from kaju.stopping import interrupt_requested

Fields = tuple[Floats, ...]
Drives = Literal["both", "forces", "displacements"]

_SAME_MOMENT = 1e-12
"""Share of a time by which two may differ and still be one (0.1 + 0.2 and 0.3)."""
_SHORTEST = 1e-30
"""Least step as a share of the time to the next corner: no process is quicker."""
_CRAWL = 1e-10
"""Least step as a share of the time since the last corner: a process as quick as that has ended
by then, unless the body moves ever faster."""
_MOST_FAILURES = 40
"""Steps that met a singular tangent, without one as long that did not: over so many the smallest
imperfection grows by more than there are digits."""


class Creeping(Protocol):
    """What can be integrated over time; its first two fields are stretches, which have errors."""

    @property
    def result(self) -> type[TimeResult]:
        """Class of its result."""

    @property
    def parts(self) -> dict[str, Any]:
        """Fields of the result besides its course and its records."""

    def start(self) -> Fields:
        """Return the state at time 0."""

    def rates(self, fields: Fields, substep: SubStep) -> tuple[Fields, Energy]:
        """Return the rates in an implicit step from `fields`, and what it adds to the balance."""

    def stored(self, fields: Fields) -> float:
        """Return the energy that can be given back (J)."""

    def record(self, fields: Fields) -> dict[str, Floats]:
        """Return what the result keeps of a time asked for, by the names of its fields."""


@dataclass(frozen=True)
class Loading:
    """Factors over time of the forces and of the given displacements."""

    forces: History
    displacements: History

    @classmethod
    def of(cls, history: History, drive: Drives) -> Loading:
        """Return the loading in which a history multiplies both, or one of them."""
        if drive not in ("both", "forces", "displacements"):
            raise ParameterError(
                f"drive: must be 'both', 'forces' or 'displacements', got {drive!r}"
            )
        still = History()
        return cls(
            still if drive == "displacements" else history, still if drive == "forces" else history
        )

    @cached_property
    def corners(self) -> Floats:
        """Times (s) at which one of them turns or jumps; points on a straight piece are none."""
        found = []
        for history in (self.forces, self.displacements):
            corners = history.corners()
            least = 1e-9 * max(abs(corner.bend) for corner in corners)
            found += [c.time for c in corners if c.jump or abs(c.bend) > least]
        return np.unique(found)

    @cached_property
    def jumps(self) -> set[float]:
        """Times (s) at which one of them jumps."""
        both = (*self.forces.corners(), *self.displacements.corners())
        return {corner.time for corner in both if corner.jump}

    def between(self, start: float, end: float) -> Floats:
        """Return both factors just after `start`, and by how much they have grown at `end`."""
        both = (self.forces, self.displacements)
        factors = np.array([[float(h.after(start)), float(h.at(end))] for h in both])
        factors[:, 1] -= factors[:, 0]
        return factors.T


@dataclass(frozen=True)
class StepControl:
    """How long steps are: at most `step` (s), or such that each keeps the tolerance."""

    step: float | None
    tolerance: float
    most_steps: int
    end: float = 0.0  # of the run (s), where the last step ends

    def __post_init__(self) -> None:
        if self.step is not None and not (isfinite(self.step) and self.step > 0.0):
            raise ParameterError(f"step: must be above 0 s, got {self.step}")
        if not 0.0 < self.tolerance < 1.0:
            raise ParameterError(f"tolerance: must lie between 0 and 1, got {self.tolerance}")


@dataclass(frozen=True)
class Integrator:
    """Takes a body through time under its loading."""

    system: Creeping
    method: Scheme
    loading: Loading
    control: StepControl

    def states(self, state: CreepState, asked: Floats) -> Iterator[CreepState]:
        """Yield the state at each time `asked`, and where an interrupt ends the run."""
        if self.control.step is None:
            yield from self._read_between(state, asked)
            return
        corners = self.loading.corners
        nodes = np.union1d(asked, corners)
        nodes = nodes[(nodes > state.time) & (nodes <= asked[-1])]
        wanted = set(asked.tolist())
        if state.time in wanted:
            yield state
        for node in nodes.tolist():
            if node - state.time <= _SAME_MOMENT * node:
                state = replace(state, time=node)
            else:
                state = self._in_equal_steps(state, node, self.control.step)
            ended = interrupt_requested()
            if node in wanted or ended:
                yield state
            if ended:
                break

    def _read_between(self, state: CreepState, asked: Floats) -> Iterator[CreepState]:
        """Yield the states at the times `asked`, which the steps on the way do not feel.

        Each is reached by a step of its own from the last half step before it.
        """
        corners, left = self.loading.corners, asked[asked >= state.time].tolist()
        if left and left[0] == state.time:
            yield state
            left.pop(0)
        while left and not interrupt_requested():
            later = corners[corners > state.time]
            node = float(later[0]) if later.size else self.control.end
            if node - state.time <= _SAME_MOMENT * node:
                state = replace(state, time=node)
                continue
            if state.scale == 0.0:
                state = replace(state, scale=self._expected_scale(state, node))
            corner = float(corners[corners <= state.time].max(initial=0.0))
            for before, middle, after in self._keep_tolerance(state, node, corner):
                state = after
                while left and left[0] <= state.time:
                    yield self._read(before, middle, state, left.pop(0))
                if not left:
                    break
        if left:
            yield state  # interrupted

    def _read(
        self, before: CreepState, middle: CreepState, after: CreepState, time: float
    ) -> CreepState:
        """Return the state at a time within a step, of which start, middle and end are known."""
        if time == after.time:
            return after
        base = before if time <= middle.time else middle
        read = self._advance(base, time, time - base.time)
        return replace(
            read,
            next_step=after.next_step,
            error_estimate=after.error_estimate,
            steps=after.steps,
            rejected=after.rejected,
        )

    def take_step(
        self, fields: Fields, start: float, end: float, step: float
    ) -> tuple[Fields, Floats]:
        """Return the fields after a step (s), and its work, dissipation and numerical energy."""
        energies = np.zeros(3)
        factors, growth = self.loading.between(start, end)
        for stage_end, weight in zip(self.method.ends, self.method.weights, strict=True):
            substep = SubStep(self.method, step, weight, *(factors + stage_end * growth).tolist())
            rates, energy = self.system.rates(fields, substep)
            fields = tuple(
                part + substep.duration * rate for part, rate in zip(fields, rates, strict=True)
            )
            energies += energy
        return fields, energies

    def _advance(self, state: CreepState, end: float, step: float) -> CreepState:
        """Return the state one step (s) later."""
        fields, energies = self.take_step(state.fields, state.time, end, step)
        work, dissipated, numerical = energies.tolist()
        return replace(
            state,
            fields=fields,
            time=end,
            scale=max(state.scale, _largest_stretch(fields)),
            work=state.work + work,
            dissipated=state.dissipated + dissipated,
            numerical=state.numerical + numerical,
            at_jumps=state.at_jumps + (numerical if state.time in self.loading.jumps else 0.0),
            steps=state.steps + 1,
        )

    def _in_equal_steps(self, state: CreepState, node: float, longest: float) -> CreepState:
        """Go on to `node` in equal steps of at most `longest`."""
        count = max(1, ceil((node - state.time) / longest * (1.0 - 1e-12)))
        ends = np.linspace(state.time, node, count + 1).tolist()
        step = (node - state.time) / count
        for end in ends[1:]:
            state = self._advance(state, end, step)
            if interrupt_requested():
                break
        return state

    def _keep_tolerance(
        self, state: CreepState, node: float, corner: float
    ) -> Iterator[tuple[CreepState, CreepState, CreepState]]:
        """Go on to `node` in steps whose estimated error keeps the tolerance.

        Yield the states before, in the middle and at the end of each.
        """
        control = self.control
        wish, failures, failed_step = state.next_step or 1e-5 * (node - state.time), 0, inf
        while state.time < node and not interrupt_requested():
            left = node - state.time
            # Two equal steps to the node rather than a long one and a sliver.
            step = left if wish >= left else min(wish, 0.5 * left)
            end = node if step == left else state.time + step
            middle, tried, error, trouble = self._doubled(state, end)
            since = state.time - corner
            allowed = 0.25 * control.tolerance * tried.scale * step / (since + step)
            growth = _growth(error, allowed, self.method.order)
            if error <= allowed:
                # A step cut short by the node says nothing against a longer one after it.
                wish = max(wish, step * growth) if step < wish else step * growth
                before = state
                state = replace(tried, next_step=wish, error_estimate=state.error_estimate + error)
                failures = 0 if step >= failed_step else failures
                yield before, middle, state
            else:
                wish = step * growth
                state = replace(state, rejected=state.rejected + 1)
            if isinstance(trouble, TangentError):
                failures, failed_step = failures + 1, step
            shortest = max(_SHORTEST * node, _CRAWL * (state.time - corner))
            too_short = wish < shortest or state.time + wish == state.time
            if failures > _MOST_FAILURES or too_short:
                self._refuse(state, trouble)
            if state.steps + state.rejected > control.most_steps:
                raise ConvergenceError(
                    f"creep: {control.most_steps} steps were made and only {state.time:.6g} s "
                    "reached; allow a larger tolerance, more steps (most_steps=), or take "
                    "scheme='sdirk2'"
                )

    def _doubled(
        self, state: CreepState, end: float
    ) -> tuple[CreepState, CreepState, float, KajuError | None]:
        """Make a step whole and in halves; return middle and end of these, error, and trouble."""
        middle, half = 0.5 * (state.time + end), 0.5 * (end - state.time)
        try:
            whole, _ = self.take_step(state.fields, state.time, end, 2.0 * half)
            first = self._advance(state, middle, half)
            halves = self._advance(first, end, half)
        except (ConvergenceError, TangentError) as trouble:
            return state, state, inf, trouble  # a shorter step may find what a long one does not
        apart = [a - b for a, b in zip(whole[:2], halves.fields[:2], strict=True)]
        error = _largest_stretch(apart) / (2**self.method.order - 1)
        return first, halves, error if isfinite(error) else inf, None

    def _expected_scale(self, state: CreepState, end: float) -> float:
        """Estimate the stretches to come by one step to the end of the first piece.

        In the first steps of a ramp stretch and error grow alike, and a tolerance that refers to
        the stretch so far could never be kept.
        """
        try:
            fields, _ = self.take_step(state.fields, state.time, end, end - state.time)
        except (ConvergenceError, TangentError):
            return float(np.finfo(np.float64).tiny)
        return _largest_stretch(fields)

    def _refuse(self, state: CreepState, trouble: KajuError | None) -> None:
        """Say why no step is short enough."""
        if isinstance(trouble, TangentError):
            text = f"creep: at {state.time:.6g} s, in every step but the shortest: {trouble}"
            raise type(trouble)(text, trouble.nodes) from trouble
        raise ConvergenceError(
            f"creep: at {state.time:.6g} s no step however short keeps the tolerance "
            f"{self.control.tolerance}: there it moves ever faster, as what folds or snaps through "
            "does; end before (duration=), or load it less"
        ) from trouble


def _largest_stretch(fields: Fields | list[Floats]) -> float:
    return max(float(np.abs(part).max(initial=0.0)) for part in fields[:2])


def _growth(error: float, allowed: float, order: int) -> float:
    """Return by which factor the next step is longer: errors grow as its power order + 1."""
    if error <= allowed * 1e-6:
        return 5.0
    if not isfinite(error):
        return 0.1
    return float(min(5.0, max(0.1, 0.9 * (allowed / error) ** (1.0 / order))))
