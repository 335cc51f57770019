"""Goals: what a quantity is, with an interval that is proved, by a second load.

A linear quantity J is the work of some load on the displacement: the dual load. Agents hold two
opinions of it as of their own load. With s, e the stresses of the opinions on the body's loads, and
t, z of those on the dual load (products are those of the energy), J is

    ((t, s) + (t, e) + (z, s) - (z, e)) / 2 - work of the dual's reactions where supports move

but for half the product of the two gaps, |t - z| |s - e| / 2, at most: s - e and t - z are each a
sum of two parts, from spaces at right angles to each other (Prager and Synge 1947, Greenberg 1948).
Agents halve that hold most of both gaps, each as a share of its sum (Becker, Estecahandy and
Trujillo, *SIAM J. Numer. Anal.* 49, 2011). In space the error is estimated: by the product of the
estimated errors under both loads, agent by agent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt
from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.arguments import SMALLEST_TOLERANCE
from kaju.model.elastic.goals.duals import TORN, DualGoal
from kaju.model.elastic.goals.quantities import Deflection, Goal, Quantity, Reaction, Stress
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.elastic.pair.cut_pair import CutPair
from kaju.model.elastic.pair.gap import ROUNDING
from kaju.model.elastic.pair.history import Settled
from kaju.model.elastic.pair.opinions import Opinions
from kaju.model.elastic.pair.space import Bricks
from kaju.model.elastic.scales import ROUNDED

AIM = 0.9
"""Of the tolerance a generation is aimed at. To 1e-3 on the plate, the hole and contrast 1000 0.8
takes a sixth more agents; 0.95 a generation more on the plate to 1e-2."""
FACTOR = 2.0
"""In space, by which the estimate is multiplied: of ten random solids of one and two materials the
errors of deflections and a stress were 0.07 to 0.73 of it."""
Largest = dict[type[Quantity], float]


@dataclass(frozen=True, eq=False)
class Judged:
    """What a generation says of the goals."""

    found: tuple[Goal, ...]
    error: float  # The largest, relative
    shares: Floats  # What agents add to the errors of goals that are not reached
    lost: bool  # Whether rounding is as large as the largest error
    wanted: float  # The share of theirs that a generation is aimed at
    first: Ints | None = None  # How often agents halve whatever their share
    each: tuple[Judged, ...] = ()  # Of several goals that are judged one by one, what it says


def judged(found: Settled | CutPair, goals: Sequence[DualGoal], tolerance: float) -> Judged:
    """Return what a generation says of the goals; without any the energy norm is."""
    told: list[tuple[Goal, Floats, float]] = []
    error, shares, lost = found.bounds.error, found.shares, found.bounds.lost
    if goals and not isinstance(found, CutPair):
        duals, agents = list(found.duals), agents_of(found)
        largest, tell = _largest(agents), _told if agents.two_minds else _estimated
        for goal in goals:
            own: list[Any] = [duals.pop(0) for _ in goal.directions]
            told.append(tell(found, goal, own, goal.read(agents), largest))
        worst, _, rounding = max(told, key=lambda one: one[0].relative_error)
        error = worst.relative_error
        missed = [part for goal, part, _ in told if goal.relative_error > tolerance]
        shares = np.sum(missed or [part for _, part, _ in told], axis=0)
        lost = rounding > ROUNDING * worst.error_estimate and error > SMALLEST_TOLERANCE
    # The share of its error that a generation is aimed at; the gap is the error's square.
    wanted = AIM * tolerance / error if 0.0 < error < inf else 0.0
    wanted **= 1 if goals else 2
    return Judged(tuple(goal for goal, *_ in told), error, shares, lost, wanted)


def _estimated(
    found: Any, goal: DualGoal, duals: list[Bricks], value: Floats, largest: Largest
) -> tuple[Goal, Floats, float]:
    """Return the answer in space, and what agents add to its relative error."""
    part, off = np.zeros(len(found.size)), []
    for dual in duals:
        both = FACTOR * found.wanting * np.sqrt(found.shares * dual.shares)
        off.append(float(both.sum()))
        part += both
    told = goal.goal(value, float(np.linalg.norm(off)), largest)
    return told, part / (told.scale or 1.0), 0.0


def _told(
    found: Any, goal: DualGoal, duals: list[Opinions], value: Floats, largest: Largest
) -> tuple[Goal, Floats, float]:
    """Return the answer, what agents add to its relative error, and what rounding does."""
    s, e = found.fields()
    apart = found.by_agent((s - e) ** 2)
    gap = float(apart.sum())
    if goal.no_bound == TORN:
        told = goal.goal(value, 0.0, largest)
        error = found.bounds.error * told.scale if found.bounds.error else 0.0
        return replace(told, error_estimate=error), apart / (gap or 1.0), 0.0
    off, rounded = np.zeros(len(duals)), np.zeros(len(duals))
    part, ragged = np.zeros(len(found.size)), found.sides.ragged
    for k, dual in enumerate(duals):
        (t, z), moved = dual.fields(), dual.borne(found.sides.moved)
        ts, te, zs, ze = t @ s, t @ e, z @ s, z @ e
        works, fitted = float(0.5 * (ts + te + zs - ze)) - moved, dual.work_on(found.fit)
        if not goal.no_bound:
            value[k] = goal.by_works(value[k], works, fitted, found.sides)
        # Two of the products are works of loads and supports, but for rounding.
        rounded[k] = abs(te - fitted - moved)
        rounded[k] += abs(zs - found.work_on(dual.fit) - found.borne(dual.sides.moved))
        rounded[k] += ROUNDED * (abs(ts) + abs(te) + abs(zs))
        dual_gap = float(dual.shares.sum())
        # What agents do not take of loads works on the dual displacement of theirs alone.
        mean = float(found.by_agent(0.25 * (t + z) ** 2)[ragged].sum())
        lost = found.sides.rest * (sqrt(mean) + 0.5 * sqrt(dual_gap))
        off[k] = 0.5 * sqrt(gap * dual_gap) + rounded[k] + lost
        if gap > 0.0 and dual_gap > 0.0:
            part += off[k] * (apart / gap + dual.shares / dual_gap)
            part[ragged] += lost / max(len(ragged), 1)
    told = goal.goal(value, float(np.linalg.norm(off)), largest)
    return told, part / (told.scale or 1.0), float(np.linalg.norm(rounded))


def agents_of(found: Settled) -> PairAgents:
    """Return agents with some opinions, of which values are read."""
    return PairAgents(found.body, [], [], "", [], found)


def _largest(agents: PairAgents) -> Largest:
    """Return the largest displacement, stress and reaction."""
    d = agents.ground.dimension
    forces = [float(np.linalg.norm(borne[:d])) for borne in agents.reactions().values()]
    stress = float(np.linalg.norm(agents.stress, axis=(1, 2)).max())
    return {Deflection: agents.farthest, Stress: stress, Reaction: max(forces, default=0.0)}
