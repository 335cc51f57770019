"""Agents that disagree most with themselves halve, until all together disagree little enough."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.pair.elements import DEEPEST_STEP
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.pair.opinions import Opinions, first, following
from kaju.model.elastic.posed_body import PosedBody
from kaju.stopping import interrupt_requested

GAIN = 0.92
"""Of its share an agent that halves is expected to lose; measured on smooth stress: 15/16."""
MOST_HALVED = 0.85
"""Of the whole gap at most is marked at once (Doerfler 1996)."""
AIM = 0.9  # Of the tolerance a generation is aimed at
AT_CORNERS = 0.1
"""Of the gap that is wanted may stay with agents at points where stress has no limit."""
STALLED = 3
"""A run ends after so many generations that do not lower the bound by a hundredth."""
MOST_AGENTS = 1_000_000


class PairLoop:
    """A body's agents, generation by generation."""

    def __init__(self, body: PosedBody, tolerance: float, most_agents: int | None = None) -> None:
        self.body, self.tolerance = body, tolerance
        self.most_agents = most_agents or MOST_AGENTS
        self.last: Opinions | None = None
        self.stopped = ""
        """Why it ended short of the tolerance: "agents", "depth", "rounding", "interrupt"."""
        self.leaves = body.start()
        self._without_gain, self._best = 0, inf

    @property
    def reached(self) -> bool:
        """Whether the tolerance is proved."""
        return self.last is not None and self._kept(self.last)

    @property
    def finished(self) -> bool:
        """Whether there is no further generation."""
        return self.reached or bool(self.stopped)

    def _kept(self, generation: Opinions) -> bool:
        bounds = generation.bounds
        return bounds.error <= self.tolerance and not bounds.lost

    def step(self) -> Opinions:
        """Let the agents agree with each other, then halve those that disagree with themselves."""
        last = self.last
        self.last = first(self.body, self.leaves) if last is None else following(last, self.leaves)
        bounds = self.last.bounds
        if self._kept(self.last):
            return self.last
        if bounds.lost:
            self.stopped = "rounding"
            return self.last
        self._without_gain = self._without_gain + 1 if bounds.error > 0.99 * self._best else 0
        self._best = min(self._best, bounds.error)
        if interrupt_requested():
            self.stopped = "interrupt"
            return self.last
        wanted = (self.tolerance / bounds.error) ** 2 if bounds.error < inf else 0.0
        leaves = self._halved(self.last, wanted)
        if leaves is None or self._without_gain >= STALLED:
            self.stopped = "depth"
        elif len(leaves) > self.most_agents:
            self.stopped = "agents"
        else:
            self.leaves = leaves
        return self.last

    def _halved(self, generation: Opinions, wanted: float) -> LeafCells | None:
        """Return the agents of the next generation, None if none may halve."""
        leaves, number = generation.leaves, len(generation.leaves)
        sharp = self.body.sharp
        often = halvings(generation.shares, wanted, leaves.holding(sharp))
        allowed = np.log2(leaves.size // self.body.smallest).astype(np.int64)
        often = np.minimum(often, allowed)
        if not often.any():
            return None
        new = leaves
        for step in range(int(often.max())):
            # Of children only those at the point itself halve again.
            again = often > step if step == 0 else np.zeros(len(new), dtype=np.bool_)
            if step:
                at = new.holding(sharp)
                parent = np.searchsorted(leaves.code, new.code[at], "right") - 1
                again[at] = often[parent] > step
            new = new.split(again, number, np.zeros(len(new)))
        new = new.balanced(number)
        # The tree's balance may not ask for more than `child_maps` holds.
        parent = np.searchsorted(leaves.code, new.code, "right") - 1
        assert (leaves.size[parent] // new.size).max() <= 1 << DEEPEST_STEP
        return new


def halvings(share: Floats, wanted: float, at: Ints) -> Ints:
    """Return how often agents halve: the fewest with most of the gap; `at` corners up to thrice."""
    total, left = share.sum(), AIM**2 * wanted
    goal = min(MOST_HALVED, (1.0 - left) / GAIN) * total
    order = np.argsort(-share, kind="stable")
    count = min(int(np.searchsorted(np.cumsum(share[order]), goal)), len(order) - 1)
    # Agents alike halve together.
    often = (share >= 0.99 * share[order[count]]).astype(np.int64)
    budget = AT_CORNERS * left * total
    if share[at].sum() > budget > 0.0:
        # A halving takes half of the share at the strongest of corners.
        more = np.ceil(np.log2(np.maximum(share[at] * len(at) / budget, 1.0))).astype(np.int64)
        often[at] = np.maximum(often[at], np.minimum(more, DEEPEST_STEP))
    return np.asarray(often)


def generations(
    body: PosedBody, tolerance: float, most_agents: int | None = None
) -> Iterator[Opinions]:
    """Yield the generations of a body until its tolerance is proved, or cannot be."""
    spawning = PairLoop(body, tolerance, most_agents)
    while not spawning.finished:
        yield spawning.step()
