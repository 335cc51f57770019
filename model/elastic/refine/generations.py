"""The outcome of adaptive refinement: the last agents, and every generation before them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultFileError
from kaju.model.elastic.bounds.bound_cells import BoundCells
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.energy_bounds import EnergyBounds, MiddleStress, bracket_of
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import (
    CellFields,
    displacement_at,
    means,
    stress_at,
    touching_alike,
)
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.equal.system import Solution
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.multigrid.nested import relative_error
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody, ground_of
from kaju.model.elastic.refine.estimator import Indicator, indicate
from kaju.model.elastic.refine.targets import Aimed, Answer
from kaju.model.elastic.scales import Scales
from kaju.model.results.archive import Archive, plain_of
from kaju.model.results.formats import AnswerRecord
from kaju.model.scene import Scene

_LEAVES = ("lower", "size", "kind", "step", "cause")  # What is stored of the agents


class OldGeneration(NamedTuple):
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

    @property
    def gap(self) -> Floats:
        """Load that every agent leaves unbalanced."""
        return self.load

    def in_units(self, energy: float, stress: float) -> Any:
        """Return it as a generation of agents of two minds."""
        from kaju.model.elastic.pair.history import Generation as Pair

        nothing = np.full(len(self.size), np.nan)
        figures = (self.agents, self.error, energy * self.energy, np.nan, np.nan)
        return Pair(*figures, self.code, self.size, self.load, nothing, nothing, self.chosen)

    def __repr__(self) -> str:
        """Return its figures without the arrays."""
        return (
            f"OldGeneration(agents={self.agents}, error={self.error:.3g}, energy={self.energy:.6g})"
        )


@dataclass
class Spawning:
    """Agents as the leaves of a tree, along a space-filling curve, and their generations; scaled.

    Lengths are in the scene's cells. Blocks of agents replace what is worked out for all at once.
    """

    storage: ClassVar[Literal["tree"]] = "tree"
    method: ClassVar[str] = "spawning"  # How the equations were solved
    stiffness: ClassVar[None] = None
    energy_bounds: ClassVar[None] = None  # There are none without those of a stress
    balance: Equilibrium  # On the last generation's grid
    displacement: Floats  # Shape (faces,)
    indicator: Indicator  # Squared error and unbalanced load of each agent
    aimed: Aimed  # The error that the tolerance limits, and the agents' contributions to it
    energy: float
    error: float  # Estimated, in the energy norm, relative
    generations: list[OldGeneration]
    residuals: list[float]  # History of the last generation's iteration
    levels: int  # Levels of the last multigrid cycle
    reached: bool  # Whether the error is within the tolerance
    stopped: str
    """Why the loop ended if not: "depth" (the smallest agents allowed), "agents", "iteration", or
    "blind" (bounds contradict the estimate)."""
    notes: list[str] = field(default_factory=list)
    retired: int = 0  # Agents of the previous answer that were coarsened
    known: EnergyBounds | str | None = field(default=None, repr=False)
    """The energy bounds, or why there are none, if the loop has worked them out."""

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.balance.grid.leaves

    @property
    def ground(self) -> PosedBody:
        """The posed body."""
        return self.balance.grid.ground

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
    def solution(self) -> Self:
        """Itself: it has the figures of its solution."""
        return self

    @property
    def tree(self) -> Self:
        """Itself: see `CellAgents.tree`."""
        return self

    def from_tree(self, values: Floats) -> Floats:
        """Return values of the tree's agents in the order of these: the same."""
        return values

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
        return halvings(self.leaves.size, self.generations[0].size.max())

    @property
    def spawn_step(self) -> Ints:
        """Step in which each agent spawned; 0 for the first."""
        return self.leaves.step

    @property
    def cause(self) -> Floats:
        """Load (N) for which each agent spawned."""
        return self.leaves.cause

    @cached_property
    def fields(self) -> CellFields:
        """Strains, stresses and displacements of all agents."""
        return CellFields(self.balance, self.displacement)

    def near(self, agent: Ints) -> tuple[CellFields, Ints]:
        """Return fields that hold some agents, and their places in these."""
        return self.fields, agent

    @property
    def proved(self) -> MiddleStress | None:
        """The displacement and stress that bounds are proved of, where they are of second order."""
        # In the plane: agents of a tolerance are too few to be read off by themselves.
        if self.ground.dimension == 3 or isinstance(self.bracket, str):
            return None
        return self.bracket.middle if self.bracket.middle.field.quadratic else None

    @property
    def moved(self) -> Floats:
        """Displacement of the agents' middles, shape (agents, dimension)."""
        if self.proved is None:
            return self.fields.displacement
        return self.proved.field.displacement_at(*_middles(self.leaves))

    @property
    def stress(self) -> Floats:
        """Stress tensors of the agents, shape (agents, dimension, dimension)."""
        return self.fields.stress if self.proved is None else self.proved.means

    def boxes(self) -> BoundCells:
        """Return the agents as energy bounds need them."""
        return boxes_of_agents(self.balance, self.displacement)

    @cached_property
    def bracket(self) -> EnergyBounds | str:
        """Energy bounds, or in words why there are none."""
        return bracket_of(self.boxes()) if self.known is None else self.known

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        return self.balance.reactions(self.displacement)

    def displacement_at(self, points: Floats, cells: Ints) -> Floats:
        """Return the displacement at points (m) in or on cells of the grid."""
        if self.proved is not None:
            return self.proved.field.displacement_at(*self.placed(points, cells))
        place, agent = self._located(points, cells)
        fields, agent = self.near(agent)
        return displacement_at(fields, place, agent)

    def stress_at(self, points: Floats, cells: Ints) -> Floats:
        """Return stress tensors at points (m) in or on cells of the grid."""
        place, agent = self._located(points, cells)
        if self.proved is not None:
            point, agent = touching_alike(self.balance.grid, place, agent)
            return means(point, self.proved.at(agent, self._inside(place[point], agent)))
        fields, agent = self.near(agent)
        return stress_at(fields, place, agent)

    def law_at(self, points: Floats, cells: Ints) -> Ints:
        """Return the index of the moduli of the agents in or on which points lie."""
        return self.leaves.kind[self._located(points, cells)[1]]

    def placed(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the agents in or on which points (m) lie, and where in each, from 0 to 1."""
        place, agent = self._located(points, cells)
        return agent, self._inside(place, agent)

    def _inside(self, place: Floats, agent: Ints) -> Floats:
        """Return where points (units) lie in agents, from 0 to 1."""
        lower, size = self.leaves.lower[agent], self.leaves.size[agent, None]
        return np.clip((place - lower) / size, 0.0, 1.0)

    def _located(self, points: Floats, cells: Ints) -> tuple[Floats, Ints]:
        """Return points in units, and the agent that each lies in or on."""
        first, cell = cells * self.ground.cell, self.ground.cell
        place = np.clip(points / self.grid.lattice.cell_size * cell, first, first + cell)
        unit = np.clip(np.floor(place).astype(np.int64), first, first + cell - 1)
        return place, self.leaves.find(unit)

    def history(self) -> dict[str, Any]:
        """Return the figures of their generations."""
        return {"generations": len(self.generations), "retired": self.retired}

    def archive(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return what is stored: arrays, and plain values."""
        aimed, arrays = self.aimed, {name: getattr(self.leaves, name) for name in _LEAVES}
        arrays |= {"displacement": self.displacement, "part": aimed.part}
        for name in OldGeneration._fields[5:]:
            arrays[f"history.{name}"] = np.concatenate(
                [getattr(generation, name) for generation in self.generations]
            )
        return arrays, {
            "spawning": plain_of(self),
            "aimed": [aimed.error, aimed.allowed],
            "answers": [[a.value.tolist(), *a[1:]] for a in aimed.answers],
            "generations": [list(g[:5]) for g in self.generations],
        }

    @classmethod
    def of_archive(cls, archive: Archive, scene: Scene, stage: int | None) -> Spawning:
        """Return the agents of a stored result; grid and estimates are worked out again."""
        ground = ground_of(scene, stage, archive.value("resolution", int | None))
        leaves = _leaves_of(archive, ground)
        n, d = len(leaves), ground.dimension
        balance = Equilibrium(CompositeGrid(ground, leaves))
        u = archive.array("displacement", "f", (balance.grid.size,))
        part = archive.array("part", "f", (n,), low=0.0)
        error, allowed = archive.value("aimed", tuple[float, float])
        answers = tuple(
            Answer(np.array(value, dtype=np.float64), *rest)
            for value, *rest in archive.value("answers", list[AnswerRecord])
        )
        unmarked = np.zeros(n, dtype=np.bool_)
        return cls(
            balance,
            u,
            indicate(balance, u),
            Aimed(error, part, unmarked, allowed, answers),
            generations=_generations_of(archive, (1 << 62) if d == 2 else (1 << 61)),
            **archive.record("spawning", Spawning),
        )


def _middles(leaves: LeafCells) -> tuple[Ints, Floats]:
    """Return all leaves, and their middles from 0 to 1 within each."""
    return np.arange(len(leaves)), np.full(leaves.lower.shape, 0.5)


def _leaves_of(archive: Archive, ground: PosedBody) -> LeafCells:
    """Return the stored leaves; refuse overlapping ones, and those outside the body."""
    d = ground.dimension
    ends = [n * ground.cell for n in ground.scene.lattice.shape]
    lower = archive.array("lower", "i", (None, d), low=0)
    n = len(lower)
    size = archive.array("size", "i", (n,), low=1, high=max(ends))
    kind = archive.array("kind", "i", (n,), low=0, high=len(ground.scene.cell_materials) - 1)
    step = archive.array("step", "i", (n,), low=0)
    cause = archive.array("cause", "f", (n,), finite=False)
    sound = n > 0 and bool(np.all(size & (size - 1) == 0))
    sound = sound and bool(np.all(lower % size[:, None] == 0))
    sound = sound and bool(np.all(lower + size[:, None] <= ends))
    leaves = LeafCells.of(lower, size, kind, step, cause)
    sound = sound and bool(np.all(np.diff(leaves.code) >= leaves.size[:-1] ** d))
    if not sound or not np.array_equal(ground.kinds_at(leaves.lower), leaves.kind):
        raise ResultFileError(
            f"{archive.path}: its agents do not stand side by side in the body: the file is "
            "damaged; compute it again"
        )
    return leaves


def _generations_of(archive: Archive, codes: int) -> list[OldGeneration]:
    """Return the steps of spawning; Morton codes of agents lie below `codes`."""
    figures = archive.value("generations", list[tuple[int, float, float, int, float]])
    count = [int(entry[0]) for entry in figures]
    if not figures or min(count) < 1:
        raise ResultFileError(f"{archive.path}: 'generations' must name agents")
    shape = (sum(count),)
    columns = (
        archive.array("history.code", "i", shape, low=0, high=codes),
        archive.array("history.size", "i", shape, low=1),
        archive.array("history.load", "f", shape, low=0.0),
        archive.array("history.chosen", "b", shape),
    )
    parts = [np.split(column, np.cumsum(count)[:-1]) for column in columns]
    return [
        OldGeneration(int(n), float(error), float(energy), int(runs), float(aimed), *part)
        for (n, error, energy, runs, aimed), *part in zip(figures, *parts, strict=True)
    ]


def tree_of_cells(
    scene: Scene,
    stage: int | None,
    cells: Ints,
    kind: Ints,
    origin: tuple[int, ...],
    scales: Scales,
    solution: Solution,
) -> Spawning:
    """Return cells of one size as a tree of one level, with the estimated error of each."""
    ground, count = PosedBody(scene, stage, at_cells=True), len(cells)
    size, nothing = np.full(count, ground.cell), np.zeros(count)
    leaves = LeafCells.of(cells * ground.cell, size, kind, nothing.astype(np.int64), nothing)
    balance = Equilibrium(CompositeGrid(ground, leaves))
    grid, unit = balance.grid, scales.displacement / ground.scales.displacement
    u = grid.value.copy()
    # Arrays of faces begin with a layer of ghosts before the first cell.
    index = np.floor(grid.place / ground.cell).astype(np.int64) - np.asarray(origin) + 1
    for axis, values in enumerate(solution.displacement):
        own = grid.axis == axis
        u[own] = unit * values[tuple(index[own].T)]
    indicator = indicate(balance, u)
    energy = solution.energy * unit * scales.force / ground.scales.force
    error = relative_error(indicator.square, energy)
    unmarked = np.zeros(count, dtype=np.bool_)
    aimed = Aimed(error, indicator.square, unmarked, 0.0)
    cost = (count, error, energy, solution.iterations, error)
    only = [OldGeneration(*cost, leaves.code, leaves.size, indicator.load, unmarked)]
    residuals = list(solution.residuals)
    return Spawning(balance, u, indicator, aimed, energy, error, only, residuals, 1, True, "")


def halvings(size: Ints, largest: int) -> Ints:
    """Return how often the largest edge would be halved to give each edge (units)."""
    return np.asarray(np.rint(np.log2(largest / size)), dtype=np.int64)
