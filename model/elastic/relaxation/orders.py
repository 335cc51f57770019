"""Orders of work: which agents act when. Each is a generator that yields after every step.

An order only says *which*; what an agent does in its turn is its own affair.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kaju.agents.face_agent import FaceAgent
from kaju.arrays import Floats
from kaju.model.elastic.relaxation.push_state import PushEngine, PushState
from kaju.stepping import Order

MOST_SOLVED_AT_ONCE = 500  # Topmost parents whose loads are relaxed at once; more take turns
Direction = tuple[Floats, Floats]
"""By how much faces move (m), and by how much the loads left on places fall (N)."""


class Visit(NamedTuple):
    """What a step was: the level visited, and whether loads go "up" or displacements "down"."""

    level: int = 0
    way: str = ""


def wave(engine: PushEngine, share: float) -> Iterator[Visit]:
    """All agents above the threshold yield at once, by a share: damped Jacobi iteration."""
    while True:
        faces = engine.state.levels[0]
        acting = np.flatnonzero(faces.measured > engine.state.threshold)
        engine.relax_together(0, acting, share * faces.left[acting])
        yield Visit()


def largest_first(engine: PushEngine, pushes: int) -> Iterator[Visit]:
    """Let the agent with the largest load yield: Southwell's relaxation."""
    # R. V. Southwell, Relaxation Methods in Engineering Science (1940).
    while True:
        engine.relax_largest(pushes)
        yield Visit()


def own_order(engine: PushEngine, order: Order[FaceAgent]) -> Iterator[Visit]:
    """Let those yield that an order of one's own chooses: the energy falls with any choice."""
    while True:
        engine.relax_chosen(order)
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
            _sweep(engine, level)
            state.restrict(level)
            yield Visit(level, "up")
        upwards = range(top)
        for level in range(top, -1, -1):
            if level == top > 0 and len(state.levels[top].weight) <= MOST_SOLVED_AT_ONCE:
                if (state.levels[top].measured > state.threshold).any():
                    loads = state.direct_loads(top)
                    acting = np.flatnonzero(loads)
                    engine.relax_together(top, acting, loads[acting])
            else:
                _sweep(engine, level)
            if level > 0:
                state.prolong(level)
            else:
                previous = _extrapolate(state, start, previous)
            yield Visit(level, "down")


def _sweep(engine: PushEngine, level: int) -> None:
    """Let the agents of a level act in turn, and in turn backwards: symmetric Gauss-Seidel."""
    engine.relax_in_turn(level, False)
    engine.relax_in_turn(level, True)


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
    scale = np.sqrt(np.maximum(np.diag(stiffness), np.finfo(float).tiny))
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
