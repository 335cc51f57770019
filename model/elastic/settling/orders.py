"""Orders of work: who acts when. Each is a generator that yields after every step.

An order only says *who*; what an agent does when its turn comes is the agent's own affair.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .momentum import Momentum
from .state import Floats, Integers, PushState

if TYPE_CHECKING:
    from kaju.agents.face_agent import FaceAgent
    from kaju.model.engine_choice import Order

    from .agent_engine import AgentPushEngine

MOST_WHO_CONFER = 500
"""Up to this many topmost parents settle their loads at once; more of them take turns."""


class PushEngine(Protocol):
    """What an order needs: agents as objects or as arrays."""

    state: PushState

    def push_together(self, level: int, acting: Integers, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own."""

    def push_in_turn(self, level: int, backward: bool) -> int:
        """Let the agents of a level above the threshold act one after another."""

    def push_largest(self, count: int) -> int:
        """Let the agent with the largest load act, `count` times."""


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
    """Let the agent with the largest load yield.

    R. V. Southwell, Relaxation Methods in Engineering Science (1940).
    """
    while True:
        engine.push_largest(pushes)
        yield Visit()


def own_order(engine: AgentPushEngine, order: Order[FaceAgent]) -> Iterator[Visit]:
    """Let those yield whom an order of one's own chooses: whoever it is, the energy falls."""
    while True:
        engine.push_chosen(order)
        yield Visit()


def multilevel(engine: PushEngine) -> Iterator[Visit]:
    """Level after level, up to the parents and down again: a multigrid V-cycle.

    The first way up is travelled without a push: the topmost parents, a handful, settle the
    whole load among themselves, and finer agents spawn only where what their parents could
    not take exceeds γ. At the end of each round the faces go on along the way of the round.
    """
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
    for level in range(top, -1, -1):
        if level == top > 0 and len(engine.state.grounds[top].weight) <= MOST_WHO_CONFER:
            _confer(engine, top)
        else:
            _take_turns(engine, level)
        if level > 0:
            engine.state.hand_down(level)
        else:
            momentum.go_on()
        yield Visit(level, "down")


def _confer(engine: PushEngine, top: int) -> None:
    """Let the topmost parents, a handful, yield at once by what leaves nothing to any."""
    state = engine.state
    if (state.measured(top) > state.threshold).any():
        loads = state.settling_loads(top)
        acting = np.flatnonzero(loads)
        engine.push_together(top, acting, loads[acting])


def _take_turns(engine: PushEngine, level: int) -> int:
    """Let the agents of a level act in turn, and in turn backwards."""
    return engine.push_in_turn(level, False) + engine.push_in_turn(level, True)
