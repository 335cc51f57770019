"""Bodies in space: bricks on an octree that spawn where stresses jump, to an estimated error.

The displacement fits, so that the potential energy is never below the true one: where forces act
and no side is moved the strain energy is a lower bound. Nothing is proved beyond that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, replace
from functools import cached_property
from math import exp, inf, log, nan, sqrt
from typing import Annotated, ClassVar

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ParameterError, ResultError
from kaju.model.elastic.goals.quantities import Goal, Quantity
from kaju.model.elastic.pair import bricks
from kaju.model.elastic.pair.brick_field import NO_BOUND, BrickField
from kaju.model.elastic.pair.brick_goals import BrickGoals
from kaju.model.elastic.pair.brick_levels import BrickLevel
from kaju.model.elastic.pair.brick_mesh import BrickMesh
from kaju.model.elastic.pair.history import Generation, GrownAgents, trees_of
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.results.stored import Column

ACROSS = 4  # The first leaves are at least this many along the body's longest side
DORFLER = 0.6  # Share of the squared error that leaves which spawn hold
SPARE = 0.95  # The last generation aims at this share of the tolerance
GAIN = 0.8  # Share of a leaf's squared error that its halving is expected to remove
ENOUGH = 0.01  # Steps end when one gains less than this share of the estimated error's energy
LAST = 1e-10  # The last generation's steps gain this share of the energy at most
ALIKE = 0.01
"""Leaves with a share less than the last one marked only by this part are marked, too, so that
marks keep the symmetry of the body."""
MOST_GENERATIONS = 60
WINDOW = 6  # Generations over which the rate is measured by which the error falls
MOST_RATIO = 0.499  # at 0.4999 the true error of a cube was 1.9 times its estimate
MOST_AGENTS = 400_000
"""Leaves: some 5 kB each, so about 2 GB."""


@dataclass(eq=False)
class BrickAgents(GrownAgents):
    """Agents in space that spawned, along a space-filling curve; scaled."""

    method: ClassVar[str] = "bricks"
    no_bound: ClassVar[str] = NO_BOUND
    master: Annotated[Floats, Column("masters 3")]  # Displacement of the nodes that are free
    energy: float
    error: float  # Estimated, in the energy norm, relative
    residuals: list[float]
    known: InitVar[BrickField | None] = None

    def __post_init__(self, known: BrickField | None) -> None:
        if known is None:
            quantities = [goal.quantity for goal in self.goals]
            start = BrickGoals(quantities, self.ground, ACROSS).start
            mesh = BrickMesh(self.ground, trees_of(start, self.generations)[-1])
            if len(self.master) != int(mesh.free.sum()):
                raise ResultError(f"'master' must have {int(mesh.free.sum())} rows")
            known = BrickField(BrickLevel(mesh, self.moduli), self.moduli, self.master)
        self.field = known

    @cached_property
    def load(self) -> Floats:
        """Load on the masters."""
        mesh = self.field.mesh
        return np.asarray(mesh.ties.T @ mesh.loads())

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.field.mesh.leaves

    @cached_property
    def moved(self) -> Floats:
        """Displacement of the agents' middles."""
        return self.field.displacement_at(*self._middles)

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors in the agents' middles."""
        return self.field.stress_at(*self._middles)

    @property
    def _shape(self) -> tuple[Callable[[Floats], Floats], Floats, Floats]:
        return bricks.values, self.field.moved, self.field.mesh.shift

    @property
    def _middles(self) -> tuple[Ints, Floats]:
        return np.arange(self.count), np.full((self.count, 3), 0.5)

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        return self.field.reactions(self.load)

    def displacement_at(self, points: Floats, cells: Ints) -> Floats:
        """Return the displacement at points (m) in or on cells of the grid."""
        return self.field.displacement_at(*self.placed(points, cells))

    def stress_at(self, points: Floats, cells: Ints) -> Floats:
        """Return stress tensors at points (m) in or on cells of the grid."""
        return self.field.stress_at(*self.placed(points, cells))


