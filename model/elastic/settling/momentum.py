"""Momentum: after a round over all levels the faces go on along the way they have come.

What a round of pushes has found out is good for more than the round itself. All faces go
on along its way, and along that of the round before, as far as lowers the energy most: two
numbers, found from two equations. Without it, a stiff part on soft ground, which no parent
can move without bending it a little, would take very many rounds. This is the conjugate
gradient iteration with rounds as its preconditioner, in the flexible form that lets agents
rest (G. H. Golub, Q. Ye, SIAM Journal on Scientific Computing 21 (1999) 1305).
"""

from __future__ import annotations

import numpy as np

from .state import Floats, PushState

Way = tuple[Floats, Floats]
"""By how much faces move (m), and by how much the loads left on places fall (N)."""


class Momentum:
    """Remembers the way of the last round.

    Parameters
    ----------
    state : PushState
        Whose finest level is moved.
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
        for length, (along, falls) in zip(self._lengths(ways), ways, strict=True):
            moved += length * along
            fallen += length * falls
        left = ground.left[: len(moved)]
        released = 0.5 * float(moved @ (2.0 * left - fallen[: len(moved)]))
        if released > 0.0:
            self.state.energy -= released
            ground.displacement[:] += moved
            ground.left[:] -= fallen
            way = way[0] + moved, way[1] + fallen
        self.previous = [way]

    def _lengths(self, ways: list[Way]) -> Floats:
        """Return how far to go along each way, from the condition that no load is left along it."""
        faces = len(ways[0][0])
        left = self.state.grounds[0].left[:faces]
        stiffness = np.array([[a @ falls[:faces] for _, falls in ways] for a, _ in ways])
        load = np.array([along @ left for along, _ in ways])
        scale = np.sqrt(np.maximum(np.diag(stiffness), np.finfo(float).tiny))
        solution = np.linalg.lstsq(stiffness / np.outer(scale, scale), load / scale, rcond=1e-12)
        lengths: Floats = solution[0] / scale
        return lengths
