"""Orders of work: who acts when. Each is a generator that yields after every step.

An order only says *who*; what an agent does when its turn comes is the agent's own affair.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.relaxation.push_state import PushState

if TYPE_CHECKING:
    from kaju.agents.face_agent import FaceAgent
    from kaju.model.elastic.relaxation.face_agent_engine import AgentPushEngine
    from kaju.model.elastic.relaxation.face_array_engine import ArrayPushEngine
    from kaju.stepping import Order

    PushEngine: TypeAlias = AgentPushEngine | ArrayPushEngine

MOST_WHO_CONFER = 500
"""Up to this many topmost parents settle their loads at once; more of them take turns."""
Way = tuple[Floats, Floats]
"""By how much faces move (m), and by how much the loads left on places fall (N)."""


class Momentum:
    """After a round over all levels the faces go on along the way they have come.

    What a round of pushes has found out is good for more than the round itself. All faces go
    on along its way, and along that of the round before, as far as lowers the energy most: two
    numbers, found from two equations. Without it, a stiff part on soft ground, which no parent
    can move without bending it a little, would take very many rounds. This is the conjugate
    gradient iteration with rounds as its preconditioner, in the flexible form that lets agents
    rest (G. H. Golub, Q. Ye, SIAM Journal on Scientific Computing 21 (1999) 1305).
    """

    def __init__(self, state: PushState) -> None:
        self.state = state
        self.previous: list[Way] = []
        self.begin()

    def begin(self) -> None:
        """Remember where a round starts."""
        ground = self.state.grounds[0]
        self.start = ground.displacement.copy(), ground.left.copy()

    def go_on(self) -> None:
        """Go on along the ways of this round and of the last one, to the least energy."""
        ground = self.state.grounds[0]
        way = ground.displacement - self.start[0], self.start[1] - ground.left
        if not way[0].any():
            return
        ways = [way, *self.previous]
        moved, fallen = np.zeros_like(way[0]), np.zeros_like(way[1])
        # How far to go along each, from the condition that no load is left along it.
        faces = len(moved)
        left = ground.left[:faces]
        stiffness = np.array([[a @ falls[:faces] for _, falls in ways] for a, _ in ways])
        load = np.array([along @ left for along, _ in ways])
        scale = np.sqrt(np.maximum(np.diag(stiffness), np.finfo(float).tiny))
        solution = np.linalg.lstsq(stiffness / np.outer(scale, scale), load / scale, rcond=1e-12)
        for length, (along, falls) in zip(solution[0] / scale, ways, strict=True):
            moved += length * along
            fallen += length * falls
        released = 0.5 * float(moved @ (2.0 * left - fallen[:faces]))
        if released > 0.0:
            self.state.energy -= released
            ground.displacement[:] += moved
            ground.left[:] -= fallen
            way = way[0] + moved, way[1] + fallen
        self.previous = [way]


class Visit(NamedTuple):
    """What a step was: the level visited, and whether loads go "up" or displacements "down"."""

    level: int = 0
    way: str = ""


def wave(engine: PushEngine, share: float) -> Iterator[Visit]:
    """All agents above the threshold yield at once, by a share: damped Jacobi iteration."""
    state = engine.state
    while True:
        acting = np.flatnonzero(state.measured(0) > state.threshold)
        engine.push_together(0, acting, share * state.grounds[0].left[acting])
        yield Visit()


def largest_first(engine: PushEngine, pushes: int) -> Iterator[Visit]:
    """Let the agent with the largest load yield."""
    # R. V. Southwell, Relaxation Methods in Engineering Science (1940).
    while True:
        engine.push_largest(pushes)
        yield Visit()


def own_order(engine: AgentPushEngine, order: Order[FaceAgent]) -> Iterator[Visit]:
    """Let those yield whom an order of one's own chooses: whoever it is, the energy falls."""
    while True:
        engine.push_chosen(order)
        yield Visit()


def multilevel(engine: PushEngine) -> Iterator[Visit]:
    """Level after level, up to the parents and down again: a multigrid V-cycle."""
    # The first way up is travelled without a push: the topmost parents, a handful, settle the whole
    # load among themselves, and finer agents spawn only where what their parents could not take
    # exceeds γ. At the end of each round the faces go on along the way of the round.
    state = engine.state
    momentum = Momentum(state)
    top = len(state.grounds) - 1
    for level in range(top):
        state.hand_up(level)
    yield from _down(engine, top, momentum)
    while True:
        momentum.begin()
        for level in range(top):
            _take_turns(engine, level)
            state.hand_up(level)
            yield Visit(level, "up")
        yield from _down(engine, top, momentum)


def _down(engine: PushEngine, top: int, momentum: Momentum) -> Iterator[Visit]:
    state = engine.state
    for level in range(top, -1, -1):
        if level == top > 0 and len(state.grounds[top].weight) <= MOST_WHO_CONFER:
            # A handful, they yield at once by what leaves nothing to any.
            if (state.measured(top) > state.threshold).any():
                loads = state.settling_loads(top)
                acting = np.flatnonzero(loads)
                engine.push_together(top, acting, loads[acting])
        else:
            _take_turns(engine, level)
        if level > 0:
            state.hand_down(level)
        else:
            momentum.go_on()
        yield Visit(level, "down")


def _take_turns(engine: PushEngine, level: int) -> int:
    """Let the agents of a level act in turn, and in turn backwards."""
    return engine.push_in_turn(level, False) + engine.push_in_turn(level, True)
