"""Agents of many sizes: their places, laws, fields and generations."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ResultError, ResultFileError
from kaju.model.elastic.bounds.energy_bounds import EnergyBounds, bracket_of
from kaju.model.elastic.cells import cell_fields as sampling
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.leaf_cells import LeafCells
from kaju.model.elastic.goals.goal_regions import located
from kaju.model.elastic.multigrid.nested import relative_error
from kaju.model.elastic.posed_body import PosedBody, ground_of
from kaju.model.elastic.problem import ElasticProblem
from kaju.model.elastic.refine.estimator import indicate
from kaju.model.elastic.refine.family import levels
from kaju.model.elastic.refine.generations import Generation, Spawning
from kaju.model.elastic.refine.targets import Aimed, Answer
from kaju.model.elastic.solver import Solution
from kaju.model.results.archive import Archive, plain_of
from kaju.model.results.formats import AnswerRecord
from kaju.model.scene import Scene

_LEAVES = ("lower", "size", "kind", "step", "cause")


class LeafAgents:
    """Agents as the leaves of a tree, along a space-filling curve; values are in SI units."""

    storage: ClassVar[Literal["tree"]] = "tree"
    stiffness: ClassVar[None] = None
    energy_bounds: ClassVar[None] = None  # There are none without those of a stress

    def __init__(self, spawning: Spawning, stage: int | None) -> None:
        self.spawning = self.solution = spawning
        self.stage = stage
        self.ground = ground = spawning.ground
        self.grid, self.scales, self.moduli = ground.scene, ground.scales, ground.moduli
        self.metre = self.grid.lattice.cell_size / ground.cell  # of a unit of the tree

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.spawning.leaves

    @property
    def levels(self) -> int:
        """Sizes of agents."""
        return len(np.unique(self.leaves.size))

    @cached_property
    def bracket(self) -> EnergyBounds | str:
        """Energy bounds, or in words why there are none."""
        found = self.spawning.bracket
        return bracket_of(self.spawning.boxes()) if found is None else found

    def history(self) -> dict[str, Any]:
        """Return the figures of their generations."""
        return {"generations": len(self.spawning.generations), "retired": self.spawning.retired}

    @property
    def count(self) -> int:
        """Number of agents."""
        return len(self.leaves)

    @property
    def lower(self) -> Floats:
        """Lower corners of the agents."""
        return np.asarray(self.leaves.lower * self.metre)

    @property
    def size(self) -> Floats:
        """Edges of the agents."""
        return np.asarray(self.leaves.size * self.metre)

    @property
    def material(self) -> Ints:
        """Index of each agent's material, which is that of its moduli."""
        return self.leaves.kind

    law = material

    @property
    def energy(self) -> Floats:
        """Not defined: the energy of edges between agents of two sizes belongs to neither."""
        raise ResultError(
            "energy: agents of many sizes do not tell their energies one by one; equal ones do "
            "(strategy='uniform')"
        )

    @property
    def displacement(self) -> Floats:
        """Displacement of the agents' middles."""
        return self.scales.displacement * self.spawning.moved

    @property
    def stress(self) -> Floats:
        """Stress tensors of the agents."""
        return self.scales.stress * self.spawning.stress

    @property
    def level(self) -> Ints:
        """How often the largest of the first agents would be halved to give each agent."""
        return levels(self.leaves.size, self.spawning.generations[0].size.max())

    @property
    def spawn_step(self) -> Ints:
        """Step in which each agent spawned; 0 for the first."""
        return self.leaves.step

    @property
    def cause(self) -> Floats:
        """Load (N) for which each agent spawned."""
        return self.leaves.cause

    def reactions(self) -> dict[str, Floats]:
        """Return the force of each support on the body."""
        unit = self.scales.force
        return {name: unit * force for name, force in self.spawning.reactions().items()}

    def displacement_at(self, points: Floats, cells: Ints) -> Floats:
        """Return the displacement at points (m) in or on cells of the grid."""
        place, agent = self._located(points, cells)
        fields, agent = self.spawning.near(agent)
        return self.scales.displacement * sampling.displacement_at(fields, place, agent)

    def stress_at(self, points: Floats, cells: Ints) -> Floats:
        """Return stress tensors at points (m) in or on cells of the grid."""
        place, agent = self._located(points, cells)
        fields, agent = self.spawning.near(agent)
        return self.scales.stress * sampling.stress_at(fields, place, agent)

    def placed(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the agents in or on which points (m) lie, and where in each, from 0 to 1."""
        place, agent = self._located(points, cells)
        lower, size = self.leaves.lower[agent], self.leaves.size[agent, None]
        return agent, np.clip((place - lower) / size, 0.0, 1.0)

    def law_at(self, points: Floats, cells: Ints) -> Ints:
        """Return the index of the moduli of the agents in or on which points lie."""
        return self.leaves.kind[self._located(points, cells)[1]]

    def _located(self, points: Floats, cells: Ints) -> tuple[Floats, Ints]:
        """Return points in units, and the agent that each lies in or on."""
        place, unit = located(self.ground, points, cells)
        return place, self.leaves.find(unit)

    @property
    def tree(self) -> LeafAgents:
        """Itself."""
        return self

    def from_tree(self, values: Floats) -> Floats:
        """Return values of the tree's agents in the order of these: the same."""
        return values

    def archive(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return what is stored: arrays, and plain values."""
        spawning = self.spawning
        arrays = {name: getattr(self.leaves, name) for name in _LEAVES}
        arrays |= {"displacement": spawning.displacement, "part": spawning.aimed.part}
        for name in Generation._fields[5:]:
            arrays[f"history.{name}"] = np.concatenate(
                [getattr(generation, name) for generation in spawning.generations]
            )
        return arrays, {
            "spawning": plain_of(spawning),
            "aimed": [spawning.aimed.error, spawning.aimed.allowed],
            "answers": [[a.value.tolist(), *a[1:]] for a in spawning.aimed.answers],
            "generations": [list(g[:5]) for g in spawning.generations],
        }

    @classmethod
    def of_archive(cls, archive: Archive, scene: Scene, stage: int | None) -> LeafAgents:
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
        spawning = Spawning(
            balance,
            u,
            indicate(balance, u),
            Aimed(error, part, unmarked, allowed, answers),
            generations=_generations_of(archive, (1 << 62) if d == 2 else (1 << 61)),
            **archive.record("spawning", Spawning),
        )
        return cls(spawning, stage)


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


def _generations_of(archive: Archive, codes: int) -> list[Generation]:
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
        Generation(int(n), float(error), float(energy), int(runs), float(aimed), *part)
        for (n, error, energy, runs, aimed), *part in zip(figures, *parts, strict=True)
    ]


def tree_of_cells(
    scene: Scene,
    stage: int | None,
    problem: ElasticProblem,
    origin: tuple[int, ...],
    solution: Solution,
) -> LeafAgents:
    """Return cells of one size as a tree of one level, with the estimated error of each."""
    ground = PosedBody(scene, stage, at_cells=True)
    kinds = problem.kinds[problem.inner]
    cells = np.argwhere(kinds >= 0) + np.asarray(origin)
    count = len(cells)
    size, nothing = np.full(count, ground.cell), np.zeros(count)
    material = kinds[kinds >= 0].astype(np.int64)
    steps = np.zeros(count, dtype=np.int64)
    leaves = LeafCells.of(cells * ground.cell, size, material, steps, nothing)
    balance = Equilibrium(CompositeGrid(ground, leaves))
    grid, unit = balance.grid, problem.scales.displacement / ground.scales.displacement
    u = grid.value.copy()
    # Arrays of faces begin with a layer of ghosts before the first cell.
    index = np.floor(grid.place / ground.cell).astype(np.int64) - np.asarray(origin) + 1
    for axis, values in enumerate(solution.displacement):
        own = grid.axis == axis
        u[own] = unit * values[tuple(index[own].T)]
    indicator = indicate(balance, u)
    energy = solution.energy * unit * problem.scales.force / ground.scales.force
    error = relative_error(indicator.square, energy)
    unmarked = np.zeros(count, dtype=np.bool_)
    aimed = Aimed(error, indicator.square, unmarked, 0.0)
    runs, residuals = solution.iterations, list(solution.residuals)
    only = Generation(
        count, error, energy, runs, error, leaves.code, leaves.size, indicator.load, unmarked
    )
    spawning = Spawning(balance, u, indicator, aimed, energy, error, [only], residuals, 1, True, "")
    return LeafAgents(spawning, stage)
