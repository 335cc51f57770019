"""The agents where the body ends: they give a load back to the agent it came from."""

from __future__ import annotations

from typing import Protocol

from mesa.discrete_space import Cell, FixedAgent

from .load import Load


class Clock(Protocol):
    """What a boundary agent needs of the model it lives in."""

    @property
    def generation(self) -> int:
        """Steps taken."""


class BoundaryAgent(FixedAgent):
    """A cell beside the body that a load has woken.

    Attributes
    ----------
    spawn_step : int
        Generation in which the first load was given back, counted from 1.
    returned : float
        Sum of the loads given back (N), unattenuated.
    """

    def __init__(self, model: Clock, cell: Cell) -> None:
        super().__init__(model)
        self.cell = cell
        self.spawn_step = model.generation + 1
        self.returned = 0.0

    def give_back(self, load: Load, arm: int) -> Load:
        """Return the load as the sender takes it again; it came over `arm`."""
        self.returned += load.total
        return load._replace(direction=self.turn(load.direction, arm))

    def turn(self, direction: int, arm: int) -> int:
        """Say where a load points after it was given back."""
        raise NotImplementedError


class FreeBoundaryAgent(BoundaryAgent):
    """Air, water, gas or vacuum: nothing is ahead, so the load comes back as it went."""

    def turn(self, direction: int, arm: int) -> int:
        """Keep the direction."""
        return direction


class RigidBoundaryAgent(BoundaryAgent):
    """Ground, a wall or a punch: it pushes back, so the load comes back reversed."""

    def turn(self, direction: int, arm: int) -> int:
        """Reverse the direction."""
        return int(self.model.lattice.opposite[direction])


class RollerBoundaryAgent(BoundaryAgent):
    """A smooth wall: it reverses what presses on it and lets slide what runs along it."""

    def turn(self, direction: int, arm: int) -> int:
        """Mirror the direction at the wall, whose normal is the arm."""
        return int(self.model.lattice.mirrored[arm, direction])
