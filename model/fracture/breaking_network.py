"""A network in small strain whose springs break.

Springs between the same two nodes are stretched alike, so they make one *joint*, which weakens
as they break, the weakest first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.network import SpringNetwork
from kaju.model.network.assembler import Assembler, along_springs
from kaju.model.network.springs import spring_lengths_and_directions

from .weakening import WeakeningBody, measured

BREAKS_CORRECTED = 64
"""Breaks from which new factors cost less than more corrections."""


class BreakingNetwork(WeakeningBody):
    """The springs of a network that are left, under the whole load (a load factor of 1)."""

    precise = 1e-4
    parted = 1e-9

    def __init__(self, network: SpringNetwork, strengths: Floats, measure: str) -> None:
        self.network = network
        length, stiffness = network.initial_length, network.stiffness
        known: dict[str, Callable[[], Floats]] = {
            "force": lambda: strengths / stiffness,
            "strain": lambda: strengths * length,
            "energy": lambda: np.sqrt(2.0 * strengths / stiffness),
        }
        self._limits = measured(measure, known)()  # elongations (m)
        forces, given = network.forces[-1], network.displacements[-1]
        self.pull = float(np.linalg.norm(forces, axis=1).sum())
        self.shift = float(np.linalg.norm(given, axis=1).max())
        self._assembler = Assembler(network)
        ends = np.sort(network.springs, axis=1)
        _, first, joint = np.unique(ends, axis=0, return_index=True, return_inverse=True)
        self._joint = joint.ravel()
        self._order = np.lexsort((self._limits, self._joint))  # by joint, the weakest first
        self._count = np.bincount(self._joint)
        self._start = np.cumsum(self._count) - self._count
        # Stiffness of a joint before each of its breaks: summed from the strongest spring on, so
        # that the last ones have no rounding of those that broke before.
        joints = np.split(stiffness[self._order], self._start[1:])
        self._left = np.concatenate([np.cumsum(springs[::-1])[::-1] for springs in joints])
        self.limit: Floats = self._limits[self._order[self._start]]
        self._gone = np.zeros(len(first), dtype=np.int64)
        springs = network.springs[first]
        direction = spring_lengths_and_directions(network.positions, springs)[1]
        super().__init__(
            _strain_matrix(self._assembler, springs, direction),
            self._left[self._start].copy(),
            np.einsum("ij,ij->i", along_springs(network, given)[first], direction),
            self._assembler.restrict(forces),
            BREAKS_CORRECTED,
            "NATURAL",  # of the assembler, which keeps the factors sparse
        )

    @property
    def shares(self) -> Floats:
        """Elongations of the joints over those that their weakest springs survive."""
        return np.asarray(self.elongation / self.limit)

    def break_part(self, place: int) -> tuple[int, float]:
        """Take the weakest spring out of a joint; see `WeakeningBody`."""
        first = self._start[place] + self._gone[place]
        self._gone[place] += 1
        spring = int(self._order[first])
        self.broken.append(spring)
        emptied = self._gone[place] == self._count[place]
        self.limit[place] = np.inf if emptied else self._limits[self._order[first + 1]]
        left = 0.0 if emptied else self._left[first + 1]
        return spring, self.weaken(np.array([place]), np.array([left]))

    def place_of(self, spring: int) -> int:
        """Return the joint of a spring."""
        return int(self._joint[spring])

    @property
    def points(self) -> tuple[Floats, Ints]:
        """Places of the nodes (m), and which of them every spring joins."""
        return self.network.positions, self.network.springs

    def displacement(self) -> Floats:
        """Return the displacement of the nodes (m), shape (n, dimension)."""
        moved = self._assembler.expand(self.solution())
        return np.where(self.network.held, self.network.displacements[-1], moved)

    def borne(self) -> Floats:
        """Return the tension of the springs (N), none of those that broke."""
        tension = self.network.stiffness * self.elongation[self._joint]
        tension[self.broken] = 0.0
        return np.asarray(tension)


def check_breakable(network: SpringNetwork) -> None:
    """Refuse a network that is none to be broken."""
    if network.stages > 1:
        raise SceneError(
            f"loads: one load is scaled until springs break, got {network.stages} stages; "
            "give the forces (or displacements) of one of them: network.with_loads(...)"
        )
    stretched = np.abs(network.prestretch) > 1e-9 * network.initial_length
    if stretched.any():
        spring = int(np.flatnonzero(stretched)[0])
        raise SceneError(
            f"rest_length: spring {spring} is stretched by {network.prestretch[spring]:.3g} m "
            "before any load; springs that break are free of force at first"
        )


def _strain_matrix(assembler: Assembler, springs: Ints, direction: Floats) -> csr_array:
    """Return elongation per displacement of the free coordinates, shape (springs, f)."""
    count, dimension = direction.shape
    number = np.full(assembler.network.positions.size, -1)
    number[assembler.free] = np.arange(len(assembler.free))
    column = number[dimension * springs[:, :, None] + np.arange(dimension)]
    value = np.stack([direction, -direction], axis=1)
    row = np.broadcast_to(np.arange(count)[:, None, None], column.shape)
    free = column >= 0
    return csr_array((value[free], (row[free], column[free])), shape=(count, len(assembler.free)))
