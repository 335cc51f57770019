"""The answer of agents of two minds: whatever is read comes from their two opinions.

Displacements are those of the opinion that fits, reactions those of the one that balances. Stress
is the mean of both, since that is the stress whose error the gap tells exactly; energy is the
middle of its bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import InitVar, dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.goals.duals import aligned, goal_of
from kaju.model.elastic.moduli import equivalent_stress
from kaju.model.elastic.pair.elements import quadratic_values, rule, strains, stresses
from kaju.model.elastic.pair.gap import energies, stress_of
from kaju.model.elastic.pair.history import Generation, GrownAgents, trees_of
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.pair.opinions import Opinions, first, following

METHOD = "agents with two opinions"


@dataclass(eq=False)
class PairAgents(GrownAgents):
    """Agents of a plane body along a space-filling curve, and their generations; scaled."""

    method: ClassVar[str] = METHOD
    no_bound: ClassVar[str] = ""
    known: InitVar[tuple[list[LeafCells], Opinions] | None] = None

    def __post_init__(self, known: tuple[list[LeafCells], Opinions] | None) -> None:
        self._last = known and known[1]
        if known is not None:
            self.trees = known[0]  # The agents of every generation
        else:
            goals = [goal_of(goal.quantity, self.ground) for goal in self.goals]
            self.trees = trees_of(aligned(goals, self.ground.start()), self.generations)

    @cached_property
    def opinions(self) -> Opinions:
        """Both opinions of the last generation; of a stored answer they are found again."""
        # Generation by generation: so they are the same to the last digit.
        found = self._last
        for leaves in self.trees if found is None else ():
            found = first(self.ground, leaves) if found is None else following(found, leaves)
        assert found is not None
        return found

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.trees[-1]

    @property
    def gap(self) -> Floats:
        """Squared difference of each agent's two opinions."""
        return self.generations[-1].gap

    @property
    def energy(self) -> float:
        """Energy of the body and of what it lies on."""
        return self.generations[-1].energy

    @property
    def error(self) -> float:
        """Error of the stress, at most, in the energy norm."""
        return self.generations[-1].error

    @property
    def residuals(self) -> list[float]:
        """What an iteration left is in the bounds."""
        return []

    @cached_property
    def energies(self) -> Floats:
        """Energy stored in each agent: half-way between those of both opinions."""
        found = self.opinions
        both = [found.fields(case) for case in range(len(found.fit))]
        balanced, fitted = (np.sum([one[k] for one in both], axis=0) for k in range(2))
        each = (energies(stress, found.law, found.size) for stress in (balanced, fitted))
        return np.asarray(0.25 * sum(each))

    @property
    def moved(self) -> Floats:
        """Displacement of the agents' middles."""
        return self.opinions.displacement_at(*self._middles)

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors of the agents: the mean of both opinions over each."""
        balanced, fitted = means_of(self.opinions)
        return tensors(0.5 * (balanced + fitted))

    @property
    def _shape(self) -> tuple[Callable[[Floats], Floats], Floats, Floats]:
        found = self.opinions
        return quadratic_values, found.fit.sum(axis=0).reshape(-1, 8, 2), found.sides.shift

    @property
    def balanced(self) -> Floats:
        """Mean stress tensors of the opinion that balances."""
        return tensors(means_of(self.opinions)[0])

    @property
    def _middles(self) -> tuple[Ints, Floats]:
        return np.arange(self.count), np.full((self.count, 2), 0.5)

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        return self.opinions.reactions()

    def displacement_at(self, points: Floats, cells: Ints) -> Floats:
        """Return the displacement at points (m) in or on cells of the grid."""
        return self.opinions.displacement_at(*self.placed(points, cells))

    def stress_at(self, points: Floats, cells: Ints) -> Floats:
        """Return stress tensors at points (m) in or on cells of the grid."""
        return self._stress(*self.placed(points, cells))

    def opinions_at(self, points: Floats, cells: Ints) -> tuple[Floats, Floats]:
        """Return the stresses that balance, and those that fit, at points (m)."""
        at = self.placed(points, cells)
        balanced, fitted = self.opinions.stresses_at(*at)
        return tensors(balanced), tensors(fitted)

    def _stress(self, agent: Ints, inside: Floats) -> Floats:
        balanced, fitted = self.opinions.stresses_at(agent, inside)
        return tensors(0.5 * (balanced + fitted))


def generation_of(found: Opinions, chosen: Flags) -> Generation:
    """Return what is kept of a generation of which some agents are to spawn."""
    bounds, body, kind = found.bounds, found.body, found.leaves.kind
    balanced, fitted = (
        equivalent_stress(tensors(stress), body.moduli, kind, body.scene.plane)
        for stress in means_of(found)
    )
    leaves, shares = found.leaves, found.shares
    figures = (bounds.error, bounds.energy, bounds.lower, bounds.upper)
    return Generation(*figures, leaves.code, leaves.size, shares, fitted, balanced, chosen)


def means_of(found: Opinions) -> tuple[Floats, Floats]:
    """Return the means over agents of both opinions' stresses xx, yy, xy: balanced, fitted."""
    weights, size = rule()[1], found.size[:, None]
    balanced = found.phi.sum(axis=0) @ np.einsum("p,pki->ik", weights, stresses()) / size**2
    strain = found.fit.sum(axis=0) @ np.einsum("p,pki->ik", weights, strains()) / size
    return np.asarray(balanced), stress_of(strain, found.law)


def tensors(three: Floats) -> Floats:
    """Return stresses xx, yy, xy as tensors, shape (n, 2, 2)."""
    return np.asarray(three[:, [[0, 2], [2, 1]]])
