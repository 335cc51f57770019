"""Goals of bodies in space: their errors are estimated by the errors of two loads' answers.

The error of a quantity is the product, in the energy, of the errors under the body's loads and
under its dual load. The estimate takes their sizes leaf by leaf.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.goals.duals import DualLoad, Forces, Strained, aligned, goal_of
from kaju.model.elastic.goals.quantities import Deflection, Goal, Quantity, Reaction, Stress
from kaju.model.elastic.pair import bricks
from kaju.model.elastic.pair.brick_field import NO_BOUND, BrickField
from kaju.model.elastic.pair.brick_levels import BrickLevel
from kaju.model.elastic.pair.history import GrownAgents
from kaju.model.elastic.posed_body import PosedBody

FACTOR = 2.0
"""On 24 random solids the estimate was down to 0.53 of an error; here two are multiplied."""


class BrickGoals:
    """The goals of a body in space, and what has been found under their dual loads."""

    def __init__(self, quantities: Sequence[Quantity], body: PosedBody, across: int) -> None:
        self.body = body
        self.goals = [goal_of(quantity, body) for quantity in quantities]
        self.start = aligned(self.goals, body.start(across)) if self.goals else body.start(across)
        self._duals: list[BrickField] = []

    def solve(self, found: GrownAgents, field: BrickField, enough: float) -> None:
        """Find the displacements under the dual loads; steps end that gain less than `enough`.

        It is a share of their estimated errors.
        """
        level, before = field.level, self._duals
        loads = [load for goal in self.goals for load in goal.loads(found.leaves, found)]
        self._duals = []
        for number, dual in enumerate(loads):
            force, master, beside = dual_of(dual, level)
            least = 0.0
            if before and isinstance(level.below, BrickLevel):
                own = before[number]
                master = np.where(field.mesh.open, level.prolong @ own.master, master)
                least = enough * 0.5 * float(own.shares.sum())
            left = force - level.summed(level.force(level.gathered(master)))
            change = level.solve(left, least)[0]
            self._duals.append(BrickField(level, field.moduli, master + change, beside))

    def judge(
        self, found: GrownAgents, field: BrickField, wanting: float
    ) -> tuple[list[Goal], Floats]:
        """Return what is found, and what leaves add to the errors of the goals, as shares."""
        goals, part, duals = [], np.zeros(len(field.shares)), iter(self._duals)
        largest = _largest(found, field)
        for goal in self.goals:
            off = []
            for _, dual in zip(goal.directions, duals, strict=False):
                both = np.sqrt(field.shares * dual.shares)
                off.append(FACTOR * wanting * float(both.sum()))
                part += both / (both.sum() or 1.0)
            told = goal.goal(goal.read(found), float(np.linalg.norm(off)), largest)
            goals.append(replace(told, no_bound=NO_BOUND))
        return goals, part

    def read(self, found: GrownAgents, goals: list[Goal]) -> list[Goal]:
        """Return what was found of goals with the values of other fields."""
        return [
            replace(told, components=tuple(goal.read(found).tolist()))
            for goal, told in zip(self.goals, goals, strict=True)
        ]


def dual_of(dual: DualLoad, level: BrickLevel) -> tuple[Floats, Floats, Floats | None]:
    """Return a dual load: forces on masters, how these are moved, and stress in leaves."""
    mesh, beside = level.mesh, None
    force, moved = np.zeros((mesh.nodes, 3)), np.zeros_like(mesh.given)
    if isinstance(dual, Forces):
        within = dual.side < 0
        share = np.where(within[:, None], bricks.means(), bricks.side_loads()[dual.side, 0])
        mesh.add(force, dual.agent, share[:, :, None] * dual.force[:, None])
    elif isinstance(dual, Strained):
        kind, edge = mesh.leaves.kind[dual.agent], mesh.edge[dual.agent]
        moduli, beside = mesh.ground.moduli, np.zeros((len(mesh.edge), 6))
        laws = [bricks.law_of(moduli.lateral[k], moduli.shear[k]) for k in range(kind.max() + 1)]
        stress = np.stack(laws)[kind] @ dual.strain * (dual.share / edge**3)[:, None]
        beside[dual.agent] = stress
        points, weights = bricks.gauss(3)
        rows = np.einsum("p,pai->ai", weights, bricks.strain_rows(points))
        own = (edge**2)[:, None] * (stress @ rows)
        mesh.add(force, dual.agent, own.reshape(-1, 20, 3))
    else:
        # What several supports hold each of them moves by its share.
        count = np.zeros_like(mesh.given)
        for holder in mesh.holders:
            count[holder.masters, holder.axis] += 1.0
            if holder.number in (dual.support, dual.support - 7):
                own_masters = holder.masters & mesh.at_corner
                moved[own_masters, holder.axis] += dual.along[holder.axis]
        moved /= np.maximum(count, 1.0)
        for leaf, side, area in level.beds:
            if side == dual.support:
                given = np.zeros((len(leaf), 20, 3))
                given[:, :, side // 2] = area * bricks.side_loads()[side, 0] * dual.along[side // 2]
                mesh.add(force, leaf, given)
    return np.asarray(mesh.ties.T @ force), moved, beside


def _largest(found: GrownAgents, field: BrickField) -> dict[type[Quantity], float]:
    """Return the largest displacement, stress and reaction."""
    moved = field.moved[:, :8] + field.mesh.shift
    six = field.corner_stress.mean(axis=1)
    square = (six[:, :3] ** 2).sum(axis=1) + 2.0 * (six[:, 3:] ** 2).sum(axis=1)
    forces = [float(np.linalg.norm(force)) for force in found.reactions().values()]
    return {
        Deflection: float(np.linalg.norm(moved, axis=2).max()),
        Stress: float(np.sqrt(square.max())),
        Reaction: max(forces, default=0.0),
    }