class BrickLoop:
    """Bricks that settle, estimate their errors and spawn, generation by generation.

    `finished` once the estimated error keeps the tolerance, or `stopped` says why none smaller can
    spawn: "depth" or "agents".
    """

    def __init__(
        self,
        ground: PosedBody,
        tolerance: float,
        most_agents: int | None,
        quantities: Sequence[Quantity] = (),
    ) -> None:
        for material in ground.scene.cell_materials:
            if material.poissons_ratio > MOST_RATIO:
                raise ParameterError(
                    f"tolerance: in space agents spawn for a Poisson's ratio of {MOST_RATIO} at "
                    f"most, and {material.name!r} has {material.poissons_ratio:.10g}; solve "
                    "without a tolerance, for which equal cells take any ratio"
                )
        self.ground, self.tolerance = ground, tolerance
        self.most_agents = most_agents or MOST_AGENTS
        self.goals = BrickGoals(quantities, ground, ACROSS)
        self.leaves, self.found = self.goals.start, list[Goal]()
        self.finished, self.stopped = False, ""
        self.generations: list[Generation] = []
        self.notes: list[str] = []
        self.residuals: list[float] = []
        self.error, self.energy = float("nan"), 0.0
        self._field: BrickField | None = None
        self._marked: Flags | None = None
        self._errors: list[tuple[int, float]] = []  # Agents and error of the generations
        self._mesh = BrickMesh(ground, self.leaves)
        self._mesh.check_held()
        if self._mesh.torn:
            self.notes.append(
                "sides that meet are moved apart: the energy has no limit as agents shrink"
            )

    def step(self) -> None:
        """Spawn, but for the first time, and settle."""
        before, marked, number = self._field, self._marked, len(self.generations)
        descent = None
        if before is not None and marked is not None:
            old = self.leaves
            new = old.split(marked, number, before.shares)
            self.leaves = new.balanced(number, young=new.step == number)
            descent = descent_of(old, self.leaves)
            self._mesh = BrickMesh(self.ground, self.leaves)
        level = BrickLevel(self._mesh, self.ground.moduli)
        master = self._mesh.given.copy()
        enough = 0.0
        if before is None or descent is None:
            level.first()
        else:
            level.on(before.level, *descent)
            prolonged = level.prolong @ before.master
            master = np.where(self._mesh.open, prolonged, self._mesh.given)
            enough = ENOUGH * 0.5 * float(before.shares.sum())
        self._load = np.asarray(self._mesh.ties.T @ self._mesh.loads())
        left = self._load - level.summed(level.force(level.gathered(master)))
        change, self.residuals, last = level.solve(left, enough)
        self._field = BrickField(level, self.ground.moduli, master + change)
        self.goals.solve(self.outcome(), self._field, ENOUGH)
        self._judge(last)
        if self.finished and level.below is not None:
            # What is read has its forces in balance; the mesh would not need it.
            master = self._field.master
            left = self._load - level.summed(self._field.force)
            change, residuals, last = level.solve(left, LAST * abs(self.energy))
            self.residuals += [residual * self.residuals[-1] for residual in residuals[1:]]
            self._field = BrickField(level, self.ground.moduli, master + change)
            self.energy = self._field.energy(float(np.vdot(self._load, self._field.master)))
            self.found = self.goals.read(self.outcome(), self.found)
            self.generations[-1] = replace(
                self.generations[-1],
                energy=self.energy,
                gap=self._field.shares,
                fitted=self._field.equivalent(),
            )

    def _judge(self, left: float) -> None:
        """Estimate the error and mark."""
        field, leaves = self._field, self.leaves
        assert field is not None
        self.energy = field.energy(float(np.vdot(self._load, field.master)))
        total = float(field.shares.sum()) * self._wanting(field) + 2.0 * left
        scale = 2.0 * abs(self.energy) or 1.0
        self.error = sqrt(total / scale)
        smallest = leaves.size <= self.ground.smallest
        error, part = self.error, field.shares
        if self.goals.goals:
            wanting = sqrt(total / (float(field.shares.sum()) or 1.0))
            self.found, part = self.goals.judge(self.outcome(), field, max(wanting, 1.0))
            error = max(answer.relative_error for answer in self.found)
        power = 1 if self.goals.goals else 2
        allowed = (SPARE * self.tolerance / (error or 1.0)) ** power * float(part.sum())
        marked = mark_largest(part, allowed, smallest)
        if error <= self.tolerance:
            self.finished = True
        elif not marked.any() or len(self.generations) + 1 == MOST_GENERATIONS:
            self.finished, self.stopped = True, "depth"
        elif max(len(leaves) + 7 * int(marked.sum()), self._expected(error)) > self.most_agents:
            self.finished, self.stopped = True, "agents"
        spawn = marked & (not self.finished)
        self._marked = None if self.finished else marked
        figures = (self.error, self.energy, None, None)
        balanced = np.full(len(leaves), nan)
        fitted = field.equivalent()
        self.generations.append(
            Generation(*figures, leaves.code, leaves.size, field.shares, fitted, balanced, spawn)
        )
        self._before = float(field.shares.sum()), self.energy

    def _expected(self, error: float) -> float:
        """Return a tenth of the agents that the tolerance takes if the error falls on so."""
        self._errors.append((len(self.leaves), error))
        if len(self._errors) < WINDOW:
            return 0.0
        few, before = max(self._errors[-WINDOW:], key=lambda one: one[1])
        rate = log(before / error) / log(len(self.leaves) / few) if error < before else 0.0
        factor = log(error / self.tolerance) / rate if rate > 0.0 else inf
        return 0.1 * len(self.leaves) * exp(min(factor, 100.0))

    def _wanting(self, field: BrickField) -> float:
        """Return how many times more than its estimated share a generation has gained, 1 or more.

        Squared errors fall by twice what the energy rises; an estimate that falls by less is too
        small by so much, as it is where materials are nearly incompressible.
        """
        if not self.generations or field.mesh.given.any():
            return 1.0
        shares, energy = self._before
        gained, estimated = 2.0 * (self.energy - energy), shares - float(field.shares.sum())
        return max(gained / estimated, 1.0) if estimated > 0.0 and gained > 0.0 else 1.0

    def outcome(self) -> BrickAgents:
        """Return the agents as they are."""
        assert self._field is not None
        return BrickAgents(
            self.ground,
            list(self.found),
            list(self.generations),
            self.stopped,
            list(self.notes),
            self._field.master,
            self.energy,
            self.error,
            list(self.residuals),
            self._field,
        )


