"""Records of a run of the elastic rule: steps, agents, boundary, ledger, and moments on its way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.elastic.relaxation.push_state import PushState

MOST_MOMENTS = 400
MOST_BYTES = 32_000_000
"""All moments together take up to this much memory."""


class StepRecord(NamedTuple):
    """One step: what it was, and how things stood after it."""

    level: int  # Level that was visited
    # "up" if loads were handed up to parents afterwards, "down" if what parents yielded was handed
    # down, "" in orders without levels
    way: str
    energy: float  # Energy of body and loads (J), 0 at the start
    loudest: float
    """Largest load left, as it counts against γ (N); as of the last visit to level 0."""
    error_estimate: float
    """√(Σ P²/k) over √(load · displacement), then."""
    pushes: int
    """How often agents have yielded so far."""


@dataclass(frozen=True, eq=False)
class FaceAgents:
    """The face agents, ordered by level, spawn step and number."""

    level: Ints
    spawn_step: Ints
    number: Ints
    """Level, 0 for the cells' own faces; step of spawning, from 1; number of the face. Shape
    (agents,)."""
    axis: Ints
    """Axis of the face's normal. Shape (agents,)."""
    position: Floats
    """Middle of the face (m). Shape (agents, dimension)."""
    taken: Floats
    """Sum of the sizes of the loads taken (N). Shape (agents,)."""
    left: Floats
    """Load left (N). Shape (agents,)."""
    displacement: Floats
    """Displacement (m) along the axis; of parents, in their last visit. Shape (agents,)."""


@dataclass(frozen=True, eq=False)
class BoundaryAgents:
    """The boundary agents: supports, then air; each ordered by spawn step and cell."""

    cells: Ints
    """Where they are. Shape (agents, dimension)."""
    kind: Ints
    """What they are, from `kaju.model.scene.cell_types`. Shape (agents,)."""
    spawn_step: Ints
    """Step in which a load first reached them. Shape (agents,)."""
    reaction: Floats
    """Force on the body (N); none from air. Shape (agents, dimension)."""
    returned: Floats
    """Sum of the sizes of the loads (N) that air gave back; none by supports. Shape (agents,)."""


@dataclass(frozen=True)
class PushLedger:
    """An account of every newton, per axis (N)."""

    applied: Floats
    """Sum of the applied forces. Shape (dimension,)."""
    resting: Floats
    """Sum of the loads left on faces."""
    carried: Floats
    """Sum of what the supports carry."""
    turnover: float
    """Sum of the sizes of all these loads, to compare the imbalance with."""

    @property
    def imbalance(self) -> float:
        """What the books do not account for, as a share of the turnover."""
        gap = np.abs(self.applied - self.resting - self.carried).max()
        return float(gap / self.turnover) if self.turnover > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Moments:
    """How things stood after some of the steps, from before the first to the last."""

    step: Ints
    """Steps taken; 0 is before the first. Shape (k,)."""
    level: Ints
    """Level that the step visited. Shape (k,)."""
    energy: Floats
    """Energy of body and loads (J). Shape (k,)."""
    left: NDArray[np.float32]
    taken: NDArray[np.float32]
    """Load left on, and sum of the sizes of the loads taken by, each agent (N), agents as in the
    run's table. Parents hold what was handed up to them last. Shape (k, agents)."""
    displacement: NDArray[np.float32] | None = None
    """Displacement (m) of each agent along its axis; older files do not tell. Shape (k, agents)."""


class Recorder:
    """Notes moments while a model steps: evenly, and few.

    A run may take tens of thousands of steps. When there are too many moments, every second one
    is forgotten, and from then on only every second step is noted.
    The moment before the first step is noted at once.
    """

    def __init__(self, state: PushState) -> None:
        self._state = state
        faces = sum(len(ground.weight) for ground in state.grounds)
        self._most = max(8, min(MOST_MOMENTS, MOST_BYTES // (12 * faces)))
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

    def moments(self, level: int, agents: Ints) -> Moments:
        """Return what was kept, and how things stand now, of the faces with agents."""
        # `level` was visited last; agents are counted through all levels.
        kept = self._kept
        if kept[-1][0] != self._state.generation:
            kept = [*kept, self._look(level)]
        steps, levels, energies, told = zip(*kept, strict=True)
        left, taken, displacement = (
            np.stack(column)[:, agents] for column in zip(*told, strict=True)
        )
        return Moments(
            np.array(steps), np.array(levels), np.array(energies), left, taken, displacement
        )

    def _look(self, level: int) -> tuple[int, int, float, list[NDArray[np.float32]]]:
        grounds = self._state.grounds
        left = [ground.left[: len(ground.weight)] for ground in grounds]
        taken = [ground.taken for ground in grounds]
        displacement = [ground.displacement for ground in grounds]
        state = self._state
        told = [np.concatenate(part).astype(np.float32) for part in (left, taken, displacement)]
        return state.generation, level, state.energy, told
