"""Load transfer on arrays: only agents and their loads are stored, never the body.

A load is a row (cell, direction, magnitude, copies). Magnitudes are few, because they are
products of a few shares, so a row carries the number of its magnitude in a table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .agent_table import AgentTable
from .stage import FloatArray, IntArray, Ledger, Stage, collect_boundary, collect_history

if TYPE_CHECKING:
    from kaju.model.scene import Scene

    from .transfer import Transfer


class Rows(NamedTuple):
    """Loads at a place: a cell's key, or an agent and arm when they leave.

    Attributes
    ----------
    place, direction : arrays of int
        Where the loads are, and where they point.
    magnitude : array of int
        Number of the magnitude in the engine's table.
    copies : array of float
        How many equal loads the row stands for.
    bits : array of int
        Arms over which they came, one bit each.
    """

    place: IntArray
    direction: IntArray
    magnitude: IntArray
    copies: FloatArray
    bits: IntArray

    def where(self, chosen: NDArray[Any]) -> Rows:
        """Return the chosen rows."""
        columns: tuple[NDArray[Any], ...] = tuple(self)
        return Rows(*(column[chosen] for column in columns))


class ArrayEngine:
    """One stage of load transfer at a time, on arrays.

    Parameters
    ----------
    scene : Scene
        What is loaded.
    transfer : Transfer
        Its rule, as tables.
    """

    def __init__(self, scene: Scene, transfer: Transfer) -> None:
        self.scene = scene
        self.transfer = transfer
        self.lattice = transfer.lattice
        self.accumulate = transfer.rule.accumulate
        self.threshold = transfer.rule.threshold

    def start(self, cells: IntArray, direction: IntArray, magnitude: FloatArray) -> None:
        """Put the applied loads (N) on the body; they are taken in the first step."""
        self.generation = 0
        self.agents = AgentTable(self.scene)
        self.record: list[tuple[IntArray, IntArray, FloatArray]] = []
        self.boundary: list[tuple[IntArray, FloatArray]] = []
        self.applied = float(magnitude.sum())
        self.passed = self.returned = self.dropped = 0.0
        self.values, number = np.unique(magnitude, return_inverse=True)
        ones = np.ones(len(cells))
        rows = Rows(self.lattice.key(cells), direction, number, ones, np.zeros_like(number))
        self._arrive(rows)

    @property
    def load(self) -> FloatArray:
        """Sum of the equal loads of each waiting row (N)."""
        amount: FloatArray = self.values[self.waiting.magnitude] * self.waiting.copies
        return amount

    @property
    def pending(self) -> float:
        """Sum of the loads that wait to be taken (N)."""
        return float(self.load.sum())

    def step(self) -> None:
        """Let every agent take the loads that reached it and pass them on."""
        self.generation += 1
        agent, direction, load = (
            self.agents.find(self.waiting.place),
            self.waiting.direction,
            self.load,
        )
        np.add.at(self.agents.taken, (agent, direction), load)
        self.record.append((agent, direction, load))
        returned = self.returned
        self._arrive(self._hand_over(self._emit(agent)))
        self.passed += self.pending - (self.returned - returned)

    def _emit(self, agent: IntArray) -> Rows:
        """Split the waiting loads into shares; the place of a row is agent and arm."""
        arms, directions, shares = self.transfer.tables
        distinct, share_number = np.unique(shares, return_inverse=True)
        share_number = share_number.reshape(shares.shape)
        products = np.outer(distinct, self.values)
        values, canonical = np.unique(products, return_inverse=True)
        canonical = canonical.reshape(products.shape)
        loud_value = values > (0.0 if self.accumulate else self.threshold)
        material = self.agents.material[agent]
        parts = []
        for emission in range(shares.shape[2]):
            which = (material, self.waiting.direction, emission)
            number = canonical[share_number[which], self.waiting.magnitude]
            loud = loud_value[number]
            quiet = ~loud
            ended = values[number[quiet]] * self.waiting.copies[quiet]
            np.add.at(self.agents.dropped, agent[quiet], ended)
            self.dropped += float(ended.sum())
            place = agent * self.lattice.directions + arms[which]
            bits = 1 << self.lattice.opposite[arms[which]]
            sent = Rows(place, directions[which], number, self.waiting.copies, bits)
            parts.append(sent.where(loud))
        self.values = values
        return Rows(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _hand_over(self, sent: Rows) -> Rows:
        """Bring emissions to the neighbours, or back from a boundary to the sender."""
        agent, arm = np.divmod(sent.place, self.lattice.directions)
        beyond = self.agents.beyond(agent, arm)
        inside = sent.where(beyond >= 0)._replace(
            place=self.agents.neighbour(agent, arm)[beyond >= 0]
        )
        load = self.values[sent.magnitude] * sent.copies
        np.add.at(self.agents.passed, (agent, arm), load)
        at_boundary = sent.where(beyond < 0)
        if self.accumulate:
            at_boundary = self._judge(self._merge(at_boundary))
        back = self._give_back(at_boundary)
        return Rows(*(np.concatenate(columns) for columns in zip(inside, back, strict=True)))

    def _give_back(self, rows: Rows) -> Rows:
        """Let boundary agents turn loads round; they return to the sender's cell."""
        agent, arm = np.divmod(rows.place, self.lattice.directions)
        kind = self.agents.beyond(agent, arm)
        load = self.values[rows.magnitude] * rows.copies
        self.boundary.append((self.agents.neighbour(agent, arm), load))
        self.returned += float(load.sum())
        direction = rows.direction.copy()
        for boundary, turned in self.transfer.turned.items():
            here = kind == boundary
            direction[here] = turned[arm[here], direction[here]]
        nothing = np.zeros_like(rows.bits)
        return rows._replace(place=self.agents.key[agent], direction=direction, bits=nothing)

    def _arrive(self, rows: Rows) -> None:
        """Merge the loads that meet, drop those too small, and wake agents for the rest."""
        rows = self._judge(self._merge(rows))
        first = np.flatnonzero(np.diff(rows.place, prepend=-1))
        key = rows.place[first]
        if len(first):
            woken_by = np.bitwise_or.reduceat(rows.bits, first)
            new = self.agents.missing(key)
            self.agents.spawn(key[new], woken_by[new], self.generation + 1)
        # Only the magnitudes that still travel stay in the table.
        used, number = np.unique(rows.magnitude, return_inverse=True)
        self.values, place = np.unique(self.values[used], return_inverse=True)
        self.waiting = rows._replace(magnitude=place[number])

    def _judge(self, rows: Rows) -> Rows:
        load = self.values[rows.magnitude]
        loud = load > self.threshold
        self.dropped += float((load * rows.copies)[~loud].sum())
        return rows.where(loud)

    def _merge(self, rows: Rows) -> Rows:
        """Put together the loads that meet: equal ones are counted, or all are added up."""
        number = np.zeros_like(rows.magnitude) if self.accumulate else rows.magnitude
        order = _sorted_by(rows.place, rows.direction, self.lattice.directions, number)
        rows, number = rows.where(order), number[order]
        changes = (np.diff(column, prepend=-1) != 0 for column in (*rows[:2], number))
        first = np.flatnonzero(np.logical_or.reduce(list(changes)))
        if not len(first):
            return rows
        bits = np.bitwise_or.reduceat(rows.bits, first)
        merged = rows.where(first)._replace(bits=bits)
        if not self.accumulate:
            return merged._replace(copies=np.add.reduceat(rows.copies, first))
        sums = np.add.reduceat(self.values[rows.magnitude] * rows.copies, first)
        numbers = len(self.values) + np.arange(len(first))
        self.values = np.append(self.values, sums)
        return merged._replace(magnitude=numbers, copies=np.ones(len(first)))

    def stage(self, factor: float, outcome: str) -> Stage:
        """Return what the stage has left behind so far."""
        table, kinds = self.agents, self.scene.kinds
        order = np.lexsort((table.key, table.spawn_step))
        boundary_key, boundary_step, returned = collect_boundary(self.boundary)
        boundary_cells = self.lattice.cells(boundary_key)
        taken = table.taken.sum(axis=1)
        ledger = Ledger(
            applied=self.applied,
            taken=float(taken.sum()),
            kept=float((self.transfer.own[table.material] * taken).sum()),
            emitted=float((self.transfer.emitted[table.material] * taken).sum()),
            passed=self.passed,
            returned=self.returned,
            dropped=self.dropped,
            pending=self.pending,
        )
        return Stage(
            factor=factor,
            outcome=outcome,
            generations=self.generation,
            cells=table.cells[order],
            material=table.material[order],
            spawn_step=table.spawn_step[order],
            woken_by=table.woken_by[order],
            taken=table.taken[order],
            passed=table.passed[order],
            dropped=table.dropped[order],
            boundary_cells=boundary_cells,
            boundary_kind=kinds(boundary_cells),
            boundary_spawn_step=boundary_step,
            returned=returned,
            history=collect_history(self.record, order),
            ledger=ledger,
        )


def _sorted_by(place: IntArray, direction: IntArray, directions: int, number: IntArray) -> IntArray:
    """Return the order of rows by place, direction and number."""
    numbers = int(number.max(initial=0)) + 1
    if int(place.max(initial=0) + 1) * directions * numbers < 2**63:
        return np.argsort((place * directions + direction) * numbers + number, kind="stable")
    return np.lexsort((number, direction, place))
