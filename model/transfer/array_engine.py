"""Load transfer on arrays: only agents and their loads are stored, never the body.

A load is a row (cell, state, magnitude, copies). Magnitudes are few, because they are
products of a few shares, so a row carries the number of its magnitude in a table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import AgentError
from kaju.model.scene import Scene

from .stage import Ledger, News, Stage, TakenRows, Totals, collect_boundary, history_of

if TYPE_CHECKING:
    from .transfer import Transfer


_UNKNOWN = np.int16(-1000)


class AgentTable:
    """Material agents as columns, ordered by spawn step and key.

    Attributes
    ----------
    key : array of int
        Number of the cell, as the lattice counts.
    material, spawn_step, woken_by : arrays of int
        As in `Stage`.
    taken : array of float, shape (agents, states)
        Loads taken (N), by state as `Transfer` numbers them.
    passed : array of float, shape (agents, directions)
        Loads handed over by arm (N).
    dropped : array of float
        Emissions that were too small (N).
    """

    def __init__(self, scene: Scene, states: int) -> None:
        self.scene = scene
        self.lattice = scene.lattice
        directions = self.lattice.directions
        self.key: Ints = np.empty(0, dtype=np.int64)
        self.material: Ints = np.empty(0, dtype=np.int64)
        self.spawn_step: Ints = np.empty(0, dtype=np.int64)
        self.woken_by: Ints = np.empty(0, dtype=np.int64)
        self.taken: Floats = np.empty((0, states))
        self.passed: Floats = np.empty((0, directions))
        self.dropped: Floats = np.empty(0)
        self._form: NDArray[np.int8] = np.empty(0, dtype=np.int8)
        self._beyond: NDArray[np.int16] = np.empty((0, directions), dtype=np.int16)
        self._sorted_key: Ints = np.empty(0, dtype=np.int64)
        self._sorted_agent: Ints = np.empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.key)

    @property
    def cells(self) -> Ints:
        """Coordinates of the agents' cells."""
        return self.lattice.cells(self.key)

    def missing(self, key: Ints) -> Flags:
        """Tell which cells have no agent yet."""
        place = np.searchsorted(self._sorted_key, key)
        found = np.zeros(len(key), dtype=np.bool_)
        inside = place < len(self._sorted_key)
        found[inside] = self._sorted_key[place[inside]] == key[inside]
        return ~found

    def find(self, key: Ints) -> Ints:
        """Return the agents of cells that have one."""
        return self._sorted_agent[np.searchsorted(self._sorted_key, key)]

    def spawn(self, key: Ints, woken_by: Ints, step: int) -> None:
        """Add agents in the cells `key` (sorted, each once, none with an agent)."""
        count, directions = len(key), self.lattice.directions
        cells = self.lattice.cells(key)
        newborn = np.arange(len(self.key), len(self.key) + count)
        place = np.searchsorted(self._sorted_key, key)
        self._sorted_key = np.insert(self._sorted_key, place, key)
        self._sorted_agent = np.insert(self._sorted_agent, place, newborn)
        self.key = np.append(self.key, key)
        self.material = np.append(self.material, self.scene.kinds(cells))
        self.spawn_step = np.append(self.spawn_step, np.full(count, step))
        self.woken_by = np.append(self.woken_by, woken_by)
        self.taken = np.append(self.taken, np.zeros((count, self.taken.shape[1])), axis=0)
        self.passed = np.append(self.passed, np.zeros((count, directions)), axis=0)
        self.dropped = np.append(self.dropped, np.zeros(count))
        self._form = np.append(self._form, self.lattice.form(cells).astype(np.int8))
        unknown = np.full((count, directions), _UNKNOWN)
        self._beyond = np.append(self._beyond, unknown, axis=0)

    def form(self, agent: Ints) -> Ints:
        """Return the row of the rule's tables for agents: material, then form."""
        return self.material[agent] * self.lattice.forms + self._form[agent]

    def neighbour(self, agent: Ints, arm: Ints) -> Ints:
        """Return the keys of the cells that agents reach over arms."""
        return self.key[agent] + self.lattice.key_steps[self._form[agent], arm]

    def beyond(self, agent: Ints, arm: Ints) -> Ints:
        """Return what lies over an arm: a material's number, or a kind of boundary.

        An agent looks round once, when it first has something to hand over.
        """
        curious = np.zeros(len(self.key), dtype=np.bool_)
        curious[agent] = True
        curious &= self._beyond[:, 0] == _UNKNOWN
        looking = np.flatnonzero(curious)
        cells = self.lattice.cells(self.key[looking])
        for each in range(self.lattice.directions if len(looking) else 0):
            self._beyond[looking, each] = self.scene.kinds(self.lattice.neighbours(cells, each))
        return self._beyond[agent, arm].astype(np.int64)


