"""The family of agents: every one that ever stood, with parent and children."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.history import Generation, halvings
from kaju.model.elastic.pair.leaves import corners

NOBODY = -1  # Parent of the first agents, and first child of those that have none
WORKING = -1  # Retirement of agents that have not retired

_ROW = np.dtype(
    [
        ("code", np.int64),
        ("size", np.int64),
        ("parent", np.int64),
        ("first_child", np.int64),
        ("spawn_step", np.int64),
        ("retired_step", np.int64),
        ("cause", np.float64),
        ("gap", np.float64),
        ("chosen", np.bool_),
    ]
)


class Family:
    """All agents as rows of a table, in the order in which they spawned.

    An agent that spawns retires: its children take its place. To keep neighbours of similar
    size, a child may spawn children of its own in the same step.

    Parameters
    ----------
    dimension : int
    metre : float
        Length (m) of the unit in which generations count.

    Attributes
    ----------
    rows : structured array, shape (agents,)
        With the fields

        - code, size: Morton code of the lower corner, and edge (units);
        - parent: row of the parent, -1 for the first agents;
        - first_child: row of the first of its 4 (in three dimensions 8) children, which
          follow one another; -1 without;
        - spawn_step, retired_step: when it spawned, 0 for the first agents, and when it
          retired, -1 if it has not;
        - cause: gap (J) of its parent, for which it spawned; 0 for the first agents, NaN for
          those that keep neighbours alike in size;
        - gap: what its two opinions differ in, or did at last (J); NaN if it has had none;
        - chosen: whether it spawned children for that gap, or will in the next step.
    working : int array
        Rows of the agents that have not retired, along a space-filling curve.
    step : int
        Number of the last generation.
    """

    def __init__(self, dimension: int, metre: float) -> None:
        self.dimension, self.metre = dimension, metre
        self.rows = np.empty(0, dtype=_ROW)
        self.working: Ints = np.empty(0, dtype=np.int64)
        self.step = -1

    @classmethod
    def of(cls, generations: Iterable[Generation], dimension: int, metre: float) -> Family:
        """Return the family of the agents that stood in generations, gaps in J."""
        family = cls(dimension, metre)
        for generation in generations:
            family.grow(generation.code, generation.size)
            family.settle(generation.gap, generation.chosen)
        return family

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def lower(self) -> Floats:
        """Lower corners (m) of the agents, shape (agents, dimension)."""
        return np.asarray(self.corners() * self.metre, dtype=np.float64)

    @property
    def size(self) -> Floats:
        """Edges (m) of the agents, shape (agents,)."""
        return np.asarray(self.rows["size"] * self.metre)

    @property
    def level(self) -> Ints:
        """How often the largest of the first agents would be halved to give each agent."""
        size = self.rows["size"]
        return halvings(size, size[self.rows["spawn_step"] == 0].max())

    def corners(self, start: int = 0) -> Ints:
        """Return the lower corners (units) of the rows from `start` onwards."""
        return corners(self.rows["code"][start:], self.dimension)

    def grow(self, code: Ints, size: Ints) -> None:
        """Add the agents of the next generation (units), in the order of their codes."""
        self.step += 1
        if self.step == 0:
            self.working = self._append(code, size, NOBODY, 0.0)
            return
        # Every agent of the new generation lies in a working one: parents spawn until the rows of
        # their children have the sizes of the generation.
        before = self.working
        holder = before[np.searchsorted(self.rows["code"][before], code, side="right") - 1]
        self.rows["retired_step"][np.setdiff1d(before, holder)] = self.step
        parents = np.unique(holder[self.rows["size"][holder] > size])
        while len(parents):
            children = self._spawn(parents)
            own, edge = self.rows["code"][children], self.rows["size"][children]
            at, last = (np.searchsorted(code, end) for end in (own, own + edge**self.dimension))
            empty = at == last  # within outlines some hold nothing of the body
            self.rows["retired_step"][children[empty]] = self.step
            stands = ~empty
            stands[~empty] = size[at[~empty]] == edge[~empty]
            holder[at[stands]] = children[stands]
            parents = children[~stands & ~empty]
        self.working = holder

    def settle(self, gap: Floats, chosen: Flags) -> None:
        """Note the gaps (J) of the working agents, and which are marked."""
        self.rows["gap"][self.working] = gap
        self.rows["chosen"][self.working] = chosen

    def standing(self, step: int) -> Ints:
        """Return the rows of the agents of a generation, along a space-filling curve."""
        spawned, retired = self.rows["spawn_step"], self.rows["retired_step"]
        there = np.flatnonzero((spawned <= step) & ((retired == WORKING) | (retired > step)))
        return there[np.argsort(self.rows["code"][there])]

    def children(self, row: int) -> range:
        """Return the rows of an agent's children."""
        first = int(self.rows["first_child"][row])
        return range(0) if first == NOBODY else range(first, first + (1 << self.dimension))

    def _spawn(self, parents: Ints) -> Ints:
        """Let agents retire; return the rows of their children."""
        many, rows = 1 << self.dimension, self.rows
        half = rows["size"][parents] // 2
        # The codes of a family follow one another, as far apart as a child has unit cells.
        code = rows["code"][parents, None] + np.arange(many) * half[:, None] ** self.dimension
        cause = np.where(rows["chosen"][parents], rows["gap"][parents], np.nan)
        rows["retired_step"][parents] = self.step
        rows["first_child"][parents] = len(rows) + many * np.arange(len(parents))
        half, parents, cause = (np.repeat(values, many) for values in (half, parents, cause))
        return self._append(code.ravel(), half, parents, cause)

    def _append(self, code: Ints, size: Ints, parent: Ints | int, cause: Floats | float) -> Ints:
        fresh = np.zeros(len(code), dtype=_ROW)
        fresh["code"], fresh["size"], fresh["parent"], fresh["cause"] = code, size, parent, cause
        fresh["first_child"], fresh["retired_step"] = NOBODY, WORKING
        fresh["spawn_step"], fresh["gap"] = self.step, np.nan
        self.rows = np.concatenate([self.rows, fresh])
        return np.arange(len(self.rows) - len(fresh), len(self.rows))
