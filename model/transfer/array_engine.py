"""Load transfer on arrays: only agents and their loads are stored, never the body.

A load is a row: an agent, a state, the number of its magnitude, and copies. What a row sends out
follows from what the agent is (material, form), the state and the magnitude. Such *kinds of
load* are few, for magnitudes are products of a few shares: so what each sends is laid out once a
generation, and rows only look it up. Rows are sorted by cell, and are taken piece by piece.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import AgentError
from kaju.model.scene import Scene

from .stage import Ledger, News, Stage, TakenHistory, TakenRows, Totals
from .transfer import Transfer

MOST_INDEXED = 1 << 27
"""Up to so many cells agents are found by an index, in larger bodies by bisection."""

PIECE = 1 << 16
"""So many rows are worked on at once: few enough to stay near the processor."""


class AgentTable:
    """Material agents as columns, ordered by spawn step and key."""

    key: Ints  # number of the cell, as the lattice counts
    material: Ints
    spawn_step: Ints
    woken_by: Ints  # as in `Stage`
    form: Ints  # row of the rule's tables: material, then form of the cell
    taken: Floats  # loads taken (N), by state as `Transfer` numbers them
    passed: Floats  # loads handed over by arm (N)
    dropped: Floats  # emissions that were too small (N)
    beyond: NDArray[np.int16]  # what lies over each arm: a material, or a type of boundary

    def __init__(self, scene: Scene, states: int) -> None:
        self.scene, self.lattice = scene, scene.lattice
        directions = self.lattice.directions
        self.count = 0
        whole = ("key", "material", "spawn_step", "woken_by", "form")
        self._columns: dict[str, NDArray[Any]] = {
            **{name: np.zeros(256, dtype=np.int64) for name in whole},
            "taken": np.zeros((256, states)),
            "passed": np.zeros((256, directions)),
            "dropped": np.zeros(256),
            "beyond": np.zeros((256, directions), dtype=np.int16),
        }
        cells = prod(count + 2 for count in self.lattice.shape)
        # Pages of the index that nobody writes to take no memory.
        self._at = np.zeros(cells, dtype=np.int32) if cells <= MOST_INDEXED else None
        self._sorted_key: Ints = np.empty(0, dtype=np.int64)
        self._sorted_agent: Ints = np.empty(0, dtype=np.int64)
        self._show()

    def __len__(self) -> int:
        return self.count

    def _show(self) -> None:
        for name, column in self._columns.items():
            setattr(self, name, column[: self.count])

    @property
    def cells(self) -> Ints:
        """Coordinates of the agents' cells."""
        return self.lattice.cells(self.key)

    def find(self, key: Ints) -> Ints:
        """Return the agents of cells, -1 where there is none."""
        if self._at is not None:
            return self._at[key] - np.int64(1)
        if not self.count:
            return np.full(len(key), -1)
        place = np.minimum(np.searchsorted(self._sorted_key, key), self.count - 1)
        return np.where(self._sorted_key[place] == key, self._sorted_agent[place], -1)

    def spawn(self, key: Ints, woken_by: Ints, step: int) -> Ints:
        """Add agents in the cells `key` (sorted, each once, none with an agent); return them."""
        before, now = self.count, self.count + len(key)
        newborn = np.arange(before, now)
        if self._at is not None:
            self._at[key] = newborn + 1
        else:
            place = np.searchsorted(self._sorted_key, key)
            self._sorted_key = np.insert(self._sorted_key, place, key)
            self._sorted_agent = np.insert(self._sorted_agent, place, newborn)
        if now > len(self._columns["key"]):
            for name, column in self._columns.items():
                larger = np.zeros((2 * now, *column.shape[1:]), dtype=column.dtype)
                larger[:before] = column[:before]
                self._columns[name] = larger
        self.count = now
        self._show()
        # They see what they are, and what lies over their arms.
        cells = self.lattice.cells(key)[:, None]
        form = self.lattice.form(cells[:, 0])
        seen = np.concatenate([cells, cells + self.lattice.steps[form]], axis=1)
        kinds = self.scene.kinds(seen.reshape(-1, cells.shape[2])).reshape(len(key), -1)
        self.key[before:] = key
        self.material[before:], self.beyond[before:] = kinds[:, 0], kinds[:, 1:]
        self.spawn_step[before:] = step
        self.woken_by[before:] = woken_by
        self.form[before:] = kinds[:, 0] * self.lattice.forms + form
        return newborn


