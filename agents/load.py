"""What travels: a load on its way into an agent."""

from __future__ import annotations

from typing import NamedTuple


class Load(NamedTuple):
    """A load that reaches an agent.

    Attributes
    ----------
    direction : int
        Where it points: the index of a face normal of the lattice.
    magnitude : float
        Its size (N), always positive.
    copies : float
        How many equal loads arrived together.
    """

    direction: int
    magnitude: float
    copies: float = 1.0

    @property
    def total(self) -> float:
        """Sum of the equal loads (N)."""
        return self.magnitude * self.copies
