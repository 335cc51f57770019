"""What the faces of all levels carry: loads left on them, displacements, who has spawned.

Loads rest on the faces, whether an agent stands there or not; agents act on what rests
there. Handing loads up to parents, and displacements down to children, is the same for
agents as objects and as arrays, and lives here.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.relaxation.push_table import PushTable


@dataclass(frozen=True, eq=False)
class LevelFaces:
    """The faces of one level."""

    left: Floats
    """Load (N) left on each face, along its normal; on the finest level followed by what the
    supports carry. Shape (places,)."""
    displacement: Floats
    """How far each face has moved (m); for parents, in their current visit. Shape (faces,)."""
    taken: Floats  # Sum of the sizes of the loads (N) that its agent has taken. Shape (faces,)
    spawn_step: Ints  # Step in which its agent spawned, 0 while there is none. Shape (faces,)
    weight: Floats  # By how much a load on the face counts against the threshold. Shape (faces,)


class PushState:
    """Loads and displacements on all levels, finest first.

    `place_step` is the step in which a load first reached each support, 0 before; `energy` that of
    body and loads together (J), 0 at the start: every step lowers it.
    """

    def __init__(self, table: PushTable) -> None:
        self.table = table
        self.grounds = []
        for number, level in enumerate(table.levels):
            left = np.zeros(level.shares.shape[1])
            if number == 0:
                left[: len(table.load)] = table.load
            moved, taken = np.zeros(level.size), np.zeros(level.size)
            step = np.zeros(level.size, dtype=np.int64)
            self.grounds.append(LevelFaces(left, moved, taken, step, table.weight(number)))
        self.energy = 0.0
        self.pushes = 0
        self.generation = 0
        self.place_step = np.zeros(len(table.load) - table.levels[0].size, dtype=np.int64)
        self.note_supports()

    @property
    def threshold(self) -> float:
        """γ (N)."""
        return self.table.threshold

    def measured(self, level: int) -> Floats:
        """Return the loads left on the faces of a level as they count against γ (N)."""
        ground = self.grounds[level]
        size: Floats = np.abs(ground.left[: len(ground.weight)]) * ground.weight
        return size

    def hand_up(self, level: int) -> None:
        """Hand what is left on a level up to the parents, each as one load."""
        children, parents = self.grounds[level], self.grounds[level + 1]
        parents.left[:] = self.table.levels[level].restrict @ children.left[: children.weight.size]
        parents.displacement[:] = 0.0

    def hand_down(self, level: int) -> None:
        """Let the children of a level follow their parents, and pass on what they yield by."""
        finer = self.table.levels[level - 1]
        ground = self.grounds[level - 1]
        assert finer.prolong is not None
        moved = finer.prolong @ self.grounds[level].displacement
        ground.displacement[:] += moved
        load = finer.stiffness * moved
        ground.left[: finer.size] -= load
        ground.left[:] += finer.arrivals @ load

    def settling_loads(self, level: int) -> Floats:
        """Return what the agents of a small level must take for nothing to be left."""
        agents, ground = self.table.levels[level], self.grounds[level]
        own = np.eye(agents.size) - agents.shares.toarray()[:, : agents.size]
        stands = np.flatnonzero(agents.stiffness > 0.0)
        root = np.sqrt(agents.stiffness[stands])
        scaled = root[:, None] * own[np.ix_(stands, stands)] / root
        moved = np.linalg.solve(0.5 * (scaled + scaled.T), ground.left[stands] / root)
        loads = np.zeros(agents.size)
        loads[stands] = root * moved
        return loads

    def note_supports(self) -> None:
        """Note which supports a load has reached by now."""
        carried = self.grounds[0].left[self.table.levels[0].size :]
        reached = (carried != 0.0) & (self.place_step == 0)
        self.place_step[reached] = max(self.generation, 1)

    def survey(self) -> tuple[float, float]:
        """Look at the loads left on all levels, as if they were handed up without a push."""
        # Returns the largest, as it counts against γ (N), and the error in energy as a share: √(Σ
        # P²/k) over √(load · displacement).
        left = self.grounds[0].left[: self.table.levels[0].size]
        loudest = total = 0.0
        for level, ground in zip(self.table.levels, self.grounds, strict=True):
            measured = np.abs(left) * ground.weight
            loudest = max(loudest, float(measured.max(initial=0.0)))
            total += float(measured @ measured) / self.table.reference
            if level.prolong is not None:
                left = level.restrict @ left
        if total == 0.0:
            return loudest, 0.0
        work = -2.0 * self.energy
        return loudest, sqrt(total / work) if work > 0.0 else float("inf")
