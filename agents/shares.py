"""What an agent passes on: the vocabulary that all rules share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple


class Emission(NamedTuple):
    """One share on its way: over which arm it leaves, along which direction it points."""

    arm: int
    direction: int
    share: float


@dataclass(frozen=True)
class Shares:
    """What becomes of a load of 1 N that an agent takes.

    Attributes
    ----------
    own : float
        Share that deforms the agent itself.
    forward, backward : float
        Share handed to the neighbour ahead, and to the one behind.
    friction : float
        Share handed to each neighbour beside, along the load's own direction.
    poisson : float
        Share pressed into each neighbour beside, outwards, by the blocked expansion.
    """

    own: float
    forward: float
    backward: float
    friction: float
    poisson: float

    def emissions(
        self, direction: int, behind: int, beside: Iterable[tuple[int, float, float]]
    ) -> tuple[Emission, ...]:
        """Return what leaves the agent for each newton that it takes along `direction`.

        Parameters
        ----------
        direction, behind : int
            Where the load points, and the opposite direction.
        beside : iterable of (arm, friction weight, Poisson weight)
            The neighbours beside, as the lattice has them.
        """
        passed = [
            Emission(direction, direction, self.forward),
            Emission(behind, direction, self.backward),
        ]
        for arm, friction, poisson in beside:
            passed.append(Emission(arm, direction, self.friction * friction))
            passed.append(Emission(arm, arm, self.poisson * poisson))
        return tuple(emission for emission in passed if emission.share > 0.0)
