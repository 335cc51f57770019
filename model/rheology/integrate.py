"""Integration over time of whatever creeps, by steps that keep a tolerance.

Over an implicit step elements are springs. So a body (a single element, a spring network, cells)
answers one question only: which forces springs of some stiffness and rest bear under a load
(`Creeping.solve`). The scheme is made of such steps.

Steps end on every corner of the history, and nowhere else on purpose: the times asked for are read
between the steps, which do not feel them. Each step is made once whole and once as two halves; the
halves are kept. Their difference, over 2² - 1, estimates the step's error, which may be
tolerance · (largest stretch so far) · h / 4(t + h), t counted since the last corner: the same share
for every e-fold of time, so that a fast and a slow process are both followed. Creep forgets errors
rather than amplify them, so the sum of the estimates, which is reported, stands above the error at
the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, KajuError, TangentError
from kaju.stepping import interrupt_requested

from .creeping_step import ORDER, STAGES, Creeping, Fields
from .load_history import History


@dataclass(frozen=True, eq=False)
class Reached:
    """What a run has reached."""

    fields: Fields  # stretches of the parts of every element, and what follows from them
    time: float = 0.0  # (s)
    next_step: float = 0.0  # to be tried next (s); 0 before the first
    # Largest stretch so far (m, or strain), to which the tolerance refers; at first, that of one
    # step over the first piece of the history.
    scale: float = 0.0
    error: float = 0.0  # sum of the estimated errors of all steps, in the unit of the stretch
    work: float = 0.0  # done from outside since time 0 (J)
    dissipated: float = 0.0  # into the dampers (J)
    numerical: float = 0.0  # of the work, in neither springs nor dampers (J)
    at_jumps: float = 0.0  # part of `numerical` of steps that take up a jump (J)
    steps: int = 0
    rejected: int = 0  # steps that were made again because they missed the tolerance


@dataclass(frozen=True)
class Integrator:
    """Takes a body through time under its history, to an end (s)."""

    system: Creeping
    history: History
    end: float
    tolerance: float
    most_steps: int

    @cached_property
    def _corners(self) -> Floats:
        """Times (s) at which the history turns or jumps; points on a straight piece are none."""
        at, jump, bend = self.history.corners()
        gaps = np.diff(at, prepend=-inf, append=inf)
        slope = np.cumsum(bend)  # after each corner
        steepest = np.maximum(np.abs(slope), np.abs(slope - bend))
        digits = 4.0 * float(np.finfo(np.float64).eps)  # so far a point may lie off a straight line
        rounding = digits * (np.abs(self.history.factors).max() + steepest * at)
        turns = np.abs(bend) > rounding / np.minimum(gaps[:-1], gaps[1:])
        return np.asarray(at[(jump != 0.0) | turns])

    @cached_property
    def _jumps(self) -> set[float]:
        at, jump, _ = self.history.corners()
        return set(at[jump != 0.0].tolist())

    def states(self, state: Reached, asked: Floats) -> Iterator[Reached]:
        """Yield the state at each time `asked`, by a step of its own, and at an interrupt."""
        corners, left = self._corners, asked.tolist()
        if left[0] == state.time:
            yield state
            left.pop(0)
        while left and not interrupt_requested():
            later = corners[corners > state.time]
            node = float(later[0]) if later.size else self.end
            if node - state.time <= 1e-12 * node:  # one moment, but for rounding
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

    def _read(self, before: Reached, middle: Reached, after: Reached, time: float) -> Reached:
        """Return the state at a time within a step, of which start, middle and end are known."""
        if time == after.time:
            return after
        base = before if time <= middle.time else middle
        read = self._advance(base, time, time - base.time)
        return replace(read, error=after.error, steps=after.steps, rejected=after.rejected)

    def take_step(
        self, fields: Fields, start: float, end: float, step: float
    ) -> tuple[Fields, Floats]:
        """Return the fields after a step (s), and its work, dissipation and numerical energy."""
        energies = np.zeros(3)
        factor = float(self.history.after(start))
        growth = float(self.history.at(end)) - factor
        for stage_end, weight in STAGES:
            fields, energy = self.system.stage(fields, step, weight, factor + stage_end * growth)
            energies += energy
        return fields, energies

    def _advance(self, state: Reached, end: float, step: float) -> Reached:
        """Return the state one step (s) later."""
        fields, energies = self.take_step(state.fields, state.time, end, step)
        work, dissipated, numerical = energies.tolist()
        return replace(
            state,
            fields=fields,
            time=end,
            scale=max(state.scale, self.system.largest_stretch(fields)),
            work=state.work + work,
            dissipated=state.dissipated + dissipated,
            numerical=state.numerical + numerical,
            at_jumps=state.at_jumps + (numerical if state.time in self._jumps else 0.0),
            steps=state.steps + 1,
        )

    def _keep_tolerance(
        self, state: Reached, node: float, corner: float
    ) -> Iterator[tuple[Reached, Reached, Reached]]:
        """Go on to `node` in steps whose estimated error keeps the tolerance.

        Yield the states before, in the middle and at the end of each.
        """
        wish, failures, failed_step = state.next_step or 1e-5 * (node - state.time), 0, inf
        while state.time < node and not interrupt_requested():
            left = node - state.time
            # Two equal steps to the node rather than a long one and a sliver.
            step = left if wish >= left else min(wish, 0.5 * left)
            end = node if step == left else state.time + step
            middle, tried, error, trouble = self._doubled(state, end)
            since = state.time - corner
            allowed = 0.25 * self.tolerance * tried.scale * step / (since + step)
            growth = _growth(error, allowed)
            if error <= allowed:
                # A step cut short by the node says nothing against a longer one after it.
                wish = max(wish, step * growth) if step < wish else step * growth
                before, state = state, replace(tried, next_step=wish, error=state.error + error)
                failures = 0 if step >= failed_step else failures
                yield before, middle, state
            else:
                wish = step * growth
                state = replace(state, rejected=state.rejected + 1)
            if isinstance(trouble, TangentError):
                failures, failed_step = failures + 1, step
            # No process is quicker: within the least step what happens has ended, unless the body
            # moves ever faster, as what snaps through does.
            shortest = max(1e-30 * node, 1e-10 * (state.time - corner))
            too_short = wish < shortest or state.time + wish == state.time
            # Over 40 singular tangents the smallest imperfection grows by more than all digits.
            if failures > 40 or too_short:
                self._refuse(state, trouble)
            if state.steps + state.rejected > self.most_steps:
                raise ConvergenceError(
                    f"creep: {self.most_steps} steps were made and only {state.time:.6g} s "
                    "reached; allow a larger tolerance, or more steps (most_steps=)"
                )

    def _doubled(
        self, state: Reached, end: float
    ) -> tuple[Reached, Reached, float, KajuError | None]:
        """Make a step whole and in halves; return middle and end of these, error, and trouble."""
        middle, half = 0.5 * (state.time + end), 0.5 * (end - state.time)
        try:
            whole, _ = self.take_step(state.fields, state.time, end, 2.0 * half)
            first = self._advance(state, middle, half)
            halves = self._advance(first, end, half)
        except (ConvergenceError, TangentError) as trouble:
            return state, state, inf, trouble  # a shorter step may find what a long one does not
        apart = [a - b for a, b in zip(whole[:2], halves.fields[:2], strict=True)]
        error = self.system.largest_stretch(apart) / (2**ORDER - 1)
        return first, halves, error if isfinite(error) else inf, None

    def _expected_scale(self, state: Reached, end: float) -> float:
        """Estimate the stretches to come by one step to the end of the first piece.

        In the first steps of a ramp stretch and error grow alike, and a tolerance that refers to
        the stretch so far could never be kept.
        """
        try:
            fields, _ = self.take_step(state.fields, state.time, end, end - state.time)
        except (ConvergenceError, TangentError):
            return float(np.finfo(np.float64).tiny)
        return self.system.largest_stretch(fields)

    def _refuse(self, state: Reached, trouble: KajuError | None) -> None:
        """Say why no step is short enough."""
        if isinstance(trouble, TangentError):
            text = f"creep: at {state.time:.6g} s, in every step but the shortest: {trouble}"
            raise type(trouble)(text, trouble.nodes) from trouble
        raise ConvergenceError(
            f"creep: at {state.time:.6g} s even the shortest step misses the tolerance "
            f"{self.tolerance}: the motion gets faster and faster, as if something folds or "
            "snaps through; end earlier (duration=), or take smaller loads"
            + (f". Of its last try: {trouble}" if trouble else "")
        ) from trouble


def _growth(error: float, allowed: float) -> float:
    """Return by which factor the next step is longer: errors grow as its power order + 1."""
    if error <= allowed * 1e-6:
        return 5.0
    if not isfinite(error):
        return 0.1
    return float(min(5.0, max(0.1, 0.9 * (allowed / error) ** (1.0 / ORDER))))
