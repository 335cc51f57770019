"""Load transfer with agents as objects on Mesa's cell space, to be watched and subclassed."""

from __future__ import annotations

import copyreg
import operator
import weakref
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import networkx
import numpy as np

from kaju._mesa import Cell, HexGrid, Network, OrthogonalVonNeumannGrid
from kaju.agents.boundary_agent import (
    BoundaryAgent,
    FreeBoundaryAgent,
    RigidBoundaryAgent,
    RollerBoundaryAgent,
)
from kaju.agents.material_agent import MaterialAgent
from kaju.agents.materials import suggestion
from kaju.agents.shares import Load, Sense
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.mesa_model import Order, chosen
from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, RIGID, ROLLER
from kaju.model.scene.lattice import Lattice
from kaju.model.scene.lattices import BUILT_IN

from .stage import History, Ledger, News, Stage, Totals, collect_history

if TYPE_CHECKING:
    from random import Random

    from .load_model import LoadModel
    from .transfer import Transfer

A = TypeVar("A", MaterialAgent, BoundaryAgent)

BOUNDARY_AGENTS: dict[int, type[BoundaryAgent]] = {
    AIR: FreeBoundaryAgent,
    RIGID: RigidBoundaryAgent,
    ROLLER: RollerBoundaryAgent,
}


def boundary_classes(own: Mapping[str, type[BoundaryAgent]]) -> dict[int, type[BoundaryAgent]]:
    """Return the class for each kind of boundary, those of one's own put in.

    Raises
    ------
    ParameterError
        If there is no such boundary, or a class is no boundary agent.
    """
    classes = dict(BOUNDARY_AGENTS)
    kinds = {usual.name: kind for kind, usual in BOUNDARY_AGENTS.items()}
    for name, agent in own.items():
        if name not in kinds:
            raise ParameterError(
                f"boundary_agents: there is no boundary {name!r}{suggestion(str(name), kinds)}; "
                f"there is {', '.join(kinds)}"
            )
        if not (isinstance(agent, type) and issubclass(agent, BoundaryAgent)):
            raise ParameterError(
                f"boundary_agents: {name!r} needs a subclass of "
                f"{classes[kinds[name]].__name__}, got {agent!r}"
            )
        classes[kinds[name]] = agent
    return classes


