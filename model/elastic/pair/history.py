"""The generations of agents: what is kept of each, and how the tree grows from one to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.goals.quantities import Goal
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.pair.elements import DEEPEST_STEP
from kaju.model.elastic.pair.leaves import LeafCells, corners
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.scales import Scales
from kaju.model.results.result import OnCells
from kaju.model.results.stored import Column
from kaju.model.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class Generation:
    """One step of spawning: figures of all agents together, then arrays with a row for each."""

    error: float
    """In the energy norm, relative: in the plane proved, in space estimated."""
    energy: float
    """Of the body (J): in the plane the middle of the bounds, in space below the true one."""
    lower: float | None
    """Bounds of the energy (J); None in space."""
    upper: float | None
    code: Annotated[Ints, Column("agents", 0, (1 << 62) - 1)]
    """Morton code of every agent's lower corner."""
    size: Annotated[Ints, Column("agents", 1)]
    """Edge (units) of every agent."""
    gap: Annotated[Floats, Column("agents", 0.0)]
    """What its two opinions differ in, squared (J): its part of the squared error."""
    fitted: Annotated[Floats, Column("agents", 0.0)]
    """Equivalent stress (Pa) of the opinion that fits, in the mean over the agent."""
    balanced: Annotated[Floats, Column("agents", finite=False)]
    """That of the opinion that balances; NaN in space, where there is none."""
    chosen: Annotated[Flags, Column("agents")]
    """Which agents spawn in the next step because of their gap."""

    @property
    def agents(self) -> int:
        """Number of agents."""
        return len(self.code)

    def __repr__(self) -> str:
        """Return its figures without the arrays."""
        return f"Generation(agents={self.agents}, error={self.error:.3g}, energy={self.energy:.6g})"

    def in_units(self, energy: float, stress: float) -> Generation:
        """Return it with energies and stresses times units of these."""
        lower, upper = (x if x is None else energy * x for x in (self.lower, self.upper))
        return replace(
            self,
            energy=energy * self.energy,
            lower=lower,
            upper=upper,
            gap=energy * self.gap,
            fitted=stress * self.fitted,
            balanced=stress * self.balanced,
        )


def halvings(size: Ints, largest: int) -> Ints:
    """Return how often the largest edge would be halved to give each edge (units)."""
    return np.asarray(np.rint(np.log2(largest / size)), dtype=np.int64)


def family_of(
    before: LeafCells, code: Ints, size: Ints, gap: Floats, chosen: Flags
) -> tuple[Ints, Ints, Floats]:
    """Return the parents of the agents of the next generation, their steps and their causes."""
    parent = np.searchsorted(before.code, code, "right") - 1
    ratio = before.size[parent] // size
    step = np.where(ratio > 1, before.step.max(initial=0) + 1, before.step[parent])
    # Of a child whose parent spawned in the same step nobody knew the gap.
    own = np.where(chosen[parent] & (ratio == 2), gap[parent], np.nan)
    return parent, step, np.where(ratio > 1, own, before.cause[parent])


def trees_of(first: LeafCells, generations: list[Generation]) -> list[LeafCells]:
    """Return the agents of stored generations; refuse some that are not parts of the first ones."""
    d, leaves = first.dimension, first
    nothing = np.zeros(len(first))
    trees = [replace(first, step=nothing.astype(np.int64), cause=nothing)]
    sound = bool(generations) and np.array_equal(generations[0].code, first.code)
    sound = sound and np.array_equal(generations[0].size, first.size)
    for last, one in pairwise(generations):
        if not sound:
            break
        code, size = one.code, one.size
        parent = np.searchsorted(leaves.code, code, "right") - 1
        ratio = leaves.size[parent] // np.maximum(size, 1)
        # They lie side by side, in parents, and fill these.
        sound = bool(np.all(np.diff(code) >= size[:-1] ** d) and np.all(parent >= 0))
        sound = sound and bool(np.all(np.isin(ratio, 2 ** np.arange(DEEPEST_STEP + 1))))
        sound = sound and bool(np.all(ratio * size == leaves.size[parent]))
        sound = sound and bool(np.all((code - leaves.code[parent]) % size**d == 0))
        filled = np.bincount(parent, (size / leaves.size[parent]) ** d, len(leaves))
        sound = sound and bool(np.all(np.abs(filled - 1.0) < 1e-9))
        if sound:
            _, step, cause = family_of(leaves, code, size, last.gap, last.chosen)
            own = corners(code, d), size, leaves.kind[parent], step, cause, code
            leaves = LeafCells(*own)
            sound = len(leaves.balanced(0)) == len(leaves)
            trees.append(leaves)
    if not sound:
        raise ResultError("its agents do not stand side by side in the body")
    return trees


