"""Agents within outlines halve where they disagree most with themselves, as others do."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from math import inf, sqrt
from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints, nearest
from kaju.errors import ParameterError, SceneError, SingularPlaceError, brief, suggestion
from kaju.model.elastic.goals.duals import SMALL
from kaju.model.elastic.goals.quantities import (
    HOOP,
    VON_MISES,
    AskedFor,
    Deflection,
    Goal,
    Reaction,
    Stress,
    directions_of,
    is_point,
    quantities_of,
)
from kaju.model.elastic.moduli import Moduli, least_equivalent
from kaju.model.outline.hoop_stress import HoopStress, turn_in
from kaju.model.outline.leaf_triangles import VagueError, leaf_triangles
from kaju.model.outline.posed_outlines import SIDES, OutlinedBody, UnlikeError, check_alone
from kaju.model.outline.true_shapes import SLIGHT, UNIT, covering
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import HOLDING

from .cut_agents import CutAgents
from .cut_pair import CutPair
from .goals import AIM, Judged, judged
from .loop import PairLoop

MOST_AGENTS = 100_000
TURN = 0.6  # angle by which a stressed outline may turn in an agent, over the root of the tolerance
NARROW = 1.5  # times the largest stress of an outline that corners of agents along it may bear
UNSEEN = 1.0  # angle: an agent in which an outline turns by more knows nothing of its stress
NO_BOUND = "nothing is proved of a stress at a point"


def goals_asked(scene: Scene, goal: AskedFor | None) -> list[Stress | Deflection]:
    """Return what `goal` asks for within true outlines; nothing for the energy norm."""
    if goal is None or (isinstance(goal, (list, tuple)) and goal and not is_point(goal)):
        return [quantity for one in goal or () for quantity in goals_asked(scene, one)]
    regions = [one for one in scene.body.regions if one.name]
    holding = [one.name for one in regions if one.material in HOLDING]
    named = [str(one.name) for one in regions]
    moves = [side for side in SIDES if scene.side_condition(side).kind == "free"]
    moves += [str(load.outline) for load in scene.loads if load.outline is not None]
    (first,) = quantities_of(goal)
    if isinstance(goal, str) and first == Deflection(goal) and (goal in named or goal not in SIDES):
        first = Stress(goal, VON_MISES if goal in holding else HOOP)
    at, moved = getattr(first, "at", None), isinstance(first, Deflection)
    if isinstance(first, Stress) and first.component not in (HOOP, VON_MISES) and at in named:
        wrong = f"of {at!r} the largest {HOOP!r} or {VON_MISES!r} is known, no {first.component!r}"
    elif at in (moves if moved else named) and not isinstance(first, Reaction):
        return [first]
    elif not isinstance(at, str):
        wrong = f"{brief(goal)}: within true outlines only an outline or a free side can be one; "
        wrong += "solve without, and read it by answer.value_of (not proved)"
    elif at in SIDES and moved:
        wrong = f"{at} is held, and has no deflection to ask for"
    elif at in named:
        wrong = f"no load acts on {at!r}, so only its stress can be one: {at!r} alone"
    else:
        every = [*dict.fromkeys([*named, *moves])]
        near = suggestion(at, [*every, *(f"{one},{VON_MISES}" for one in named)])
        wrong = f"there is no outline {at!r}{near}; there is {', '.join(every)}"
    raise ParameterError(f"goal: {wrong}")


class CutLoop(PairLoop):
    """The agents of a body within outlines, generation by generation."""

    body: OutlinedBody
    _kept: tuple[CutPair, Judged, int]  # the best generation of a peak, and how many there were

    def __init__(
        self,
        body: OutlinedBody,
        tolerance: float,
        most_agents: int | None = None,
        asked: Sequence[Stress | Deflection] = (),
    ) -> None:
        super().__init__(body, tolerance, most_agents or MOST_AGENTS)
        self._asked, judges = asked, list[Any]()
        for one in asked:
            self.patience = 4  # the peak of a neck may be found late, at another place
            if isinstance(one, Deflection):
                pushed = [body.pushed(str(one.at), way) for way in directions_of(one.along, 2)]
                judges.append(partial(self._by_deflection, one, pushed))
            else:
                judges.append(_Peak(body, one, tolerance).judge)
        if not asked:
            body.check_rounding(tolerance)
        self._judges = judges or [self._by_energy]

    def step(self) -> None:
        """Go on; keep the best generation, which too small agents may lose again."""
        super().step()
        if len(self.generations) == 1 or self._judged.error < self._kept[1].error:
            self._kept = self.last, self._judged, len(self.generations)

    def _solve(self) -> None:
        """Solve both fields; leaves of which it is not known what they hold are halved."""
        # Cut agents are all halved so often at most, to find out what hangs together.
        patience = 6
        while True:
            try:
                pair = CutPair(self.body, self.leaves)
                if pair.bounds.lower > pair.bounds.upper and not self.body.no_bound:
                    thin = "body.regions: a part that bears loads is too thin; make it thicker"
                    raise UnlikeError(thin)
                told = tuple(judge(pair) for judge in self._judges)
                break
            except VagueError as vague:
                codes = vague.codes
                near = "body.regions: outlines nearly touch themselves, others or a line of cells;"
                why = UnlikeError(f"{near} move one a little, or change the number of cells")
            except UnlikeError as error:
                # coarse pieces may not hang together
                patience, why = patience - 1, error
                codes = self._cut()
            chosen = np.isin(self.leaves.code, codes)
            smallest = self.leaves.size[chosen].min(initial=2) < 2
            if not patience or not chosen.any() or smallest or len(chosen) > self.most_agents:
                raise SceneError(str(why))
            self.leaves = self.leaves.split(chosen).balanced()
        self.last, worst = pair, max(told, key=lambda one: one.error)
        found = tuple(goal for one in told for goal in one.found)
        first = np.max([one.first for one in told], axis=0)
        self._judged = replace(worst, found=found, first=first, each=told)
        self.leaves = self.leaves.only(np.isin(self.leaves.code, pair.leaves.code))

    def _cut(self) -> Ints:
        """Return the codes of the agents that outlines cut."""
        every = covering(self.leaves, self.body.shape)
        held = np.isin(every.code, self.leaves.code)
        share = leaf_triangles(self.body.true, every, held, False)[1].shares(every)
        return every.code[((share > 0.0) & (share < 1.0 - 1e-12)).any(axis=1)]

    def _by_energy(self, pair: Any) -> Judged:
        told, often = judged(pair, (), self.tolerance), coarse_along(pair, self.tolerance)
        if told.error <= self.tolerance:
            often = np.where(often > 1, often, 0)
        return replace(told, first=often)

    def _by_deflection(
        self, asked: Deflection, pushed: list[OutlinedBody], pair: CutPair
    ) -> Judged:
        """Return the error of the mean displacement of a free side or loaded outline, with bounds.

        It is the work of a unit force there, under which bodies are `pushed`. With s, e the
        stresses of both opinions under the loads, and t, z those under the force, this is
        ((s, t) + (e, z)) / 2 (products are those of the energy) but for half the product of both
        gaps, as in `goals`.
        """
        value, off, part = [], [], np.zeros(len(pair.leaves))
        for body in pushed:
            dual = CutPair(body, pair.leaves)
            both = (pair.balancing, dual.balancing), (pair.fitting, dual.fitting)
            value.append(0.5 * sum(float(np.vdot(one.felt, other.felt)) for one, other in both))
            off.append(0.5 * sqrt(pair.gap * dual.gap))
            part += off[-1] * (pair.shares / pair.gap + dual.shares / dual.gap)
        scale = max(float(np.linalg.norm(value)), SMALL * float(np.abs(pair.fitting.value).max()))
        goal = Goal(asked, tuple(value), float(np.linalg.norm(off)), scale, self.body.no_bound)
        error = goal.relative_error
        wanted = min(AIM * self.tolerance / error, 1.0) if error > 0.0 else 0.0
        return Judged((goal,), error, part / scale, False, wanted, np.zeros_like(pair.leaves.size))

    def outcome(self) -> CutAgents:
        """Return the agents as they are, or as they were when far more was known."""
        found = copy(self)
        if self.stopped and self._judged.error > 2.0 * self._kept[1].error:
            found.last, found._judged, count = self._kept
            found.generations = self.generations[:count]
        agents = CutAgents(self.body, *found._told(), found.last)
        agents.notes += agents.remarks(self._asked)
        return agents


def coarse_along(pair: CutPair, tolerance: float) -> Ints:
    """Return how often to halve leaves in which a stressed outline turns by too much.

    The energy does not see a small hole's peak. What turns by little in all, such as a kink
    rounded off, has none: of those that turn by more there are few.
    """
    leaves, body = pair.leaves, pair.body.true
    stress = np.sqrt((pair.means[0] ** 2).sum(axis=(1, 2)))
    often = np.zeros(len(leaves), dtype=np.int64)
    for region in body.regions:
        turn = turn_in(leaves, region.arcs)
        bent = turn > TURN * tolerance**0.5
        # an outline is stressed above half of its largest stress
        stressed = stress > 0.5 * stress[turn > 0.0].max(initial=0.0)
        more = np.ceil(np.log2(turn[bent & stressed] / (TURN * tolerance**0.5)))
        often[bent & stressed] = np.maximum(often[bent & stressed], more)
    return np.minimum(often, 2)


def _narrow(pair: CutPair, along: HoopStress) -> Ints:
    """Return leaves along an outline whose corners bear far more than any place of it.

    Such hold a narrow part of the body, between the outline and another edge.
    """
    leaf, at, told = pair.at_corners
    kind, plane = pair.leaves.kind[leaf], pair.body.asked.plane
    least = least_equivalent(told, Moduli(*pair.body.moduli), kind, plane)
    sharp = pair.body.without_limit / pair.body.edge
    if len(sharp):
        least[nearest(sharp, at)[0] < 2.0 * UNIT * pair.leaves.size[leaf]] = 0.0
    seen = np.zeros(len(pair.leaves))
    np.maximum.at(seen, leaf, least)
    far_more = seen[along.leaf] > NARROW * along.von_mises.max(initial=0.0)
    return np.asarray(along.leaf[far_more])


class _Peak:
    """The largest hoop or von Mises stress along an outline, generation by generation.

    Its estimated error is the larger of how far both fields differ there, and of a third of what
    the last generation changed. An agent's part in it is about √(its part of the gap) h² / r³ at
    a distance r from the nearest place where the stress may be as large: the influence of a stress
    falls off as 1/r², its error as h/r³.
    """

    def __init__(self, body: OutlinedBody, asked: Stress, tolerance: float):
        self._asked, self._tolerance, name = asked, tolerance, str(asked.at)
        self._which = [region.name for region in body.asked.body.regions].index(name)
        self._value = self._off = self._error = inf
        self._ends = -inf, inf
        self._place: tuple[float, ...] = ()
        check_alone(body.true.regions, self._which, f"goal: {name!r}", "peak")
        no_limit = f"goal: the stress along {name!r} has no limit: this outline"
        sharp = body.true.without_limit(SLIGHT, body.shape, self._which)
        for x, y in body.edge * sharp[:1]:
            corner = f"has a sharp corner at ({x:g}, {y:g}) m; make it round, by a radius that fits"
            raise SingularPlaceError(f"{no_limit} {corner} its ends")
        self._no_bound = NO_BOUND
        met = (ending[self._which] for ending in body.ends.values() if self._which in ending)
        for side in [*met][:1]:
            told = f"ends at the side {side!r}, where there is no limit"
            if not body.singular_on(self._which)[1]:
                raise SingularPlaceError(
                    f"{no_limit} {told}, and has no rounded part away from it; make this side a "
                    "roller that it meets at a right angle, name the outline of the fillet or hole "
                    "that is meant, or give no goal"
                )
            self._no_bound += f", and {name!r} {told}: this is the largest of its rounded parts"

    def judge(self, pair: CutPair) -> Judged:
        """Return the error, what each leaf adds to it, and the share of it to aim at."""
        along = HoopStress.along(pair, self._which).counted()
        often = coarse_along(pair, self._tolerance)
        # Where an agent holds so much of a bend it does not see its stress: no error is known.
        bends = turn_in(pair.leaves, pair.body.true.regions[self._which].arcs) > UNSEEN
        bends[_narrow(pair, along)] = True
        often = np.maximum(often, 2 * bends)
        if not len(along.place):
            if not often.any():
                raise ParameterError(f"goal: no part of the body ends along {self._asked.at!r}")
            return self._aimed(np.zeros(len(pair.leaves)), often)
        values = getattr(along, kind := self._asked.component)
        at = int(np.abs(values).argmax())
        self._value, self._place = float(values[at]), tuple(along.place[at].tolist())
        # A pull and a push may be alike: which of them is larger says nothing of the error.
        before, self._ends = self._ends[int(values[at] > 0.0)], (values.min(), values.max())
        # The error of a small peak is relative to a hundredth of the largest stress.
        largest = max(abs(self._value), 0.01 * float(np.abs(pair.means[0]).max()))
        # where it was within the tolerance, the last agents spawned for something else
        kept = self._off if self._error <= self._tolerance else 0.0
        # the error is a third of what changed: squares of edges are a fourth
        self._off = max(1.0 / 3.0 * abs(self._value - before), along.apart(at, kind), kept)
        self._error = inf if bends.any() else self._off / largest
        size = pair.leaves.size * UNIT
        # elsewhere it may be as large, as all round a pressed bore
        rows = np.flatnonzero(np.abs(values) >= abs(self._value) - 2.0 * self._off)
        away, near = nearest(along.place[rows], pair.leaves.middle * UNIT)
        # within so many edges of the agent at the peak all are as near
        away = np.maximum(away, 1.5 * size[along.leaf[rows[near]]])
        return self._aimed(np.sqrt(pair.shares) * size**2 / away**3, often)

    def _aimed(self, part: Floats, often: Ints) -> Judged:
        scale = self._off / self._error if np.isfinite(self._error) and self._error else 1.0
        off = self._off if np.isfinite(self._error) else inf
        goal = Goal(self._asked, (self._value,), off, scale, self._no_bound, self._place)
        # A generation aims at a quarter of the peak's error.
        return Judged((goal,), self._error, part, False, AIM**2 * 0.25, often)
