"""What the faces of all levels carry, and what orders of work ask of the agents on them.

Loads rest on the faces, whether an agent stands there or not; agents act on what rests there.
Restricting loads to parents and prolonging displacements to children is the same for agents as
objects and as arrays.

An order of work says which agents act when. It is a generator that yields after every step; what an
agent does in its turn is its own affair.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.agents.face_agent import FaceAgent
from kaju.arrays import Floats, Ints
from kaju.model.elastic.relaxation.push_table import PushTable, inverse
from kaju.stepping import Order


class LevelState(NamedTuple):
    """The faces of one level as arrays: shares by rows, and what faces carry."""

    begin: NDArray[np.integer]  # Where the shares of each agent begin
    target: NDArray[np.integer]  # Which faces or supports they go to
    share: Floats
    stiffness: Floats
    left: Floats  # Residual: load (N) on each face; on the finest level then those of the supports
    displacement: Floats  # How far each face has moved (m); of parents, in their current visit
    taken: Floats  # Sum of the sizes of the loads (N) that each agent has taken
    spawn_step: Ints  # Step in which each agent spawned, 0 while there is none
    weight: Floats  # √(k₀/k): by how much a load on a face counts against the threshold

    @property
    def measured(self) -> Floats:
        """The residual loads of the faces as they count against γ (N)."""
        return np.abs(self.left[: len(self.weight)]) * self.weight


class PushState:
    """Loads and displacements on all levels, finest first.

    `energy` is that of body and loads together (J), 0 at the start: every step lowers it.
    """

    def __init__(self, table: PushTable) -> None:
        self.table, self.threshold = table, table.threshold
        self.levels = []
        for level in table.levels:
            left = np.zeros(level.shares.shape[1])
            moved, taken = np.zeros(level.size), np.zeros(level.size)
            step = np.zeros(level.size, dtype=np.int64)
            row, target, share = level.shares.indptr, level.shares.indices, level.shares.data
            weight = np.sqrt(table.reference * inverse(level.stiffness))
            carried = left, moved, taken, step, weight
            self.levels.append(LevelState(row, target, share, level.stiffness, *carried))
        self.levels[0].left[: len(table.load)] = table.load
        self.energy = 0.0
        self.pushes = 0
        self.generation = 0

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

    def survey(self) -> tuple[float, float]:
        """Return the largest residual load (as it counts against γ, N) and the error estimate."""
        # Of all levels, as if loads were restricted without a push; the estimate is √(Σ P²/k) over
        # √(load · displacement), the error in energy as a share.
        left = self.levels[0].left[: self.table.levels[0].size]
        loudest, total = [0.0], 0.0
        for level, faces in zip(self.table.levels, self.levels, strict=True):
            measured = np.abs(left) * faces.weight
            loudest.append(float(measured.max(initial=0.0)))
            total += float(measured @ measured) / self.table.reference
            if level.prolong is not None:
                left = level.restrict @ left
        work, most = -2.0 * self.energy, float(np.max(loudest))  # or NaN
        if total == 0.0:
            return most, 0.0
        return most, sqrt(total / work) if work > 0.0 else float("inf")


class PushEngine(ABC):
    """Lets agents act, level by level; they are objects or rows of arrays."""

    space: Any = None  # The agents' network of cells, if they are objects

    def __init__(self, table: PushTable) -> None:
        self.table = table

    def reset(self) -> None:
        """Put the loads on the body, before any agent has yielded."""
        self.state = PushState(self.table)
        self.idle = 0  # Steps since an agent last took a load

    @abstractmethod
    def relax_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own: a Jacobi step."""

    def relax_all(self, share: float) -> None:
        """Let all agents above γ take a share of their loads at once: damped Jacobi iteration."""
        faces = self.state.levels[0]
        acting = np.flatnonzero(faces.measured > self.state.threshold)
        self.relax_together(0, acting, share * faces.left[acting])

    @abstractmethod
    def relax_in_turn(self, level: int) -> None:
        """Let the agents of a level above γ act in turn, and in turn backwards."""
        # Both sweeps together are symmetric Gauss-Seidel.

    @abstractmethod
    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""
        # R. V. Southwell, Relaxation Methods in Engineering Science (1940).

    def relax_chosen(self, order: Order[FaceAgent]) -> None:
        """Let the agents act that an order chooses from those above γ; any lowers the energy."""
        raise NotImplementedError("arrays do not act in an order of your own")


Direction = tuple[Floats, Floats]
"""By how much faces move (m), and by how much the loads left on places fall (N)."""


class Visit(NamedTuple):
    """What a step was: the level visited, and whether loads go "up" or displacements "down"."""

    level: int = 0
    way: str = ""


def repeated(act: Callable[[], None]) -> Iterator[Visit]:
    """Let the same agents' turn come in every step."""
    while True:
        act()
        yield Visit()


def multilevel(engine: PushEngine) -> Iterator[Visit]:
    """Level after level, up to the parents and down again: multigrid V-cycles."""
    # The first way up takes no push: the topmost parents, a handful, relax the whole load among
    # themselves, and finer agents spawn only where what their parents could not take exceeds γ.
    state, top = engine.state, len(engine.state.levels) - 1
    previous: list[Direction] = []
    for level in range(top):
        state.restrict(level)
    upwards = range(0)
    while True:
        faces = state.levels[0]
        start: Direction = faces.displacement.copy(), faces.left.copy()
        for level in upwards:
            engine.relax_in_turn(level)
            state.restrict(level)
            yield Visit(level, "up")
        upwards = range(top)
        for level in range(top, -1, -1):
            if level == top > 0 and len(state.levels[top].weight) <= 500:  # A matrix of 2 MB.
                if (state.levels[top].measured > state.threshold).any():
                    loads = state.direct_loads(top)
                    acting = np.flatnonzero(loads)
                    engine.relax_together(top, acting, loads[acting])
            else:
                engine.relax_in_turn(level)
            if level > 0:
                state.prolong(level)
            else:
                previous = _extrapolate(state, start, previous)
            yield Visit(level, "down")


def _extrapolate(state: PushState, start: Direction, previous: list[Direction]) -> list[Direction]:
    """Go on along the direction of a cycle, and that of the last one, to the least energy."""
    # Without it a stiff part on soft ground, which no parent can move without bending it a little,
    # would take very many cycles. This is the conjugate gradient iteration with cycles as its
    # preconditioner, in the flexible form that lets agents rest (G. H. Golub, Q. Ye, SIAM Journal
    # on Scientific Computing 21 (1999) 1305). Returns the direction for the next cycle.
    faces = state.levels[0]
    move, fall = faces.displacement - start[0], start[1] - faces.left
    if not move.any():
        return previous
    # How far to go along each direction, from the condition that no load is left along it.
    moves, falls = (np.stack(part) for part in zip((move, fall), *previous, strict=True))
    left, falls_of_faces = faces.left[: len(move)], falls[:, : len(move)]
    stiffness = moves @ falls_of_faces.T
    if not np.diag(stiffness).min() > 0.0:
        return []  # agents of one's own may add energy: their directions lead nowhere
    scale = np.sqrt(np.diag(stiffness))
    load = moves @ left / scale
    lengths = np.linalg.lstsq(stiffness / np.outer(scale, scale), load, rcond=1e-12)[0] / scale
    further, fallen = lengths @ moves, lengths @ falls
    released = 0.5 * float(further @ (2.0 * left - fallen[: len(move)]))
    if released > 0.0:
        state.energy -= released
        faces.displacement[:] += further
        faces.left[:] -= fallen
        move, fall = move + further, fall + fallen
    return [(move, fall)]
