"""The agents of the array engine: a table that grows as loads reach new cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .stage import FloatArray, IntArray

if TYPE_CHECKING:
    from kaju.model.scene import Scene

_UNKNOWN = np.int16(-1000)


class AgentTable:
    """Material agents as columns, ordered by spawn step and key.

    Attributes
    ----------
    key : array of int
        Number of the cell, as the lattice counts.
    material, spawn_step, woken_by : arrays of int
        As in `Stage`.
    taken : array of float, shape (agents, states)
        Loads taken (N), by state as `Transfer` numbers them.
    passed : array of float, shape (agents, directions)
        Loads handed over by arm (N).
    dropped : array of float
        Emissions that were too small (N).
    """

    def __init__(self, scene: Scene, states: int) -> None:
        self.scene = scene
        self.lattice = scene.lattice
        directions = self.lattice.directions
        self.key: IntArray = np.empty(0, dtype=np.int64)
        self.material: IntArray = np.empty(0, dtype=np.int64)
        self.spawn_step: IntArray = np.empty(0, dtype=np.int64)
        self.woken_by: IntArray = np.empty(0, dtype=np.int64)
        self.taken: FloatArray = np.empty((0, states))
        self.passed: FloatArray = np.empty((0, directions))
        self.dropped: FloatArray = np.empty(0)
        self._form: NDArray[np.int8] = np.empty(0, dtype=np.int8)
        self._beyond: NDArray[np.int16] = np.empty((0, directions), dtype=np.int16)
        self._sorted_key: IntArray = np.empty(0, dtype=np.int64)
        self._sorted_agent: IntArray = np.empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.key)

    @property
    def cells(self) -> IntArray:
        """Coordinates of the agents' cells."""
        return self.lattice.cells(self.key)

    def missing(self, key: IntArray) -> NDArray[np.bool_]:
        """Tell which cells have no agent yet."""
        place = np.searchsorted(self._sorted_key, key)
        found = np.zeros(len(key), dtype=np.bool_)
        inside = place < len(self._sorted_key)
        found[inside] = self._sorted_key[place[inside]] == key[inside]
        return ~found

    def find(self, key: IntArray) -> IntArray:
        """Return the agents of cells that have one."""
        return self._sorted_agent[np.searchsorted(self._sorted_key, key)]

    def spawn(self, key: IntArray, woken_by: IntArray, step: int) -> None:
        """Add agents in the cells `key` (sorted, each once, none with an agent)."""
        count, directions = len(key), self.lattice.directions
        cells = self.lattice.cells(key)
        newborn = np.arange(len(self.key), len(self.key) + count)
        place = np.searchsorted(self._sorted_key, key)
        self._sorted_key = np.insert(self._sorted_key, place, key)
        self._sorted_agent = np.insert(self._sorted_agent, place, newborn)
        self.key = np.append(self.key, key)
        self.material = np.append(self.material, self.scene.kinds(cells))
        self.spawn_step = np.append(self.spawn_step, np.full(count, step))
        self.woken_by = np.append(self.woken_by, woken_by)
        self.taken = np.append(self.taken, np.zeros((count, self.taken.shape[1])), axis=0)
        self.passed = np.append(self.passed, np.zeros((count, directions)), axis=0)
        self.dropped = np.append(self.dropped, np.zeros(count))
        self._form = np.append(self._form, self.lattice.form(cells).astype(np.int8))
        unknown = np.full((count, directions), _UNKNOWN)
        self._beyond = np.append(self._beyond, unknown, axis=0)

    def form(self, agent: IntArray) -> IntArray:
        """Return the row of the rule's tables for agents: material, then form."""
        return self.material[agent] * self.lattice.forms + self._form[agent]

    def neighbour(self, agent: IntArray, arm: IntArray) -> IntArray:
        """Return the keys of the cells that agents reach over arms."""
        return self.key[agent] + self.lattice.key_steps[self._form[agent], arm]

    def beyond(self, agent: IntArray, arm: IntArray) -> IntArray:
        """Return what lies over an arm: a material's number, or a kind of boundary.

        An agent looks round once, when it first has something to hand over.
        """
        curious = np.zeros(len(self.key), dtype=np.bool_)
        curious[agent] = True
        curious &= self._beyond[:, 0] == _UNKNOWN
        looking = np.flatnonzero(curious)
        cells = self.lattice.cells(self.key[looking])
        for each in range(self.lattice.directions if len(looking) else 0):
            self._beyond[looking, each] = self.scene.kinds(self.lattice.neighbours(cells, each))
        return self._beyond[agent, arm].astype(np.int64)
