"""Load transfer with agents as objects on Mesa's cell space, to be watched and subclassed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from mesa.discrete_space import Cell, HexGrid, OrthogonalVonNeumannGrid

from kaju.agents.boundary_agent import (
    BoundaryAgent,
    FreeBoundaryAgent,
    RigidBoundaryAgent,
    RollerBoundaryAgent,
)
from kaju.agents.load import Load
from kaju.agents.material_agent import MaterialAgent
from kaju.model.scene.kinds import AIR, RIGID, ROLLER

from .stage import FloatArray, History, IntArray, Ledger, Stage, collect_history

if TYPE_CHECKING:
    from kaju.model.scene import Scene

    from .load_model import LoadModel
    from .transfer import Transfer

A = TypeVar("A", MaterialAgent, BoundaryAgent)

BOUNDARY_AGENTS: dict[int, type[BoundaryAgent]] = {
    AIR: FreeBoundaryAgent,
    RIGID: RigidBoundaryAgent,
    ROLLER: RollerBoundaryAgent,
}


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
    """

    def __init__(
        self,
        model: LoadModel,
        scene: Scene,
        transfer: Transfer,
        material_agent: type[MaterialAgent] = MaterialAgent,
    ) -> None:
        self.model = model
        self.scene = scene
        self.transfer = transfer
        self.lattice = transfer.lattice
        self.material_agent = material_agent
        self.accumulate = transfer.rule.accumulate
        self.threshold = transfer.rule.threshold
        shape = tuple(count + 2 for count in self.lattice.shape)
        grid = HexGrid if self.lattice.kind == "hexagon" else OrthogonalVonNeumannGrid
        self.space = grid(shape, torus=False, random=model.random)
        self.kinds: IntArray = scene.kinds(np.indices(shape).reshape(len(shape), -1).T - 1)
        self.kinds = self.kinds.reshape(shape)
        self.steps = self.lattice.steps.tolist()
        self.agents: dict[Cell, MaterialAgent] = {}
        self.boundaries: dict[Cell, BoundaryAgent] = {}

    def start(self, cells: IntArray, direction: IntArray, magnitude: FloatArray) -> None:
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
        self.passed = self.returned = self.dropped = 0.0
        places = [self.space[tuple(cell)] for cell in (cells + 1).tolist()]
        loads = [Load(*load) for load in zip(direction.tolist(), magnitude.tolist(), strict=True)]
        self._arrive([(cell, load, None) for cell, load in zip(places, loads, strict=True)])

    @property
    def pending(self) -> float:
        """Sum of the loads that wait to be taken (N)."""
        return sum(
            (
                m * copies
                for agent in self.agents.values()
                for (_, m), copies in agent.inbox.items()
            ),
            start=0.0,
        )

    def step(self) -> None:
        """Let every agent take the loads that reached it and pass them on."""
        self.record.append(self._arrived())
        self.generation += 1
        self.model.agents_by_type[self.material_agent].do("step")
        self._deliver()

    def _arrived(self) -> list[tuple[MaterialAgent, int, float]]:
        """Return what waits to be taken, added up by agent and direction, ordered by place."""
        sums: dict[tuple[MaterialAgent, int], float] = {}
        for agent in sorted(self.agents.values(), key=lambda agent: agent.cell.coordinate):
            for direction, magnitude in sorted(agent.inbox):
                load = magnitude * agent.inbox[direction, magnitude]
                sums[agent, direction] = sums.get((agent, direction), 0.0) + load
        return [(agent, direction, load) for (agent, direction), load in sums.items()]

    def neighbour(self, cell: Cell, arm: int) -> Cell:
        """Return the cell over an arm."""
        # The rim shifts rows by one, so the parity of a row is the other one here.
        parity = (cell.coordinate[1] - 1) & 1
        return cell.connections[tuple(self.steps[parity][arm])]

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
            arriving.append((sender.cell, boundary.give_back(load, arm), None))
            self.returned += load.total
            self.passed -= load.total
        self.passed += self._arrive(arriving)

    def _add_up(
        self, leaving: list[tuple[MaterialAgent, int, Load]]
    ) -> Iterable[tuple[MaterialAgent, int, Load]]:
        """Add the loads that one agent hands to one boundary along one direction."""
        sums: dict[tuple[MaterialAgent, int, int], float] = {}
        for sender, arm, load in leaving:
            key = (sender, arm, load.direction)
            sums[key] = sums.get(key, 0.0) + load.total
        for (sender, arm, direction), total in sums.items():
            if total > self.threshold:
                yield sender, arm, Load(direction, total)
            else:
                self.dropped += total

    def _arrive(self, arriving: list[tuple[Cell, Load, MaterialAgent | None]]) -> float:
        """Judge the loads that meet in a cell, and wake agents for those above the threshold."""
        meeting: dict[tuple[Cell, int, float], list[tuple[Load, MaterialAgent | None]]] = {}
        for cell, load, sender in arriving:
            alike = 0.0 if self.accumulate else load.magnitude
            meeting.setdefault((cell, load.direction, alike), []).append((load, sender))
        accepted = 0.0
        for (cell, direction, magnitude), met in meeting.items():
            total = sum(load.total for load, _ in met)
            load = Load(direction, magnitude, sum(load.copies for load, _ in met))
            if self.accumulate:
                load = Load(direction, total)
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
            kind = BOUNDARY_AGENTS[int(self.kinds[cell.coordinate])]
            self.boundaries[cell] = kind(self.model, cell)
        return self.boundaries[cell]

    def stage(self, factor: float, outcome: str) -> Stage:
        """Return what the stage has left behind so far."""
        agents = self._ordered(self.agents.values())
        boundaries = self._ordered(self.boundaries.values())
        cells, boundary_cells = self._places(agents), self._places(boundaries)
        passed = self._by_direction([agent.passed for agent in agents])
        dropped = np.array([agent.dropped for agent in agents])
        taken = self._by_direction([agent.taken for agent in agents])
        return Stage(
            factor=factor,
            outcome=outcome,
            generations=self.generation,
            cells=cells,
            material=self.scene.kinds(cells),
            spawn_step=np.array([agent.spawn_step for agent in agents], dtype=np.int64),
            woken_by=np.array([self._arms_to_wakers(a) for a in agents], dtype=np.int64),
            taken=taken,
            passed=passed,
            dropped=dropped,
            boundary_cells=boundary_cells,
            boundary_kind=self.scene.kinds(boundary_cells),
            boundary_spawn_step=np.array([b.spawn_step for b in boundaries], dtype=np.int64),
            returned=np.array([boundary.returned for boundary in boundaries]),
            history=self._history(agents),
            ledger=Ledger(
                applied=self.applied,
                taken=float(taken.sum()),
                kept=sum((agent.kept for agent in agents), start=0.0),
                emitted=float(passed.sum() + dropped.sum()),
                passed=self.passed,
                returned=self.returned,
                dropped=self.dropped + float(dropped.sum()),
                pending=self.pending,
            ),
        )

    def _ordered(self, agents: Iterable[A]) -> list[A]:
        """Sort agents by spawn step and place."""
        return sorted(agents, key=lambda agent: (agent.spawn_step, *agent.cell.coordinate))

    def _places(self, agents: Sequence[MaterialAgent] | Sequence[BoundaryAgent]) -> IntArray:
        """Return the cells of agents, without the rim."""
        cells = np.array([agent.cell.coordinate for agent in agents], dtype=np.int64)
        return cells.reshape(-1, self.lattice.dimension) - 1

    def _history(self, agents: list[MaterialAgent]) -> History:
        number = {agent: row for row, agent in enumerate(agents)}
        record = [
            (
                np.array([number[agent] for agent, _, _ in rows], dtype=np.int64),
                np.array([direction for _, direction, _ in rows], dtype=np.int64),
                np.array([load for _, _, load in rows]),
            )
            for rows in self.record
        ]
        return collect_history(record)

    def _by_direction(self, amounts: list[dict[int, float]]) -> FloatArray:
        table = np.zeros((len(amounts), self.lattice.directions))
        for row, amount in enumerate(amounts):
            for direction, load in amount.items():
                table[row, direction] = load
        return table

    def _arms_to_wakers(self, agent: MaterialAgent) -> int:
        wakers = {waker.cell for waker in agent.woken_by}
        arms = range(self.lattice.directions)
        return sum(1 << arm for arm in arms if self.neighbour(agent.cell, arm) in wakers)
