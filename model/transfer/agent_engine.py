"""Load transfer with agents as objects on Mesa's cell space, to be watched and subclassed.

A generation has three parts. It begins with loads in the inboxes. Then agents act, in any order:
`MaterialAgent.step` takes each load, keeps a share, and puts the others straight into the boxes
of its neighbours, where they wait for the next generation. In the end boundaries give back what
reached them, and the boxes are opened.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain, islice
from math import inf, isfinite
from numbers import Real
from operator import index
from sys import float_info
from typing import Any, TypeVar

import numpy as np

from kaju._mesa import FixedAgent, Model
from kaju.agents.boundary_agent import (
    BoundaryAgent,
    FreeBoundaryAgent,
    RigidBoundaryAgent,
    RollerBoundaryAgent,
)
from kaju.agents.material_agent import MaterialAgent, PlacedAgent
from kaju.agents.materials import Material
from kaju.agents.parameter import State, declared
from kaju.agents.shares import Emission, Emissions, Load, Sense, Shares, Split
from kaju.arrays import Floats, Ints
from kaju.errors import AgentError
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.stepping import Order, chosen

from .cell_space import Index, space_of
from .stage import Ledger, News, Stage, StateCourse, TakenRows, Totals, history_of
from .transfer import Transfer, check_shares

A = TypeVar("A", MaterialAgent, BoundaryAgent)

BOUNDARY_AGENTS: dict[int, type[BoundaryAgent]] = {
    AIR: FreeBoundaryAgent,
    RIGID: RigidBoundaryAgent,
    ROLLER: RollerBoundaryAgent,
}

MOST_EMISSIONS = 1_000
"""An agent of one's own that sends out more for one load is taken to never end."""

MOST_REMEMBERED = 10_000
"""So many sets of emissions are kept, so that they need not be worked out for every load."""

ACTS_AT_ONCE = 20_000
"""So many acts of agents are noted as they are before they are added up in arrays."""


