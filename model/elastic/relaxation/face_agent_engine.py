"""The elastic rule with agents as objects, to be watched and subclassed."""

from __future__ import annotations

from math import isfinite
from typing import Any

import networkx
import numpy as np

from kaju._mesa import Cell, Network
from kaju.agents.face_agent import FaceAgent, Place
from kaju.agents.own_agents import OwnAgents
from kaju.agents.parameter import is_number
from kaju.arrays import Floats, Ints
from kaju.errors import brief
from kaju.model.elastic.relaxation.push_state import PushEngine
from kaju.model.elastic.relaxation.push_table import PushTable, cells_beside
from kaju.model.scene.cell_types import AIR
from kaju.stepping import Order, chosen


class AgentPushEngine(PushEngine):
    """Lets agents act, with one object per agent.

    The space is a network that grows with the agents: each brings its cell, linked to those that it
    hands shares to.
    """

    def __init__(self, model: Any, table: PushTable, face_agent: type[FaceAgent]) -> None:
        self.model, self.face_agent = model, face_agent
        self.guard, self.own = OwnAgents(model), face_agent is not FaceAgent
        self.agents: list[dict[int, FaceAgent]] = []
        super().__init__(table)

    def reset(self) -> None:
        """Put the loads on the body, before any agent has yielded."""
        for agents in self.agents:
            for agent in agents.values():
                agent.remove()
        super().reset()
        self.space = Network(networkx.Graph(), random=self.model.random)
        self.agents = [{} for _ in self.table.levels]
        self.outbox: list[tuple[int, float]] | None = None

    def relax_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own: a Jacobi step."""
        state, faces = self.state, self.state.levels[level]
        agents = [self.agent(level, number) for number in acting.tolist()]
        left, moved = faces.left[acting], faces.displacement[acting]
        outbox = self.outbox = []
        for agent, load in zip(agents, loads.tolist(), strict=True):
            self._act(agent, load)
        self.outbox = None
        for target, load in outbox:
            faces.left[target] += load
        yielded = faces.displacement[acting] - moved
        state.energy -= 0.5 * float(yielded @ (left + faces.left[acting]))
        state.pushes += len(acting)

    def relax_in_turn(self, level: int, backward: bool) -> None:
        """Let the agents of a level above γ act one after another: a Gauss-Seidel sweep."""
        faces = self.state.levels[level]
        numbers = range(len(faces.weight))
        for number in reversed(numbers) if backward else numbers:
            if abs(faces.left[number]) * faces.weight[number] > self.state.threshold:
                self._push(level, number)

    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""
        faces = self.state.levels[0]
        measured = faces.measured
        for _ in range(count):
            number = int(np.argmax(measured))
            if not measured[number] > self.state.threshold:
                return
            agent = self._push(0, number)
            for face in (number, *dict(agent.place.links)):
                if face < len(measured):
                    measured[face] = abs(faces.left[face]) * faces.weight[face]

    def relax_chosen(self, order: Order[FaceAgent]) -> None:
        """Let the agents act that an order chooses from those above γ, in turn."""
        waiting = np.flatnonzero(self.state.levels[0].measured > self.state.threshold)
        for agent in chosen(order, [self.agent(0, number) for number in waiting.tolist()]):
            self._push(0, agent.place.number)

    def _push(self, level: int, number: int) -> FaceAgent:
        """Let one agent act, and book the energy that it releases."""
        faces = self.state.levels[level]
        before, moved = faces.left[number], faces.displacement[number]
        agent = self.agent(level, number)
        self._act(agent, agent.left)
        yielded = faces.displacement[number] - moved
        self.state.energy -= 0.5 * float(yielded * (before + faces.left[number]))
        self.state.pushes += 1
        return agent

    def _act(self, agent: FaceAgent, load: float) -> None:
        """Let an agent act; what it leaves must be numbers."""
        before = agent.left, agent.displacement
        agent.act(load)
        if (agent.left, agent.displacement) != before:
            self.idle = 0
        if self.own and not (isfinite(agent.left) and isfinite(agent.displacement)):
            what = f"has left {agent.left} N and moved by {agent.displacement} m"
            raise self.guard.wrong(agent, "take", what)

    def hand_over(self, sender: FaceAgent, target: int, load: float) -> None:
        """Bring a load to a face or support: at once, or when all agents of a wave have acted."""
        left = self.state.levels[sender.level].left
        if self.own and not (is_number(load) and target in range(len(left))):
            over = f"hands over {brief(load)} N to {brief(target)}"
            what = f"{over}; its neighbours are `place.links`"
            raise self.guard.wrong(sender, "hand_over", what)
        if self.outbox is not None:
            self.outbox.append((target, load))
        else:
            left[target] += load

    def agent(self, level: int, number: int) -> FaceAgent:
        """Return the agent of a face; it spawns if there is none yet."""
        agents = self.agents[level]
        if number not in agents:
            place, faces = self._place(level, number), self.state.levels[level]
            cell = Cell((level, place.axis, *place.index), random=self.model.random)
            self.space.add_cell(cell)
            agents[number] = self.face_agent(self.model, cell, place, faces)
            self.guard.check_begun(agents[number], place.index)
            faces.spawn_step[number] = agents[number].spawn_step
            for target, _ in place.links:
                if target in agents:
                    self.space.add_connection(cell, agents[target].cell)
        return agents[number]

    def _place(self, level: int, number: int) -> Place:
        table, agents = self.table, self.table.levels[level]
        axis, index = (values[[number]] for values in agents.place)
        shares = agents.shares
        row = slice(shares.indptr[number], shares.indptr[number + 1])
        materials = []
        if level == 0:
            kinds = [int(table.problem.kinds[tuple(*cell)]) for cell in cells_beside(axis, index)]
            materials = [table.grid.cell_materials[kind] for kind in kinds if kind > AIR]
        return Place(
            level,
            number,
            int(axis[0]),
            tuple((index[0] - 1 + (np.array(table.origin) if level == 0 else 0)).tolist()),
            table.positions(level)[number],
            tuple(materials),
            float(agents.stiffness[number]),
            tuple(zip(shares.indices[row].tolist(), shares.data[row].tolist(), strict=True)),
        )
