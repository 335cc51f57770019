"""What a goal asks of a body: a load whose work on the displacement it is, and how it is read.

The dual load of a displacement is a force at its place, that of a stress an even stress in the
agents there, that of a reaction the movement of its support (Maxwell's influence functions).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.goals.goal_places import Cover, GoalBox, Where, where_of
from kaju.model.elastic.goals.quantities import (
    Deflection,
    Goal,
    Quantity,
    Reaction,
    Stress,
    component_of,
    directions_of,
    support_of,
)
from kaju.model.elastic.moduli import Moduli, equivalent_stress
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene import Scene

SMALL = 0.01  # Of the largest: errors of smaller values are relative to this share
NEAREST = (
    "agents cannot end where the place ends; the error is that of the nearest box where they "
    "can end"
)

if TYPE_CHECKING:
    from kaju.model.elastic.pair.answer import PairAgents

Found: TypeAlias = "CellAgents | PairAgents"
"""Agents whose fields are read."""


class Forces(NamedTuple):
    """Forces on agents or their sides."""

    agent: Ints
    side: Ints  # -1: within
    force: Floats


class Strained(NamedTuple):
    """Stress in agents: that of an even strain, whose shares of the place's volume add up to 1."""

    agent: Ints
    share: Floats
    strain: Floats  # Normal strains, then twice the shear strains


class Moved(NamedTuple):
    """The movement of a support, and of nothing else."""

    support: int
    along: Floats


DualLoad = Forces | Strained | Moved


class DualGoal(ABC):
    """A quantity of a body."""

    box: GoalBox | None = None  # Where its dual loads act
    no_bound = ""  # Why nothing is proved of it

    def __init__(self, quantity: Quantity, directions: Floats) -> None:
        self.quantity, self.directions = quantity, directions

    @abstractmethod
    def loads(self, leaves: LeafCells, found: Found | None) -> list[DualLoad]:
        """Return the dual load of each component, by what was found before if anything was."""

    @abstractmethod
    def read(self, found: Found) -> Floats:
        """Return the quantity of agents."""

    def goal(self, value: Floats, error: float, largest: dict[type[Quantity], float]) -> Goal:
        """Return what has been found, with what its error is relative to."""
        least = SMALL * largest[type(self.quantity)]
        scale = max(float(np.linalg.norm(value)), least)
        return Goal(self.quantity, tuple(value.tolist()), error, scale, self.no_bound)


class _At(DualGoal):
    """A quantity of a place."""

    where: Where

    def _place(self, body: PosedBody | Scene, flat: bool) -> None:
        assert isinstance(self.quantity, (Deflection, Stress))
        scene = body if isinstance(body, Scene) else body.scene
        self.where = where_of(self.quantity.at, scene)
        if isinstance(body, PosedBody):
            self.box = GoalBox.of(self.where, body, flat)
            self.no_bound = "" if self.box.exact else NEAREST

    def _cover(self, leaves: LeafCells) -> Cover:
        assert self.box is not None
        cover = self.box.cover(leaves)
        if not len(cover.agent):
            raise ParameterError(f"goal: there is no body at {self.where.name}")
        return cover


class Displaced(_At):
    """The mean displacement of a place."""

    def __init__(self, quantity: Deflection, body: PosedBody | Scene, d: int) -> None:
        super().__init__(quantity, directions_of(quantity.along, d))
        self._place(body, flat=True)

    def loads(self, leaves: LeafCells, found: Found | None) -> list[DualLoad]:
        """Return a force along each direction."""
        agent, side, share = self._cover(leaves)
        return [Forces(agent, side, share[:, None] * along) for along in self.directions]

    def read(self, found: Found) -> Floats:
        """Return the mean over the place's points."""
        place, cell, weight = self.where.points(found.lower, found.size)
        return np.asarray(self.directions @ (weight @ found.displacement_at(place, cell)))


class Stressed(_At):
    """The mean stress of a place."""

    def __init__(self, quantity: Stress, body: PosedBody | Scene, d: int) -> None:
        super().__init__(quantity, np.ones((1, 1)))
        self._place(body, flat=False)
        self._plane = self.where.scene.plane
        self._pairs = [(k, k) for k in range(d)] + list(combinations(range(d), 2))
        self._component = component_of(quantity.component, d)
        if self._component is None:
            self.no_bound = "the equivalent stress is no linear quantity, and only such are proved"

    def loads(self, leaves: LeafCells, found: Found | None) -> list[DualLoad]:
        """Return the stress of the strain by which the quantity grows."""
        agent, _, share = self._cover(leaves)
        if self._component is None and found is not None:
            return [Strained(agent, share, self._slope(found))]
        strain = np.eye(len(self._pairs))[self._pairs.index(self._component or (0, 0))]
        return [Strained(agent, share, strain)]

    def read(self, found: Found) -> Floats:
        """Return the mean over the place's points."""
        place, cell, weight = self.where.points(found.lower, found.size)
        stress, law = found.stress_at(place, cell), found.law_at(place, cell)
        return np.array([weight @ self._measured(stress, law, found.moduli)])

    def _measured(self, stress: Floats, law: Ints, moduli: Moduli) -> Floats:
        if self._component is None:
            return equivalent_stress(stress, moduli, law, self._plane)
        return np.asarray(stress[:, self._component[0], self._component[1]])

    def _slope(self, found: Found) -> Floats:
        """Return the slopes of the equivalent stress by the components of the mean stress."""
        place, cell, weight = self.where.points(found.lower, found.size)
        mean = np.tensordot(weight, found.stress_at(place, cell), 1)
        step = 1e-4 * float(np.abs(mean).max()) or 1.0
        law, slopes = found.law_at(place, cell)[:1], []
        for a, b in self._pairs:
            by = np.zeros_like(mean)
            by[a, b] = by[b, a] = step
            ends = [self._measured((mean + sign * by)[None], law, found.moduli) for sign in (1, -1)]
            slopes.append(float(ends[0][0] - ends[1][0]) / (2.0 * step))
        return np.array(slopes)


class Supported(DualGoal):
    """The force of a support."""

    def __init__(self, quantity: Reaction, body: PosedBody | Scene, d: int) -> None:
        super().__init__(quantity, directions_of(quantity.along, d))
        scene = body if isinstance(body, Scene) else body.scene
        self.support, self._name = support_of(quantity.side, scene.lattice.sides), quantity.side

    def loads(self, leaves: LeafCells, found: Found | None) -> list[DualLoad]:
        """Return the movement of the support along each direction."""
        return [Moved(self.support, along) for along in self.directions]

    def read(self, found: Found) -> Floats:
        """Return the force."""
        reactions = found.reactions()
        if self._name not in reactions:
            raise ParameterError(
                f"goal: nothing holds the body at {self._name!r}; supports are "
                f"{', '.join(reactions) or 'missing'}"
            )
        return np.asarray(self.directions @ reactions[self._name])


def goal_of(quantity: Quantity, body: PosedBody | Scene) -> DualGoal:
    """Return a quantity as a goal of a body; of a scene it can only be read."""
    d = (body if isinstance(body, Scene) else body.scene).lattice.dimension
    if isinstance(quantity, Deflection):
        return Displaced(quantity, body, d)
    if isinstance(quantity, Stress):
        return Stressed(quantity, body, d)
    return Supported(quantity, body, d)


def aligned(goals: list[DualGoal], leaves: LeafCells) -> LeafCells:
    """Return agents that are as small as the places of goals ask for."""
    for goal in goals:
        if goal.box is not None:
            leaves = goal.box.aligned(leaves)
    return leaves.balanced()
