"""What travels: a load on its way into an agent."""

from __future__ import annotations

from typing import Literal, NamedTuple

Sense = Literal["push", "pull"]
"""A push travels along its force, a pull against it."""


class Load(NamedTuple):
    """A load that reaches an agent.

    Attributes
    ----------
    direction : int
        Where its force points: the index of a face normal of the lattice.
    magnitude : float
        Its size (N), always positive.
    copies : float
        How many equal loads arrived together.
    sense : {"push", "pull"}
        Whether it travels along its force or against it. Only a rule with `sense` knows pulls.
    """

    direction: int
    magnitude: float
    copies: float = 1.0
    sense: Sense = "push"

    @property
    def total(self) -> float:
        """Sum of the equal loads (N)."""
        return self.magnitude * self.copies

    def turned(self) -> Load:
        """Return the load with the same force and the other sense: it travels back."""
        return self._replace(sense="pull" if self.sense == "push" else "push")
