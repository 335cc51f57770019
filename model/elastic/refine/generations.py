"""What spawning leaves: the agents at last, and every generation on the way."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.bound_cells import BoundCells
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.energy_bounds import EnergyBounds
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import CellFields
from kaju.model.elastic.cells.leaf_cells import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.refine.estimator import Indicator
from kaju.model.elastic.refine.targets import Aimed


class Generation(NamedTuple):
    """One step of spawning."""

    agents: int
    error: float
    """Estimated error in the energy norm, relative."""
    energy: float
    iterations: int
    aimed_error: float
    """Estimated error that the tolerance is about, relative."""
    code: Ints
    size: Ints
    """Morton code of the lower corner and edge (units) of every agent. Shape (agents,)."""
    load: Floats
    """Load that every agent left unbalanced. Shape (agents,)."""
    chosen: Flags
    """Who of them spawns children for that load in the next step. Shape (agents,)."""

    def __repr__(self) -> str:
        """Return its figures, without the arrays, which fill a screen."""
        return f"Generation(agents={self.agents}, error={self.error:.3g}, energy={self.energy:.6g})"


@dataclass
class Spawning:
    """The agents and how they came to be; scaled."""

    method: ClassVar[str] = "spawning"  # How the equations were solved
    balance: Equilibrium  # The last generation's grid
    displacement: Floats  # Shape (faces,)
    indicator: Indicator  # What each agent leaves unbalanced
    aimed: Aimed  # The error that the tolerance is about, and who contributes to it
    energy: float
    error: float
    """Estimated error in the energy norm, relative."""
    generations: list[Generation]
    residuals: list[float]
    """History of the last generation's iteration."""
    levels: int  # Levels of the last multigrid cycle
    reached: bool  # Whether the error is within the tolerance
    stopped: str
    """Why it ended, if it is not: "depth" (the smallest agents allowed), "agents", "iteration", or
    "blind" (bounds say that agents do not see their errors)."""
    notes: list[str] = field(default_factory=list)
    retired: int = 0
    """Agents of the previous answer for which a parent has come back."""
    bracket: EnergyBounds | str | None = field(default=None, repr=False)
    """What is certain of the answer, if that has been looked for; in words why nothing is."""

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.balance.grid.leaves

    @property
    def ground(self) -> PosedBody:
        """What they stand on."""
        return self.balance.grid.ground

    @cached_property
    def fields(self) -> CellFields:
        """Strains, stresses and displacements of all agents."""
        return CellFields(self.balance, self.displacement)

    def near(self, agent: Ints) -> tuple[CellFields, Ints]:
        """Return the fields of agents and of those about them, and which of these they are."""
        return self.fields, agent

    @property
    def moved(self) -> Floats:
        """Displacement of the agents' middles, shape (agents, dimension)."""
        return self.fields.displacement

    @property
    def stress(self) -> Floats:
        """Stress tensors of the agents, shape (agents, dimension, dimension)."""
        return self.fields.stress

    def boxes(self) -> BoundCells:
        """Return the agents as bounds see them."""
        return boxes_of_agents(self.balance, self.displacement)

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        return self.balance.reactions(self.displacement)
