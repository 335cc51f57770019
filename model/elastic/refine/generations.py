"""The outcome of adaptive refinement: the last agents, and every generation before them."""

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
    error: float  # Estimated, in the energy norm, relative
    energy: float
    iterations: int
    aimed_error: float  # Estimated error that the tolerance limits, relative
    code: Ints  # Morton code of every agent's lower corner. Shape (agents,)
    size: Ints  # Edge (units) of every agent. Shape (agents,)
    load: Floats  # Load that every agent leaves unbalanced. Shape (agents,)
    chosen: Flags  # Which agents are marked, to spawn in the next step. Shape (agents,)

    def __repr__(self) -> str:
        """Return its figures without the arrays."""
        return f"Generation(agents={self.agents}, error={self.error:.3g}, energy={self.energy:.6g})"


@dataclass
class Spawning:
    """The last agents and their generations; scaled."""

    method: ClassVar[str] = "spawning"  # How the equations were solved
    balance: Equilibrium  # On the last generation's grid
    displacement: Floats  # Shape (faces,)
    indicator: Indicator  # Squared error and unbalanced load of each agent
    aimed: Aimed  # The error that the tolerance limits, and the agents' contributions to it
    energy: float
    error: float  # Estimated, in the energy norm, relative
    generations: list[Generation]
    residuals: list[float]  # History of the last generation's iteration
    levels: int  # Levels of the last multigrid cycle
    reached: bool  # Whether the error is within the tolerance
    stopped: str
    """Why the loop ended if not: "depth" (the smallest agents allowed), "agents", "iteration", or
    "blind" (bounds contradict the estimate)."""
    notes: list[str] = field(default_factory=list)
    retired: int = 0  # Agents of the previous answer that were coarsened
    bracket: EnergyBounds | str | None = field(default=None, repr=False)
    """Energy bounds, or why there are none; None if they have not been worked out."""

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.balance.grid.leaves

    @property
    def ground(self) -> PosedBody:
        """The posed body."""
        return self.balance.grid.ground

    @cached_property
    def fields(self) -> CellFields:
        """Strains, stresses and displacements of all agents."""
        return CellFields(self.balance, self.displacement)

    def near(self, agent: Ints) -> tuple[CellFields, Ints]:
        """Return fields that hold some agents, and their places in these."""
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
        """Return the agents as energy bounds need them."""
        return boxes_of_agents(self.balance, self.displacement)

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        return self.balance.reactions(self.displacement)