class AgentEngine:
    """One stage of load transfer at a time, with one object per agent.

    The space is Mesa's grid, one cell wider than the body's array on every side, so that
    boundary agents have a place to live in.

    Parameters
    ----------
    model : LoadModel
        The model in which the agents live.
    scene, transfer
        What is loaded, and its rule.
    material_agent : type
        Class of the material agents.
    boundary_agents : dict of int to type
        Class of the boundary agents, by kind.
    order : callable, optional
        Who acts in a step; None: all at once.
    """

    def __init__(
        self,
        model: LoadModel,
        scene: Scene,
        transfer: Transfer,
        material_agent: type[MaterialAgent],
        boundary_agents: dict[int, type[BoundaryAgent]],
        order: Order[MaterialAgent] | None,
    ) -> None:
        self.model = model
        self.scene = scene
        self.boundary_agents = boundary_agents
        self.order = order
        self.transfer = transfer
        self.lattice = transfer.lattice
        self.material_agent = material_agent
        self.accumulate = transfer.rule.accumulate
        self.threshold = transfer.rule.threshold
        shape = tuple(count + 2 for count in self.lattice.shape)
        self.space = _space(self.lattice, shape, model.random)
        # Mesa enters the class of the cells there for ever, and with it a layer of the grid.
        weakref.finalize(self.space, copyreg.dispatch_table.pop, self.space.cell_klass, None)
        self.kinds: Ints = scene.kinds(np.indices(shape).reshape(len(shape), -1).T - 1)
        self.kinds = self.kinds.reshape(shape)
        self.steps = self.lattice.steps.tolist()
        self.agents: dict[Cell, MaterialAgent] = {}
        self.boundaries: dict[Cell, BoundaryAgent] = {}
        self._around: dict[Cell, dict[int, Cell]] = {}

    def start(self, cells: Ints, state: Ints, magnitude: Floats) -> None:
        """Put the applied loads (N) on the body; they are taken in the first step."""
        for agent in self.agents.values():
            agent.remove()
        for boundary in self.boundaries.values():
            boundary.remove()
        self.agents, self.boundaries = {}, {}
        self.generation = 0
        self.post: list[tuple[MaterialAgent, int, Load]] = []
        self.record: list[list[tuple[MaterialAgent, int, float]]] = []
        self.applied = float(magnitude.sum())
        self.taken = self.passed = self.returned = self.dropped = 0.0
        arriving: list[tuple[Cell, Load, MaterialAgent | None]] = []
        applied = zip((cells + 1).tolist(), state.tolist(), magnitude.tolist(), strict=True)
        for cell, number, size in applied:
            pull, direction = divmod(number, self.lattice.directions)
            load = Load(direction, size, 1.0, "pull" if pull else "push")
            arriving.append((self.space[tuple(cell)], load, None))
        self._arrive(arriving)

    @property
    def pending(self) -> float:
        """Sum of the loads that wait to be taken (N)."""
        total = 0.0
        for agent in self.agents.values():
            for waiting in (agent.inbox, agent.pulls):
                for (_, magnitude), copies in waiting.items():
                    total += magnitude * copies
        return total

    def step(self) -> None:
        """Let every agent take the loads that reached it and pass them on."""
        acting = self._acting()
        taken = self._arrived(acting)
        self.taken += sum(load for _, _, load in taken)
        self.record.append(taken)
        self.generation += 1
        for agent in acting:
            agent.step()
        self._deliver()

    @property
    def awake(self) -> int:
        """Number of material agents."""
        return len(self.agents)

    def _acting(self) -> list[MaterialAgent]:
        """Return who acts in this step: all agents, unless an order chooses."""
        everybody = list(self.agents.values())
        if self.order is None:
            return everybody
        waiting = [agent for agent in everybody if agent.inbox or agent.pulls]
        return chosen(self.order, waiting)

    def _arrived(self, acting: list[MaterialAgent]) -> list[tuple[MaterialAgent, int, float]]:
        """Return what these agents will take, added up by agent and state, ordered by place."""
        sums: dict[tuple[MaterialAgent, int], float] = {}
        pulls = self.lattice.directions
        awake = [agent for agent in acting if agent.inbox or agent.pulls]
        for agent in sorted(awake, key=lambda agent: agent.cell.coordinate):
            for first, waiting in ((0, agent.inbox), (pulls, agent.pulls)):
                for direction, magnitude in sorted(waiting):
                    load = magnitude * waiting[direction, magnitude]
                    key = (agent, first + direction)
                    sums[key] = sums.get(key, 0.0) + load
        return [(agent, state, load) for (agent, state), load in sums.items()]

    def neighbour(self, cell: Cell, arm: int) -> Cell:
        """Return the cell over an arm."""
        around = self._around.get(cell)
        if around is None:
            around = self._around[cell] = self._neighbours(cell)
        reached = around.get(arm)
        if reached is None:
            raise ParameterError(
                f"arm: cell {tuple(count - 1 for count in cell.coordinate)} has no face along "
                f"direction {arm}; lattice.way(direction, agent.form) tells what lies ahead"
            )
        return reached

    def _neighbours(self, cell: Cell) -> dict[int, Cell]:
        """Return the cells over all arms of a cell of the body."""
        at, form = cell.coordinate, 0
        if self.lattice.forms > 1:  # the rim shifts the space by one cell against the scene
            form = self.model.form(tuple(count - 1 for count in at))
        steps = self.steps[form]
        return {
            arm: self.space[tuple(map(operator.add, at, steps[arm]))]
            for arm in self.lattice.arms[form]
        }

    def hand_over(self, sender: MaterialAgent, arm: int, load: Load) -> None:
        """Keep a load until all agents have stepped."""
        sender.passed[arm] = sender.passed.get(arm, 0.0) + load.total
        self.post.append((sender, arm, load))

    def _deliver(self) -> None:
        """Bring the handed loads to the neighbours, or back from a boundary to the sender."""
        arriving: list[tuple[Cell, Load, MaterialAgent | None]] = []
        leaving: list[tuple[MaterialAgent, int, Load]] = []
        for sender, arm, load in self.post:
            target = self.neighbour(sender.cell, arm)
            if self.kinds[target.coordinate] >= 0:
                arriving.append((target, load, sender))
            else:
                leaving.append((sender, arm, load))
        self.post = []
        for sender, arm, load in self._add_up(leaving) if self.accumulate else leaving:
            boundary = self._boundary_agent(self.neighbour(sender.cell, arm))
            back = boundary.answer(load, arm)
            given = 0.0 if back is None else back.total
            if back is not None:
                arriving.append((sender.cell, back, None))
            self.returned += given
            self.passed -= given
        self.passed += self._arrive(arriving)

    def _add_up(
        self, leaving: list[tuple[MaterialAgent, int, Load]]
    ) -> Iterable[tuple[MaterialAgent, int, Load]]:
        """Add the loads in one state that one agent hands to one boundary."""
        sums: dict[tuple[MaterialAgent, int, int, Sense], float] = {}
        for sender, arm, load in leaving:
            key = (sender, arm, load.direction, load.sense)
            sums[key] = sums.get(key, 0.0) + load.total
        for (sender, arm, direction, sense), total in sums.items():
            if total > self.threshold:
                yield sender, arm, Load(direction, total, 1.0, sense)
            else:
                self.dropped += total

    def _arrive(self, arriving: list[tuple[Cell, Load, MaterialAgent | None]]) -> float:
        """Judge the loads that meet in a cell, and wake agents for those above the threshold."""
        meeting: dict[tuple[Cell, int, Sense, float], list[tuple[Load, MaterialAgent | None]]] = {}
        for cell, load, sender in arriving:
            alike = 0.0 if self.accumulate else load.magnitude
            key = (cell, load.direction, load.sense, alike)
            meeting.setdefault(key, []).append((load, sender))
        accepted = 0.0
        for (cell, direction, sense, magnitude), met in meeting.items():
            total = sum(load.total for load, _ in met)
            load = Load(direction, magnitude, sum(load.copies for load, _ in met), sense)
            if self.accumulate:
                load = Load(direction, total, 1.0, sense)
            if load.magnitude > self.threshold:
                senders = [sender for _, sender in met if sender is not None]
                self._material_agent(cell).receive(load, senders)
                accepted += total
            else:
                self.dropped += total
        return accepted

    def _material_agent(self, cell: Cell) -> MaterialAgent:
        if cell not in self.agents:
            number = self.kinds[cell.coordinate]
            material, shares = self.transfer.materials[number], self.transfer.shares[number]
            self.agents[cell] = self.material_agent(self.model, cell, material, shares)
        return self.agents[cell]

    def _boundary_agent(self, cell: Cell) -> BoundaryAgent:
        if cell not in self.boundaries:
            kind = self.boundary_agents[int(self.kinds[cell.coordinate])]
            self.boundaries[cell] = kind(self.model, cell)
        return self.boundaries[cell]

    def since(self, generation: int, agents: int) -> News:
        """Return what came after a generation, and after so many agents."""
        parts = enumerate(self.record[generation:], start=generation + 1)
        rows = [(g, *row) for g, part in parts for row in part]
        born = list(self.agents.values())[agents:]
        return News(
            np.array([g for g, _, _, _ in rows], dtype=np.int64),
            self.lattice.key(self._places([agent for _, agent, _, _ in rows])),
            np.array([state for _, _, state, _ in rows], dtype=np.int64),
            np.array([load for _, _, _, load in rows]),
            self.lattice.key(self._places(born)),
            np.array([agent.spawn_step for agent in born], dtype=np.int64),
            np.array([self._arms_to_wakers(agent) for agent in born], dtype=np.int64),
        )

    def totals(self) -> Totals:
        """Return what each agent has done by now."""
        agents = self._ordered(self.agents.values())
        cells, axes = self._places(agents), len(self.lattice.axes)
        kept = _table([agent.squeezed for agent in agents], axes)
        if self.material_agent.shortening is MaterialAgent.shortening:  # asked of all at once
            modulus = np.array([agent.material.youngs_modulus for agent in agents])
            shortened = kept / (self.transfer.cross_section * modulus[:, None])
        else:
            laws = [[agent.shortening(axis) for axis in range(axes)] for agent in agents]
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

    def stage(self, factor: float, outcome: str) -> Stage:
        """Return what the stage has left behind so far."""
        agents = self._ordered(self.agents.values())
        boundaries = self._ordered(self.boundaries.values())
        boundary_cells, directions = self._places(boundaries), self.lattice.directions
        taken, totals = _table([agent.taken for agent in agents], directions), self.totals()
        return Stage(
            **totals._asdict(),
            factor=factor,
            outcome=outcome,
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
            history=self._history(agents),
            ledger=Ledger(
                applied=self.applied,
                taken=float(taken.sum()),
                kept=sum((agent.kept for agent in agents), start=0.0),
                emitted=float(totals.passed.sum() + totals.dropped.sum()),
                passed=self.passed,
                returned=self.returned,
                dropped=self.dropped + float(totals.dropped.sum()),
                pending=self.pending,
                absorbed=sum((boundary.kept for boundary in boundaries), start=0.0),
            ),
        )

    def _ordered(self, agents: Iterable[A]) -> list[A]:
        """Sort agents by spawn step and place."""
        return sorted(agents, key=lambda agent: (agent.spawn_step, *agent.cell.coordinate))

    def _places(self, agents: Sequence[MaterialAgent] | Sequence[BoundaryAgent]) -> Ints:
        """Return the cells of agents, without the rim."""
        cells = np.array([agent.cell.coordinate for agent in agents], dtype=np.int64)
        return cells.reshape(-1, self.lattice.dimension) - 1

    def _history(self, agents: list[MaterialAgent]) -> History:
        number = {agent: row for row, agent in enumerate(agents)}
        record = [
            (
                np.array([number[agent] for agent, _, _ in rows], dtype=np.int64),
                np.array([state for _, state, _ in rows], dtype=np.int64),
                np.array([load for _, _, load in rows]),
            )
            for rows in self.record
        ]
        return collect_history(record, self.lattice.directions)

    def _arms_to_wakers(self, agent: MaterialAgent) -> int:
        wakers = {waker.cell for waker in agent.woken_by}
        arms = self.lattice.arms[agent.form]
        return sum(1 << arm for arm in arms if self.neighbour(agent.cell, arm) in wakers)


def _space(lattice: Lattice, shape: tuple[int, ...], random: Random) -> Any:
    """Return Mesa's space of the array and a rim of one cell, joined as the lattice is."""
    if lattice.kind in BUILT_IN:
        grid = HexGrid if lattice.kind == "hexagon" else OrthogonalVonNeumannGrid
        return grid(shape, torus=False, random=random)
    graph = networkx.Graph()
    cells = np.indices(shape).reshape(len(shape), -1).T
    graph.add_nodes_from(map(tuple, cells.tolist()))
    for arm in range(lattice.directions):
        reached = lattice.neighbours(cells - 1, arm) + 1
        joined = np.all((reached >= 0) & (reached < shape), axis=1)
        joined &= np.any(reached != cells, axis=1)
        ends = (map(tuple, column[joined].tolist()) for column in (cells, reached))
        graph.add_edges_from(zip(*ends, strict=True))
    return Network(graph, random=random)


def _table(amounts: list[dict[int, float]], columns: int) -> Floats:
    """Return dictionaries as the rows of a table."""
    table = np.zeros((len(amounts), columns))
    for row, amount in enumerate(amounts):
        for column, load in amount.items():
            table[row, column] = load
    return table
