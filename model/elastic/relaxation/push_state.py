"""What the faces of all levels carry, and what orders of work ask of the agents on them.

Loads rest on the faces, whether an agent stands there or not; agents act on what rests there.
Restricting loads to parents and prolonging displacements to children is the same for agents as
objects and as arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from kaju.agents.face_agent import FaceAgent
from kaju.arrays import Floats, Ints
from kaju.model.elastic.relaxation.push_table import PushTable
from kaju.stepping import Order


@dataclass(frozen=True, eq=False)
class LevelState:
    """The faces of one level."""

    left: Floats  # Residual: load (N) on each face; on the finest level then those of the supports
    displacement: Floats  # How far each face has moved (m); of parents, in their current visit
    taken: Floats  # Sum of the sizes of the loads (N) that each agent has taken
    spawn_step: Ints  # Step in which each agent spawned, 0 while there is none
    weight: Floats  # By how much a load on a face counts against the threshold

    @property
    def measured(self) -> Floats:
        """The residual loads of the faces as they count against γ (N)."""
        return np.abs(self.left[: len(self.weight)]) * self.weight


class PushState:
    """Loads and displacements on all levels, finest first.

    `place_step` is the step in which a load first reached each support, 0 before; `energy` that of
    body and loads together (J), 0 at the start: every step lowers it.
    """

    def __init__(self, table: PushTable) -> None:
        self.table, self.threshold = table, table.threshold
        self.levels = []
        for number, level in enumerate(table.levels):
            left = np.zeros(level.shares.shape[1])
            moved, taken = np.zeros(level.size), np.zeros(level.size)
            step = np.zeros(level.size, dtype=np.int64)
            self.levels.append(LevelState(left, moved, taken, step, table.weight(number)))
        self.levels[0].left[: len(table.load)] = table.load
        self.energy = 0.0
        self.pushes = 0
        self.generation = 0
        self.place_step = np.zeros(len(table.load) - table.levels[0].size, dtype=np.int64)
        self.note_supports()

    def restrict(self, level: int) -> None:
        """Sum the residual loads of a level up to loads of their parents."""
        children, parents = self.levels[level], self.levels[level + 1]
        parents.left[:] = self.table.levels[level].restrict @ children.left[: children.weight.size]
        parents.displacement[:] = 0.0

    def prolong(self, level: int) -> None:
        """Move the children of a level along with their parents, and pass their loads on."""
        finer, faces = self.table.levels[level - 1], self.levels[level - 1]
        assert finer.prolong is not None
        moved = finer.prolong @ self.levels[level].displacement
        faces.displacement[:] += moved
        load = finer.stiffness * moved
        faces.left[: finer.size] -= load
        faces.left[:] += finer.arrivals @ load

    def direct_loads(self, level: int) -> Floats:
        """Return the loads that agents of a small level must take for none to be left."""
        agents, faces = self.table.levels[level], self.levels[level]
        own = np.eye(agents.size) - agents.shares.toarray()[:, : agents.size]
        stands = np.flatnonzero(agents.stiffness > 0.0)
        root = np.sqrt(agents.stiffness[stands])
        scaled = root[:, None] * own[np.ix_(stands, stands)] / root
        moved = np.linalg.solve(0.5 * (scaled + scaled.T), faces.left[stands] / root)
        loads = np.zeros(agents.size)
        loads[stands] = root * moved
        return loads

    def note_supports(self) -> None:
        """Note which supports a load has reached by now."""
        carried = self.levels[0].left[self.table.levels[0].size :]
        reached = (carried != 0.0) & (self.place_step == 0)
        self.place_step[reached] = max(self.generation, 1)

    def survey(self) -> tuple[float, float]:
        """Return the largest residual load (as it counts against γ, N) and the error estimate."""
        # Of all levels, as if loads were restricted without a push; the estimate is √(Σ P²/k) over
        # √(load · displacement), the error in energy as a share.
        left = self.levels[0].left[: self.table.levels[0].size]
        loudest = total = 0.0
        for level, faces in zip(self.table.levels, self.levels, strict=True):
            measured = np.abs(left) * faces.weight
            loudest = max(loudest, float(measured.max(initial=0.0)))
            total += float(measured @ measured) / self.table.reference
            if level.prolong is not None:
                left = level.restrict @ left
        if total == 0.0:
            return loudest, 0.0
        work = -2.0 * self.energy
        return loudest, sqrt(total / work) if work > 0.0 else float("inf")


class PushEngine(ABC):
    """Lets agents act, level by level; they are objects or rows of arrays."""

    space: Any = None  # The agents' network of cells, if they are objects

    def __init__(self, table: PushTable) -> None:
        self.table = table
        self.reset()

    def reset(self) -> None:
        """Put the loads on the body, before any agent has yielded."""
        self.state = PushState(self.table)

    @abstractmethod
    def relax_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own: a Jacobi step."""

    @abstractmethod
    def relax_in_turn(self, level: int, backward: bool) -> None:
        """Let the agents of a level above γ act one after another: a Gauss-Seidel sweep."""

    @abstractmethod
    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""

    def relax_chosen(self, order: Order[FaceAgent]) -> None:
        """Let the agents act that an order chooses from those above γ, in turn."""
        raise NotImplementedError("arrays do not act in an order of your own")

    @abstractmethod
    def wake_supports(self) -> None:
        """Let an agent spawn in every supporting cell that a load has reached."""
