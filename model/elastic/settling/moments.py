"""What a run of the elastic rule looked like on its way: who had taken how much, what was left.

A run may take tens of thousands of steps. So moments are kept evenly, and few: when there
are too many, every second one is forgotten, and from then on only every second step is noted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .state import PushState

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_MOMENTS = 400
MOST_BYTES = 32_000_000
"""All moments together take up to this much memory."""


@dataclass(frozen=True, eq=False)
class Moments:
    """How things stood after some of the steps, from before the first to the last.

    Attributes
    ----------
    step : array of int, shape (k,)
        Steps taken; 0 is before the first.
    level : array of int, shape (k,)
        Level that the step visited.
    energy : array, shape (k,)
        Energy of body and loads (J).
    left, taken : arrays of single precision, shape (k, agents)
        Load left on, and sum of the sizes of the loads taken by, each agent (N), agents as in
        the run's table. Parents hold what was handed up to them last.
    """

    step: Integers
    level: Integers
    energy: Floats
    left: NDArray[np.float32]
    taken: NDArray[np.float32]


class Recorder:
    """Notes moments while a model steps.

    Parameters
    ----------
    state : PushState
        What is watched; the moment before the first step is noted at once.
    """

    def __init__(self, state: PushState) -> None:
        self._state = state
        faces = sum(len(ground.weight) for ground in state.grounds)
        self._most = max(8, min(MOST_MOMENTS, MOST_BYTES // (8 * faces)))
        self._every = 1
        self._kept = [self._look(0)]

    def note(self, level: int) -> None:
        """Keep the step that has just been taken, if its turn has come."""
        if self._state.generation % self._every:
            return
        self._kept.append(self._look(level))
        if len(self._kept) > self._most:
            self._kept = self._kept[::2]
            self._every *= 2

    def moments(self, level: int, agents: Integers) -> Moments:
        """Return what was kept, and how things stand now, of the faces with agents.

        Parameters
        ----------
        level : int
            Level that the last step visited.
        agents : array of int
            Their numbers, counted through all levels.
        """
        kept = self._kept
        if kept[-1][0] != self._state.generation:
            kept = [*kept, self._look(level)]
        steps, levels, energies, left, taken = zip(*kept, strict=True)
        return Moments(
            np.array(steps),
            np.array(levels),
            np.array(energies),
            np.stack(left)[:, agents],
            np.stack(taken)[:, agents],
        )

    def _look(self, level: int) -> tuple[int, int, float, NDArray[np.float32], NDArray[np.float32]]:
        grounds = self._state.grounds
        left = [ground.left[: len(ground.weight)] for ground in grounds]
        taken = [ground.taken for ground in grounds]
        state = self._state
        both = [np.concatenate(part).astype(np.float32) for part in (left, taken)]
        return state.generation, level, state.energy, both[0], both[1]