class WaitingLoads(NamedTuple):
    """Waiting loads, ordered by cell, state and magnitude."""

    slot: Ints  # agent times the number of states, plus the state
    number: NDArray[np.int32]  # number of the magnitude in the engine's table
    copies: Floats  # how many equal loads the row stands for


class Arrivals(NamedTuple):
    """Loads on their way into cells."""

    code: Ints  # cell, state and number of the magnitude, as one number
    amount: Floats  # copies; where loads that meet are added up, their sum (N)
    bits: NDArray[np.uint8]  # arms over which they come, one bit each; 0 from a boundary

    def part(self, chosen: Any) -> Arrivals:
        """Return some of the arrivals."""
        return Arrivals(self.code[chosen], self.amount[chosen], self.bits[chosen])

    @classmethod
    def joined(cls, parts: list[Arrivals]) -> Arrivals:
        """Put arrivals one after another."""
        if len(parts) == 1:
            return parts[0]
        columns: Any = zip(*parts, strict=True)
        return cls(*map(np.concatenate, columns))


class BoundaryRows(NamedTuple):
    """Loads that boundary agents gave back in one generation."""

    generation: int  # when they were handed over
    key: Ints  # the boundary agents' cells
    load: Floats  # what they gave back (N)
    state: NDArray[np.int8]  # in which state it came


class EmissionTable(NamedTuple):
    """The rule as (emissions, columns): a column is a material, form and state of a load."""

    arm: Ints
    state: Ints
    step: Ints  # what the step over the arm adds to the key
    share: Floats


class Sent(NamedTuple):
    """What kinds of load send out; the first axis of arrays is the emission, the last the kind."""

    size: Floats  # magnitude (N)
    above: Flags  # whether it exceeds γ and goes on
    code: Ints  # state and number of the magnitude, as in codes of arrivals
    delta: Ints  # the same, and the step to the neighbour
    number: Ints  # number of the magnitude among those that travel next
    ended: Floats  # sum of what ends (N), per kind
    any_above: Flags  # whether anything goes on, per kind
    values: Floats  # magnitudes that travel next (N)