class Rows(NamedTuple):
    """Loads at a place: a cell's key, or an agent and arm when they leave.

    Attributes
    ----------
    place : array of int
        Where the loads are.
    state : array of 8-bit int
        Where their force points, and whether they pull, as `Transfer` numbers it.
    magnitude : array of 32-bit int
        Number of the magnitude in the engine's table.
    copies : array of float
        How many equal loads the row stands for.
    bits : array of 8-bit int
        Arms over which they came, one bit each.
    """

    place: Ints
    state: NDArray[np.int8]
    magnitude: NDArray[np.int32]
    copies: Floats
    bits: NDArray[np.uint8]

    def where(self, chosen: NDArray[Any]) -> Rows:
        """Return the chosen rows."""
        columns: tuple[NDArray[Any], ...] = tuple(self)
        return Rows(*(column[chosen] for column in columns))


class BoundaryRows(NamedTuple):
    """Loads that boundary agents gave back in a generation.

    Attributes
    ----------
    key : array of int
        The boundary agents' cells.
    load : array of float
        What they gave back (N).
    state, arm : arrays of int
        In which state it came, and over which arm of the sender.
    """

    key: Ints
    load: Floats
    state: NDArray[np.int8]
    arm: Ints


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

    def start(self, cells: Ints, state: Ints, magnitude: Floats) -> None:
        """Put the applied loads (N) on the body; they are taken in the first step."""
        self.generation, self.acted = 0, True
        self.agents = AgentTable(self.scene, self.transfer.states)
        self.record: list[tuple[Ints, Ints, Floats]] = []
        self.boundary: list[BoundaryRows] = []
        self.applied = float(magnitude.sum())
        self.taken = self.passed = self.returned = self.dropped = 0.0
        self.values, number = np.unique(magnitude, return_inverse=True)
        place = self.lattice.key(cells)
        outside = np.zeros(len(cells), dtype=np.uint8)
        self._arrive(_rows(place, state, number, np.ones(len(cells)), outside))

    @property
    def awake(self) -> int:
        """Number of material agents."""
        return len(self.agents)

    @property
    def load(self) -> Floats:
        """Sum of the equal loads of each waiting row (N)."""
        return self.values[self.waiting.magnitude] * self.waiting.copies

    @property
    def pending(self) -> float:
        """Sum of the loads that wait to be taken (N)."""
        return float(self.load.sum())

    def begin(self) -> None:
        """Count a generation."""
        self.generation += 1
        self.acted = False

    def act(self, order: object = None) -> None:
        """Let every agent take the loads that reached it and pass them on."""
        if self.acted:
            return
        self.acted = True
        agent = self.agents.find(self.waiting.place)
        self._take(agent)
        returned = self.returned
        self._arrive(self._hand_over(self._emit(agent)))
        self.passed += self.pending - (self.returned - returned)

    def end(self) -> None:
        """Refuse a generation in which nobody acted."""
        if not self.acted:
            raise AgentError(
                "step: on arrays a step of your own must call super().step(), which lets agents "
                "act; to let them act yourself take engine='agents'"
            )

    def _take(self, agent: Ints) -> None:
        """Add up what each agent takes in each state; the rows are sorted by both."""
        state = self.waiting.state
        first = np.flatnonzero(
            (np.diff(agent, prepend=-1) != 0) | (np.diff(state, prepend=-1) != 0)
        )
        agent, state = agent[first], state[first]
        load = np.add.reduceat(self.load, first)
        self.taken += float(load.sum())
        self.agents.taken[agent, state] += load
        self.record.append((agent, state.astype(np.int64), load))

    def _emit(self, agent: Ints) -> Rows:
        """Split the waiting loads into shares; the place of a row is agent and arm."""
        arms, states, shares = self.transfer.tables
        distinct, share_number = np.unique(shares, return_inverse=True)
        products = np.outer(distinct, self.values)
        values, product_number = np.unique(products, return_inverse=True)
        loud_value = values > (0.0 if self.accumulate else self.threshold)
        quiet_value = np.where(loud_value, 0.0, values)
        share_number = share_number.reshape(-1, shares.shape[-1])
        product_number = product_number.ravel()

        waiting, agent, row = self._audible(agent)
        ended = np.zeros(len(agent))
        parts = []
        for emission in range(shares.shape[-1]):
            product = share_number[:, emission][row] * len(self.values) + waiting.magnitude
            number = product_number[product]
            ended += quiet_value[number]
            loud = np.flatnonzero(loud_value[number])
            arm = arms[..., emission].ravel()[row[loud]]
            place = agent[loud] * self.lattice.directions + arm
            state = states[..., emission].ravel()[row[loud]]
            bits = (1 << self.lattice.opposite)[arm]
            parts.append(_rows(place, state, number[loud], waiting.copies[loud], bits))
        self._drop(agent, ended * waiting.copies)
        self.values = values
        return _joined(parts)

    def _audible(self, agent: Ints) -> tuple[Rows, Ints, Ints]:
        """Drop what loads too small would send out; return others, whose, and their rows."""
        shares = self.transfer.tables[2]
        row = self.agents.form(agent) * self.transfer.states + self.waiting.state
        if self.accumulate:
            return self.waiting, agent, row
        largest = shares.max(axis=-1).ravel()[row] * self.values[self.waiting.magnitude]
        silent = np.flatnonzero(largest <= self.threshold)
        self._drop(agent[silent], (shares.sum(axis=-1).ravel()[row] * self.load)[silent])
        rest = np.flatnonzero(largest > self.threshold)
        return self.waiting.where(rest), agent[rest], row[rest]

    def _drop(self, agent: Ints, load: Floats) -> None:
        np.add.at(self.agents.dropped, agent, load)
        self.dropped += float(load.sum())

    def _hand_over(self, sent: Rows) -> Rows:
        """Bring emissions to the neighbours, or back from a boundary to the sender."""
        agent, arm = np.divmod(sent.place, self.lattice.directions)
        load = self.values[sent.magnitude] * sent.copies
        np.add.at(self.agents.passed.reshape(-1), sent.place, load)
        outside = np.flatnonzero(self.agents.beyond(agent, arm) < 0)
        arriving = sent._replace(place=self.agents.neighbour(agent, arm))
        at_boundary = sent.where(outside)
        if self.accumulate:
            back = self._give_back(self._judge(self._merge(at_boundary)))
            inside = np.delete(np.arange(len(arm)), outside)
            return _joined([arriving.where(inside), back])
        back = self._give_back(at_boundary)
        arriving.place[outside] = back.place
        arriving.state[outside] = back.state
        arriving.bits[outside] = back.bits
        return arriving

    def _give_back(self, rows: Rows) -> Rows:
        """Let boundary agents turn loads round; they return to the sender's cell."""
        agent, arm = np.divmod(rows.place, self.lattice.directions)
        kind = self.agents.beyond(agent, arm)
        load = self.values[rows.magnitude] * rows.copies
        beyond = self.agents.neighbour(agent, arm)
        self.boundary.append(BoundaryRows(beyond, load, rows.state.copy(), arm))
        self.returned += float(load.sum())
        state = rows.state.copy()
        for boundary, turned in self.transfer.turned.items():
            here = kind == boundary
            state[here] = turned[arm[here], state[here]]
        nothing = np.zeros_like(rows.bits)
        return rows._replace(place=self.agents.key[agent], state=state, bits=nothing)

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
        used = np.bincount(rows.magnitude, minlength=len(self.values)) > 0
        self.values = self.values[used]
        self.waiting = rows._replace(magnitude=(np.cumsum(used) - 1)[rows.magnitude])

    def _judge(self, rows: Rows) -> Rows:
        load = self.values[rows.magnitude]
        loud = load > self.threshold
        self.dropped += float((load * rows.copies)[~loud].sum())
        return rows.where(loud)

    def _merge(self, rows: Rows) -> Rows:
        """Put together the loads that meet: equal ones are counted, or all are added up."""
        number = np.zeros_like(rows.magnitude) if self.accumulate else rows.magnitude
        places, states = rows.place, self.transfer.states
        numbers = int(number.max(initial=0)) + 1
        met = None
        if (int(places.max(initial=0)) + 1) * states * numbers >= 2**63:
            met, places = np.unique(places, return_inverse=True)
        code = (places * states + rows.state) * numbers + number
        order = np.argsort(code, kind="stable")
        code = code[order]
        first = np.flatnonzero(np.diff(code, prepend=-1))
        if not len(first):
            return rows
        place_and_state, kept = np.divmod(code[first], numbers)
        place, state = np.divmod(place_and_state, states)
        place = place if met is None else met[place]
        bits = np.bitwise_or.reduceat(rows.bits[order], first)
        if not self.accumulate:
            copies = np.add.reduceat(rows.copies[order], first)
            return _rows(place, state, kept, copies, bits)
        sums = np.add.reduceat((self.values[rows.magnitude] * rows.copies)[order], first)
        added = len(self.values) + np.arange(len(first))
        self.values = np.append(self.values, sums)
        return _rows(place, state, added, np.ones(len(first)), bits)

    def since(self, generation: int, agents: int) -> News:
        """Return what came after a generation, and after so many agents."""
        table, taken = self.agents, TakenRows.joined(self._taken(generation))
        return News(
            taken.generation,
            taken.key,
            taken.state,
            taken.load,
            table.key[agents:],
            table.spawn_step[agents:],
            table.woken_by[agents:],
        )

    def _taken(self, generation: int = 0) -> Iterator[TakenRows]:
        """Return what was taken after a generation."""
        parts = enumerate(self.record[generation:], start=generation + 1)
        for number, (agent, state, load) in parts:
            yield TakenRows(np.full(len(agent), number), self.agents.key[agent], state, load)

    def at_boundary(self) -> tuple[Floats, Floats]:
        """Return what boundary agents took by direction, and gave back by arm (N)."""
        key, _, _ = collect_boundary([rows[:2] for rows in self.boundary])
        order = np.argsort(key)
        taken: Floats = np.zeros((len(key), self.lattice.directions))
        passed = np.zeros_like(taken)
        for rows in self.boundary:
            agent = order[np.searchsorted(key[order], rows.key)]
            np.add.at(taken, (agent, rows.state % self.lattice.directions), rows.load)
            np.add.at(passed, (agent, self.lattice.opposite[rows.arm]), rows.load)
        return taken, passed

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        table = self.agents
        kept = self.transfer.kept(table.material, table.taken)
        modulus = np.array([material.youngs_modulus for material in self.transfer.materials])
        widening = np.array([shares.widening for shares in self.transfer.shares])
        shortened = kept / (self.transfer.cross_section * modulus[table.material, None])
        widened = shortened * widening[table.material, None]
        cells, material = table.cells, table.material
        return Totals(cells, material, kept, shortened, widened, table.passed, table.dropped)

    def stage(self, factor: float, outcome: Callable[[Ledger], str]) -> Stage:
        """Return what the stage has left behind so far."""
        table, kinds = self.agents, self.scene.kinds
        boundary_key, boundary_step, returned = collect_boundary(
            [rows[:2] for rows in self.boundary]
        )
        boundary_cells = self.lattice.cells(boundary_key)
        taken = table.taken.sum(axis=1)
        pulled = table.taken[:, self.lattice.directions :]
        if not pulled.shape[1]:
            pulled = np.zeros_like(table.taken)
        everyone = np.arange(len(table))
        emitted = self.transfer.emitted.reshape(-1, self.transfer.states)[table.form(everyone)]
        ledger = Ledger(
            applied=self.applied,
            taken=float(taken.sum()),
            kept=float((self.transfer.own[table.material] * taken).sum()),
            emitted=float((emitted * table.taken).sum()),
            passed=self.passed,
            returned=self.returned,
            dropped=self.dropped,
            pending=self.pending,
        )
        return Stage(
            factor=factor,
            outcome=outcome(ledger),
            generations=self.generation,
            **self.totals()._asdict(),
            spawn_step=table.spawn_step,
            woken_by=table.woken_by,
            taken=table.taken[:, : self.lattice.directions] + pulled,
            pulled=pulled,
            boundary_cells=boundary_cells,
            boundary_kind=kinds(boundary_cells),
            boundary_spawn_step=boundary_step,
            returned=returned,
            arrived=self.at_boundary()[0],
            history=history_of(self._taken(), table.key, self.lattice.directions),
            ledger=ledger,
        )


def _rows(
    place: Ints,
    state: NDArray[np.integer],
    magnitude: NDArray[np.integer],
    copies: Floats,
    bits: NDArray[np.integer],
) -> Rows:
    """Return rows in as few bytes as they need: millions of them travel."""
    return Rows(
        place, state.astype(np.int8), magnitude.astype(np.int32), copies, bits.astype(np.uint8)
    )


def _joined(parts: list[Rows]) -> Rows:
    columns: list[NDArray[Any]] = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Rows(*columns)
