"""The agent of a material cell: it takes a load, keeps its share and passes the rest on."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from math import inf
from typing import Any

import numpy as np

from kaju._mesa import Cell, FixedAgent
from kaju.arrays import Floats
from kaju.errors import AgentError

from .materials import Material
from .shares import Emission, Emissions, Load, Sense, Shares


class Amounts(dict[int, float]):
    """Newtons by number; what was never booked is 0."""

    def __missing__(self, number: int) -> float:
        return 0.0


class PlacedAgent(FixedAgent):
    """An agent that stands for a cell of the scene, or for one just beside the body.

    `index`, `pos` and ``cell.coordinate`` are the same: column, row (and layer), counted from 0;
    -1 is beside the first.
    """

    model: Any

    def __init__(self, model: Any, cell: Cell) -> None:
        super().__init__(model)
        self.cell = cell
        self.pos = cell.coordinate

    @property
    def index(self) -> tuple[int, ...]:
        """The scene's cell."""
        at: tuple[int, ...] = self.cell.coordinate
        return at

    @property
    def position(self) -> Floats:
        """Middle of the cell (m), shape (dimension,)."""
        return np.asarray(self.model.lattice.centres(np.array([self.index]))[0])


class MaterialAgent(PlacedAgent):
    """A cell of material that a load has woken.

    Subclass it to try agents of your own: `take` says what the agent does with a load,
    `emissions` which shares leave it, `pass_on` whom it hands how much, `shortening` how it
    yields to what it keeps. A model that is given a subclass keeps its agents as objects by
    itself. Whatever a subclass hands over is looked at: what is no load, or has no neighbour
    to go to, is refused by name.

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
        Emissions that end here, up to γ each (N).
    inbox, pulls : dict
        Pushes, and pulls, to take in the next step: (direction, magnitude) → copies.
    form : int
        Which of the lattice's forms the cell has; see `kaju.Lattice`.

    Examples
    --------
    >>> from kaju import LoadModel, MaterialAgent, Scene
    >>> class Counting(MaterialAgent):
    ...     loads = 0
    ...     def take(self, load):
    ...         super().take(load)
    ...         self.loads += 1
    ...
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> model = LoadModel(scene, material_agent=Counting)
    >>> result = model.run()
    >>> max(agent.loads for agent in model.agents_by_type[Counting])
    7
    """

    def __init__(self, model: Any, cell: Cell, material: Material, shares: Shares) -> None:
        super().__init__(model, cell)
        self.material = material
        self.shares = shares
        self.spawn_step = model.generation + 1
        self.woken_by: list[MaterialAgent] = []
        self.taken: dict[int, float] = Amounts()
        self.pulled: dict[int, float] = Amounts()
        self.kept = 0.0
        self.squeezed: dict[int, float] = Amounts()
        self.passed: dict[int, float] = Amounts()
        self.dropped = 0.0
        self.inbox: dict[tuple[int, float], float] = {}
        self.pulls: dict[tuple[int, float], float] = {}
        self.form: int = model.form(cell.coordinate)
        self.post: Any = model.engine
        # Neighbours by arm, once met, and what comes from them: the inboxes of the next step.
        self.around: list[Any] = [None] * len(self.post.opposite)
        self.kind = self.key = -1  # of the cell, as the scene and the lattice count
        self.beyond: Any = None  # by arm: the place there, and its kind
        self.coming: dict[tuple[int, float], float] = {}
        self.coming_pulls: dict[tuple[int, float], float] = {}
        self.fresh = True  # woken in this generation: whoever hands over now has woken it
        self._sent_by: tuple[object, Any] = (False, None)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the neighbours: a copy meets its own, one would drag along all others."""
        return self.__dict__ | {"around": [None] * len(self.around)}

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} at {self.index}: {self.material.name}, "
            f"took {sum(self.taken.values()):g} N, kept {self.kept:g} N, "
            f"since generation {self.spawn_step}>"
        )

    def remove(self) -> None:
        """Refuse to leave: a load may be on its way here.

        Raises
        ------
        AgentError
            Always.
        """
        raise AgentError(
            f"remove: {type(self).__name__} at {self.index} stays, for loads may be on their way "
            "to it; to let it pass nothing on, return no emissions"
        )

    def step(self) -> None:
        """Take every load that has arrived, keep a share, and pass the others on."""
        if not (self.inbox or self.pulls):
            return
        loads = self.waiting()
        self.post.note(self)
        self.inbox, self.pulls = {}, {}
        axis_of, squeezed = self.post.axis_of, self.squeezed
        for load in loads:
            before = self.kept
            try:
                self.take(load)
                kept = self.kept - before
            except TypeError as error:
                raise self.post.wrong(
                    self, "take", f"of {load} failed ({error}); it has kept {self.kept!r:.60}"
                ) from error
            squeezed[axis_of[load[0]]] += kept if load[3] == "push" else -kept
            self.pass_on(load)
        if not -inf < self.kept < inf:
            raise self.post.wrong(self, "take", f"has kept {self.kept} N")

    def waiting(self) -> list[Load]:
        """Return the loads to take in the next step."""
        new = tuple.__new__  # takes a third of the time of Load(...), and there are thousands
        loads = [new(Load, (*key, copies, "push")) for key, copies in self.inbox.items()]
        return loads + [Load(*key, copies, "pull") for key, copies in self.pulls.items()]

    def take(self, load: Load) -> None:
        """Keep the own share of a load."""
        direction, magnitude, copies, sense = load
        total = magnitude * copies
        self.taken[direction] += total
        if sense == "pull":
            self.pulled[direction] += total
        self.kept += self.shares.own * total

    def emissions(self, load: Load) -> tuple[Emission, ...]:
        """Return what leaves the agent for each newton of a load."""
        shares, sent = self._sent_by
        if shares is not self.shares:
            sent = self.post.emissions_of(self)
            self._sent_by = self.shares, sent
        emissions: tuple[Emission, ...] = sent[load[3]][load[0]]
        return emissions

    def pass_on(self, load: Load) -> None:
        """Hand the other shares of a load to the neighbours."""
        self.send(self.emissions(load), load)

    def send(self, emissions: Iterable[Emission], load: Load) -> None:
        """Put shares of a load into the boxes of the neighbours, unless they are too small."""
        _, magnitude, copies, _ = load
        post, around, passed = self.post, self.around, self.passed
        known = type(emissions) is Emissions and emissions.split.get(magnitude)
        sent, ended = known or post.split(self, emissions, magnitude)
        for arm, key, sense in sent:
            passed[arm] += key[1] * copies
            neighbour = around[arm]
            if neighbour is None:
                neighbour = post.look(self, arm)
            neighbour.put(key, copies, sense, self)
        for size in ended:
            self.dropped += size * copies

    def put(
        self, key: tuple[int, float], copies: float, sense: Sense, sender: MaterialAgent | None
    ) -> None:
        """Keep a load of a (direction, magnitude) for the next step; equal ones are counted."""
        box = self.coming if sense == "push" else self.coming_pulls
        if key in box:
            box[key] += copies
        else:
            box[key] = copies
            self.post.called[self] = None
        if self.fresh and sender is not None and sender not in self.woken_by:
            self.woken_by.append(sender)

    def receive(self, load: Load, senders: Iterable[MaterialAgent] = ()) -> None:
        """Put a load into the box of what is coming."""
        for sender in senders or (None,):
            self.put(load[:2], load.copies, load.sense, sender)

    def open(self) -> float:
        """Put what has come into the inbox; return its sum (N)."""
        came = 0.0
        for (_, magnitude), copies in chain(self.coming.items(), self.coming_pulls.items()):
            came += magnitude * copies
        self.inbox = _merged(self.inbox, self.coming)
        self.pulls = _merged(self.pulls, self.coming_pulls)
        self.coming, self.coming_pulls = {}, {}
        return came

    def shortening(self, axis: int) -> float:
        """Return by which part of its length the cell is shortened along an axis (1)."""
        area: float = self.model.cross_section
        return self.squeezed.get(axis, 0.0) / (area * self.material.youngs_modulus)


def _merged(
    waiting: dict[tuple[int, float], float], coming: dict[tuple[int, float], float]
) -> dict[tuple[int, float], float]:
    """Return loads that came, together with those that an order of one's own has left waiting."""
    if not waiting:
        return coming
    for key, copies in coming.items():
        waiting[key] = waiting.get(key, 0.0) + copies
    return waiting