class AgentEngine:
    """One stage of load transfer at a time, with one object per agent."""

    def __init__(
        self,
        model: Model,
        scene: Scene,
        transfer: Transfer,
        material_agent: type[MaterialAgent],
        own_boundaries: Mapping[str, type[BoundaryAgent]],
    ) -> None:
        self.model, self.scene, self.transfer = model, scene, transfer
        self.lattice = transfer.lattice
        self.material_agent = material_agent
        self.boundary_agents = {
            kind: own_boundaries.get(usual.name, usual) for kind, usual in BOUNDARY_AGENTS.items()
        }
        self.own_boundaries = bool(own_boundaries)
        self.states = declared([material_agent], State)
        self.accumulate, self.threshold = transfer.rule.accumulate, transfer.rule.threshold
        self.opposite: list[int] = self.lattice.opposite.tolist()
        self.axis_of: list[int] = self.lattice.axis_of.tolist()
        self.senses: tuple[Sense, ...] = ("push", "pull") if transfer.rule.sense else ("push",)
        # What arm, direction and sense a load can have, by its sender's form; None: a boundary.
        every = range(self.lattice.directions)
        arms_of: dict[int | None, Sequence[int]] = {
            **dict(enumerate(self.lattice.arms)),
            None: every,
        }
        self.possible = {
            form: {(arm, d, sense) for arm in arms for d in every for sense in self.senses}
            for form, arms in arms_of.items()
        }
        self._sent: dict[tuple[Shares, int], dict[Sense, tuple[Emissions, ...]]] = {}
        self.space = space_of(self.lattice, model.random)
        self.agents: dict[Index, MaterialAgent] = {}
        self.boundaries: dict[Index, BoundaryAgent] = {}

    def start(self, cells: Ints, state: Ints, magnitude: Floats, *, live_on: bool = False) -> None:
        """Put the applied loads (N) on the body; they are taken in the next step.

        Unless agents `live_on`, the body is without any.
        """
        if not live_on:
            self._clear()
        self.applied += float(magnitude.sum())
        kinds = self.scene.kinds(cells).tolist()
        pull, direction = np.divmod(state, self.lattice.directions)
        applied = (cells.tolist(), kinds, direction.tolist(), magnitude.tolist(), pull.tolist())
        for cell, kind, along, size, pulls in zip(*applied, strict=True):
            self._bring(tuple(cell), kind, Load(along, size, 1.0, "pull" if pulls else "push"))
        self._open()

    def _clear(self) -> None:
        """Begin without agents, loads and generations."""
        for agent in (*self.agents.values(), *self.boundaries.values()):
            FixedAgent.remove(agent)
        self.agents, self.boundaries = {}, {}
        self.generation = 0
        self.waiting: list[MaterialAgent] = []
        self.called: dict[MaterialAgent, None] = {}
        self.newborn: list[MaterialAgent] = []
        self.leaving: list[tuple[BoundaryAgent, Load, MaterialAgent, int]] = []
        self.sums: dict[tuple[Any, ...], Sum] = {}
        self.acts: list[tuple[int, MaterialAgent, dict[Any, float], dict[Any, float]]] = []
        self.record: list[TakenRows] = []
        self.known: dict[str, dict[MaterialAgent, float]] = {name: {} for name in self.states}
        self.changes: dict[str, list[tuple[int, int, float]]] = {name: [] for name in self.states}
        self.applied = 0.0
        self.taken = self.passed = self.returned = self.dropped = self.pending = 0.0

    # One generation: begin, agents act, end.

    def begin(self) -> None:
        """Count a generation, and let agents that have just been woken look round."""
        self.generation += 1
        self._look_round(self.newborn)
        for agent in self.newborn:
            agent.fresh = False
        self.newborn = []
        self.waiting = [agent for agent in self.agents.values() if agent.inbox or agent.pulls]

    def act(self, order: Order[MaterialAgent] | None = None) -> None:
        """Let all act for whom loads wait, or those whom an order chooses."""
        waiting = [agent for agent in self.waiting if agent.inbox or agent.pulls]
        for agent in waiting if order is None or not waiting else chosen(order, waiting):
            agent.step()

    def end(self) -> None:
        """Let boundaries give back what has reached them, and open the boxes of those called."""
        late = [agent for agent in self.waiting if agent.inbox or agent.pulls]
        left = sum((load.total for agent in late for load in agent.waiting()), start=0.0)
        self.taken += self.pending - left
        self._judge_sums(at_boundary=True)
        given = 0.0
        for boundary, load, sender, arm in self.leaving:
            back = boundary.answer(load, arm)
            if back is not None:
                given += back.total
                self._bring(sender.index, sender.kind, back)
        self.leaving.clear()
        self.returned += given
        self._open()
        self.passed += self.pending - given
        self.pending += left
        if len(self.acts) > ACTS_AT_ONCE:
            self._settle()
        if self.states:
            self._note_states()

    def _note_states(self) -> None:
        """Note what agents of one's own know now, where it has changed."""
        for name, state in self.states.items():
            known, changes = self.known[name], self.changes[name]
            for number, agent in enumerate(self.agents.values()):
                value = getattr(agent, name)
                if value == known.get(agent, state.default):
                    continue
                if not state.allows(value):
                    kind = type(state.default).__name__
                    raise self.wrong(agent, name, f"must be a {kind}, and is {value!r:.60}")
                known[agent] = value
                changes.append((self.generation, number, float(value)))

    def _open(self) -> None:
        """Open the boxes of those to whom loads have come."""
        self._judge_sums(at_boundary=False)
        called, self.called = self.called, {}
        self.pending = sum((agent.open() for agent in called), start=0.0)
        self.most_at_one = max((len(a.inbox) + len(a.pulls) for a in called), default=0)

    def goes_on(self, magnitude: float, met: bool = True) -> bool:
        """Tell whether a load (N) exceeds γ; loads to be added up are judged once they have met."""
        return magnitude > (self.threshold if met or not self.accumulate else 0.0)

    def split(self, agent: MaterialAgent, emissions: Iterable[Emission], magnitude: float) -> Split:
        """Part the emissions of a load of a magnitude (N): those that go on, those that end."""
        goes_on = self.goes_on
        sent: list[tuple[int, tuple[int, float], Sense]] = []
        ended: list[float] = []
        checked = type(emissions) is Emissions
        rows = emissions if checked else self.checked_emissions(agent, emissions)
        for arm, direction, share, sense in rows:
            size = share * magnitude
            if not 0.0 <= size < inf:
                raise self.wrong(agent, "pass_on", f"would hand over {size} N")
            if goes_on(size, False):
                sent.append((arm, (direction, size), sense))
            else:
                ended.append(size)
        split = Split(sent, ended)
        # Sums of loads that have met are hardly ever alike: nothing to remember.
        if (
            isinstance(emissions, Emissions)
            and not self.accumulate
            and len(emissions.split) < MOST_REMEMBERED
        ):
            emissions.split[magnitude] = split
        return split

    def _bring(self, cell: Index, kind: int, load: Load) -> None:
        """Bring a load to a cell, from outside or back from a boundary."""
        if self.accumulate:
            MeetingPlace(self.sums, cell, kind).put(load[:2], load.copies, load.sense, None)
        elif self.goes_on(load.magnitude):
            self._material_agent(cell, kind).receive(load)
        else:
            self.dropped += load.total

    def _judge_sums(self, at_boundary: bool) -> None:
        """Let loads go on that were added up to more than the threshold."""
        judged = [key for key in self.sums if (key[1] < 0) == at_boundary]
        for key in judged:
            cell, kind, direction, sense, sender, arm = key
            added = self.sums.pop(key)
            load = Load(direction, added.total, 1.0, sense)
            if not self.goes_on(load.magnitude):
                self.dropped += load.total
                continue
            if at_boundary:
                boundary = self._boundary_agent(cell, kind)
                self.leaving.append((boundary, load, sender, arm))
                continue
            agent = self._material_agent(cell, kind)
            agent.receive(load)
            if agent.fresh:
                agent.woken_by += [
                    s for s in dict.fromkeys(added.senders) if s not in agent.woken_by
                ]

    # Neighbours.

    def look(self, agent: MaterialAgent, arm: int) -> Any:
        """Return the neighbour over an arm, and wake it: a load is on its way."""
        if agent.beyond is None:
            self._look_round([agent])
        if arm not in self.lattice.arms[agent.form]:
            raise self.wrong(agent, "pass_on", f"has no face along direction {arm}")
        cell, kind = agent.beyond[arm]
        neighbour: Any
        if self.accumulate:
            neighbour = MeetingPlace(self.sums, cell, kind, arm)
        elif kind < 0:
            neighbour = Edge(self._boundary_agent(cell, kind), arm, self.leaving)
        else:
            neighbour = self._material_agent(cell, kind)
        agent.around[arm] = neighbour
        return neighbour

    def _look_round(self, agents: Sequence[MaterialAgent]) -> None:
        """Let agents see what lies over their arms, all of them in one question to the scene."""
        if not agents:
            return
        cells, directions = self._places(agents), self.lattice.directions
        beyond = [self.lattice.neighbours(cells, arm) for arm in range(directions)]
        kinds = self.scene.kinds(np.concatenate(beyond)).reshape(directions, -1).T.tolist()
        places = np.stack(beyond, axis=1).tolist()
        keys = self.lattice.key(cells).tolist()
        for agent, key, place, kind in zip(agents, keys, places, kinds, strict=True):
            agent.key, agent.beyond = key, list(zip(map(tuple, place), kind, strict=True))

    def _material_agent(self, cell: Index, kind: int) -> MaterialAgent:
        agent = self.agents.get(cell)
        if agent is None:
            agent = self.material_agent(
                self.model,
                self.space.cell(cell),
                self.transfer.materials[kind],
                self.transfer.shares[kind],
            )
            self._check_begun(agent, cell, "around")
            agent.kind = kind
            self.agents[cell] = agent
            self.newborn.append(agent)
        return agent

    def _boundary_agent(self, cell: Index, kind: int) -> BoundaryAgent:
        agent = self.boundaries.get(cell)
        if agent is None:
            agent = self.boundary_agents[kind](self.model, self.space.cell(cell))
            self._check_begun(agent, cell, "returned")
            self.boundaries[cell] = agent
        return agent

    # Answers of agents of one's own are checked.

    def wrong(self, agent: PlacedAgent, hook: str, what: str) -> AgentError:
        """Return the error of an answer that is none."""
        return AgentError(
            f"{hook}: {type(agent).__name__} at cell {agent.index} in generation "
            f"{self.generation} {what}"
        )

    def _check_begun(self, agent: PlacedAgent, cell: Index, last: str) -> None:
        if not hasattr(agent, last):
            raise AgentError(
                f"__init__: {type(agent).__name__} at cell {cell} in generation {self.generation} "
                "must call super().__init__ with all that it is given"
            )

    def emissions_of(self, agent: MaterialAgent) -> dict[Sense, tuple[Emissions, ...]]:
        """Return what an agent sends out for each newton by its shares: by sense and direction."""
        shares, form = agent.shares, agent.form
        if not isinstance(shares, Shares):
            raise self.wrong(agent, "shares", f"must have kaju.Shares, has {shares!r:.60}")
        sent = self._sent.get((shares, form))
        if sent is None:
            problem = check_shares(shares, self.transfer.rule.sense)
            if problem:
                raise self.wrong(agent, "shares", problem)
            if len(self._sent) > MOST_REMEMBERED:
                self._sent.clear()
            every = range(self.lattice.directions)
            sent = self._sent[shares, form] = {
                sense: tuple(
                    Emissions(self.transfer.emissions(shares, d, sense, form)) for d in every
                )
                for sense in self.senses
            }
        return sent

    def checked_emissions(self, agent: MaterialAgent, sent: Any) -> list[Any]:
        """Return the emissions of an agent of one's own; refuse what is none."""
        checked = []
        try:
            rows = iter(sent)
        except TypeError:
            raise self.wrong(agent, "emissions", f"returned {sent!r:.60}{_EMISSION}") from None
        for row in islice(rows, MOST_EMISSIONS + 1):
            try:
                arm, direction, share, sense = row
                fits = self._fits(agent, arm, direction, sense, share)
            except (TypeError, ValueError):
                raise self.wrong(agent, "emissions", f"returned {row!r:.60}{_EMISSION}") from None
            if not fits:
                raise self.wrong(agent, "emissions", f"returned {row!r:.120}{self._limits(agent)}")
            if type(arm) is not int or type(direction) is not int:  # True would mask an array
                row = int(arm), int(direction), share, sense
            checked.append(row)
        if len(checked) > MOST_EMISSIONS:
            raise self.wrong(agent, "emissions", f"returned more than {MOST_EMISSIONS} for a load")
        return checked

    def _fits(
        self, agent: PlacedAgent, arm: Any, direction: Any, sense: Any, *amounts: Any
    ) -> bool:
        """Tell whether this body has the arm, direction and sense, and amounts are amounts."""
        possible = self.possible[getattr(agent, "form", None)]
        return (index(arm), index(direction), sense) in possible and all(map(_is_amount, amounts))

    def _limits(self, agent: PlacedAgent) -> str:
        """Return what emissions and loads of this body can be."""
        own = isinstance(agent, MaterialAgent)
        arms = f"an arm of {self.lattice.arms[agent.form]}, " if own else ""
        senses = " or ".join(map(repr, self.senses))
        return (
            f"; it has {arms}a direction from 0 to {self.lattice.directions - 1}, an amount that "
            f"is finite and not negative, and the sense {senses}"
        )

    def checked_load(self, agent: PlacedAgent, hook: str, load: Any, arm: int) -> Load:
        """Return a load of an agent of one's own; refuse what is none."""
        try:
            direction, magnitude, copies, sense = load
            fits = self._fits(agent, arm, direction, sense, magnitude, copies)
        except (TypeError, ValueError):
            fits = False
        if not fits:
            over = f" over arm {arm!r}" if isinstance(agent, MaterialAgent) else ""
            raise self.wrong(agent, hook, f"hands over {load!r:.100}{over}{self._limits(agent)}")
        return Load(int(direction), float(magnitude), float(copies), sense)

    def hand_over(self, sender: Any, arm: int, load: Any) -> None:
        """Hand over a load of an agent's own making, unless it is too small."""
        if not isinstance(sender, MaterialAgent):
            raise AgentError(
                "hand_over: who hands over comes first, as in hand_over(self, arm, load), got "
                f"{sender!r:.60}"
            )
        checked = self.checked_load(sender, "hand_over", load, arm)
        sender.send([Emission(arm, checked.direction, 1.0, checked.sense)], checked)

    def checked_return(self, boundary: BoundaryAgent, load: Load, back: Any) -> Load:
        """Return what a boundary of one's own gives back; refuse what is no load, or too much."""
        checked = self.checked_load(boundary, "give_back", back, 0)
        if checked.total > load.total * (1.0 + 1e-12):
            raise self.wrong(
                boundary,
                "give_back",
                f"gives back {checked.total:g} N of {load.total:g} N; what pushes on its own is a "
                "load of the scene",
            )
        return checked

    # What has happened.

    def note(self, agent: MaterialAgent) -> None:
        """Note what an agent takes now."""
        self.acts.append((self.generation, agent, agent.inbox, agent.pulls))

    def _settle(self) -> None:
        """Add up what was taken by generation, place and state."""
        acts, self.acts = self.acts, []
        if not acts:
            return
        boxes = [box for act in acts for box in act[2:]]
        count = np.fromiter(map(len, boxes), np.int64, len(boxes))
        rows = int(count.sum())
        copies = np.fromiter(chain.from_iterable(box.values() for box in boxes), float, rows)
        keys = np.fromiter(chain.from_iterable(chain.from_iterable(boxes)), float, 2 * rows)
        direction, magnitude = keys.reshape(-1, 2).T
        generation = np.array([act[0] for act in acts], dtype=np.int64)
        place = np.array([act[1].key for act in acts], dtype=np.int64)
        order = np.lexsort((place, generation))
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        act, pull = np.divmod(np.repeat(np.arange(len(boxes)), count), 2)
        states = 2 * self.lattice.directions
        code = rank[act] * states + direction.astype(np.int64) + self.lattice.directions * pull
        by_size = np.lexsort((magnitude, code))
        code = code[by_size]
        new = np.diff(code, prepend=-1) != 0
        # Added one after another, from the smallest on: the sums of a plain loop.
        load = np.asarray(np.bincount(np.cumsum(new) - 1, (magnitude * copies)[by_size]), float)
        acted, state = np.divmod(code[new], states)
        acted = order[acted]
        self.record.append(TakenRows(generation[acted], place[acted], state, load))

    @property
    def awake(self) -> int:
        """Number of material agents."""
        return len(self.agents)

    def since(self, generation: int, agents: int) -> News:
        """Return what came after a generation, and after so many agents."""
        self._settle()
        taken = TakenRows.joined(self.record)
        born = list(self.agents.values())[agents:]
        late = taken.generation > generation
        return News(
            taken.generation[late],
            taken.key[late],
            taken.state[late],
            taken.load[late],
            self.lattice.key(self._places(born)),
            np.array([agent.spawn_step for agent in born], dtype=np.int64),
            np.array([self._arms_to_wakers(agent) for agent in born], dtype=np.int64),
        )

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        agents = self._ordered(self.agents.values())
        for agent in agents:
            for name, kind in _MUST_STAY.items():
                if not isinstance(getattr(agent, name), kind):
                    raise self.wrong(agent, name, f"has become {getattr(agent, name)!r:.60}")
        cells, axes = self._places(agents), len(self.lattice.axes)
        kept = _table([agent.squeezed for agent in agents], axes)
        if self.material_agent.shortening is MaterialAgent.shortening:  # asked of all at once
            modulus = np.array([agent.material.youngs_modulus for agent in agents])
            shortened = kept / (self.transfer.cross_section * modulus[:, None])
        else:
            laws = [[self._shortening(agent, axis) for axis in range(axes)] for agent in agents]
            shortened = np.array(laws).reshape(-1, axes)
        widening = np.array([agent.shares.widening for agent in agents])
        return Totals(
            cells=cells,
            material=self.scene.kinds(cells),
            kept=kept,
            shortened=shortened,
            widened=shortened * widening[:, None],
            passed=_table([agent.passed for agent in agents], self.lattice.directions),
            dropped=np.array([agent.dropped for agent in agents]),
        )

    def _shortening(self, agent: MaterialAgent, axis: int) -> float:
        short = agent.shortening(axis)
        if not (isinstance(short, Real) and isfinite(short)):
            raise self.wrong(agent, "shortening", f"must answer a finite number, got {short!r:.60}")
        return float(short)

    def stage(self, factor: float, outcome: Callable[[Ledger], str]) -> Stage:
        """Return what the stage has left behind so far; its ledger tells how it ended."""
        self._settle()
        agents = self._ordered(self.agents.values())
        boundaries = self._ordered(self.boundaries.values())
        boundary_cells, directions = self._places(boundaries), self.lattice.directions
        totals = self.totals()
        taken = _table([agent.taken for agent in agents], directions)
        ledger = Ledger(
            applied=self.applied,
            taken=float(taken.sum()),
            kept=sum((agent.kept for agent in agents), start=0.0),
            emitted=float(totals.passed.sum() + totals.dropped.sum()),
            passed=self.passed,
            returned=self.returned,
            dropped=self.dropped + float(totals.dropped.sum()),
            pending=self.pending,
            absorbed=sum((boundary.kept for boundary in boundaries), start=0.0),
        )
        return Stage(
            **totals._asdict(),
            factor=factor,
            outcome=outcome(ledger),
            generations=self.generation,
            spawn_step=np.array([agent.spawn_step for agent in agents], dtype=np.int64),
            woken_by=np.array([self._arms_to_wakers(a) for a in agents], dtype=np.int64),
            taken=taken,
            pulled=_table([agent.pulled for agent in agents], directions),
            boundary_cells=boundary_cells,
            boundary_kind=self.scene.kinds(boundary_cells),
            boundary_spawn_step=np.array([b.spawn_step for b in boundaries], dtype=np.int64),
            returned=np.array([boundary.returned for boundary in boundaries]),
            arrived=_table([boundary.taken for boundary in boundaries], directions),
            history=history_of(self.record, self.lattice.key(totals.cells), directions),
            ledger=ledger,
            states=tuple(self._course(state, agents) for state in self.states.values()),
        )

    def _course(self, state: State, ordered: list[MaterialAgent]) -> StateCourse:
        """Return what became of a state, agents as the stage counts them."""
        place = {id(agent): row for row, agent in enumerate(ordered)}
        row = np.array([place[id(agent)] for agent in self.agents.values()], dtype=np.int64)
        changes = np.array(self.changes[state.name], dtype=np.float64).reshape(-1, 3)
        generation, number = changes[:, :2].T.astype(np.int64)
        agent, value = row[number], changes[:, 2]
        return StateCourse(state.name, state.meaning, state.default, generation, agent, value)

    def _ordered(self, agents: Iterable[A]) -> list[A]:
        """Sort agents by spawn step and place."""
        return sorted(agents, key=lambda agent: (agent.spawn_step, agent.cell.coordinate))

    def _places(self, agents: Sequence[PlacedAgent]) -> Ints:
        cells = np.array([agent.cell.coordinate for agent in agents], dtype=np.int64)
        return cells.reshape(-1, self.lattice.dimension)

    def _arms_to_wakers(self, agent: MaterialAgent) -> int:
        if not agent.woken_by:
            return 0
        if agent.beyond is None:
            self._look_round([agent])
        wakers = {waker.cell.coordinate for waker in agent.woken_by}
        arms = self.lattice.arms[agent.form]
        return sum([1 << arm for arm in arms if agent.beyond[arm][0] in wakers])


