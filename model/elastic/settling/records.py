"""Records of a run of the elastic rule: steps, agents, boundary, and the ledger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class StepRecord(NamedTuple):
    """One step: what it was, and how things stood after it.

    Attributes
    ----------
    level : int
        Level that was visited.
    way : str
        "up" if loads were handed up to parents afterwards, "down" if what parents yielded
        was handed down, "" in orders without levels.
    energy : float
        Energy of body and loads (J), 0 at the start.
    loudest : float
        Largest load left, as it counts against γ (N); as of the last visit to level 0.
    error_estimate : float
        √(Σ P²/k) over √(load · displacement), then.
    pushes : int
        How often agents have yielded so far.
    """

    level: int
    way: str
    energy: float
    loudest: float
    error_estimate: float
    pushes: int


@dataclass(frozen=True, eq=False)
class FaceAgents:
    """The face agents, ordered by level, spawn step and number.

    Attributes
    ----------
    level, spawn_step, number : arrays of int, shape (agents,)
        Level, 0 for the cells' own faces; step of spawning, from 1; number of the face.
    axis : array of int, shape (agents,)
        Axis of the face's normal.
    position : array, shape (agents, dimension)
        Middle of the face (m).
    taken : array, shape (agents,)
        Sum of the sizes of the loads taken (N).
    left : array, shape (agents,)
        Load left (N).
    displacement : array, shape (agents,)
        Displacement (m) along the axis; of parents, in their last visit.
    """

    level: Integers
    spawn_step: Integers
    number: Integers
    axis: Integers
    position: Floats
    taken: Floats
    left: Floats
    displacement: Floats


@dataclass(frozen=True, eq=False)
class BoundaryAgents:
    """The boundary agents: supports, then air; each ordered by spawn step and cell.

    Attributes
    ----------
    cells : array of int, shape (agents, dimension)
        Where they are.
    kind : array of int, shape (agents,)
        What they are, from `kaju.model.scene.kinds`.
    spawn_step : array of int, shape (agents,)
        Step in which a load first reached them.
    reaction : array, shape (agents, dimension)
        Force on the body (N); none from air.
    returned : array, shape (agents,)
        Sum of the sizes of the loads (N) that air gave back; none by supports.
    """

    cells: Integers
    kind: Integers
    spawn_step: Integers
    reaction: Floats
    returned: Floats


@dataclass(frozen=True)
class PushLedger:
    """An account of every newton, per axis (N).

    Attributes
    ----------
    applied : array, shape (dimension,)
        Sum of the applied forces.
    resting : array
        Sum of the loads left on faces.
    carried : array
        Sum of what the supports carry.
    turnover : float
        Sum of the sizes of all these loads, to compare the imbalance with.
    """

    applied: Floats
    resting: Floats
    carried: Floats
    turnover: float

    @property
    def imbalance(self) -> float:
        """What the books do not account for, as a share of the turnover."""
        gap = np.abs(self.applied - self.resting - self.carried).max()
        return float(gap / self.turnover) if self.turnover > 0.0 else 0.0
