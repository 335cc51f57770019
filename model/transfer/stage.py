"""What one stage of loading leaves behind: the agents it woke, and its ledger."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints


@dataclass(frozen=True)
class Ledger:
    """An account of every newton of a stage (N).

    Loads enter a cell from outside (`applied`) or from an agent (`emitted`); each of them is
    taken by an agent, dropped because it is too small, or still pending when the run stops.
    """

    applied: float
    """Sum of the loads put on the body, split along the lattice's directions."""
    taken: float
    """Sum of the loads that material agents took."""
    kept: float
    """Part of the taken loads that deforms the agents."""
    emitted: float
    """Sum of what the taken loads sent out, whatever became of it."""
    passed: float
    returned: float
    """Emissions that reached another material agent, and those that a boundary gave back."""
    dropped: float
    """Loads up to the threshold, which ended."""
    pending: float
    """Loads handed over but not yet taken; 0 when the stage has come to rest."""
    absorbed: float = 0.0
    """Emissions that a boundary of one's own did not give back."""

    @property
    def imbalance(self) -> float:
        """What the books do not account for, as a share of all loads; 0 but for rounding."""
        entered = self.applied + self.emitted
        left = self.taken + self.dropped + self.pending + self.absorbed
        handed = self.applied + self.passed + self.returned
        return max(abs(entered - left), handed - entered, 0.0) / entered if entered else 0.0


@dataclass(frozen=True, eq=False)
class TakenHistory:
    """Loads taken, generation by generation: one row per agent, direction and generation."""

    generation: Ints
    agent: Ints
    direction: Ints
    """When, by which agent (a row of `Stage.cells`) and along which direction. Shape (rows,)."""
    load: Floats
    """Sum of the loads taken then (N). Shape (rows,)."""
    pull: Flags
    """Whether these are pulls. Shape (rows,)."""


class News(NamedTuple):
    """What has happened since a generation: loads taken, and agents that spawned."""

    generation: Ints
    key: Ints
    channel: Ints
    """When, in which cell (`Lattice.key`), and along which direction; pulls are counted after all
    directions. Shape (rows,)."""
    load: Floats
    """Sum of the loads taken then (N). Shape (rows,)."""
    born: Ints
    spawn_step: Ints
    woken_by: Ints
    """Cells of the new agents, and what `Stage` says of them. Shape (agents,)."""


class Totals(NamedTuple):
    """What each agent has done by now; the columns are those of `Stage`."""

    cells: Ints
    material: Ints
    kept: Floats
    shortened: Floats
    widened: Floats
    passed: Floats
    dropped: Floats


@dataclass(frozen=True, eq=False)
class Stage:
    """The agents of one stage of loading, in the order in which they spawned."""

    factor: float
    """Share of the full loads that was applied."""
    outcome: str
    """How the stage ended, in words."""
    generations: int
    """Number of steps in which loads were taken."""
    cells: Ints
    """Where the material agents are. Shape (agents, dimension)."""
    material: Ints
    """What they are made of: index into the scene's `cell_materials`. Shape (agents,)."""
    spawn_step: Ints
    """Generation in which each took its first load, counted from 1. Shape (agents,)."""
    woken_by: Ints
    """Bit a is set if a load that woke the agent came over its arm a; 0 for applied loads. Shape
    (agents,)."""
    taken: Floats
    """Loads taken (N), by the direction their force points along, pushes and pulls. Shape (agents,
    directions)."""
    pulled: Floats
    """The pulls among them (N); 0 unless the rule has a sense. Shape (agents, directions)."""
    kept: Floats
    """Own shares along each axis (N), pushes less pulls. Shape (agents, axes)."""
    shortened: Floats
    """By which part of its length each cell is shortened along each axis. Shape (agents, axes)."""
    widened: Floats
    """By which part it is widened, for that, along the others. Shape (agents, axes)."""
    passed: Floats
    """Loads handed over by arm (N), to neighbours and to boundaries. Shape (agents, directions)."""
    dropped: Floats
    """Emissions that were too small (N). Shape (agents,)."""
    boundary_cells: Ints
    boundary_kind: Ints
    boundary_spawn_step: Ints
    """Where the boundary agents are, what they are (`AIR`, `RIGID`, `ROLLER`), and the generation
    in which each first gave a load back."""
    returned: Floats
    """Loads given back (N). Shape (boundary agents,)."""
    arrived: Floats
    """Loads that reached them (N), by the direction their force points along. Shape (boundary
    agents, directions)."""
    history: TakenHistory
    """The loads taken, generation by generation."""
    ledger: Ledger
    """The account of every newton."""


class TakenRows(NamedTuple):
    """Loads taken: generation, cell (`Lattice.key`), state, and their sum (N)."""

    generation: Ints
    key: Ints
    state: Ints
    load: Floats

    @classmethod
    def joined(cls, parts: Iterable[TakenRows]) -> TakenRows:
        """Put parts one after another."""
        none = np.empty(0, dtype=np.int64)
        columns = zip(cls(none, none, none, np.empty(0)), *parts, strict=True)
        return cls(*(np.concatenate(column) for column in columns))


def history_of(record: Iterable[TakenRows], key: Ints, directions: int) -> TakenHistory:
    """Return the loads taken as a history of agents, whose cells are `key`."""
    taken = TakenRows.joined(record)
    order = np.argsort(key)
    agent = order[np.searchsorted(key, taken.key, sorter=order)]
    pull, direction = np.divmod(taken.state, directions)
    return TakenHistory(taken.generation, agent, direction, taken.load, pull > 0)
