"""An agent that stands for a square or cube of material, and spawns smaller ones."""

from __future__ import annotations

from typing import Any

from kaju._mesa import Agent

from .materials import Material


class SpawningAgent(Agent):
    """One of the agents of a `SpawningModel`; it retires when it spawns, or holds no body."""

    row: int  # its number in the order of spawning, from 0, as in the model's `family`
    parent: SpawningAgent | None  # who spawned it, None for the first ones
    level: int  # how often the largest of the first agents would be halved to give it
    lower: tuple[float, ...]  # corner (m)
    size: float  # edge (m)
    material: Material
    spawn_step: int  # 0 for the first agents
    cause: float  # gap (J) of its parent; 0 for the first, NaN if it keeps neighbours alike in size

    alive = property(lambda agent: agent.retired_step is None, doc="Whether it has not retired.")

    def __init__(self, model: Any, **birth: Any) -> None:
        super().__init__(model)
        self.__dict__.update(birth)

    @property
    def children(self) -> list[SpawningAgent]:
        """The agents that it spawned: none, or 4, or in three dimensions 8."""
        return [self.model.agent(row) for row in self.model.family.children(self.row)]

    @property
    def retired_step(self) -> int | None:
        """Step in which its children took over, or it vanished; None while it works."""
        step = int(self.model.family.rows["retired_step"][self.row])
        return None if step < 0 else step

    gap = property(lambda agent: float(agent.model.family.rows["gap"][agent.row]))
    """What its two opinions differ in, or did at last (J); NaN before it has any."""
