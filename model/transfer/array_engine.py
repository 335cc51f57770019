"""Load transfer on arrays: only agents and their loads are stored, never the body.

A row stands for equal loads that wait in one cell: agent, state, number of their magnitude, copies.
A generation takes the rows, and lets each send out its shares. What a row sends follows from its
*kind*: form of the cell, state and magnitude. Kinds are few, for magnitudes are products of few
shares, so what they send is laid out first. Where loads that meet are added up, all loads have
the magnitude 1 N, and copies are newtons. Many rows are passed on by a compiled loop. `AgentEngine`
does the same with objects.
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

from .stage import Ledger, Stage, TakenHistory, TakenRows, Totals
from .transfer import Transfer

MANY_ROWS = 200_000
"""From so many rows on the compiled loop pays for its import."""


class Waiting(NamedTuple):
    """Loads that wait, ordered by cell, state and magnitude; equal ones are one row."""

    agent: NDArray[np.int32]
    state: NDArray[np.int8]  # as `Transfer` numbers them
    number: NDArray[np.int32]  # of the magnitude in a table of all magnitudes
    copies: Floats  # how many equal loads the row stands for


class Arrivals(NamedTuple):
    """Loads on their way to cells."""

    key: Ints  # number of the cell, as the lattice counts
    state: Ints
    number: Ints
    copies: Floats
    bits: Ints  # arms over which they come, one bit each; 0 from outside or a boundary

    def part(self, chosen: Any) -> Arrivals:
        """Return some of them."""
        key, state, number, copies, bits = self
        return Arrivals(key[chosen], state[chosen], number[chosen], copies[chosen], bits[chosen])


class Sent(NamedTuple):
    """What kinds of load send out; arrays have a row for each kind, a column for each emission."""

    column: NDArray[np.int32]  # of each row of loads its row in the rule's tables: form and state
    kind: NDArray[np.int32]  # and in this one
    of_kind: Ints  # the row in the rule's tables of each kind
    size: Floats  # what is handed over for each copy (N)
    copies: Floats  # the same in copies
    number: Ints  # of the magnitude in the next generation's table; -1: it ends, up to γ


class ArrayEngine:
    """One stage of load transfer at a time, on arrays."""

    most_at_one = 0  # rows of a table, not objects: any number may wait at one agent

    def __init__(self, transfer: Transfer) -> None:
        self.transfer, self.scene, self.lattice = transfer, transfer.scene, transfer.lattice
        self.accumulate, self.threshold = transfer.rule.accumulate, transfer.rule.threshold
        self.states, self.directions = transfer.states, transfer.lattice.directions
        arm, state, share = transfer.tables  # here by form and state in one, then by emission
        most = share.shape[2]
        self.arm, self.next_state = arm.reshape(-1, most), state.reshape(-1, most)
        self.share = share.reshape(-1, most)
        self.cells = prod(count + 2 for count in self.lattice.shape)
        every = range(self.directions)
        self.has_arm = np.array([[arm in arms for arm in every] for arms in self.lattice.arms])
        form = np.arange(len(self.arm))[:, None] // self.states % self.lattice.forms
        self.step = self.lattice.key_steps[form, self.arm]  # what an emission adds to a cell's key

    @cached_property
    def leaving(self) -> Ints:
        """The emissions that leave over an arm, then -1: by form and state, arm, one by one."""
        leaves = (self.arm[:, None] == np.arange(self.directions)[:, None]) & (self.share > 0.0)[
            :, None
        ]
        found = np.where(leaves, np.arange(self.arm.shape[1]), self.arm.shape[1])
        found.sort(axis=2)
        most = max(1, int(leaves.sum(axis=2).max()))
        return np.where(found == self.arm.shape[1], -1, found)[:, :, :most].copy()

    def start(self, cells: Ints, state: Ints, magnitude: Floats, *, live_on: bool = False) -> None:
        """Put the applied loads (N) on the body; they are taken in the next step.

        Unless agents `live_on`, the body is without any.
        """
        if not live_on:
            self._clear()
        self.applied += float(magnitude.sum())
        number = np.zeros(len(state), dtype=np.int64)
        self.values, copies = np.ones(1), magnitude
        if not self.accumulate:
            above = magnitude > self.threshold
            self.dropped += float(magnitude[~above].sum())
            cells, state = cells[above], state[above]
            self.values, number = np.unique(magnitude[above], return_inverse=True)
            copies = np.ones(len(state))
        bits = np.zeros(len(state), dtype=np.int64)
        self._arrive(self._merged(Arrivals(self.lattice.key(cells), state, number, copies, bits)))

    def _clear(self) -> None:
        """Begin without agents, loads and generations."""
        none, d = np.empty(0, dtype=np.int64), self.directions
        self.generation, self.acted, self.awake = 0, True, 0
        # Agents in the order in which they woke; `find` looks for them by the numbers of cells.
        self.key = self.material = self.form = self.spawn_step = self.woken_by = none
        self.sorted_key = self.sorted_agent = none
        self.beyond = np.empty((0, d), dtype=np.int16)  # over each arm a material, or a boundary
        self.taken_by, self.passed_by = np.empty((0, self.states)), np.empty((0, d))
        self.dropped_by = np.empty(0)
        self.record: list[tuple[NDArray[np.int32], Floats]] = []  # taken by agent and state, in one
        self.given_back = [TakenRows(none, none, none, np.empty(0))]  # by cell beside the body
        self.applied = self.taken = self.passed = self.returned = self.dropped = 0.0

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
        rows = self.waiting
        self._take(rows)
        sent = self._sent(rows)
        returned, self.returned = self.returned, 0.0  # the difference of totals loses small loads
        if len(rows.agent) < MANY_ROWS:
            came = self._merged(self._emit(rows, sent))
        else:
            came = self._emit_many(rows, sent)
        self._arrive(came)
        self.passed += self.pending - self.returned
        self.returned += returned

    def end(self) -> None:
        """Refuse a generation in which nobody acted."""
        if not self.acted:
            raise AgentError(
                "step: on arrays a step of your own must call super().step(), which lets agents "
                "act; to let them act yourself take engine='agents'"
            )

    def _take(self, rows: Waiting) -> None:
        """Book what each agent takes in each state."""
        slot = rows.agent * np.int64(self.states) + rows.state
        first = _firsts(slot)
        slot, load = slot[first], np.add.reduceat(self.values[rows.number] * rows.copies, first)
        self.taken_by.reshape(-1)[slot] += load
        self.taken += self.pending
        self.record.append((slot.astype(np.int32), load))

    def _sent(self, rows: Waiting) -> Sent:
        """Lay out what each kind of load sends out; book what ends."""
        column, count = self.form[rows.agent] * self.states + rows.state, len(self.values)
        kinds, kind = _numbered(column * count + rows.number, len(self.share) * count)
        of_kind, magnitude = np.divmod(kinds, count)
        size = self.share[of_kind] * self.values[magnitude, None]
        above = size > (0.0 if self.accumulate else self.threshold)
        ended = np.where(above, 0.0, size).sum(axis=1)
        copies, number = np.where(above, size, 0.0), above.astype(np.int64) - 1
        if not self.accumulate:
            copies = above.astype(np.float64)
            self.values, number[above] = np.unique(size[above], return_inverse=True)
        dropped = ended[kind] * rows.copies
        np.add.at(self.dropped_by, rows.agent, dropped)
        self.dropped += float(dropped.sum())
        return Sent(column.astype(np.int32), kind.astype(np.int32), of_kind, size, copies, number)

    def _emit(self, rows: Waiting, sent: Sent) -> Arrivals:
        """Return the shares that go on, one row each, where boundaries have turned theirs."""
        # Emissions one after another, each in the order of cells; `place` is its place in tables.
        emission, row = np.nonzero((sent.number >= 0).T[:, sent.kind])
        place = sent.kind[row] * np.int64(sent.number.shape[1]) + emission
        arm, state = self.arm[sent.of_kind].take(place), self.next_state[sent.of_kind].take(place)
        sender, copies = rows.agent[row].astype(np.int64), rows.copies[row]
        load, over = sent.size.take(place) * copies, sender * self.directions + arm
        np.add.at(self.passed_by.reshape(-1), over, load)
        came = Arrivals(
            key=self.key[sender] + self.step[sent.of_kind].take(place),
            state=state,
            number=sent.number.take(place),
            copies=load if self.accumulate else copies,
            bits=(1 << self.lattice.opposite)[arm],
        )
        leaving = self.beyond.reshape(-1)[over] < 0
        if not leaving.any():
            return came
        sender, arm, state, load = sender[leaving], arm[leaving], state[leaving], load[leaving]
        back = came.part(leaving)
        if self.accumulate:  # what one agent hands to one boundary in one state is judged as a sum
            place = over[leaving] * self.states + state
            _, first, met = np.unique(place, return_index=True, return_inverse=True)
            above, load = self._judged(np.bincount(met, load).astype(np.float64, copy=False))
            sender, arm, state = (c[first][above] for c in (sender, arm, state))
            back = back.part(first[above])._replace(copies=load)
        state = self._give_back(sender, arm, state, load)
        back = back._replace(key=self.key[sender], state=state, bits=np.zeros_like(sender))
        columns: Any = zip(came.part(~leaving), back, strict=True)
        return Arrivals(*map(np.concatenate, columns))

    def _judged(self, load: Floats) -> tuple[Flags, Floats]:
        """Tell which sums of loads are above γ, and return these; the others end."""
        above = load > self.threshold
        self.dropped += float(load[~above].sum())
        return above, load[above]

    def _give_back(self, sender: Ints, arm: Ints, state: Ints, load: Floats) -> Ints:
        """Book loads that boundary agents turn round; return the states in which they go back."""
        when = np.full(len(sender), self.generation)
        self.given_back.append(TakenRows(when, self._over(sender, arm), state, load))
        self.returned += float(load.sum())
        return self.transfer.turned[self.beyond[sender, arm], arm, state]

    def _emit_many(self, rows: Waiting, sent: Sent) -> Arrivals:
        """Do what `_emit` and `_merged` do, cell by cell, in a compiled loop."""
        from .compiled_generation import gathered, handed_over

        first = _firsts(rows.agent)
        active, start = rows.agent[first].astype(np.int64), np.append(first, len(rows.agent))
        key = self.key[active]
        beyond = self.beyond[active]
        goes, back = handed_over(
            start, active, beyond, rows.copies, sent.column, sent.kind, sent.size, sent.number,
            self.arm, self.next_state, self.passed_by, self.states,
        )  # fmt: skip
        turned = np.zeros(back.shape, dtype=np.int64)
        if self.accumulate:
            back[~self._judged(back)[0]] = 0.0
        who, arm, state = np.nonzero(back)
        load = back[who, arm, state]
        turned[who, arm, state] = self._give_back(active[who], arm, state, load)
        # Whoever may get something: neighbours, and those to whom boundaries give back.
        who, arm = np.nonzero(goes & (beyond >= 0))
        target = np.append(self._over(active[who], arm), key)
        target.sort(kind="stable")
        target = target[_firsts(target)]
        form = self.lattice.form(self.lattice.cells(target))
        near = target[:, None] + self.lattice.key_steps[form]
        source = np.where(self.has_arm[form], _places(key, near), -1)
        which, slot, copies, bits = gathered(
            source, _places(key, target), self.lattice.opposite, start, beyond,
            rows.copies, sent.column, sent.kind, sent.copies, sent.number, self.leaving,
            self.next_state, back, turned, self.accumulate, self.states, len(self.values),
        )  # fmt: skip
        state, number = np.divmod(slot.astype(np.int64), len(self.values))
        return Arrivals(target[which], state, number, copies, bits.astype(np.int64))

    def _merged(self, rows: Arrivals) -> Arrivals:
        """Let equal loads wait together, in order."""
        key, names, count = rows.key, None, len(self.values)
        if self.cells * self.states * count >= 2**62:  # no integer numbers all these: name anew
            names, key = np.unique(key, return_inverse=True)
        order, code = _sorted((key * self.states + rows.state) * count + rows.number)
        first = _firsts(code)
        if not len(first):
            return rows
        key, rest = np.divmod(code[first], self.states * count)
        state, number = np.divmod(rest, count)
        copies = np.add.reduceat(rows.copies[order], first)
        bits = np.bitwise_or.reduceat(rows.bits[order], first)
        return Arrivals(key if names is None else names[key], state, number, copies, bits)

    def _arrive(self, rows: Arrivals) -> None:
        """Let merged loads wait to be taken; agents wake in the cells that they have reached."""
        if self.accumulate:
            rows = rows.part(self._judged(rows.copies)[0])
        else:
            used = np.bincount(rows.number, minlength=len(self.values)) > 0
            self.values, number = self.values[used], np.cumsum(used) - 1
            rows = rows._replace(number=number[rows.number])
        first = _firsts(rows.key)
        agent = self.find(rows.key[first])
        new = np.flatnonzero(agent < 0)
        if len(new):
            woken_by = np.bitwise_or.reduceat(rows.bits, first)[new]
            self._wake(rows.key[first[new]], woken_by)
            agent[new] = np.arange(self.awake - len(new), self.awake)
        self.waiting = Waiting(
            np.repeat(agent.astype(np.int32), np.diff(np.append(first, len(rows.key)))),
            rows.state.astype(np.int8),
            rows.number.astype(np.int32),
            rows.copies,
        )
        self.pending = float((self.values[rows.number] * rows.copies).sum())

    def _wake(self, key: Ints, woken_by: Ints) -> None:
        """Add agents in cells; they see what they are, and what lies over their arms."""
        cells, newborn = self.lattice.cells(key), self.awake + np.arange(len(key))
        form = self.lattice.form(cells)
        seen = np.concatenate([cells[:, None], cells[:, None] + self.lattice.steps[form]], axis=1)
        kinds = self.scene.kinds(seen.reshape(-1, cells.shape[1])).reshape(len(key), -1)
        every = np.append(self.sorted_key, key)
        order = np.argsort(every, kind="stable")
        self.sorted_key = every[order]
        self.sorted_agent = np.append(self.sorted_agent, newborn)[order]
        self.key, self.woken_by = np.append(self.key, key), np.append(self.woken_by, woken_by)
        self.material = np.append(self.material, kinds[:, 0])
        self.form = np.append(self.form, kinds[:, 0] * self.lattice.forms + form)
        self.beyond = np.append(self.beyond, kinds[:, 1:].astype(np.int16), axis=0)
        self.spawn_step = np.append(self.spawn_step, np.full(len(key), self.generation + 1))
        nothing = np.zeros((len(key), self.states))
        self.taken_by = np.append(self.taken_by, nothing, axis=0)
        self.passed_by = np.append(self.passed_by, nothing[:, : self.directions], axis=0)
        self.dropped_by = np.append(self.dropped_by, np.zeros(len(key)))
        self.awake = len(self.key)

    def find(self, key: Ints) -> Ints:
        """Return the agents of cells, -1 where there is none."""
        place = _places(self.sorted_key, key)
        return np.append(self.sorted_agent, -1)[place]

    def _over(self, agent: Ints, arm: Ints) -> Ints:
        """Return the cells over arms of agents."""
        return self.key[agent] + self.lattice.key_steps[self.form[agent] % self.lattice.forms, arm]

    # What has happened.

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        transfer, material = self.transfer, self.material
        kept = transfer.kept(material, self.taken_by)
        modulus = np.array([each.youngs_modulus for each in transfer.materials])[material]
        widening = np.array([shares.widening for shares in transfer.shares])[material]
        shortened = kept / (transfer.cross_section * modulus[:, None])
        return Totals(
            cells=self.lattice.cells(self.key),
            material=material,
            kept=kept,
            shortened=shortened,
            widened=shortened * widening[:, None],
            passed=self.passed_by,
            dropped=self.dropped_by,
        )

    def stage(self, factor: float, outcome: Callable[[Ledger], str]) -> Stage:
        """Return what the stage has left behind so far; its ledger tells how it ended."""
        d, taken = self.directions, self.taken_by.sum(axis=1)
        pulled = self.taken_by[:, d:] if self.states > d else np.zeros_like(self.taken_by)
        back = TakenRows.joined(self.given_back)
        key, first, number = np.unique(back.key, return_index=True, return_inverse=True)
        arrived = np.zeros((len(key), d))
        np.add.at(arrived, (number, back.state % d), back.load)
        step = back.generation[first] + 1  # a load handed over in g is taken again in g + 1
        by_step = np.lexsort((key, step))
        cells = self.lattice.cells(key[by_step])
        ledger = Ledger(
            applied=self.applied,
            taken=float(taken.sum()),
            kept=float((self.transfer.own[self.material] * taken).sum()),
            emitted=float((self.transfer.emitted[self.form] * self.taken_by).sum()),
            passed=self.passed,
            returned=self.returned,
            dropped=self.dropped,
            pending=self.pending,
        )
        return Stage(
            **self.totals()._asdict(),
            factor=factor,
            outcome=outcome(ledger),
            generations=self.generation,
            spawn_step=self.spawn_step,
            woken_by=self.woken_by,
            taken=self.taken_by[:, :d] + pulled,
            pulled=pulled,
            boundary_cells=cells,
            boundary_kind=self.scene.kinds(cells),
            boundary_spawn_step=step[by_step],
            returned=arrived[by_step].sum(axis=1),
            arrived=arrived[by_step],
            history=self._history(),
            ledger=ledger,
        )

    def _history(self) -> TakenHistory:
        slot = np.concatenate([np.empty(0, dtype=np.int32), *(slot for slot, _ in self.record)])
        load = np.concatenate([np.empty(0), *(load for _, load in self.record)])
        count = [len(load) for _, load in self.record]
        generation = np.repeat(np.arange(1, len(count) + 1), count)
        agent, state = np.divmod(slot.astype(np.int64), self.states)
        pull, direction = np.divmod(state, self.directions)
        return TakenHistory(generation, agent, direction, load, pull > 0)


def _numbered(code: Ints, most: int) -> tuple[Ints, Ints]:
    """Return the numbers that occur, all below `most`, and of which each is."""
    if most > 4 * len(code) + 10_000:
        return np.unique(code, return_inverse=True)
    occurs = np.zeros(most, dtype=np.bool_)
    occurs[code] = True
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[code]


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


def _places(rising: Ints, number: Ints) -> Ints:
    """Return where numbers are among rising ones, -1 where they are not."""
    if not len(rising):
        return np.full(number.shape, -1)
    place = np.minimum(np.searchsorted(rising, number), len(rising) - 1)
    return np.where(rising[place] == number, place, -1)


def _firsts(rising: Ints | NDArray[np.int32]) -> Ints:
    """Return where each new number begins."""
    begins = np.ones(len(rising), dtype=np.bool_)
    np.not_equal(rising[1:], rising[:-1], out=begins[1:])
    return np.flatnonzero(begins)
