"""Orders of work: who acts when. Each is a generator that yields after every step.

An order only says *who*; what an agent does when its turn comes is the agent's own affair.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from .push_state import PushState

MOST_SWEEPS_AT_THE_TOP = 100
"""The topmost parents, a handful, go on among themselves until they rest, or this often."""


class PushEngine(Protocol):
    """What an order needs: agents as objects or as arrays."""

    state: PushState

    def push_together(self) -> None:
        """Let all agents above the threshold take a share of their loads at once."""

    def push_in_turn(self, level: int, backward: bool) -> int:
        """Let the agents of a level above the threshold act one after another."""

    def push_largest(self, count: int) -> int:
        """Let the agent with the largest load act, `count` times."""


class Visit(NamedTuple):
    """What a step was: the level visited, and whether loads go "up" or displacements "down"."""

    level: int = 0
    way: str = ""


def wave(engine: PushEngine) -> Iterator[Visit]:
    """All agents above the threshold yield at once: damped Jacobi iteration."""
    while True:
        engine.push_together()
        yield Visit()


def largest_first(engine: PushEngine, pushes: int) -> Iterator[Visit]:
    """Let the agent with the largest load yield.

    R. V. Southwell, Relaxation Methods in Engineering Science (1940).
    """
    while True:
        engine.push_largest(pushes)
        yield Visit()


def multilevel(engine: PushEngine) -> Iterator[Visit]:
    """Level after level, up to the parents and down again: a multigrid V-cycle.

    The first way up is travelled without a push: the topmost parents take the whole load,
    and finer agents spawn only where what their parents could not take exceeds γ.
    """
    state = engine.state
    top = len(state.grounds) - 1
    for level in range(top):
        state.hand_up(level)
    yield from _down(engine, top)
    while True:
        for level in range(top):
            _take_turns(engine, level)
            state.hand_up(level)
            yield Visit(level, "up")
        yield from _down(engine, top)


def _down(engine: PushEngine, top: int) -> Iterator[Visit]:
    for _ in range(MOST_SWEEPS_AT_THE_TOP - 1):
        if not _take_turns(engine, top):
            break
    for level in range(top, -1, -1):
        _take_turns(engine, level)
        if level > 0:
            engine.state.hand_down(level)
        yield Visit(level, "down")


def _take_turns(engine: PushEngine, level: int) -> int:
    """Let the agents of a level act in turn, and in turn backwards."""
    return engine.push_in_turn(level, False) + engine.push_in_turn(level, True)