@dataclass(eq=False)
class GrownAgents(OnCells):
    """What agents of many sizes tell in the plane and in space alike; scaled."""

    storage: ClassVar[Literal["tree"]] = "tree"
    stiffness: ClassVar[None] = None
    ground: PosedBody
    goals: list[Goal]  # What the tolerance is about
    generations: list[Generation]
    stopped: str
    """Why they missed the tolerance: "agents", "depth", "stalled" or "rounding"."""
    notes: list[str]

    if TYPE_CHECKING:  # what either has of its own

        @property
        def leaves(self) -> LeafCells:
            """The agents."""

        def reactions(self) -> dict[str, Floats]:
            """Return the force of every support on the body."""

        def displacement_at(self, points: Floats, cells: Ints) -> Floats:
            """Return the displacement at points (m) in or on cells of the grid."""

        def stress_at(self, points: Floats, cells: Ints) -> Floats:
            """Return stress tensors at points (m) in or on cells of the grid."""

        @property
        def _shape(self) -> tuple[Callable[[Floats], Floats], Floats, Floats]:
            """Shape functions, their numbers for each agent, and the shift of all."""

    @property
    def scene(self) -> Scene:
        """What was asked."""
        return self.ground.asked

    @property
    def stage(self) -> int | None:
        """Stage of loading; None is the last."""
        return self.ground.stage

    @property
    def grid(self) -> Scene:
        """The scene on the cells that say where the body is."""
        return self.ground.scene

    @property
    def scales(self) -> Scales:
        """Units of the scaled values."""
        return self.ground.scales

    @property
    def moduli(self) -> Moduli:
        """Scaled moduli of every material."""
        return self.ground.moduli

    @property
    def count(self) -> int:
        """Number of agents."""
        return len(self.leaves)

    @property
    def lower(self) -> Floats:
        """Lower corners of the agents."""
        return np.asarray(self.leaves.lower / self.ground.cell)

    @property
    def size(self) -> Floats:
        """Edges of the agents."""
        return np.asarray(self.leaves.size / self.ground.cell)

    @property
    def material(self) -> Ints:
        """Index of each agent's material, which is that of its moduli."""
        return self.leaves.kind

    law = material

    @property
    def level(self) -> Ints:
        """How often the largest of the first agents would be halved to give each agent."""
        return halvings(self.leaves.size, int(self.generations[0].size.max()))

    @property
    def cause(self) -> Floats:
        """Gap (J) for which each agent spawned."""
        return self.leaves.cause * self.scales.energy

    def placed(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the agents in or on which points (m) in cells lie, and where in each, 0 to 1."""
        first, cell = cells * self.ground.cell, self.ground.cell
        place = np.clip(points / self.grid.lattice.cell_size * cell, first, first + cell)
        unit = np.clip(np.floor(place).astype(np.int64), first, first + cell - 1)
        agent = self.leaves.find(unit)
        inside = (place - self.leaves.lower[agent]) / self.leaves.size[agent, None]
        return agent, np.clip(inside, 0.0, 1.0)

    def law_at(self, points: Floats, cells: Ints) -> Ints:
        """Return the index of the moduli of the agents in or on which points lie."""
        return self.leaves.kind[self.placed(points, cells)[0]]

    def history(self) -> dict[str, Any]:
        """Return the figures of their generations."""
        return {"generations": len(self.generations)}

    @property
    def spawn_step(self) -> Ints:
        """Step in which each agent spawned; 0 for the first."""
        return self.leaves.step

    @property
    def farthest(self) -> float:
        """Largest displacement at corners, on sides and in the middles of agents."""
        values, moved, shift = self._shape
        places = 0.5 * np.array(list(product(range(3), repeat=moved.shape[2])))
        found = (np.tensordot(moved, row, (1, 0)) + shift for row in values(places))
        return max(float(np.linalg.norm(u, axis=1).max()) for u in found)

    @property
    def solution(self) -> Self:
        """Itself: it has the figures of its solution."""
        return self
