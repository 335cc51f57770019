"""Agents that disagree most with themselves halve, until all together disagree little enough."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import partial
from math import exp, inf, log, sqrt
from typing import Any

import numpy as np

from kaju.arrays import Flags, Ints
from kaju.model.elastic.goals.duals import aligned, goal_of
from kaju.model.elastic.goals.quantities import Goal, Quantity
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.outline.posed_outlines import OutlinedBody

from .answer import PairAgents
from .border import torn
from .elements import DEEPEST_STEP
from .goals import Judged, agents_of, judged
from .history import Generation, generation_of, settled
from .leaves import LeafCells
from .space import FIRST, refuse_rubber

GAIN = 0.92
"""Of its share an agent that halves is expected to lose; measured on smooth stress: 15/16. With 0.9
the hole and contrasts take 4 % more agents to 1e-3, with 1 a generation more."""
MOST_HALVED = {2: 0.85, 3: 0.6}
"""Of the whole gap at most is marked at once (Doerfler 1996). With 0.75 the plate and the L take a
generation or two more to 3e-3, and up to a third more time. With 0.85 in space a hinge of solids
takes 30,000 agents before it is known for what it is, with 0.6 some 800."""
AT_CORNERS = 0.1
"""Of the gap that is wanted may stay with agents at points where stress has no limit; and of what
the smallest agents keep the others may have."""
ENOUGH = 0.95
"""A generation that leaves more than this of the error ends a run in the plane; in space, of goals
and outlines the second. Of 200 random bodies those that keep 0.1 and 0.03 left 0.92 at most."""
NEAR_THE_END = 12
"""So many halvings before agents at corners are as small as can be it is judged whether they will
keep more than the tolerance. Of 200 random bodies those that miss 0.03 are told by some 10,000
agents, where they took up to 290,000; those that keep 0.1 or 0.03 come to 0.6 of it at most."""
WINDOW = 6  # Generations over which the rate is measured by which errors fall
TORN = "sides that meet are moved apart: the energy has no limit as agents shrink"
MOST_AGENTS, MOST_BRICKS = 1_000_000, 400_000
"""Those in space take some 5 kB each, so about 2 GB."""


class PairLoop:
    """A body's agents, generation by generation."""

    patience = 2  # generations without gain that end a run, where one does not

    def __init__(
        self,
        body: PosedBody | OutlinedBody,
        tolerance: float,
        most_agents: int | None = None,
        quantities: Sequence[Quantity] = (),
    ) -> None:
        self.body: PosedBody | OutlinedBody = body
        self.tolerance = tolerance
        self.goals = [goal_of(one, body) for one in quantities if isinstance(body, PosedBody)]
        self.most_agents = most_agents or (MOST_AGENTS if body.dimension == 2 else MOST_BRICKS)
        self.last: Any = None  # What they have found: opinions, or those of cut agents
        self.stopped = ""
        """Why it ended short of the tolerance, as in `PairAgents`."""
        self.leaves = aligned(self.goals, body)
        self.generations: list[Generation] = []
        self.notes: list[str] = []
        self._without_gain, self._best, self._at_corners = 0, inf, 0.0
        # In the plane, as small as agents can be counted
        plane = isinstance(body, PosedBody) and body.dimension == 2
        self._proves = plane and body.resolution is None
        self._errors: list[tuple[int, float]] = []  # Agents and error of the generations
        if isinstance(body, PosedBody) and body.dimension == 3:
            refuse_rubber(body)

    @property
    def reached(self) -> bool:
        """Whether the tolerance is kept, and no agent is to halve whatever its share."""
        if self.last is None or self._judged.error > self.tolerance:
            return False
        return not np.any(self._judged.first)

    @property
    def finished(self) -> bool:
        """Whether there is no further generation."""
        return self.reached or bool(self.stopped)

    def step(self) -> None:
        """Let the agents agree with each other, then halve those that disagree with themselves."""
        self._solve()
        chosen = np.zeros(len(self.leaves), dtype=np.bool_) if self.reached else self._spawn()
        self.generations.append(generation_of(self.last, chosen))

    def _solve(self) -> None:
        """Let the agents find their opinions, and judge these."""
        assert isinstance(self.body, PosedBody)
        before = self.last and agents_of(self.last)
        aims = [partial(goal.loaded, found=before) for goal in self.goals]
        self.last = found = settled(self.body, self.leaves, self.last, aims)
        if not self.generations and torn(found.mesh, found.sides).any():
            self.notes.append(TORN)
        self._judged = judged(found, self.goals, self.tolerance)

    def progress(self) -> str:
        """Return the line of progress."""
        agents, error = self.generations[-1].agents, self._judged.error
        doubts = [goal.no_bound for goal in self._judged.found] or [self.body.no_bound]
        known = "estimated" if any(doubts) else "proved"
        told = f"{known} error {error:.2g}, tolerance {self.tolerance:g}"
        return f"generation {len(self.generations)}: {agents:,} agents, {told}"

    def outcome(self) -> PairAgents:
        """Return the agents as they are."""
        assert isinstance(self.body, PosedBody)
        found = copy(self.last)
        found.levels = found.duals = ()  # which take most of the memory
        return PairAgents(self.body, *self._told(), found)

    def _told(self) -> tuple[list[Goal], list[Generation], str, list[str]]:
        """Return copies of what goes into an answer."""
        return list(self._judged.found), list(self.generations), self.stopped, list(self.notes)

    def _spawn(self) -> Flags:
        """Halve some agents, and return which; or say why there is no further generation."""
        judged, leaves = self._judged, self.leaves
        deep = leaves.size.min() <= self.body.smallest
        gained = judged.error <= ENOUGH * self._best
        self._without_gain = 0 if gained else self._without_gain + 1
        if leaves.dimension == 2 or self.generations:
            # In space the second generation tells how much too small estimates are.
            self._best = min(self._best, judged.error)
        often = np.max([self._halvings(leaves, one) for one in judged.each or (judged,)], axis=0)
        patience = 1 if self._proves and not judged.found else self.patience
        if judged.lost:
            self.stopped = "rounding"
        elif self._hopeless(leaves):
            self.stopped = "corners"
        elif not often.any() or self._without_gain >= patience:
            self.stopped = "depth" if deep or not often.any() else "stalled"
        elif self._expected(judged.error) > self.most_agents:
            self.stopped = "stalled" if leaves.dimension == 2 else "agents"
        else:
            new = self._halved(leaves, often)
            if len(new) <= self.most_agents:
                self.leaves = new
                return np.asarray(often > 0)
            self.stopped = "agents"
        return np.zeros(len(leaves), dtype=np.bool_)

    def _hopeless(self, leaves: LeafCells) -> bool:
        """Tell whether agents at corners will be as small as can be before they agree enough."""
        at, share = leaves.holding(self.body.sharp), self._judged.shares
        before, self._at_corners = self._at_corners, float(share[at].sum())
        if self.goals or not self._proves or not before or not len(at):
            return False
        left = np.log2(leaves.size[at].min() / self.body.smallest)
        fall = min(self._at_corners / before, 1.0) ** (left / DEEPEST_STEP)
        limit = (self.tolerance / self._judged.error) ** 2 * share.sum()
        return bool(left <= NEAR_THE_END and self._at_corners * fall > limit)

    def _halvings(self, leaves: LeafCells, judged: Judged) -> Ints:
        """Return how often each halves: the fewest with most of the gap; corners up to thrice."""
        share = judged.shares
        allowed = np.log2(leaves.size // self.body.smallest).astype(np.int64)
        often = np.zeros(len(leaves), dtype=np.int64) if judged.first is None else judged.first
        # What the smallest agents hold stays: the others share the rest of what is wanted; or, if
        # the smallest alone hold more, as little as is hardly seen beside it.
        free = np.where(allowed > 0, share, 0.0)
        total, frozen = float(free.sum()), float(share.sum() - free.sum())
        left = max(judged.wanted * share.sum() - frozen, AT_CORNERS * frozen)
        if judged.error <= self.tolerance or total <= left:
            return np.minimum(often, allowed)
        goal = min(MOST_HALVED[leaves.dimension] * total, (total - left) / GAIN)
        largest = np.sort(free)[::-1]
        last = largest[min(int(np.searchsorted(np.cumsum(largest), goal)), len(free) - 1)]
        # Agents whose share is nearly that of the last halve, too: a body's symmetry is kept.
        often = np.maximum(often, free >= 0.99 * last)
        at, budget = leaves.holding(self.body.sharp), AT_CORNERS * left
        if free[at].sum() > budget > 0.0:
            # A halving takes half of the share at the strongest of corners.
            more = np.ceil(np.log2(np.maximum(free[at] * len(at) / budget, 1.0))).astype(np.int64)
            often[at] = np.maximum(often[at], np.minimum(more, DEEPEST_STEP))
        return np.asarray(np.minimum(often, allowed))

    def _halved(self, leaves: LeafCells, often: Ints) -> LeafCells:
        """Return the agents of the next generation."""
        new, first = leaves.split(often > 0), self._judged.first
        for step in range(1, int(often.max())):
            # Of the children of agents at a point only those at the point itself halve again.
            parent, at = new.parents_in(leaves), new.holding(self.body.sharp)
            again = np.zeros(len(new), dtype=np.bool_) if first is None else first[parent] > step
            again[at] |= often[parent[at]] > step
            new = new.split(again)
        return new.balanced()

    def _expected(self, error: float) -> float:
        """Return a tenth of the agents that the tolerance takes if errors fall on so."""
        # In space the first error is raised by what no gain tells yet.
        raised = 1.0 if self.generations or self.leaves.dimension == 2 else sqrt(FIRST)
        self._errors.append((len(self.leaves), error / raised))
        if len(self._errors) < WINDOW or not isinstance(self.body, PosedBody):
            return 0.0
        # At first errors of small goals hardly fall: the latest half of the window may tell better.
        rate, now = 0.0, len(self.leaves)
        for window in (WINDOW // 2, WINDOW):
            few, before = max(self._errors[-window:], key=lambda one: one[1])
            rate = max(rate, log(before / error) / log(now / few) if error < before else 0.0)
        factor = log(error / self.tolerance) / rate if rate > 0.0 else inf
        return 0.1 * now * exp(min(factor, 100.0))
