"""Agents that are rows of arrays, shown as objects.

On large bodies what agents do is computed on arrays. These objects are made when somebody
looks: they tell the same as `MaterialAgent` and `BoundaryAgent`, and cannot be told anything.
"""

# Mesa's bookkeeping is all that these objects hold; everything else is asked of the arrays.
# mypy: disable-error-code="override"

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from kaju._mesa import Agent
from kaju.arrays import Floats

from .boundary_agent import BoundaryAgent
from .material_agent import MaterialAgent
from .placed import PlacedAgent

if TYPE_CHECKING:
    from .materials import Material
    from .shares import Load, Shares


def _filled(row: Floats) -> dict[int, float]:
    """Return the entries of a row that are not 0."""
    return {column: value for column, value in enumerate(row.tolist()) if value}


def _told(column: str, read: Callable[[Any], Any]) -> Any:
    """Return a property that reads the agent's row of a column of the current stage."""
    return property(lambda agent: read(getattr(agent._stage, column)[agent.row]))


class _Row(PlacedAgent):
    """An agent that is a row of the model's arrays."""

    _column: str

    def __init__(self, model: Any, row: int) -> None:
        Agent.__init__(self, model)
        self.row = row

    @property
    def _stage(self) -> Any:
        return self.model.looked_at

    @property
    def index(self) -> tuple[int, ...]:
        """The scene's cell; -1 is beside the first."""
        cell: list[int] = getattr(self._stage, self._column)[self.row].tolist()
        return tuple(cell)

    def remove(self) -> None:
        """Forget the object; the row stays."""
        Agent.remove(self)


class AwakeCell(_Row, MaterialAgent):
    """A material agent that is a row of the model's arrays."""

    _column = "cells"
    spawn_step = _told("spawn_step", int)
    taken = _told("taken", _filled)
    pulled = _told("pulled", _filled)
    squeezed = _told("kept", _filled)
    passed = _told("passed", _filled)
    dropped = _told("dropped", float)

    @property
    def material(self) -> Material:
        """What the cell is made of."""
        material: Material = self.model.transfer.materials[self._stage.material[self.row]]
        return material

    @property
    def shares(self) -> Shares:
        """What the agent keeps and passes on of each newton."""
        shares: Shares = self.model.transfer.shares[self._stage.material[self.row]]
        return shares

    @property
    def woken_by(self) -> list[AwakeCell]:
        """The agents whose loads arrived in that generation."""
        return [self.model.agent_at(cell) for cell in self.model.wakers(self.row)]

    @property
    def kept(self) -> float:
        """Sum of the own shares (N)."""
        return self.shares.own * float(self._stage.taken[self.row].sum())

    @property
    def form(self) -> int:
        """Which of the lattice's forms the cell has."""
        form: int = self.model.form(self.index)
        return form

    @property
    def inbox(self) -> dict[tuple[int, float], float]:
        """Pushes to take in the next step: (direction, magnitude) → copies."""
        return {load[:2]: load.copies for load in self.waiting() if load.sense == "push"}

    @property
    def pulls(self) -> dict[tuple[int, float], float]:
        """Pulls to take in the next step: (direction, magnitude) → copies."""
        return {load[:2]: load.copies for load in self.waiting() if load.sense == "pull"}

    def waiting(self) -> list[Load]:
        """Return the loads to take in the next step."""
        loads: list[Load] = self.model.engine.waiting_for(self.row)
        return loads


class AwakeBoundary(_Row, BoundaryAgent):
    """A boundary agent that is a row of the model's arrays."""

    _column = "boundary_cells"
    spawn_step = _told("boundary_spawn_step", int)
    returned = _told("returned", float)

    @property
    def name(self) -> str:
        """Whether it is "free", "rigid" or "roller"."""
        name: str = self.model.boundary_name(int(self._stage.boundary_kind[self.row]))
        return name

    @property
    def kept(self) -> float:
        """Nothing: it gives back all it takes."""
        return 0.0

    @property
    def taken(self) -> dict[int, float]:
        """Loads that reached it (N), by the direction their force points along."""
        return _filled(self.model.engine.at_boundary()[0][self.row])

    @property
    def passed(self) -> dict[int, float]:
        """Loads given back (N), by the arm to the agent that takes them."""
        return _filled(self.model.engine.at_boundary()[1][self.row])
