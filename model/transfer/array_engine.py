"""Load transfer on arrays: only cells near agents and their loads are stored, never the body.

A *place* is a cell and the state of a load in it; equal loads at a place are one row. Where loads
go from a place is the same in every generation, and is looked up once. What a load sends out
follows from its *kind*: the form and material of its cell, its state and its magnitude. Kinds are
few, for magnitudes are products of few shares. So a generation reads two tables, and adds up what
comes to each place. Where loads that meet are added up, all loads have the magnitude 1 N, and
copies are newtons. `AgentEngine` does the same with objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import AgentError

from .stage import Ledger, Stage, TakenHistory, Totals, totals_of
from .transfer import Transfer

LOOKED_AT_ONCE = 144
"""An agent that wakes looks at blocks of about so many cells; of 64 to 1,024 on squares of 20 to
300 cells a side the quickest."""

ROWS_AT_ONCE = 2**18
"""So many rows are passed on at once: more take more memory, and no less time."""

MOST_EMPTY = 64
"""Loads are added up in a table, unless it had so many times more entries than there are rows."""


class Waits(NamedTuple):
    """Loads that wait, ordered by place and magnitude; equal ones are one row."""

    place: Ints  # number of the cell times the number of states, plus the state
    number: Ints  # of the magnitude in a table of all magnitudes
    copies: Floats  # how many equal loads the row stands for
    load: Floats  # what these are together (N)


NOTHING = Waits(*np.empty((2, 0), dtype=np.int64), *np.empty((2, 0)))


class Sent(NamedTuple):
    """What a copy of each kind of load does. A kind is a column of the rule and a magnitude."""

    # Of each emission state · (magnitudes + 1) + magnitude, as they will be, (emissions, kinds);
    # one magnitude more than there are: it ends.
    entry: Ints
    books: Floats  # what is passed over each arm, and dropped (N), (directions + 1, kinds)


class ArrayEngine:
    """One stage of load transfer at a time, on arrays."""

    most_at_one = 0  # rows of a table, not objects: any number may wait at one agent
    absorbed = 0.0  # kaju's own boundaries give all back

    def __init__(self, transfer: Transfer) -> None:
        self.transfer, self.scene, self.lattice = transfer, transfer.scene, transfer.lattice
        self.accumulate, self.threshold = transfer.rule.accumulate, transfer.rule.threshold
        self.states, self.directions = transfer.states, transfer.lattice.directions
        self.opposite, self.bits = self.lattice.opposite, 1 << np.arange(self.directions)
        # The rule's tables: a row for each emission, a column for each material, form and state.
        arm, state, share = transfer.tables
        most = share.shape[2]
        self.arm, self.next_state = arm.reshape(-1, most).T.copy(), state.reshape(-1, most).T.copy()
        self.share = share.reshape(-1, most).T.copy()
        self.shares, which = np.unique(self.share, return_inverse=True)
        self.which_share = which.reshape(self.share.shape)
        # What enters the books of an agent, of shares that are passed or dropped.
        every, some = np.arange(self.share.shape[1]), len(self.shares)
        books = np.zeros((self.directions + 1, len(every), 2 * some))
        for over, one in zip(self.arm, self.which_share, strict=True):
            books[over, every, one] += 1.0
            books[-1, every, some + one] += 1.0
        self.books_of = books.reshape(-1, 2 * some)
        edge = round(LOOKED_AT_ONCE ** (1.0 / self.lattice.dimension))
        if self.lattice.size <= 4 * LOOKED_AT_ONCE:  # with its rim a block of its own
            edge = max(self.lattice.shape) + 2
        self.edges = np.minimum(edge, np.array(self.lattice.shape) + 2)
        self.block = np.indices(self.edges).reshape(len(self.edges), -1).T

    def start(self, cells: Ints, state: Ints, magnitude: Floats, *, live_on: bool = False) -> None:
        """Put the applied loads (N) on a body without agents, or on one whose agents `live_on`."""
        if not live_on:
            self._clear()
        self.applied += float(magnitude.sum())
        self.values, number = np.ones(1), np.zeros(len(state), dtype=np.int64)
        copies = magnitude
        if not self.accumulate:
            above = magnitude > self.threshold
            self.ended += float(magnitude[~above].sum())
            cells, state = cells[above], state[above]
            self.values, number = np.unique(magnitude[above], return_inverse=True)
            copies = np.ones(len(state))
        self._look_round(cells)
        place = self.find(self.lattice.key(cells)) * self.states + state
        self.sent: list[tuple[Ints, Ints]] = []
        self._arrive([(place * (len(self.values) + 1) + number, copies)])

    def _clear(self) -> None:
        """Begin without agents, loads and generations."""
        self.generation, self.acted, self.awake = 0, True, 0
        # Cells by number, in the order in which they were seen. Nobody is in the cell 0.
        none, self.blocks = np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int64)
        self.key = none - 1
        self.seen_key = self.seen = none[:0]  # keys of cells; their numbers, or kinds below 0
        self.material = self.form = self.shift = self.woken_by = none
        self.spawn_step = none - 1  # 0: it sleeps
        # The first place over each arm, below 0 of a boundary; 0: not seen yet.
        self.over = np.zeros((1, self.directions), dtype=np.int64)
        self.took = np.zeros((1, self.states))
        self.books = np.zeros((1, self.directions + 1))  # as those of `Sent`
        # A boundary for each cell and arm with nothing of the body over it. Its places count from
        # -1 downwards, so that they are found from the end: a new one comes first.
        self.wall = np.zeros((2, 0), dtype=np.int64)  # cell and arm
        self.home = np.zeros(0, dtype=np.int64)  # the places where they give back
        self.applied = self.taken = self.passed = self.returned = self.ended = 0.0
        # Loads taken and given back: generation, place, and load there.
        self.record: list[tuple[int, NDArray[np.int32], Floats]] = []
        self.given_back: list[tuple[int, Ints, Floats]] = []
        self.waiting = NOTHING

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
        self.taken += self.pending
        returned, self.returned = self.returned, 0.0  # the difference of totals loses small loads
        self._arrive(self._passed_on(self.waiting, self.values, self._sent()))
        self.passed += self.pending - self.returned
        self.returned += returned

    def end(self) -> None:
        """Refuse a generation in which nobody acted."""
        if not self.acted:
            raise AgentError(
                "step: on arrays a step of your own must call super().step(), which lets agents "
                "act; to let them act yourself take engine='agents'"
            )

    def _sent(self) -> Sent:
        """Lay out what each kind of load sends out; the magnitudes become the next ones."""
        size = self.shares[:, None] * self.values
        passes = size > (0.0 if self.accumulate else self.threshold)
        passed = np.where(passes, size, 0.0)
        books = self.books_of @ np.concatenate([passed, size - passed])
        if self.accumulate:
            number = 1 - passes
        else:
            values = size[passes]
            values.sort()  # sooner than np.sort, as is the method below
            self.values = values[_firsts(values)]
            number = self.values.searchsorted(size)
            number[~passes] = len(self.values)
        entry = number.take(self.which_share, axis=0)
        entry += (self.next_state * (len(self.values) + 1))[:, :, None]
        return Sent(entry.reshape(len(entry), -1), books.reshape(self.directions + 1, -1))

    def _passed_on(self, rows: Waits, values: Floats, sent: Sent) -> Iterator[tuple[Ints, Floats]]:
        """Book what is done with loads; yield where their shares come, and how many copies."""
        self.sent, count = [], len(self.values) + 1
        for part in self._parts(rows.place):
            place, copies = rows.place[part], rows.copies[part]
            cell = place // self.states
            column = self.shift.take(cell) + place
            kind = column * len(values) + rows.number[part]
            self._book(place, rows.load[part], kind, copies, sent.books)
            arm = self.arm.take(column, axis=1)
            arm += cell * self.directions
            over = self.over.take(arm)
            came = over * count
            came += sent.entry.take(kind, axis=1)
            if self.accumulate:
                asleep = self.spawn_step.take(over // self.states, mode="clip") == 0
                self.sent.append((came[asleep], arm[asleep]))
                yield came.reshape(-1), (self.share.take(column, axis=1) * copies).reshape(-1)
            else:
                yield came.reshape(-1), np.concatenate([copies] * len(came))

    def _parts(self, place: Ints) -> Iterator[slice]:
        """Yield slices of so many rows at once; those of one agent stay together."""
        later = place[ROWS_AT_ONCE::ROWS_AT_ONCE]
        cuts = [int(place.searchsorted(each - each % self.states)) for each in later]
        ends = pairwise((0, *cuts, len(place)))
        return (slice(begin, end) for begin, end in ends if begin < end)

    def _book(self, place: Ints, load: Floats, kind: Ints, copies: Floats, books: Floats) -> None:
        """Book what agents take, pass on and drop."""
        first = _firsts(place)
        place, taken = place[first], np.add.reduceat(load, first)
        self.took.reshape(-1)[place] += taken
        self.record.append((self.generation, place.astype(np.int32), taken))
        cell = place // self.states
        agent = _firsts(cell)
        done = books.take(kind, axis=1)
        done *= copies
        done = np.add.reduceat(done, first[agent], axis=1)
        cell = cell[agent]
        self.books[cell] = self.books.take(cell, axis=0) + done.T
        self.ended += float(done[-1].sum())

    def _arrive(self, came: Iterable[tuple[Ints, Floats]]) -> None:
        """Let loads that meet wait together; agents wake in the cells that they have reached."""
        place, number, copies = self._met(came)
        if self.accumulate:
            above = copies > self.threshold
            self.ended += float(copies[~above].sum())
            place, number, copies = place[above], number[above], copies[above]
        elif len(self.values) > max(64, len(place) // 8):  # some may not occur
            used = np.bincount(number, minlength=len(self.values)) > 0
            self.values, number = self.values[used], (np.cumsum(used) - 1)[number]
        load = self.values.take(number) * copies
        self.waiting = Waits(place, number, copies, load)
        self.pending = float(load.sum())
        cell = place // self.states
        new = cell[self.spawn_step.take(cell) == 0]
        if len(new):
            self._wake(new[_firsts(new)], place)

    def _met(self, came: Iterable[tuple[Ints, Floats]]) -> tuple[Ints, Ints, Floats]:
        """Add up what comes to each place, and what boundaries give back; leave out what ends."""
        count, places = len(self.values) + 1, len(self.key) * self.states
        size = all_entries = (places + len(self.home)) * count
        cells, names = places * count, None
        if size > MOST_EMPTY * len(self.waiting.place) + 2**16:  # a table of those that occur
            came = [(where % size, copies) for where, copies in came]
            names = np.concatenate([where for where, _ in came])
            back = names[names >= cells] - size
            home = self.home[back // count] * count + back % count
            names = np.append(names, home)
            names.sort()
            names = names[_firsts(names)]
            came = [(np.searchsorted(names, where), copies) for where, copies in came]
            size, cells = len(names), int(np.searchsorted(names, cells))
        table = np.zeros(size)
        for where, copies in came:
            np.add.at(table, where, copies)
        self.waiting = NOTHING  # all are taken: they need no memory
        if names is None:
            table[: self.states * count] = table[count - 1 :: count] = 0.0
        else:
            table[(names < self.states * count) | (names % count == count - 1)] = 0.0
        walls = cells + (table[cells:] > 0.0).nonzero()[0]
        if len(walls):
            entry = walls if names is None else names[walls]
            where, copies = self._given_back(entry - all_entries, table[walls], count)
            np.add.at(table, where if names is None else np.searchsorted(names, where), copies)
        where = (table[:cells] > 0.0).nonzero()[0]
        copies, where = table[where], where if names is None else names[where]
        place = where // count
        return place, where - place * count, copies

    def _given_back(self, where: Ints, copies: Floats, count: int) -> tuple[Ints, Floats]:
        """Let boundaries give loads back; book them, and return where they come."""
        if self.accumulate:  # what one agent hands to one boundary in one state is judged as a sum
            above = copies > self.threshold
            self.ended += float(copies[~above].sum())
            where, copies = where[above], copies[above]
        place, number = np.divmod(where, count)
        load = self.values.take(number) * copies
        self.given_back.append((self.generation, place, load))
        self.returned += float(load.sum())
        return self.home[place] * count + number, copies

    def _wake(self, cell: Ints, place: Ints) -> None:
        """Wake agents in cells, in which loads wait at `place`; they look round."""
        self.spawn_step[cell] = self.generation + 1
        self.awake += len(cell)
        over, back = self.over.take(cell, axis=0), self.opposite
        if not over.all():
            self._look_round(self.lattice.cells(self.key[cell]))
            over = self.over.take(cell, axis=0)
        beside = np.maximum(over, 0) // self.states  # a boundary wakes nobody, nor does cell 0
        if self.accumulate:  # loads that met may have ended
            alive = np.zeros(2 * (self.took.size + len(self.home)), dtype=np.bool_)
            alive[2 * place] = True
            handed = np.zeros(self.over.size, dtype=np.bool_)
            for came, arm in self.sent:
                handed[arm[alive[came]]] = True
            brought = handed.reshape(self.over.shape)[beside, back]
        else:  # whoever handed over a load before had woken the agent then
            brought = self.books[beside, back] > 0.0
        self.woken_by[cell] = brought @ self.bits

    # What is where.

    def _look_round(self, cells: Ints) -> None:
        """See the blocks that cells and their neighbours are in, and number their cells."""
        lattice, edges = self.lattice, self.edges
        if (edges > lattice.shape).all():  # one block, which is seen once
            blocks = lattice.key(np.full((1 - len(self.blocks), lattice.dimension), -1))
        else:
            near = cells[:, None] + lattice.steps[lattice.form(cells)]
            near = np.concatenate([cells, near.reshape(-1, lattice.dimension)])
            corner = (near + 1) // edges * edges - 1  # from -1 on: the rim is seen, too
            blocks = np.setdiff1d(lattice.key(corner), self.blocks)
        self.blocks = np.append(self.blocks, blocks)
        for part in _slices(len(blocks), len(self.block)):
            seen = lattice.cells(blocks[part])[:, None] + self.block
            self._number(seen[(seen <= lattice.shape).all(axis=2)])
        order = np.argsort(self.seen_key)
        self.seen_key, self.seen = self.seen_key[order], self.seen[order]
        changed = (self.over == 0).any(axis=1)
        changed[0] = False
        cell = changed.nonzero()[0]
        for part in _slices(len(cell)):
            self._see_over(cell[part])

    def _number(self, cells: Ints) -> None:
        """See cells, and number those of the body; all sleep."""
        lattice, kinds, key = self.lattice, self.scene.kinds(cells), self.lattice.key(cells)
        body = (kinds >= 0).nonzero()[0]
        number = len(self.key) + np.arange(len(body))
        form, material, seen = lattice.form(cells[body]), kinds[body], kinds
        column = (material * lattice.forms + form) * self.states
        seen[body] = number
        self.seen_key, self.seen = np.append(self.seen_key, key), np.append(self.seen, seen)
        self.key = np.append(self.key, key[body])
        self.material, self.form = np.append(self.material, material), np.append(self.form, form)
        self.shift = np.append(self.shift, column - number * self.states)
        self.spawn_step, self.woken_by, self.over, self.took, self.books = (
            np.concatenate([table, np.zeros((len(body), *table.shape[1:]), dtype=table.dtype)])
            for table in (self.spawn_step, self.woken_by, self.over, self.took, self.books)
        )

    def _see_over(self, cell: Ints) -> None:
        """Look up what lies over arms of cells, as far as it is seen."""
        row, arm = (self.over[cell] == 0).nonzero()
        cell = cell[row]
        over = self.find(self._beside(cell, arm)) * self.states
        wall = (over < 0).nonzero()[0]
        at, over_arm = cell[wall], arm[wall]
        kind = over[wall] // self.states
        turned = self.transfer.turned[kind, over_arm] + at[:, None] * self.states
        over[wall] = -(len(self.home) + self.states * np.arange(1, 1 + len(wall)))
        self.home = np.append(turned[::-1], self.home)
        self.wall = np.append(np.array([at, over_arm])[:, ::-1], self.wall, axis=1)
        self.over[cell, arm] = over

    def _beside(self, cell: Ints, arm: Ints) -> Ints:
        """Return the keys of what lies over arms of cells."""
        return self.key[cell] + self.lattice.key_steps[self.form[cell], arm]

    def find(self, key: Ints) -> Ints:
        """Return numbers of cells; outside of the body kinds, below 0; 0 for what is not seen."""
        place = np.minimum(np.searchsorted(self.seen_key, key), len(self.seen_key) - 1)
        return np.where(self.seen_key[place] == key, self.seen[place], 0)

    # What has happened.

    def _agents(self) -> Ints:
        """Return the cells of agents, in the order in which they woke."""
        cell = (self.spawn_step > 0).nonzero()[0]
        return cell[np.lexsort((self.key[cell], self.spawn_step[cell]))]

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        cell = self._agents()
        material, books = self.material[cell], self.books[cell]
        done = self.transfer.kept(material, self.took[cell]), books[:, :-1], books[:, -1]
        return totals_of(self.transfer, self.lattice.cells(self.key[cell]), material, *done)

    def stage(self, factor: float) -> Stage:
        """Return what the stage has left behind so far."""
        d, agent = self.directions, self._agents()
        by_state = self.took[agent]
        taken = by_state.sum(axis=1)
        pulled = by_state[:, d:] if self.states > d else np.zeros_like(by_state)
        # What boundaries gave back, by generation, cell and state.
        none = np.empty(0, dtype=np.int64)
        when, places, loads = zip((0, none, np.empty(0)), *self.given_back, strict=True)
        wall, state = np.divmod(np.concatenate(places), self.states)
        back = self._beside(*self.wall[:, wall])
        key, first, number = np.unique(back, return_index=True, return_inverse=True)
        came = np.bincount(number * d + state % d, np.concatenate(loads), len(key) * d)
        arrived = np.asarray(came, float).reshape(-1, d)
        # A load handed over in g is taken again in g + 1.
        step = np.repeat(when, list(map(len, places)))[first] + 1
        by_step = np.lexsort((key, step))
        cells = self.lattice.cells(key[by_step])
        form = self.material[agent] * self.lattice.forms + self.form[agent]
        ledger = Ledger(
            applied=self.applied,
            taken=float(taken.sum()),
            kept=float((self.transfer.own[self.material[agent]] * taken).sum()),
            emitted=float((self.transfer.emitted[form] * by_state).sum()),
            passed=self.passed,
            returned=self.returned,
            dropped=self.ended,
            pending=self.pending,
        )
        return Stage(
            **self.totals()._asdict(),
            factor=factor,
            outcome="",  # which the ledger tells
            generations=self.generation,
            spawn_step=self.spawn_step[agent],
            woken_by=self.woken_by[agent],
            taken=by_state[:, :d] + pulled,
            pulled=pulled,
            boundary_cells=cells,
            boundary_kind=self.scene.kinds(cells),
            boundary_spawn_step=step[by_step],
            returned=arrived[by_step].sum(axis=1),
            arrived=arrived[by_step],
            history=self._history(agent),
            ledger=ledger,
        )

    def _history(self, agents: Ints) -> TakenHistory:
        """Return what was taken, by generation, then by place in the body and state."""
        row = np.empty(len(self.key), dtype=np.int32)
        row[agents] = np.arange(len(agents))
        start = 0, np.empty(0, dtype=np.int32), np.empty(0)
        when, places, loads = zip(start, *self.record, strict=True)
        generation = np.repeat(when, list(map(len, places)))
        load = np.concatenate(loads)
        cell, state = np.divmod(np.concatenate(places), np.int32(self.states))
        direction, pull = (state % self.directions).astype(np.int8), state >= self.directions
        columns: tuple[Any, ...] = generation, row[cell], direction, load, pull
        if (self.key[1:] < self.key[:-1]).any():  # blocks of cells were seen one after another
            rank = np.empty_like(self.key)
            rank[np.argsort(self.key)] = np.arange(len(rank))
            order = np.argsort(generation * len(rank) + rank[cell], kind="stable")
            columns = tuple(column[order] for column in columns)
        return TakenHistory(*columns)


def _slices(count: int, each: int = 1) -> Iterator[slice]:
    """Yield slices of so many rows, of which `each` belong together."""
    most = max(1, ROWS_AT_ONCE // each)
    return (slice(first, first + most) for first in range(0, count, most))


def _firsts(rising: Ints | Floats) -> Ints:
    """Return where each new number begins."""
    begins = np.empty(len(rising), dtype=np.bool_)
    begins[:1] = True
    np.not_equal(rising[1:], rising[:-1], out=begins[1:])
    return begins.nonzero()[0]
