"""Agents that disagree most with themselves halve, until all together disagree little enough."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from math import inf

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.goals.quantities import Quantity
from kaju.model.elastic.pair.answer import PairAgents, generation_of
from kaju.model.elastic.pair.elements import DEEPEST_STEP
from kaju.model.elastic.pair.goals import Goals
from kaju.model.elastic.pair.history import Generation, family_of
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.pair.opinions import Opinions, first, following
from kaju.model.elastic.posed_body import PosedBody

GAIN = 0.92
"""Of its share an agent that halves is expected to lose; measured on smooth stress: 15/16."""
MOST_HALVED = 0.85
"""Of the whole gap at most is marked at once (Doerfler 1996)."""
AIM = 0.9  # Of the tolerance a generation is aimed at
AT_CORNERS = 0.1
"""Of the gap that is wanted may stay with agents at points where stress has no limit."""
BESIDE = 0.25
"""Of the gap that the smallest agents keep the others may have: it adds a tenth to the error."""
STALLED, ENOUGH = 2, 0.97
"""A run ends after so many generations that lower the bound to no less than this share: at stiff
parts that touch in corners (seed 160 of the random bodies) 2.8 times the agents gained 2 %."""
ENOUGH_DEEP = 0.95
"""Where agents are as small as they may be it ends with the first that gains no more than this: at
stiff parts that touch in a corner (seed 37 of the random bodies) others gained 1 % for twice the
agents."""
MOST_AGENTS = 1_000_000


class PairLoop:
    """A body's agents, generation by generation."""

    def __init__(
        self,
        body: PosedBody,
        tolerance: float,
        most_agents: int | None = None,
        quantities: Sequence[Quantity] = (),
    ) -> None:
        self.body, self.tolerance = body, tolerance
        self.goals = Goals(quantities, body)
        self.most_agents = most_agents or MOST_AGENTS
        self.last: Opinions | None = None
        self.stopped = ""
        """Why it ended short of the tolerance: "agents", "depth", "stalled", "rounding"."""
        self.leaves = self.goals.start()
        self.trees: list[LeafCells] = []
        self.generations: list[Generation] = []
        self._without_gain, self._best = 0, inf

    @property
    def reached(self) -> bool:
        """Whether the tolerance is proved."""
        return self.last is not None and self._judged.error <= self.tolerance

    @property
    def finished(self) -> bool:
        """Whether there is no further generation."""
        return self.reached or bool(self.stopped)

    def step(self) -> Opinions:
        """Let the agents agree with each other, then halve those that disagree with themselves."""
        self._solve()
        assert self.last is not None
        self.trees.append(self.leaves)
        chosen = np.zeros(len(self.leaves), dtype=np.bool_)
        if not self.reached:
            chosen = self._spawn(self.last)
        self._keep(chosen)
        return self.last

    def _solve(self) -> None:
        """Let the agents find their opinions, and judge these."""
        last, aims = self.last, self.goals.aims(self.leaves, self.last)
        if last is None:
            self.last = first(self.body, self.leaves, aims)
        else:
            self.last = following(last, self.leaves, aims)
        self._judged = self.goals.judge(self.last, self.tolerance)

    def _keep(self, chosen: Flags) -> None:
        """Note the generation."""
        assert self.last is not None
        self.generations.append(generation_of(self.last, chosen))

    def outcome(self) -> PairAgents:
        """Return the agents as they are."""
        assert self.last is not None
        found = copy(self.last)
        for name, nothing in (("levels", None), ("duals", ())):  # which take most of the memory
            object.__setattr__(found, name, nothing)
        trees, generations = list(self.trees), list(self.generations)
        goals = list(self._judged.found)
        return PairAgents(self.body, goals, generations, self.stopped, [], (trees, found))

    def _spawn(self, generation: Opinions) -> Flags:
        """Halve some agents, and return which; or say why there is no further generation."""
        judged, leaves = self._judged, generation.leaves
        deep = leaves.size.min() <= self.body.smallest
        gained = judged.error <= (ENOUGH_DEEP if deep else ENOUGH) * self._best
        self._without_gain = 0 if gained else self._without_gain + 1
        self._best = min(self._best, judged.error)
        nobody = np.zeros(len(leaves), dtype=np.bool_)
        if judged.lost:
            self.stopped = "rounding"
            return nobody
        often = self._halvings(leaves)
        if not often.any() or self._without_gain >= (1 if deep else STALLED):
            self.stopped = "depth" if deep or not often.any() else "stalled"
            return nobody
        new = self._halved(leaves, often)
        if len(new) > self.most_agents:
            self.stopped = "agents"
            return nobody
        gap, chosen = generation.shares, often > 0
        _, step, cause = family_of(leaves, new.code, new.size, gap, chosen)
        self.leaves = replace(new, step=step, cause=cause)
        return chosen

    def _halvings(self, leaves: LeafCells) -> Ints:
        """Return how often each agent halves."""
        share, error = self._judged.shares, self._judged.error
        allowed = np.log2(leaves.size // self.body.smallest).astype(np.int64)
        # What the smallest agents hold stays: the others share the rest of what is wanted; or, if
        # the smallest alone hold more, as little as is hardly seen beside it.
        free = np.where(allowed > 0, share, 0.0)
        budget = self._wanted() * float(share.sum()) if error < inf else 0.0
        frozen = float(share.sum() - free.sum())
        left = budget - frozen if frozen < 0.9 * budget else BESIDE * frozen
        if not free.sum() > left:
            return np.zeros(len(leaves), dtype=np.int64)
        often = halvings(free, left, leaves.holding(self.body.sharp))
        return np.minimum(often, allowed)

    def _wanted(self) -> float:
        """Return the share of the whole that a generation is aimed at."""
        power = 1 if self.goals.goals else 2  # Of the gap: that of one load, or the product of two
        return (AIM * self.tolerance / self._judged.error) ** power

    def _halved(self, leaves: LeafCells, often: Ints) -> LeafCells:
        """Return the agents of the next generation."""
        sharp, new = self.body.sharp, leaves
        for step in range(int(often.max())):
            # Of children only those at the point itself halve again.
            again = often > step if step == 0 else np.zeros(len(new), dtype=np.bool_)
            if step:
                at = new.holding(sharp)
                parent = np.searchsorted(leaves.code, new.code[at], "right") - 1
                again[at] = often[parent] > step
            new = new.split(again, 0, np.zeros(len(new)))
        new = new.balanced(0)
        # The tree's balance may not ask for more than `child_maps` holds.
        parent = np.searchsorted(leaves.code, new.code, "right") - 1
        assert (leaves.size[parent] // new.size).max() <= 1 << DEEPEST_STEP
        return new


def halvings(share: Floats, left: float, at: Ints) -> Ints:
    """Return how often agents halve: the fewest with most of the gap; `at` corners up to thrice."""
    total = float(share.sum())
    goal = min(MOST_HALVED * total, (total - left) / GAIN)
    order = np.argsort(-share, kind="stable")
    count = min(int(np.searchsorted(np.cumsum(share[order]), goal)), len(order) - 1)
    # Agents alike halve together.
    often = (share >= 0.99 * share[order[count]]).astype(np.int64)
    budget = AT_CORNERS * left
    if share[at].sum() > budget > 0.0:
        # A halving takes half of the share at the strongest of corners.
        more = np.ceil(np.log2(np.maximum(share[at] * len(at) / budget, 1.0))).astype(np.int64)
        often[at] = np.maximum(often[at], np.minimum(more, DEEPEST_STEP))
    return np.asarray(often)
