"""Load transfer with agents as objects on Mesa's cell space, to be watched and subclassed.

A generation has three parts. It begins with loads in the inboxes. Then agents act, in any order:
`MaterialAgent.step` takes each load, keeps a share, and puts the others into the boxes of its
neighbours. In the end boxes are opened: boundaries give back what has reached them, then agents
wake where loads have come, and find them in their inboxes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import chain, product
from math import inf
from operator import add
from random import Random
from typing import Any, TypeVar

import networkx
import numpy as np

from kaju import _mesa
from kaju._mesa import AgentSet, Cell, DiscreteSpace, FixedAgent, Model
from kaju.agents.boundary_agent import BOUNDARIES, BoundaryAgent
from kaju.agents.material_agent import LoadBox, MaterialAgent, PlacedAgent
from kaju.agents.own_agents import OwnAgents
from kaju.agents.parameter import State, declared
from kaju.agents.shares import Amounts, Emission, Emissions, Load, Sense, Shares, Split
from kaju.arrays import Floats, Ints
from kaju.errors import AgentError, brief
from kaju.model.scene.lattice import BUILT_IN, Lattice
from kaju.stepping import Order, chosen

from .stage import Ledger, Stage, StateCourse, TakenHistory, Totals, totals_of
from .transfer import BOUNDARY_NAMES, Transfer, check_shares

A = TypeVar("A", MaterialAgent, BoundaryAgent)
Index = tuple[int, ...]
SentOut = dict[Sense, tuple[Emissions, ...]]  # for each newton of a load: by sense and direction

MOST_REMEMBERED = 10_000
"""So many sets of emissions are kept, so that they need not be worked out for every load."""


class AgentEngine:
    """One stage of load transfer at a time, with one object per agent."""

    def __init__(
        self,
        model: Model,
        transfer: Transfer,
        material_agent: type[MaterialAgent],
        own_boundaries: Mapping[str, type[BoundaryAgent]],
    ) -> None:
        self.model, self.scene, self.transfer = model, transfer.scene, transfer
        self.lattice, self.material_agent = transfer.lattice, material_agent
        classes = BOUNDARIES | dict(own_boundaries)
        self.boundary_agents = {kind: classes[name] for kind, name in BOUNDARY_NAMES.items()}
        self.own_boundaries = bool(own_boundaries)
        self.own_classes = self.own_boundaries or material_agent is not MaterialAgent
        self.states = declared([material_agent], State)
        self.accumulate, self.threshold = transfer.rule.accumulate, transfer.rule.threshold
        self.least = 0.0 if self.accumulate else self.threshold  # sums are judged once loads met
        self.opposite: list[int] = self.lattice.opposite.tolist()
        self.axis_of: list[int] = self.lattice.axis_of.tolist()
        self.two_senses = transfer.rule.sense
        self.senses: tuple[Sense, ...] = ("push", "pull") if self.two_senses else ("push",)
        self.guard = OwnAgents(model)
        # The way over each arm, by the form of the cell that it starts in.
        self.steps = [
            {arm: tuple(self.lattice.steps[form, arm].tolist()) for arm in arms}
            for form, arms in enumerate(self.lattice.arms)
        ]
        # The scene is asked about blocks of some 256 cells, and about each but once.
        self.edge = round(256 ** (1.0 / self.lattice.dimension))
        self.seen: dict[Index, tuple[int, int, int]] = {}  # kind, number and form of cells
        self._sent: dict[tuple[Shares, int], SentOut] = {}
        self._same: dict[Any, Any] = {}  # boxes find a load sooner if equal ones are one object
        self.space = space_of(self.lattice, model.random)
        self.agents: dict[Index, MaterialAgent] = {}
        self.waking: Index | None = None  # the cell of whom loads are waking
        self.boundaries: dict[Index, BoundaryAgent] = {}

    def start(self, cells: Ints, state: Ints, magnitude: Floats, *, live_on: bool = False) -> None:
        """Put the applied loads (N) on a body without agents, or on one whose agents `live_on`."""
        if not live_on:
            self._clear()
        self.applied += float(magnitude.sum())
        pull, direction = np.divmod(state, self.lattice.directions)
        applied = (cells.tolist(), direction.tolist(), magnitude.tolist(), pull.tolist())
        for cell, along, size, pulls in zip(*applied, strict=True):
            place = tuple(cell)
            box = self.boxes.setdefault(place, LoadBox(self.called, place))
            self._bring(box, Load(along, size, 1.0, "pull" if pulls else "push"))
        self._open_boxes()

    def _clear(self) -> None:
        """Begin without agents, loads and generations."""
        for agent in (*self.agents.values(), *self.boundaries.values()):
            FixedAgent.remove(agent)
        self.agents, self.boundaries = {}, {}
        self.boxes: dict[Index, LoadBox] = {}  # of the body's cells
        self.called: list[LoadBox] = []
        self.generation = 0
        self.waiting: list[MaterialAgent] = []
        # Who took how much, by state: generation, agent, loads (N).
        self.acts: list[tuple[int, MaterialAgent, dict[int, float]]] = []
        self.record: list[tuple[Ints, Ints, Ints, Floats]] = []  # generation, place, state, load
        self.known: dict[str, dict[MaterialAgent, float]] = {name: {} for name in self.states}
        self.changes: dict[str, list[tuple[int, int, float]]] = {name: [] for name in self.states}
        self.applied = self.absorbed = 0.0
        self.taken = self.passed = self.returned = self.dropped = self.pending = 0.0

    # One generation: begin, agents act, end.

    def begin(self) -> None:
        """Count a generation, and see for whom loads wait."""
        self.generation += 1
        if len(self._same) > MOST_REMEMBERED:
            self._same.clear()
        self.waiting = [agent for agent in self.agents.values() if agent.inbox]

    acted = property(lambda self: not self.waiting or not all(a.inbox for a in self.waiting))
    """Whether an agent has taken its loads in this generation, or none had any."""

    def act(self, order: Order[MaterialAgent] | None = None) -> None:
        """Let all act for whom loads wait, or those whom an order chooses."""
        waiting = [agent for agent in self.waiting if agent.inbox]
        for agent in waiting if order is None or not waiting else chosen(order, waiting):
            agent.step()

    def end(self) -> None:
        """Let boundaries give back what has reached them, and open the boxes of those called."""
        late = [agent for agent in self.waiting if agent.inbox]  # an order has left them waiting
        left = sum((load.total for agent in late for load in agent.waiting()), start=0.0)
        self.taken += self.pending - left
        given = 0.0
        for box in [box for box in self.called if box.home is not None]:
            given += self._give_back(box)
        self.returned += given
        self._open_boxes()
        self.passed += self.pending - given
        self.pending += left
        if len(self.acts) > 20_000:
            self._settle()
        if self.own_classes:  # a slip is told when it happens; one agent for each set of names
            for agent in {tuple(vars(one)): one for one in self.waiting}.values():
                self.guard.check_names(agent)
        if self.states:
            self._note_states()

    def _give_back(self, box: LoadBox) -> float:
        """Let a boundary agent give back what one agent has handed over; return the sum (N)."""
        given, (home, arm) = 0.0, box.home
        loads = self._judged(box) if self.accumulate else dict(box)
        box.clear()
        for (direction, magnitude, sense), copies in loads.items():
            boundary = self._wake(box) if box.agent is None else box.agent
            back = boundary.answer(Load(direction, magnitude, copies, sense), arm)
            came = magnitude * copies
            if back is not None:
                given += back.total
                came -= back.total
                self._bring(home, back)
            self.absorbed += came
        return given

    def _open_boxes(self) -> None:
        """Let loads that have come to cells wait there to be taken; agents wake where they come."""
        called, self.called[:] = [box for box in self.called if box.home is None], []
        pending, self.most_at_one = 0.0, 0
        for box in called:
            loads = self._judged(box) if self.accumulate else dict(box)
            box.clear()
            if not loads:
                box.senders.clear()
                continue
            for (_, magnitude, _), copies in loads.items():
                pending += magnitude * copies
            agent = self._wake(box, loads) if box.agent is None else box.agent
            if agent.inbox:  # left by an order of your own
                for load, copies in loads.items():
                    agent.inbox[load] = agent.inbox.get(load, 0.0) + copies
            else:
                agent.inbox = loads
            self.most_at_one = max(self.most_at_one, len(agent.inbox))
        self.pending, self.awake = pending, len(self.agents)  # material agents

    def _judged(self, box: LoadBox) -> dict[tuple[int, float, Sense], float]:
        """Return the loads of a box that were added up to more than γ; the others end."""
        goes_on = {load: newtons > self.threshold for load, newtons in box.items()}
        self.dropped += sum((box[load] for load in box if not goes_on[load]), start=0.0)
        return {(load[0], box[load], load[2]): 1.0 for load in box if goes_on[load]}

    def _bring(self, box: LoadBox, load: Load) -> None:
        """Bring a load to a cell, from outside or back from a boundary."""
        if load.magnitude > self.least:
            self._put(box, load)
        else:
            self.dropped += load.total

    def _put(self, box: LoadBox, load: Load) -> tuple[int, float, Sense]:
        """Put a load into a box; return what the box calls it."""
        direction, magnitude, copies, sense = load
        if self.accumulate:
            magnitude, copies = 1.0, magnitude * copies
        key = (direction, magnitude, sense)
        box[key] += copies
        return key

    def hand_over(self, sender: Any, arm: int, load: Any) -> None:
        """Hand over a load of an agent's own making, unless it is too small."""
        if not isinstance(sender, MaterialAgent):
            told = "hand_over: who hands over comes first, as in hand_over(self, arm, load)"
            raise AgentError(f"{told}, got {brief(sender)}")
        checked, arm = self.guard.load(sender, "hand_over", load, arm), int(arm)
        if not checked.magnitude > self.least:
            sender.dropped += checked.total
            return
        sender.passed[arm] += checked.total
        box = sender._around[arm]
        box = self.box_over(sender, arm) if box is None else box
        key = self._put(box, checked)
        if box.agent is None:
            box.senders.append((sender, key))

    # What agents ask for.

    def box_over(self, agent: MaterialAgent, arm: int) -> LoadBox:
        """Return the box into which an agent puts what it hands over an arm."""
        if (step := self.steps[agent._form].get(arm)) is None:
            raise self.guard.wrong(agent, "pass_on", f"has no face along direction {arm}")
        place = tuple(map(add, agent.cell.coordinate, step))
        kind = (self.seen.get(place) or self._look_round(place))[0]
        if kind < 0:
            box = LoadBox(self.called, place, (self.boxes[agent.cell.coordinate], arm))
        else:
            box = self.boxes.setdefault(place, LoadBox(self.called, place))
        agent._around[arm] = box
        return box

    def emissions_of(self, agent: MaterialAgent) -> SentOut:
        """Return what an agent sends out for each newton by its shares: by sense and direction."""
        shares, form = agent.shares, agent._form
        if not isinstance(shares, Shares):
            raise self.guard.wrong(agent, "shares", f"must have kaju.Shares, has {brief(shares)}")
        if (sent := self._sent.get((shares, form))) is None:
            if problem := check_shares(shares, self.two_senses):
                raise self.guard.wrong(agent, "shares", problem)
            if len(self._sent) > MOST_REMEMBERED:
                self._sent.clear()
            sent = self._sent[shares, form] = {
                sense: tuple(
                    Emissions(self.transfer.emissions(shares, direction, sense, form))
                    for direction in range(self.lattice.directions)
                )
                for sense in self.senses
            }
        return sent

    def split(self, agent: MaterialAgent, emissions: Iterable[Emission], magnitude: float) -> Split:
        """Part the emissions of a load of a magnitude (N): those that go on, those that end."""
        sent: list[tuple[int, tuple[int, float, Sense], float, float]] = []
        ended = 0.0
        checked = isinstance(emissions, Emissions)
        for arm, direction, share, sense in (
            emissions if checked else self.guard.emissions(agent, emissions)
        ):
            size = share * magnitude
            if not 0.0 <= size < inf:
                raise self.guard.wrong(agent, "pass_on", f"would hand over {size} N")
            if not size > self.least:
                ended += size
            elif self.accumulate:
                sent.append((arm, (direction, 1.0, sense), size, size))
            else:
                load = (direction, size, sense)
                sent.append((arm, self._same.setdefault(load, load), size, 1.0))
        # Sums of loads that have met are hardly ever alike: nothing to remember.
        if (
            isinstance(emissions, Emissions)
            and not self.accumulate
            and len(emissions.split) < MOST_REMEMBERED
        ):
            emissions.split[magnitude] = sent, ended
        return sent, ended

    # Where agents live, and what is there.

    def _look_round(self, place: Index) -> tuple[int, int, int]:
        """Ask the scene about the block of cells that a place is in; return what is there."""
        ends = [  # cells beside the body, at -1 and beyond the last, are seen, too
            ((at + 1) // self.edge * self.edge - 1, count + 1)
            for at, count in zip(place, self.lattice.shape, strict=True)
        ]
        block = [range(first, min(first + self.edge, end)) for first, end in ends]
        cells = np.array(list(product(*block)), dtype=np.int64)
        columns = self.scene.kinds(cells), self.lattice.key(cells), self.lattice.form(cells)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        self.seen.update(zip(map(tuple, cells.tolist()), rows, strict=True))
        return self.seen[place]

    def _wake(self, box: LoadBox, loads: Iterable[tuple[int, float, Sense]] = ()) -> Any:
        """Return who lives in the cell of a box; an agent wakes if nobody does yet."""
        place = box.place
        kind = (self.seen.get(place) or self._look_round(place))[0]
        if kind < 0:
            box.agent = self.boundaries.get(place)
        if box.agent is None:
            cell: Any = self.space.cell(place, kind >= 0)
            if kind < 0:
                box.agent = self.boundaries[place] = self.boundary_agents[kind](self.model, cell)
            else:
                made_of = self.transfer.materials[kind], self.transfer.shares[kind]
                self.waking = place
                box.agent = self.agents[place] = self.material_agent(self.model, cell, *made_of)
                self.waking = None
            if self.own_classes:
                self.guard.check_begun(box.agent, place)
        if kind >= 0:  # loads that met, and ended, have woken nobody
            alive = {(direction, sense) for direction, _, sense in loads}
            came = (sender for sender, load in box.senders if (load[0], load[2]) in alive)
            box.agent.woken_by = list(dict.fromkeys(came))
        box.senders.clear()
        return box.agent

    # What has happened.

    def note_taken(self, agent: MaterialAgent, loads: Iterable[Load]) -> None:
        """Note which loads an agent takes in this generation."""
        taken, pulls = Amounts(), len(self.opposite)
        for direction, magnitude, copies, sense in loads:
            taken[direction if sense == "push" else direction + pulls] += magnitude * copies
        self.acts.append((self.generation, agent, taken))

    def _note_states(self) -> None:
        """Note what agents of your own know now, where it has changed."""
        for name, state in self.states.items():
            known, changes = self.known[name], self.changes[name]
            for number, agent in enumerate(self.agents.values()):
                value = getattr(agent, name)
                same = value == known.get(agent, state.default)
                if isinstance(same, bool | np.bool_) and same:  # of an array it is an array
                    continue
                if not state.allows(value):
                    told = f"must be a {state.kind}, and is {brief(value)}"
                    raise self.guard.wrong(agent, name, told)
                known[agent] = value
                changes.append((self.generation, number, float(value)))

    def _settle(self) -> None:
        """Lay out what was taken by generation, place and state."""
        acts, self.acts = self.acts, []
        if not acts:
            return
        sums = [taken for _, _, taken in acts]
        acted = np.array([(when, agent._key) for when, agent, _ in acts], dtype=np.int64)
        state = np.fromiter(chain.from_iterable(sums), np.int64)
        load = np.fromiter(chain.from_iterable(map(dict.values, sums)), float)
        rows = np.vstack([np.repeat(acted, list(map(len, sums)), axis=0).T, state])
        order = np.lexsort(rows[::-1])
        self.record.append((*rows[:, order], load[order]))

    @property
    def ended(self) -> float:
        """Loads that were too small, and ended (N)."""
        return self.dropped + sum(agent.dropped for agent in self.agents.values())

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        agents = self._ordered(self.agents.values())
        for agent in agents if self.own_classes else ():
            self.guard.check_books(agent)
        cells, axes = self._places(agents), len(self.lattice.axes)
        material = np.array([agent._kind for agent in agents], dtype=np.int64)
        kept = _table([agent.squeezed for agent in agents], axes)
        passed = _table([agent.passed for agent in agents], self.lattice.directions)
        dropped = np.array([agent.dropped for agent in agents])
        totals = totals_of(self.transfer, cells, material, kept, passed, dropped)
        shortened = totals.shortened
        if self.own_classes:
            every = range(axes)
            laws = [[self.guard.shortening(agent, axis) for axis in every] for agent in agents]
            shortened = np.array(laws).reshape(-1, axes)
        widening = np.array([agent.shares.widening for agent in agents])
        return totals._replace(shortened=shortened, widened=shortened * widening[:, None])

    def stage(self, factor: float) -> Stage:
        """Return what the stage has left behind so far."""
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
            absorbed=self.absorbed,
        )
        return Stage(
            **totals._asdict(),
            factor=factor,
            outcome="",  # which the ledger tells
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
            history=self._history(totals.cells),
            ledger=ledger,
            states=tuple(self._course(state, agents) for state in self.states.values()),
        )

    def _history(self, cells: Ints) -> TakenHistory:
        """Return the loads taken as a history of agents in cells."""
        none = np.empty(0, dtype=np.int64)
        columns = zip((none, none, none, np.empty(0)), *self.record, strict=True)
        generation, place, state, load = map(np.concatenate, columns)
        key = self.lattice.key(cells)
        order = np.argsort(key)
        pull, direction = np.divmod(state, self.lattice.directions)
        agent = order[np.searchsorted(key, place, sorter=order)].astype(np.int32)
        return TakenHistory(generation, agent, direction.astype(np.int8), load, pull > 0)

    def _course(self, state: State, ordered: list[MaterialAgent]) -> StateCourse:
        """Return what became of a state, agents as the stage counts them."""
        place = {id(agent): row for row, agent in enumerate(ordered)}
        row = np.array([place[id(agent)] for agent in self.agents.values()], dtype=np.int64)
        changes = np.array(self.changes[state.name], dtype=np.float64).reshape(-1, 3)
        generation, number = changes[:, :2].T.astype(np.int64)
        about = state.name, state.meaning or state.name, state.default
        counts = len(ordered), self.generation
        return StateCourse(*about, *counts, generation, row[number], changes[:, 2])

    def _ordered(self, agents: Iterable[A]) -> list[A]:
        """Sort agents by spawn step and place."""
        return sorted(agents, key=lambda agent: (agent.spawn_step, agent.cell.coordinate))

    def _places(self, agents: Sequence[PlacedAgent]) -> Ints:
        cells = np.array([agent.cell.coordinate for agent in agents], dtype=np.int64)
        return cells.reshape(-1, self.lattice.dimension)

    def _arms_to_wakers(self, agent: MaterialAgent) -> int:
        at, wakers = agent.cell.coordinate, {waker.cell.coordinate for waker in agent.woken_by}
        steps = self.steps[agent._form].items() if wakers else ()
        return sum(1 << arm for arm, step in steps if tuple(map(add, at, step)) in wakers)