class Sum:
    """Loads that are added up, and their senders."""

    __slots__ = ("senders", "total")

    def __init__(self) -> None:
        self.total = 0.0
        self.senders: list[MaterialAgent] = []


class MeetingPlace:
    """Stands for a neighbour while the loads that meet there are added up.

    In a cell of the body all loads of a state meet, at a boundary those of one sender and arm.
    """

    __slots__ = ("arm", "cell", "kind", "sums")

    def __init__(
        self, sums: dict[tuple[Any, ...], Sum], cell: Index, kind: int, arm: int = -1
    ) -> None:
        self.sums, self.cell, self.kind, self.arm = sums, cell, kind, arm

    def put(self, key: tuple[int, float], copies: float, sense: Sense, sender: Any) -> None:
        """Add a load."""
        direction, magnitude = key
        from_one = (sender, self.arm) if self.kind < 0 else (None, -1)
        place = (self.cell, self.kind, direction, sense, *from_one)
        added = self.sums.setdefault(place, Sum())
        added.total += magnitude * copies
        if sender is not None:
            added.senders.append(sender)


class Edge:
    """Where an agent meets a boundary: loads wait there until all agents have acted."""

    __slots__ = ("arm", "boundary", "leaving")

    def __init__(self, boundary: BoundaryAgent, arm: int, leaving: list[Any]) -> None:
        self.boundary, self.arm, self.leaving = boundary, arm, leaving

    def put(self, key: tuple[int, float], copies: float, sense: Sense, sender: Any) -> None:
        """Let a load wait."""
        self.leaving.append((self.boundary, Load(*key, copies, sense), sender, self.arm))


_MUST_STAY: dict[str, type] = {
    "material": Material,
    "shares": Shares,
    **dict.fromkeys(("taken", "pulled", "passed", "squeezed"), dict),
}
_EMISSION = ", which is no Emission: (arm, direction, share, sense)"


def _is_amount(value: Any) -> bool:
    """Tell whether a value is a number that is finite and not negative."""
    real = type(value) is float or isinstance(value, Real)  # the latter takes ten times as long
    return real and bool(0.0 <= value <= float_info.max)


def _table(amounts: list[dict[int, float]], columns: int) -> Floats:
    """Return dictionaries as the rows of a table."""
    rows = [[amount.get(column, 0.0) for column in range(columns)] for amount in amounts]
    return np.array(rows, dtype=np.float64).reshape(-1, columns)
