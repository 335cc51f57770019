"""The answer of agents that spawned: whatever is read comes from their opinions.

Displacements are those of the opinion that fits. In the plane reactions are those of the one that
balances, and stress is the mean of both, since that is the stress whose error the gap tells
exactly; energy is the middle of its bounds.
"""

from __future__ import annotations

from dataclasses import InitVar, dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Literal

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.goals.duals import aligned, goal_of
from kaju.model.elastic.goals.quantities import Goal
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.results.result import OnCells

from .elements import quadratic_values
from .history import Generation, settled, trees_of
from .leaves import LeafCells


@dataclass(eq=False)
class PairAgents(OnCells):
    """Agents of many sizes along a space-filling curve, and their generations; scaled."""

    name: ClassVar[str] = "spawned agents"
    storage: ClassVar[Literal["tree"]] = "tree"
    films: ClassVar[tuple[str, ...]] = ("loading", "generations", "gaps")
    stiffness: ClassVar[None] = None
    along: ClassVar[Any] = {}
    ground: PosedBody
    goals: list[Goal]  # What the tolerance is about
    generations: list[Generation]
    stopped: str
    """Why they missed the tolerance: "agents", "corners", "depth", "stalled" or "rounding"."""
    notes: list[str]
    known: InitVar[Any] = None  # Opinions of the last, if they have just been found

    solution = property(lambda agents: agents, doc="Itself: it has the figures of its solution.")
    grid = property(lambda agents: agents.ground.scene, doc="Cells that say where the body is.")
    no_bound = property(
        lambda agents: agents.ground.no_bound, doc="Why nothing is proved, or empty."
    )
    error = property(lambda agents: agents.generations[-1].error, doc="Of the stress, as in these.")

    def __post_init__(self, known: Any) -> None:
        body, self._last = self.ground, known
        if known is None:
            whole = isinstance(body, PosedBody)
            goals = [goal_of(goal.quantity, body) for goal in self.goals if whole]
            self._trees = trees_of(aligned(goals, body), self.generations, whole)
        self.leaves: LeafCells = self._trees[-1] if known is None else known.leaves
        self.scene, self.stage = body.asked, body.stage
        self.scales, self.moduli = body.scales, body.moduli
        self.count = len(self.leaves)
        self.residuals: list[float] = []  # What an iteration left is in the bounds
        self.lower: Floats = self.leaves.lower / body.cell
        self.size: Floats = self.leaves.size / body.cell
        # Whether agents have two opinions, so that errors are proved: in the plane
        self.two_minds = body.dimension == 2
        self.method = "agents with two opinions" if self.two_minds else "bricks"

    @cached_property
    def opinions(self) -> Any:
        """Opinions of the last generation; of a stored answer they are found again."""
        # Generation by generation: so they are the same to the last digit.
        found = self._last
        for leaves in self._trees if found is None else ():
            found = settled(self.ground, leaves, found)
        return found

    @property
    def material(self) -> Ints:
        """Index of each agent's material, which is that of its moduli."""
        return self.leaves.kind

    law = material

    @property
    def energy(self) -> float:
        """Energy of the body and of what it lies on."""
        return self.generations[-1].energy / self.scales.energy

    @cached_property
    def energies(self) -> Floats | None:
        """Energy stored in each agent: half-way between those of both opinions."""
        return self.opinions.energies if self.two_minds else None

    @cached_property
    def moved(self) -> Floats:
        """Displacement of the agents' middles."""
        middles = np.full((self.count, self.ground.dimension), 0.5)
        return np.asarray(self.opinions.displacement_at(np.arange(self.count), middles))

    @cached_property
    def farthest(self) -> float:
        """Largest displacement at corners, on sides and in the middles of agents."""
        found, d = self.opinions, self.ground.dimension
        own = found.fit.reshape(self.count, -1, d)
        values = quadratic_values(0.5 * np.array(list(product(range(3), repeat=d))))
        moved = (np.tensordot(own, row, (1, 0)) + found.sides.shift for row in values)
        return max(float(np.linalg.norm(u, axis=1).max()) for u in moved)

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors of the agents: in the plane means over each."""
        return np.asarray(np.mean(self.opinions.means, axis=0))

    @property
    def balanced(self) -> Floats:
        """Mean stress tensors of the opinion that balances; in space of the only one."""
        return np.asarray(self.opinions.means[0])

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        found: dict[str, Floats] = self.opinions.reactions()
        return found

    def placed(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the agents in or on which points (m) in cells lie, and where in each, 0 to 1."""
        first, cell = cells * self.ground.cell, self.ground.cell
        place = np.clip(points / self.grid.lattice.cell_size * cell, first, first + cell)
        unit = np.clip(np.floor(place).astype(np.int64), first, first + cell - 1)
        agent = self.leaves.find(unit)
        inside = (place - self.leaves.lower[agent]) / self.leaves.size[agent, None]
        return agent, np.clip(inside, 0.0, 1.0)

    def displacement_at(self, points: Floats, cells: Ints) -> Floats:
        """Return the displacement at points (m) in or on cells of the grid."""
        return np.asarray(self.opinions.displacement_at(*self.placed(points, cells)))

    def stresses_at(self, points: Floats, cells: Ints) -> tuple[Floats, ...]:
        """Return stress tensors at points (m) in or on cells of the grid, of each opinion."""
        return tuple(self.opinions.stresses_at(*self.placed(points, cells)))

    def law_at(self, points: Floats, cells: Ints) -> Ints:
        """Return the index of the moduli of the agents in or on which points lie."""
        return self.leaves.kind[self.placed(points, cells)[0]]
