"""The elastic rule with agents as objects, to be watched and subclassed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import networkx
import numpy as np

from kaju._mesa import Cell, FixedAgent, Network
from kaju.agents.boundary_agent import FreeBoundaryAgent
from kaju.agents.face_agent import FaceAgent, Link, Place, SupportAgent
from kaju.arrays import Floats, Ints
from kaju.model.elastic.relaxation.push_state import PushState
from kaju.model.elastic.relaxation.push_table import PushTable
from kaju.model.scene.cell_types import AIR
from kaju.stepping import Order, chosen

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.elastic_model import ElasticModel


class AgentPushEngine:
    """Lets agents act, level by level, with one object per agent.

    The space is a network that grows with the agents: each brings its cell, linked to those that it
    hands shares to.
    """

    def __init__(
        self, model: ElasticModel, table: PushTable, face_agent: type[FaceAgent] = FaceAgent
    ) -> None:
        self.model, self.table = model, table
        self.holding, self.open_air = table.holding, table.open_air
        self.face_agent = face_agent
        self.agents: list[dict[int, FaceAgent]] = []
        self.air: dict[int, FreeBoundaryAgent] = {}
        self.supports: dict[int, SupportAgent] = {}
        self._openings = self.open_air.links.T.tocsr()
        self.reset()

    def reset(self) -> None:
        """Put the loads on the body, before anybody has yielded."""
        faces = [agent for agents in self.agents for agent in agents.values()]
        everybody: list[FixedAgent] = [*faces, *self.air.values(), *self.supports.values()]
        for agent in everybody:
            agent.remove()
        self.state = PushState(self.table)
        self.space = Network(networkx.Graph(), random=self.model.random)
        self.cells: dict[tuple[object, ...], Cell] = {}
        self.agents = [{} for _ in self.table.levels]
        self.air, self.supports = {}, {}
        self.post: list[tuple[int, float]] | None = None

    def push_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own."""
        state, ground = self.state, self.state.grounds[level]
        agents = [self.agent(level, number) for number in acting.tolist()]
        left, moved = ground.left[acting], ground.displacement[acting]
        self.post = []
        for agent, load in zip(agents, loads.tolist(), strict=True):
            agent.act(load)
        post, self.post = self.post, None
        for target, load in post:
            ground.left[target] += load
        yielded = ground.displacement[acting] - moved
        state.energy -= 0.5 * float(yielded @ (left + ground.left[acting]))
        state.pushes += len(acting)

    def push_in_turn(self, level: int, backward: bool) -> int:
        """Let the agents of a level above the threshold act one after another."""
        ground, threshold = self.state.grounds[level], self.state.threshold
        numbers = range(len(ground.weight))
        pushes = 0
        for number in reversed(numbers) if backward else numbers:
            if abs(ground.left[number]) * ground.weight[number] > threshold:
                self._push(level, number)
                pushes += 1
        return pushes

    def push_largest(self, count: int) -> int:
        """Let the agent with the largest load act, `count` times."""
        ground = self.state.grounds[0]
        measured = self.state.measured(0)
        for pushes in range(count):
            number = int(np.argmax(measured))
            if not measured[number] > self.state.threshold:
                return pushes
            agent = self._push(0, number)
            for face in (number, *(link.target for link in agent.place.links)):
                if face < len(measured):
                    measured[face] = abs(ground.left[face]) * ground.weight[face]
        return count

    def push_chosen(self, order: Order[FaceAgent]) -> None:
        """Let those act whom an order chooses from the agents above the threshold, in turn."""
        waiting = np.flatnonzero(self.state.measured(0) > self.state.threshold)
        for agent in chosen(order, [self.agent(0, number) for number in waiting.tolist()]):
            self._push(0, agent.place.number)

    def _push(self, level: int, number: int) -> FaceAgent:
        """Let one agent act, and book the energy that it releases."""
        ground = self.state.grounds[level]
        before, moved = ground.left[number], ground.displacement[number]
        agent = self.agent(level, number)
        agent.act(agent.left)
        yielded = ground.displacement[number] - moved
        self.state.energy -= 0.5 * float(yielded * (before + ground.left[number]))
        self.state.pushes += 1
        return agent

    def hand_over(self, sender: FaceAgent, target: int, load: float) -> None:
        """Bring a load to a face or support at once, or keep it until the wave has passed."""
        if self.post is not None:
            self.post.append((target, load))
        else:
            self.state.grounds[sender.level].left[target] += load

    def agent(self, level: int, number: int) -> FaceAgent:
        """Return the agent of a face; it spawns if there is none yet."""
        agents = self.agents[level]
        if number not in agents:
            place = self._place(level, number)
            cell = self._cell(("face", level, place.axis, *place.index))
            agents[number] = self.face_agent(self.model, cell, place, self.state.grounds[level])
            self.state.grounds[level].spawn_step[number] = agents[number].spawn_step
            for link in place.links:
                if link.target in agents:
                    self.space.add_connection(cell, agents[link.target].cell)
        return agents[number]

    def boundary_agent(self, number: int) -> FreeBoundaryAgent:
        """Return the agent of an air cell; it spawns if there is none yet."""
        if number not in self.air:
            cell = self._cell(("air", *(self.open_air.cells[number] + self.table.origin).tolist()))
            self.air[number] = FreeBoundaryAgent(self.model, cell)
        return self.air[number]

    def wake_supports(self) -> None:
        """Let an agent spawn in every supporting cell that a load has reached."""
        table, state = self.table, self.state
        axes, faces = table.place_axes, table.levels[0].size
        kinds = table.grid.kinds(self.holding.cells + table.origin)
        for number in np.flatnonzero(self.holding.first(state.place_step)).tolist():
            if number in self.supports:
                continue
            links = self.holding.links
            row = slice(links.indptr[number], links.indptr[number + 1])
            held = tuple(
                (int(axes[place]), faces + int(place), float(part))
                for place, part in zip(links.indices[row], links.data[row], strict=True)
            )
            cell = self._cell(("support", *(self.holding.cells[number] + table.origin).tolist()))
            agent = SupportAgent(self.model, cell, int(kinds[number]), state.grounds[0], held)
            agent.spawn_step = max(state.generation, 1)
            self.supports[number] = agent

    def _cell(self, name: tuple[object, ...]) -> Cell:
        if name not in self.cells:
            self.cells[name] = Cell(name, random=self.model.random)
            self.space.add_cell(self.cells[name])
        return self.cells[name]

    def _place(self, level: int, number: int) -> Place:
        table = self.table
        axes, indices = table.levels[level].place
        axis, index = int(axes[number]), indices[number]
        links = _row(table.levels[level].shares, number)
        materials = []
        if level == 0:
            low = index.copy()
            low[axis] -= 1
            kinds = [int(table.problem.kinds[tuple(cell)]) for cell in (low, index)]
            materials = [table.grid.cell_materials[kind] for kind in kinds if kind > AIR]
        return Place(
            level,
            number,
            axis,
            tuple((index - 1 + (np.array(table.origin) if level == 0 else 0)).tolist()),
            table.positions(level)[number],
            tuple(materials),
            float(table.levels[level].stiffness[number]),
            links,
            _row(self._openings, number) if level == 0 else (),
        )


def _row(matrix: object, number: int) -> tuple[Link, ...]:
    """Return one row of a sparse array as links."""
    indptr, indices, data = matrix.indptr, matrix.indices, matrix.data  # type: ignore[attr-defined]
    row = slice(indptr[number], indptr[number + 1])
    return tuple(map(Link, indices[row].tolist(), data[row].tolist()))
