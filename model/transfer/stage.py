"""What one stage of loading leaves behind: the agents it woke, and its ledger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from kaju.arrays import Flags, Floats, Ints, without_rows
from kaju.errors import ResultError
from kaju.model.results.stored import Column
from kaju.model.scene.cell_types import AIR, DISPLACED

from .transfer import Transfer


@dataclass(frozen=True)
class Ledger:
    """An account of every newton of a stage (N).

    Loads enter a cell from outside (`applied`) or from an agent (`emitted`); each of them is
    taken by an agent, dropped because it is too small, or still pending when the run stops.
    """

    applied: float  # loads put on the body, split along the lattice's directions
    taken: float  # loads that material agents took
    kept: float  # part of the taken loads that deforms the agents
    emitted: float  # what the taken loads sent out, whatever became of it
    passed: float  # emissions that reached another material agent
    returned: float  # emissions that a boundary gave back
    dropped: float  # loads up to the threshold, which ended
    pending: float  # loads handed over but not yet taken; 0 when the stage has come to rest
    absorbed: float = 0.0  # emissions that a boundary of your own did not give back

    @property
    def imbalance(self) -> float:
        """What the books do not account for, as a share of all loads; 0 but for rounding."""
        entered = self.applied + self.emitted
        left = self.taken + self.dropped + self.pending + self.absorbed
        handed = self.applied + self.passed + self.returned
        return max(abs(entered - left), handed - entered, 0.0) / entered if entered else 0.0


@dataclass(frozen=True, eq=False)
class TakenHistory:
    """Loads taken: one row per agent, direction and generation, narrow, for there are many."""

    generation: Annotated[Ints, Column("rows", 0)]
    agent: Annotated[NDArray[np.int32], Column("rows", 0, "agents")]  # row of `Stage.cells`
    direction: Annotated[NDArray[np.int8], Column("rows", 0, "directions")]
    load: Annotated[Floats, Column("rows")]  # sum of the loads taken then (N)
    pull: Annotated[Flags, Column("rows")]  # whether these are pulls
    __repr__ = without_rows


@dataclass(frozen=True, eq=False)
class StateCourse:
    """What agents knew (`kaju.State`): one row whenever the value of an agent changed."""

    name: str
    meaning: str
    """What it means, in words."""
    default: bool | int | float  # the value of who has no row yet
    agents: Annotated[int, Field(ge=0)]  # how many there are
    generations: Annotated[int, Field(ge=0)]  # of the stage
    generation: Annotated[Ints, Column("changes", 0)]  # after which the value holds
    agent: Annotated[Ints, Column("changes", 0, "agents")]  # row of `Stage.cells`
    value: Annotated[Floats, Column("changes")]
    __repr__ = without_rows

    def values(self, generation: int | None = None) -> NDArray[Any]:
        """Return each agent's value after a generation, or the last, in the order of `Stage`.

        Who still sleeps has the default: leave it out by `[result.last.spawn_step <= generation]`.
        """
        if generation is not None and not 0 <= generation <= self.generations:
            raise ResultError(f"generation: must be 0 to {self.generations}, got {generation}")
        found = np.full(self.agents, self.default, dtype=np.float64)
        rows = slice(None) if generation is None else self.generation <= generation
        found[self.agent[rows]] = self.value[rows]  # rows are in order: the last one stands
        return found.astype(type(self.default))


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
    """The agents of one stage of loading, in the order in which they spawned.

    Columns have a row for each material agent, those from `boundary_cells` to `arrived` for each
    boundary agent.
    """

    factor: float  # share of the full loads that was applied
    outcome: str  # how the stage ended, in words
    generations: Annotated[int, Field(ge=0)]  # steps in which loads were taken
    cells: Annotated[Ints, Column("agents dimension", 0, "cells")]  # shape (agents, dimension)
    # Index into the scene's `cell_materials`.
    material: Annotated[Ints, Column("agents", 0, "materials")]
    # Generation in which the first load was taken, counted from 1.
    spawn_step: Annotated[Ints, Column("agents", 0)]
    # Bit a is set if a load that woke the agent came over its arm a.
    woken_by: Annotated[Ints, Column("agents", 0, "sets of arms")]
    # Loads taken (N), pushes and pulls, by the direction of their force.
    taken: Annotated[Floats, Column("agents directions")]
    # The pulls among them (N); 0 unless the rule has a sense.
    pulled: Annotated[Floats, Column("agents directions")]
    # Own shares (N), pushes less pulls, shape (agents, axes).
    kept: Annotated[Floats, Column("agents axes")]
    # By which part of its length a cell is shortened along each axis.
    shortened: Annotated[Floats, Column("agents axes")]
    # By which part it is widened, for that, along the others.
    widened: Annotated[Floats, Column("agents axes")]
    # Loads handed over (N) to neighbours and boundaries, by arm.
    passed: Annotated[Floats, Column("agents directions")]
    dropped: Annotated[Floats, Column("agents")]  # emissions that were too small (N)
    boundary_cells: Annotated[Ints, Column("boundary dimension", -1, "cells and beyond")]
    # `AIR`, `RIGID` or `ROLLER`.
    boundary_kind: Annotated[Ints, Column("boundary", DISPLACED, AIR)]
    # Generation in which a load was first given back.
    boundary_spawn_step: Annotated[Ints, Column("boundary", 0)]
    returned: Annotated[Floats, Column("boundary")]  # loads given back (N)
    # Loads that reached it (N), by the direction of their force.
    arrived: Annotated[Floats, Column("boundary directions")]
    history: TakenHistory
    ledger: Ledger
    states: tuple[StateCourse, ...] = ()  # what agents of your own declare
    __repr__ = without_rows


def totals_of(
    transfer: Transfer, cells: Ints, material: Ints, kept: Floats, passed: Floats, dropped: Floats
) -> Totals:
    """Return what agents have done that yield as their material does."""
    modulus = np.array([each.youngs_modulus for each in transfer.materials])[material]
    widening = np.array([shares.widening for shares in transfer.shares])[material]
    shortened = kept / (transfer.cross_section * modulus[:, None])
    widened = shortened * widening[:, None]
    return Totals(cells, material, kept, shortened, widened, passed, dropped)