def _table(amounts: list[dict[int, float]], columns: int) -> Floats:
    """Return dictionaries as the rows of a table."""
    rows = [[amount.get(column, 0.0) for column in range(columns)] for amount in amounts]
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


# Mesa's cell spaces of a body. Mesa lays all cells of a grid at once, which on a large body takes
# longer than the run. These are Mesa's own classes, so that its drawing and its neighbourhoods
# work, but a cell is made when it is looked up, and finds its neighbours when it is asked for them.


class BodyCell(Cell):
    """A cell that finds its neighbours when it is asked for them."""

    space: BodySpace
    found: dict[Index, Cell] | None = None

    @property
    def connections(self) -> dict[Index, Cell]:
        """The cells beside it, by the step that leads there."""
        if self.found is None:
            self.found = self.space.neighbours(self.coordinate)
        return self.found

    @connections.setter
    def connections(self, given: dict[Index, Cell]) -> None:
        self.found = given or None

    def __reduce__(self) -> Any:
        """Leave out the neighbours, each of which would drag along its own."""
        kept = {k: v for k, v in self.__dict__.items() if k not in ("found", "neighborhood")}
        start = partial(BodyCell, random=self.random)
        return start, (self.coordinate,), (kept, {"_agents": self._agents})


class CellsOnDemand(dict[Index, Cell]):
    """The array's cells by coordinate; asked for all of them it makes those that are missing."""

    def __init__(self, space: BodySpace) -> None:
        super().__init__()
        self.space = space

    def __missing__(self, at: Index) -> Cell:
        if not self.space.holds(at):
            raise KeyError(at)
        return self.space.cell(at, inside=True)

    def values(self) -> Any:
        """Return all cells, made by now."""
        for at in product(*map(range, self.space.dimensions)):
            self[at]
        return super().values()


