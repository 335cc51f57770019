"""The agent of a material cell: it takes a load, keeps its share and passes the rest on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol

from mesa.discrete_space import Cell, FixedAgent

from .load import Load
from .rules import Emission, Shares

if TYPE_CHECKING:
    from .materials import Material


class Carrier(Protocol):
    """What an agent needs of the model it lives in."""

    generation: int
    threshold: float
    accumulate: bool

    def emissions(self, shares: Shares, direction: int) -> tuple[Emission, ...]:
        """Return the shares that a load along `direction` sends out, by arm."""

    def hand_over(self, sender: MaterialAgent, arm: int, load: Load) -> None:
        """Bring a load to the neighbour over an arm, where it is taken in the next step."""


class MaterialAgent(FixedAgent):
    """A cell of material that a load has woken.

    Subclass it to try a rule of your own: `take` says what the agent does with a load,
    `pass_on` whom it hands how much. A model that is given a subclass keeps its agents as
    objects by itself.

    Attributes
    ----------
    material : Material
        What the cell is made of.
    shares : Shares
        What the agent keeps and passes on of each newton.
    spawn_step : int
        Generation in which the first load was taken, counted from 1.
    woken_by : list
        The agents whose loads arrived in that generation; empty for an applied load.
    taken : dict of int to float
        Loads taken (N), by the direction they point along.
    kept : float
        Sum of the own shares (N): what deforms the cell.
    passed : dict of int to float
        Loads handed over (N), by arm.
    dropped : float
        Emissions up to the threshold (N), which end here.
    inbox : dict
        Loads to take in the next step: (direction, magnitude) → copies.
    """

    def __init__(self, model: Carrier, cell: Cell, material: Material, shares: Shares) -> None:
        super().__init__(model)
        self.cell = cell
        self.material = material
        self.shares = shares
        self.spawn_step = model.generation + 1
        self.woken_by: list[MaterialAgent] = []
        self.taken: dict[int, float] = {}
        self.kept = 0.0
        self.passed: dict[int, float] = {}
        self.dropped = 0.0
        self.inbox: dict[tuple[int, float], float] = {}

    def receive(self, load: Load, senders: Iterable[MaterialAgent] = ()) -> None:
        """Put a load into the inbox; equal loads are merged and counted."""
        key = (load.direction, load.magnitude)
        self.inbox[key] = self.inbox.get(key, 0.0) + load.copies
        if self.spawn_step == self.model.generation + 1:
            self.woken_by += [agent for agent in senders if agent not in self.woken_by]

    def step(self) -> None:
        """Take every load that has arrived, and pass each on."""
        inbox, self.inbox = self.inbox, {}
        for (direction, magnitude), copies in inbox.items():
            load = Load(direction, magnitude, copies)
            self.take(load)
            self.pass_on(load)

    def take(self, load: Load) -> None:
        """Keep the own share of a load."""
        self.taken[load.direction] = self.taken.get(load.direction, 0.0) + load.total
        self.kept += self.shares.own * load.total

    def pass_on(self, load: Load) -> None:
        """Hand the other shares of a load to the neighbours, unless they are too small."""
        for arm, direction, share in self.model.emissions(self.shares, load.direction):
            emission = Load(direction, share * load.magnitude, load.copies)
            if emission.magnitude > self.model.threshold or self.model.accumulate:
                self.model.hand_over(self, arm, emission)
            else:
                self.dropped += emission.total