class PackedHistory(TakenHistory):
    """A history that is unpacked when it is looked at: its columns can be larger than the run."""

    def __init__(self, record: list[tuple[Ints, Floats]], states: int, directions: int) -> None:
        self.__dict__.update(record=tuple(record), states=states, directions=directions)

    def __getattr__(self, name: str) -> Any:
        record = self.__dict__.get("record", ())
        if name == "generation":
            column = [np.full(len(slot), g) for g, (slot, _) in enumerate(record, start=1)]
        elif name == "load":
            column = [load for _, load in record]
        elif name == "agent":
            column = [slot.astype(np.int64) // self.states for slot, _ in record]
        elif name == "direction":
            column = [slot.astype(np.int64) % self.states % self.directions for slot, _ in record]
        elif name == "pull":
            column = [slot % self.states >= self.directions for slot, _ in record]
        else:
            raise AttributeError(name)
        dtypes = {"load": np.float64, "pull": np.bool_}
        whole = np.concatenate([np.empty(0, dtype=dtypes.get(name, np.int64)), *column])
        self.__dict__[name] = whole
        return whole


class ArrayEngine:
    """One stage of load transfer at a time, on arrays."""

    most_at_one = 0  # magnitudes are products of few shares: rows of a table, not objects

    def __init__(self, transfer: Transfer) -> None:
        scene = transfer.scene
        self.scene, self.transfer, self.lattice = scene, transfer, transfer.lattice
        self.states, self.directions = transfer.states, transfer.lattice.directions
        self.accumulate, self.threshold = transfer.rule.accumulate, transfer.rule.threshold
        self.bits = (1 << self.lattice.opposite).astype(np.uint8)
        self.cells = prod(count + 2 for count in self.lattice.shape)
        self.reach = int(np.abs(self.lattice.key_steps).max())

    @cached_property
    def rule(self) -> EmissionTable:
        """The tables of the rule, emissions first."""
        arm, state, share = self.transfer.tables
        form = np.arange(len(arm))[:, None, None] % self.lattice.forms
        tables: Any = (arm, state, self.lattice.key_steps[form, arm], share)
        most = share.shape[-1]
        columns = [np.ascontiguousarray(table.reshape(-1, most).T) for table in tables]
        return EmissionTable(*columns)

    def start(self, cells: Ints, state: Ints, magnitude: Floats, *, live_on: bool = False) -> None:
        """Put the applied loads (N) on the body; they are taken in the next step.

        Unless agents `live_on`, the body is without any.
        """
        if not live_on:
            self.generation, self.acted = 0, True
            self.agents = AgentTable(self.scene, self.states)
            self.record: list[tuple[Ints, Floats]] = []
            self.boundary: list[BoundaryRows] = []
            self.applied = self.taken = self.passed = self.returned = self.dropped = 0.0
        self.applied += float(magnitude.sum())
        above = self._go_on(magnitude, met=False)
        self.dropped += float(magnitude[~above].sum())
        place = self.lattice.key(cells)[above] * self.states + state[above]
        values, number = np.unique(magnitude[above], return_inverse=True)
        self.names: Ints | None = None
        if self.cells * self.states * max(len(values), 1) >= 2**62:
            self.names, rank = np.unique(self.lattice.key(cells)[above], return_inverse=True)
            place = rank * self.states + state[above]
        self._new_values(values)
        arrivals = Arrivals(place, magnitude[above], np.zeros(len(place), dtype=np.uint8))
        if not self.accumulate:
            arrivals = arrivals._replace(
                code=place * max(len(values), 1) + number, amount=np.ones(len(place))
            )
        self._wait([self._arrive(_merged(arrivals))])

    def _new_values(self, values: Floats) -> None:
        """Note the magnitudes that travel, and how many codes a cell has with them."""
        self.values = values
        self.codes = self.states * (1 if self.accumulate else max(len(values), 1))

    @property
    def awake(self) -> int:
        """Number of material agents."""
        return len(self.agents)

    # One generation: begin, agents act, end.

    def begin(self) -> None:
        """Count a generation."""
        self.generation += 1
        self.acted = False

    def act(self, order: object = None) -> None:
        """Let every agent take its loads, keep a share, and pass the others on."""
        if self.acted:
            return
        self.acted = True
        self._take()
        # Summed up for this generation alone: the difference of two totals loses small loads.
        slot, returned, self.returned = self.waiting.slot, self.returned, 0.0
        kind = self._kinds_of_load()
        sent = self._what_they_send(kind)
        self._new_values(sent.values)
        self._name_cells(slot)
        pieces: list[WaitingLoads] = []
        tail: list[Arrivals] = []
        begin, whole = 0, self.accumulate or self.names is not None
        while begin < len(slot):
            end = len(slot) if whole else min(begin + PIECE, len(slot))
            while end < len(slot) and slot[end] // self.states == slot[end - 1] // self.states:
                end += 1  # an agent has all its loads in one piece
            new = self._merge(
                Arrivals.joined([*tail, self._pass_on(slice(begin, end), kind, sent)])
            )
            # No agent of a later piece reaches a cell before this one: those are complete.
            done = len(new.code)
            if end < len(slot):
                least = self.agents.key[slot[end] // self.states] - self.reach
                done = int(np.searchsorted(new.code, least * self.codes))
            pieces.append(self._arrive(new.part(slice(done))))
            tail = [new.part(slice(done, None))]
            begin = end
        self._wait(pieces)
        self.passed += self.pending - self.returned
        self.returned += returned

    def end(self) -> None:
        """Refuse a generation in which nobody acted."""
        if not self.acted:
            raise AgentError(
                "step: on arrays a step of your own must call super().step(), which lets agents "
                "act; to let them act yourself take engine='agents'"
            )

    def _take(self) -> None:
        """Add up what each agent takes in each state."""
        first = _firsts(self.waiting.slot)
        slot, load = self.waiting.slot[first], np.add.reduceat(self.load, first)
        self.taken += self.pending
        self.agents.taken.reshape(-1)[slot] += load
        few = len(self.agents) * self.states < 2**31
        self.record.append((slot.astype(np.int32) if few else slot, load))

    def _kinds_of_load(self) -> tuple[Ints, Ints] | None:
        """Return the kinds that occur, and of which each row is; None if all may be laid out."""
        kinds = self.rule.share.shape[1] * len(self.values)
        if kinds <= 4 * len(self.waiting.slot) + 1000 and not self.accumulate:
            return None
        column = self._column(self.waiting.slot, self.waiting.slot // self.states)
        kind, which = np.unique(
            column * len(self.values) + self.waiting.number, return_inverse=True
        )
        return kind, which

    def _column(self, slot: Ints, agent: Ints) -> Ints:
        """Return the columns of the rule's tables that hold for agents and states."""
        return np.asarray(slot + (self.agents.form[agent] - agent) * self.states)

    def _what_they_send(self, kinds: tuple[Ints, Ints] | None) -> Sent:
        """Lay out what the kinds of load send."""
        rule, count = self.rule, len(self.values)
        if kinds is None:
            size = (rule.share[:, :, None] * self.values).reshape(len(rule.share), -1)
            column: Any = np.repeat(np.arange(rule.share.shape[1]), count)
        else:
            column, magnitude = np.divmod(kinds[0], count)
            size = rule.share[:, column] * self.values[magnitude]
        above = self._go_on(size, met=False)
        code, number = rule.state[:, column], np.zeros(size.shape, dtype=np.int64)
        values, codes = self.values[:0], self.states
        if not self.accumulate:
            values, number[above] = np.unique(size[above], return_inverse=True)
            code = code * max(len(values), 1) + number
            codes = self.states * max(len(values), 1)
        ended = np.where(above, 0.0, size).cumsum(axis=0)[-1]  # one after another, unlike a sum
        delta = rule.step[:, column] * codes + code
        return Sent(size, above, code, delta, number, ended, np.any(above, axis=0), values)

    def _name_cells(self, slot: Ints) -> None:
        """Give the cells in reach new numbers where the keys of all would be too large."""
        self.names = None
        if self.cells * self.codes >= 2**62:
            key = self.agents.key[np.unique(slot // self.states)]
            steps = np.unique(np.append(self.lattice.key_steps, 0))
            self.names = np.unique(key[:, None] + steps)

    def _pass_on(self, piece: slice, kinds: tuple[Ints, Ints] | None, sent: Sent) -> Arrivals:
        """Split waiting loads into shares, and bring them to the neighbours."""
        table, rule = self.agents, self.rule
        waiting, count = self.waiting, sent.size.shape[1]
        slot, copies = waiting.slot[piece], waiting.copies[piece]
        agent = slot // self.states
        column = self._column(slot, agent)
        if kinds is None:
            kind = column * (count // rule.share.shape[1]) + waiting.number[piece]
        else:
            kind = kinds[1][piece]
        goes_on = sent.any_above[kind]
        if not (self.accumulate or goes_on.all()):
            silent = np.flatnonzero(~goes_on)
            whole = self.transfer.emitted.ravel()[column[silent]]
            self._drop(agent[silent], whole * self.load[piece][silent])
            agent, copies, kind, column = (c[goes_on] for c in (agent, copies, kind, column))
        self._drop(agent, sent.ended[kind] * copies)

        # A row for every emission that goes on: which of the rule's it is, and of which load.
        emission, row = _divided(
            np.flatnonzero(np.take(sent.above, kind, axis=1)), max(len(kind), 1)
        )
        entry, place = emission * count + kind[row], emission * rule.arm.shape[1] + column[row]
        sender, copies = agent[row], copies[row]
        arm = rule.arm.ravel()[place]
        load = sent.size.ravel()[entry] * copies
        over = sender * self.directions + arm
        np.add.at(table.passed.reshape(-1), over, load)
        # What arrives is numbered by cell, state and magnitude in one.
        if self.names is None:
            code = table.key[sender] * self.codes + sent.delta.ravel()[entry]
        else:
            reached = np.searchsorted(self.names, table.key[sender] + rule.step.ravel()[place])
            code = reached * self.codes + sent.code.ravel()[entry]
        beyond = table.beyond.reshape(-1)[over]
        arrivals = Arrivals(code, load if self.accumulate else copies, self.bits[arm])
        outside = np.flatnonzero(beyond < 0)
        if not len(outside):
            return arrivals
        leaving = (sender[outside], arm[outside], rule.state.ravel()[place[outside]])
        number = sent.number.ravel()[entry[outside]]
        if not self.accumulate:
            code[outside] = self._give_back(*leaving, load[outside]) + number
            arrivals.bits[outside] = 0
            return arrivals
        inside = np.flatnonzero(beyond >= 0)
        back = self._add_up(*leaving, load[outside])
        return Arrivals.joined([arrivals.part(inside), back])

    def _add_up(self, agent: Ints, arm: Ints, state: Ints, load: Floats) -> Arrivals:
        """Let loads that one agent hands to one boundary in one state go on as their sum."""
        which = (agent * self.directions + arm) * self.states + state
        nothing = np.zeros(len(which), dtype=np.uint8)
        met = self._judged(_merged(Arrivals(which, load, nothing)))
        place, state = _divided(met.code, self.states)
        agent, arm = _divided(place, self.directions)
        return met._replace(code=self._give_back(agent, arm, state, met.amount))

    def _give_back(self, agent: Ints, arm: Ints, state: Ints, load: Floats) -> Ints:
        """Let boundary agents turn loads round; return the codes of the first magnitude then."""
        table = self.agents
        key = table.key[agent]
        beside = key + self.lattice.key_steps[table.form[agent] % self.lattice.forms, arm]
        self.boundary.append(BoundaryRows(self.generation, beside, load, state.astype(np.int8)))
        self.returned += float(load.sum())
        turned = self.transfer.turned[table.beyond[agent, arm], arm, state]
        place = key if self.names is None else np.searchsorted(self.names, key)
        return np.asarray(place * self.codes + turned * (self.codes // self.states))

    def _judged(self, rows: Arrivals) -> Arrivals:
        """Let sums of loads end that are not above the threshold."""
        above = self._go_on(rows.amount)
        self.dropped += float(rows.amount[~above].sum())
        return rows.part(above)

    def _go_on(self, load: Floats, met: bool = True) -> Flags:
        """Tell which loads (N) are above γ; those to be added up are judged when they have met."""
        return load > (self.threshold if met or not self.accumulate else 0.0)

    def _drop(self, agent: Ints, load: Floats) -> None:
        np.add.at(self.agents.dropped, agent, load)
        self.dropped += float(load.sum())

    def _merge(self, rows: Arrivals) -> Arrivals:
        """Put together the loads of one code; where they lie close, by counting, not sorting."""
        if self.accumulate or self.names is not None or not len(rows.code):
            return _merged(rows)
        first = int(rows.code.min()) // self.codes
        code = rows.code - first * self.codes
        span = int(code.max()) + 1
        if span > 8 * len(code):
            return _merged(rows)
        amount: Floats = np.bincount(code, rows.amount, minlength=span).astype(
            np.float64, copy=False
        )
        found = np.flatnonzero(amount > 0.0)
        # Who hands over is asked for only where nobody is awake yet.
        cells = span // self.codes + 1
        asleep = self.agents.find(np.arange(first, first + cells)) < 0
        cell = code // self.codes
        rousing = np.flatnonzero(asleep[cell])
        woken_by = np.zeros(cells, dtype=np.uint8)
        for bit in self.bits:
            woken_by[cell[rousing[rows.bits[rousing] == bit]]] |= bit
        return Arrivals(found + first * self.codes, amount[found], woken_by[found // self.codes])

    def _arrive(self, rows: Arrivals) -> WaitingLoads:
        """Wake agents in the cells that loads have reached; return the loads that wait there."""
        copies = rows.amount
        if self.accumulate:
            rows = self._judged(rows)
            self.values, copies = rows.amount, np.ones(len(rows.amount))
        key, rest = _divided(rows.code, self.codes)
        if self.names is not None:
            key = self.names[key]
        first = _firsts(key)
        cells = key[first]
        agent = self.agents.find(cells)
        new = np.flatnonzero(agent < 0)
        if len(new):
            woken_by = np.bitwise_or.reduceat(rows.bits, first)[new]
            agent[new] = self.agents.spawn(cells[new], woken_by, self.generation + 1)
        agent = np.repeat(agent, _lengths(first, len(key)))
        if self.accumulate:
            return WaitingLoads(
                agent * self.states + rest, np.arange(len(rest), dtype=np.int32), copies
            )
        state, number = _divided(rest, self.codes // self.states)
        return WaitingLoads(agent * self.states + state, number.astype(np.int32), copies)

    def _wait(self, pieces: list[WaitingLoads]) -> None:
        """Let loads wait to be taken; only the magnitudes that still travel stay in the table."""
        slot, number, copies = (np.concatenate(column) for column in zip(*pieces, strict=True))
        used = np.bincount(number, minlength=len(self.values)) > 0
        if not used.all():
            self.values = self.values[used]
            number = (np.cumsum(used, dtype=np.int32) - 1)[number]
        self.waiting = WaitingLoads(slot, number, copies)
        self.load = self.values[number] * copies
        self.pending = float(self.load.sum())

    # What has happened.

    def since(self, generation: int, agents: int) -> News:
        """Return what came after a generation, and after so many agents."""
        table = self.agents
        parts = []
        for number, (slot, load) in enumerate(self.record[generation:], start=generation + 1):
            agent, state = _divided(slot.astype(np.int64), self.states)
            parts.append(TakenRows(np.full(len(slot), number), table.key[agent], state, load))
        return News(
            *TakenRows.joined(parts),
            table.key[agents:],
            table.spawn_step[agents:],
            table.woken_by[agents:],
        )

    def _boundary_agents(self) -> tuple[Ints, Ints, Floats, Floats]:
        """Return the boundary agents, by spawn step and key: what each gave back, and took (N)."""
        rows = self.boundary or [
            BoundaryRows(0, np.empty(0, int), np.empty(0), np.empty(0, np.int8))
        ]
        every = np.concatenate([given.key for given in rows])
        load = np.concatenate([given.load for given in rows])
        state = np.concatenate([given.state for given in rows])
        generation = np.repeat([given.generation for given in rows], [len(r.key) for r in rows])
        order, rising = _sorted(every)
        first = _firsts(rising)
        key = rising[first]
        number = np.empty_like(order)
        number[order] = np.repeat(np.arange(len(key)), _lengths(first, len(order)))
        step = generation[order[first]] + 1  # a load handed over in g is taken again in g + 1
        returned = np.zeros(len(key))
        np.add.at(returned, number, load)
        arrived = np.zeros((len(key), self.directions))
        np.add.at(arrived, (number, state % self.directions), load)
        by_step = np.lexsort((key, step))
        return key[by_step], step[by_step], returned[by_step], arrived[by_step]

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        table = self.agents
        kept = self.transfer.kept(table.material, table.taken)
        modulus = np.array([material.youngs_modulus for material in self.transfer.materials])
        widening = np.array([shares.widening for shares in self.transfer.shares])
        shortened = kept / (self.transfer.cross_section * modulus[table.material, None])
        return Totals(
            cells=table.cells,
            material=table.material,
            kept=kept,
            shortened=shortened,
            widened=shortened * widening[table.material, None],
            passed=table.passed,
            dropped=table.dropped,
        )

    def stage(self, factor: float, outcome: Callable[[Ledger], str]) -> Stage:
        """Return what the stage has left behind so far; its ledger tells how it ended."""
        table = self.agents
        key, boundary_step, returned, arrived = self._boundary_agents()
        boundary_cells = self.lattice.cells(key)
        taken = table.taken.sum(axis=1)
        pulled = table.taken[:, self.directions :]
        if not pulled.shape[1]:
            pulled = np.zeros_like(table.taken)
        emitted = self.transfer.emitted[table.form]
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
            taken=table.taken[:, : self.directions] + pulled,
            pulled=pulled,
            boundary_cells=boundary_cells,
            boundary_kind=self.scene.kinds(boundary_cells),
            boundary_spawn_step=boundary_step,
            returned=returned,
            arrived=arrived,
            history=PackedHistory(self.record, self.states, self.directions),
            ledger=ledger,
        )


def _merged(rows: Arrivals) -> Arrivals:
    """Put together the loads of one code, in the order of codes."""
    order, code = _sorted(rows.code)
    first = _firsts(code)
    amount, bits = rows.amount[order], rows.bits[order]
    if len(first) == len(code):
        return Arrivals(code, amount, bits)
    reduced = np.add.reduceat(amount, first), np.bitwise_or.reduceat(bits, first)
    return Arrivals(code[first], *reduced)


def _sorted(code: Ints) -> tuple[Ints, Ints]:
    """Return in which order codes rise, equal ones as they stand, and the codes in that order.

    Sorting numbers is several times faster than sorting their places, so each takes its place
    along in its lowest bits where there is room.
    """
    bits = len(code).bit_length()
    if not len(code) or int(code.max()) >> (62 - bits):
        order = np.argsort(code, kind="stable")
        return order, code[order]
    packed = (code << bits) | np.arange(len(code))
    packed.sort(kind="stable")  # they come in long rising runs, which only this kind sees
    return packed & ((1 << bits) - 1), packed >> bits


def _divided(number: Ints, by: int) -> tuple[Ints, Ints]:
    """Return quotient and remainder; NumPy's own divmod is several times slower."""
    quotient = number // by
    return quotient, number - quotient * by


def _firsts(rising: Ints) -> Ints:
    """Return where each new number begins."""
    begins = np.empty(len(rising), dtype=np.bool_)
    begins[:1] = True
    np.not_equal(rising[1:], rising[:-1], out=begins[1:])
    return np.flatnonzero(begins)


def _lengths(first: Ints, whole: int) -> Ints:
    """Return the lengths of the parts that begin there."""
    return np.concatenate((first[1:], [whole])) - first
