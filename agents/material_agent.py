"""The agent of a material cell: it takes a load, keeps its share and passes the rest on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol

from kaju._mesa import Cell

from .placed import PlacedAgent
from .shares import Emission, Load, Shares

if TYPE_CHECKING:
    from .materials import Material


class Carrier(Protocol):
    """What an agent needs of the model it lives in."""

    @property
    def generation(self) -> int:
        """Steps taken."""

    @property
    def threshold(self) -> float:
        """γ (N)."""

    @property
    def accumulate(self) -> bool:
        """Whether loads that meet are added before they are judged."""

    @property
    def cross_section(self) -> float:
        """A (m²), over which an own share is spread."""

    def form(self, index: tuple[int, ...]) -> int:
        """Return the form of the cell with that index."""

    def axis_of(self, direction: int) -> int:
        """Return the number of the axis that a direction lies on."""

    def emissions(self, agent: MaterialAgent, load: Load) -> tuple[Emission, ...]:
        """Return what a load sends out of an agent for each newton, by its shares."""

    def hand_over(self, sender: MaterialAgent, arm: int, load: Load) -> None:
        """Bring a load to the neighbour over an arm, where it is taken in the next step."""


class MaterialAgent(PlacedAgent):
    """A cell of material that a load has woken.

    Subclass it to try agents of your own: `take` says what the agent does with a load,
    `emissions` which shares leave it, `pass_on` whom it hands how much, `shortening` how it
    yields to what it keeps. A model that is given a subclass keeps its agents as objects by
    itself.

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
        Loads taken (N), by the direction their force points along, pushes and pulls.
    pulled : dict of int to float
        The pulls among them (N); empty unless the rule has a sense.
    kept : float
        Sum of the own shares (N): what deforms the cell. What `take` adds to it acts along
        the axis of the load that it takes.
    squeezed : dict of int to float
        What is kept along each axis (N), pushes less pulls.
    passed : dict of int to float
        Loads handed over (N), by arm.
    dropped : float
        Emissions up to the threshold (N), which end here.
    inbox, pulls : dict
        Pushes, and pulls, to take in the next step: (direction, magnitude) → copies.
    form : int
        Which of the lattice's forms the cell has; see `kaju.Lattice`.
    """

    def __init__(self, model: Carrier, cell: Cell, material: Material, shares: Shares) -> None:
        super().__init__(model)
        self.cell = cell
        self.material = material
        self.shares = shares
        self.spawn_step = model.generation + 1
        self.woken_by: list[MaterialAgent] = []
        self.taken: dict[int, float] = {}
        self.pulled: dict[int, float] = {}
        self.kept = 0.0
        self.squeezed: dict[int, float] = {}
        self.passed: dict[int, float] = {}
        self.dropped = 0.0
        self.inbox: dict[tuple[int, float], float] = {}
        self.pulls: dict[tuple[int, float], float] = {}
        self.form = model.form(self.index)

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} at {self.index}: {self.material.name}, "
            f"took {sum(self.taken.values()):g} N, kept {self.kept:g} N, "
            f"since generation {self.spawn_step}>"
        )

    def receive(self, load: Load, senders: Iterable[MaterialAgent] = ()) -> None:
        """Put a load into the inbox; equal loads are merged and counted."""
        inbox = self.inbox if load.sense == "push" else self.pulls
        key = (load.direction, load.magnitude)
        inbox[key] = inbox.get(key, 0.0) + load.copies
        if self.spawn_step == self.model.generation + 1:
            self.woken_by += [agent for agent in senders if agent not in self.woken_by]

    def waiting(self) -> list[Load]:
        """Return the loads to take in the next step."""
        loads = [Load(d, magnitude, copies) for (d, magnitude), copies in self.inbox.items()]
        for (direction, magnitude), copies in self.pulls.items():
            loads.append(Load(direction, magnitude, copies, "pull"))
        return loads

    def step(self) -> None:
        """Take every load that has arrived, and pass each on."""
        if not (self.inbox or self.pulls):
            return
        loads = self.waiting()
        self.inbox, self.pulls = {}, {}
        for load in loads:
            before = self.kept
            self.take(load)
            self._squeeze(load, self.kept - before)
            self.pass_on(load)

    def take(self, load: Load) -> None:
        """Keep the own share of a load."""
        direction, total = load.direction, load.total
        self.taken[direction] = self.taken.get(direction, 0.0) + total
        if load.sense == "pull":
            self.pulled[direction] = self.pulled.get(direction, 0.0) + total
        self.kept += self.shares.own * total

    def _squeeze(self, load: Load, kept: float) -> None:
        """Book what is kept of a load (N) along its axis."""
        axis = self.model.axis_of(load.direction)
        along = kept if load.sense == "push" else -kept
        self.squeezed[axis] = self.squeezed.get(axis, 0.0) + along

    def shortening(self, axis: int) -> float:
        """Return by which part of its length the cell is shortened along an axis (1)."""
        area: float = self.model.cross_section
        return self.squeezed.get(axis, 0.0) / (area * self.material.youngs_modulus)

    def emissions(self, load: Load) -> tuple[Emission, ...]:
        """Return what leaves the agent for each newton of a load."""
        sent: tuple[Emission, ...] = self.model.emissions(self, load)
        return sent

    def pass_on(self, load: Load) -> None:
        """Hand the other shares of a load to the neighbours, unless they are too small."""
        model, copies = self.model, load.copies
        least = -1.0 if model.accumulate else model.threshold
        for arm, direction, share, sense in self.emissions(load):
            magnitude = share * load.magnitude
            if magnitude > least:
                model.hand_over(self, arm, Load(direction, magnitude, copies, sense))
            else:
                self.dropped += magnitude * copies
