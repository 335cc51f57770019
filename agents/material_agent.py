"""The agent of a material cell: it takes a load, keeps its share and passes the rest on."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from kaju._mesa import Cell, FixedAgent
from kaju.errors import AgentError, brief

from .materials import Material
from .parameter import is_number
from .shares import Amounts, Emission, Emissions, Load, Sense, Shares


class LoadBox(dict[tuple[int, float, Sense], float]):
    """Loads on their way to one cell: (direction, magnitude, sense) → copies.

    A cell of the body has one box; beside the body each agent that hands over has its own there,
    so that it gets back what it handed over. Where loads that meet are added up, all have the
    magnitude 1 N, and copies are newtons. When all agents have acted, the engine opens the boxes.
    """

    def __init__(self, called: list[LoadBox], place: tuple[int, ...], home: Any = None) -> None:
        self.called = called  # the boxes into which something was put in this generation
        self.place, self.home = place, home  # home: beside the body, the sender's box and arm
        self.agent: Any = None  # who lives in the cell, once awake
        self.senders: list[tuple[Any, tuple[int, float, Sense]]] = []  # until then, with the loads

    def __missing__(self, load: tuple[int, float, Sense]) -> float:
        """Begin at no copies; the first load of a generation calls the engine."""
        if not self:
            self.called.append(self)
        return 0.0


class PlacedAgent(FixedAgent):
    """An agent that stands for a cell of the scene, or for one just beside the body."""

    def __init__(self, model: Any, cell: Cell) -> None:
        """Wake in a cell; an `__init__` of your own takes *start and calls this one with them."""
        super().__init__(model)
        self.cell = cell
        self.pos = cell.coordinate
        self.spawn_step = model.generation + 1
        self.taken: dict[int, float] = Amounts()
        self.kept = 0.0
        self.passed: dict[int, float] = Amounts()

    def __repr__(self) -> str:
        taken, passed = (sum(loads.values()) for loads in (self.taken, self.passed))
        told = f"took {taken:g} N, kept {self.kept:g} N, passed on {passed:g} N, since generation"
        return f"<{type(self).__name__} at {self.index}: {told} {self.spawn_step}>"

    index = property(lambda agent: agent.cell.coordinate)
    position = property(lambda agent: agent.model.lattice.centres(np.array([agent.index]))[0])


class MaterialAgent(PlacedAgent):
    """A cell of material that a load has woken.

    Subclass it to make agents of your own: `take` keeps a share of a load, `emissions` returns the
    shares that leave, `pass_on` hands them over, `shortening` returns the strain. Everything that a
    subclass hands over is checked: an impossible load raises an `AgentError`.

    Attributes
    ----------
    index, position : tuple of int, array
        Column, row (and layer) of its cell, counted from 0; the middle of the cell (m).
    material, shares : Material, Shares
        What the cell is made of; what the agent keeps and passes on of each newton.
    inbox : dict
        Loads to take in the next step: (direction, magnitude, sense) → copies.
    taken, pulled, passed : dict of int to float
        Loads taken and the pulls among them (N), by direction; loads handed over (N), by arm.
    kept, squeezed : float, dict of int to float
        Own shares (N), summed; the same along each axis, pushes less pulls, which deform the cell.
    dropped : float
        Emissions that end here, up to γ each (N).
    spawn_step, woken_by : int, list of MaterialAgent
        Generation in which it took its first load, counted from 1; whose loads arrived then, none
        if it was an applied load.

    Examples
    --------
    >>> import kaju
    >>> class Counting(kaju.MaterialAgent):
    ...     loads = 0.0
    ...     def take(self, load):
    ...         super().take(load)
    ...         self.loads += load.copies  # equal loads that arrive together are one call
    >>> model = kaju.LoadModel(kaju.load_scene("plate.toml"), material_agent=Counting)
    >>> result = model.run()
    >>> max(agent.loads for agent in model.agents_by_type[Counting])
    21.0
    """

    def __init__(self, model: Any, cell: Cell, material: Material, shares: Shares) -> None:
        if model.engine.waking != cell.coordinate:
            told = "loads wake agents, nobody else makes one; hand the cell a load, with pass_on"
            raise AgentError(f"{type(self).__name__}: {told}")
        super().__init__(model, cell)
        self.material, self.shares = material, shares
        self.engine: Any = model.engine
        self.woken_by: list[MaterialAgent] = []
        self.pulled: dict[int, float] = Amounts()
        self.squeezed: dict[int, float] = Amounts()
        self.dropped = 0.0
        self.inbox: dict[tuple[int, float, Sense], float] = {}
        # What the cell is, its number, and its form, as the scene and the lattice count.
        self._kind, self._key, self._form = self.engine.seen[cell.coordinate]
        # Over each arm the box there; the engine finds it when something is handed over.
        self._around: list[LoadBox | None] = [None] * len(self.engine.opposite)
        self._handed: object = self
        self._sent_by: tuple[object, dict[Sense, tuple[Emissions, ...]]] = self, {}

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the neighbours: a copy meets its own, one would drag along all others."""
        return self.__dict__ | {"_around": [None] * len(self._around)}

    def remove(self) -> None:
        """Raise an error: a load may be on its way here."""
        told = "cannot be removed, because loads may be on their way to it; let its emissions"
        raise self.engine.guard.wrong(self, "remove", f"{told} return nothing instead")

    # The life of a load: an agent takes it, keeps a share, and passes the others on.

    def step(self) -> None:
        """Take all loads that wait, keep shares, pass the others on; called only if loads wait."""
        if not self.inbox:
            return
        engine, squeezed, loads = self.engine, self.squeezed, self.waiting()
        engine.note_taken(self, loads)
        self.inbox, axis_of = {}, engine.axis_of
        for load in loads:
            before = self.kept
            self.take(load)
            kept = self.kept
            plain = type(kept) is float and 0.0 <= kept < inf  # seen at once
            if not plain and not (is_number(kept) and kept >= 0.0):
                what = f"has kept {brief(kept)} N; kept must be a number from 0 upwards"
                raise engine.guard.wrong(self, "take", what)
            squeezed[axis_of[load[0]]] += kept - before if load[3] == "push" else before - kept
            if self.pass_on(load) is not None:  # type: ignore[func-returns-value]
                what = "must return nothing: rows of shares are what emissions(load) returns"
                raise engine.guard.wrong(self, "pass_on", what)

    def waiting(self) -> list[Load]:
        """Return the loads to take in the next step, pushes before pulls."""
        new = tuple.__new__  # takes a third of the time of Load(...), and there are thousands
        loads = [new(Load, (d, size, copies, s)) for (d, size, s), copies in self.inbox.items()]
        return sorted(loads, key=lambda one: one[3] == "pull") if self.engine.two_senses else loads

    def take(self, load: Load) -> None:
        """Keep the own share of a load: book it in `taken`, and add what stays to `kept`.

        Parameters
        ----------
        load : Load
            Its `direction`, `magnitude` (N), number of `copies`, and `sense`; `total` (N) is all.
        """
        if type(load) is not Load:
            raise self.engine.guard.wrong(self, "take", f"gets the load, not {brief(load)}")
        direction, magnitude, copies, sense = load
        total = magnitude * copies
        self.taken[direction] += total
        if sense == "pull":
            self.pulled[direction] += total
        self.kept += self.shares.own * total

    def emissions(self, load: Load) -> tuple[Emission, ...]:
        """Return what leaves the agent for each newton that arrives, not newtons; [] is nothing.

        Parameters
        ----------
        load : Load
            The load just taken, as for `take`.

        Returns
        -------
        tuple of Emission
            Rows of (arm, direction, share, sense): over which face a load leaves, where its force
            points, both as in `lattice.direction_names`; its size for each newton taken; and
            "push", or "pull" if the rule has a sense.
        """
        if self._sent_by[0] is not self.shares:
            self._sent_by = self.shares, self.engine.emissions_of(self)
        return self._sent_by[1][load[3]][load[0]]

    def pass_on(self, load: Load) -> None:
        """Hand the `emissions` of a load to the neighbours, unless they are too small.

        Parameters
        ----------
        load : Load
            The load just taken, handed on once. `self.model.hand_over(self, arm, load)` hands over
            a load of your own making instead.
        """
        if type(load) is not Load:
            raise self.engine.guard.wrong(self, "pass_on", f"gets the load, not {brief(load)}")
        if load is self._handed:
            what = "hands one load on twice; call super().pass_on(load) once for a load"
            raise self.engine.guard.wrong(self, "pass_on", what)
        self._handed = load
        emissions, (_, magnitude, copies, _) = self.emissions(load), load
        known = type(emissions) is Emissions and emissions.split.get(magnitude)
        sent, ended = known or self.engine.split(self, emissions, magnitude)
        around, passed = self._around, self.passed
        for arm, key, size, count in sent:
            passed[arm] += size * copies
            box = around[arm]
            if box is None:  # nothing has gone over this arm yet
                box = self.engine.box_over(self, arm)
            box[key] += count * copies
            if box.agent is None:
                box.senders.append((self, key))
        self.dropped += ended * copies

    def shortening(self, axis: int) -> float:
        """Return by which part of its length the cell is shortened along an axis (1)."""
        area: float = self.model.cross_section
        return self.squeezed.get(axis, 0.0) / (area * self.material.youngs_modulus)