def descent_of(before: LeafCells, after: LeafCells) -> tuple[Ints, Ints]:
    """Return the leaf that each leaf came from, and which of its `descents` it is."""
    parent = np.searchsorted(before.code, after.code, side="right") - 1
    many = before.size[parent] // after.size
    offset = (after.lower - before.lower[parent]) // after.size[:, None]
    level = np.rint(np.log2(many)).astype(np.int64)
    child = (offset[:, 2] * many + offset[:, 1]) * many + offset[:, 0]
    return parent, np.asarray(bricks.FIRST_OF_LEVEL[level] + child)


def mark_largest(part: Floats, allowed: float, smallest: Flags) -> Flags:
    """Mark the leaves with the largest shares, but none of the smallest (Doerfler 1996)."""
    # The smallest keep their shares: the others have what is left of the sum that is allowed, or
    # all of it where the smallest alone exceed it.
    fixed = float(part[smallest].sum())
    part = np.where(smallest, 0.0, part)
    total = float(part.sum())
    excess = total - (allowed - fixed if fixed < allowed else allowed)
    wanted = max(min(DORFLER * total, excess / GAIN), 0.0)
    order = np.argsort(-part, kind="stable")
    count = int(np.searchsorted(np.cumsum(part[order]), wanted)) + 1
    threshold = part[order[count - 1]] if count <= len(part) else 0.0
    return (part >= (1.0 - ALIKE) * threshold) & (part > 0.0) & (excess > 0.0)