class BodySpace(DiscreteSpace):
    """What the spaces of all lattices share."""

    def __init__(self, lattice: Lattice, random: Random) -> None:
        DiscreteSpace.__init__(self, random=random, cell_klass=BodyCell)
        self.lattice, self.dimensions, self.torus = lattice, lattice.shape, False
        self._ndims, self._try_random = lattice.dimension, True
        self._cells = CellsOnDemand(self)
        self.beside: dict[Index, Cell] = {}  # where boundary agents live
        self._mesa_property_layers: dict[str, Any] = {}  # Mesa 3 keeps layers of properties here
        if not hasattr(type(self), "property_layers"):
            self.property_layers: dict[str, Any] = {}  # and Mesa 4 here

    def add_property_layer(self, layer: Any) -> None:
        """Refuse layers, for which all cells would have to be made."""
        cure = f"let cells have the attribute: agent.cell.{layer.name} = 0.0"
        raise AgentError(f"{layer.name}: the space of a body has no layers; {cure}")

    def holds(self, at: Index) -> bool:
        """Tell whether a cell belongs to the array."""
        shape = self.dimensions
        return len(at) == len(shape) and all(0 <= i < n for i, n in zip(at, shape, strict=True))

    def cell(self, at: Index, inside: bool) -> Cell:
        """Return the cell with that coordinate, inside the body's array or beside it."""
        cells: dict[Index, Cell] = self._cells if inside else self.beside
        if at not in cells:
            cells[at] = cell = BodyCell(at, capacity=self.capacity, random=self.random)
            cell.space = self
        return cells[at]

    def neighbours(self, at: Index) -> dict[Index, Cell]:
        """Return the array's cells beside a cell, by the step that leads there."""
        form = int(self.lattice.form(np.array([at]))[0])
        steps = [tuple(self.lattice.steps[form, arm].tolist()) for arm in self.lattice.arms[form]]
        places = {step: tuple(map(add, at, step)) for step in steps}
        return {step: self._cells[at] for step, at in places.items() if self.holds(at)}

    @property
    def agents(self) -> AgentSet:
        """The agents in the space and beside it."""
        cells: Iterable[Cell] = (*dict.values(self._cells), *self.beside.values())
        return AgentSet([agent for cell in cells for agent in cell.agents], random=self.random)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state

    def _connect_cells(self) -> None:
        """Do nothing: cells find their neighbours themselves."""

    @property
    def _celllist(self) -> list[Cell]:
        return list(self._cells.values())


class SquareSpace(BodySpace, _mesa.OrthogonalVonNeumannGrid):
    """Squares and cubes."""


class HexagonSpace(BodySpace, _mesa.HexGrid):
    """Hexagons."""


class GraphSpace(BodySpace, _mesa.Network):
    """Cells of any other lattice."""

    @property
    def G(self) -> networkx.Graph:  # noqa: N802
        """Which cells are beside each other, as a graph of their coordinates."""
        graph = networkx.Graph()
        for cell in self._cells.values():
            graph.add_node(cell.coordinate)
            beside = [other.coordinate for other in cell.connections.values()]
            graph.add_edges_from((cell.coordinate, other) for other in beside)
        return graph


def space_of(lattice: Lattice, random: Random) -> BodySpace:
    """Return Mesa's space of a lattice, without cells yet."""
    if lattice.kind not in BUILT_IN:
        return GraphSpace(lattice, random)
    return (HexagonSpace if lattice.kind == "hexagon" else SquareSpace)(lattice, random)
