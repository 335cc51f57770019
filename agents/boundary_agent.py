"""The agents where the body ends: they give a load back to the agent it came from."""

from __future__ import annotations

from typing import Protocol

from kaju._mesa import Cell

from .load import Load
from .placed import PlacedAgent


class Clock(Protocol):
    """What a boundary agent needs of the model it lives in."""

    @property
    def generation(self) -> int:
        """Steps taken."""


class BoundaryAgent(PlacedAgent):
    """A cell beside the body that a load has woken.

    Subclass one of the three kinds to try a boundary of your own: `give_back` says what
    becomes of a load, `turn` where it goes. What is not given back counts as absorbed.

    Attributes
    ----------
    spawn_step : int
        Generation in which the first load was given back, counted from 1.
    returned : float
        Sum of the loads given back (N).
    absorbed : float
        Sum of what was not given back (N): 0 unless a boundary of your own keeps some.
    """

    def __init__(self, model: Clock, cell: Cell) -> None:
        super().__init__(model)
        self.cell = cell
        self.spawn_step = model.generation + 1
        self.returned = 0.0
        self.absorbed = 0.0

    def give_back(self, load: Load, arm: int) -> Load | None:
        """Return the load as the sender takes it again, or None; it came over `arm`."""
        return self.turn(load, arm)

    def turn(self, load: Load, arm: int) -> Load:
        """Return the load on its way back."""
        raise NotImplementedError


class FreeBoundaryAgent(BoundaryAgent):
    """Air, water, gas or vacuum: nothing is ahead, so the load comes back with its force.

    Where loads have a sense, what arrives straight travels back: a push comes back as a pull,
    a pull as a push, as a wave does at a free end.
    """

    def turn(self, load: Load, arm: int) -> Load:
        """Keep the force; turn round what arrives along the normal."""
        straight = self.model.transfer.rule.sense and self.model.heading(load) == arm
        return load.turned() if straight else load


class RigidBoundaryAgent(BoundaryAgent):
    """Ground, a wall or a punch: it pushes or pulls back, so the load comes back reversed."""

    def turn(self, load: Load, arm: int) -> Load:
        """Reverse the force and keep the sense."""
        return load._replace(direction=int(self.model.lattice.opposite[load.direction]))


class RollerBoundaryAgent(BoundaryAgent):
    """A smooth wall: it reverses what presses on it and lets slide what runs along it."""

    def turn(self, load: Load, arm: int) -> Load:
        """Mirror the force at the wall, whose normal is the arm, and keep the sense."""
        return load._replace(direction=int(self.model.lattice.mirrored[arm, load.direction]))
