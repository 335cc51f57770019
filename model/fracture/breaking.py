"""A network in small strain that loses springs, its factors kept and corrected.

Springs between the same two nodes are stretched alike, so they make one *joint*, which weakens
as they break, the weakest first. With factors of K at hand, K + V d Vᵀ (a column of V and a
loss d < 0 of stiffness for every weakened joint) is solved by putting the lost forces back as
loads: u = u₀ − K⁻¹V d e, where the elongations e of those joints solve (1 + VᵀK⁻¹V d) e = e₀.

References
----------
W. W. Hager, "Updating the inverse of a matrix", SIAM Review 31 (1989) 221-239.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.sparse import csr_array

from kaju.arrays import Flags, Floats, Ints
from kaju.model.network import SpringNetwork
from kaju.model.network.assembler import Assembler, along_springs
from kaju.model.network.linear import DirectSolver, GivesWayError

_MOST_WEAKENED = 64
"""Weakened joints from which new factors cost less than more corrections."""

_PRECISE = 1e-4
"""Share of its resistance that the network must keep for corrections to be precise."""

_RESISTING = 1e-6
"""Share of the unbroken network's resistance below which what is left has parted: the equations
of a network that hardly resists lose the digits by which its springs could be told apart."""


class BreakingNetwork:
    """The springs of a network that are left, under the whole load (a load factor of 1).

    Parameters
    ----------
    network : SpringNetwork
        What is loaded: in one stage, with springs that are free of force at first.
    limits : (m,) floats
        Elongations (m) above which springs break.

    Attributes
    ----------
    elongation : (j,) floats
        Of every joint (m).
    limit : (j,) floats
        Elongation (m) above which the weakest spring left in a joint breaks; infinite: none left.
    yielded : float
        F·u: work that the final forces would do on the displacements (J).
    broken : list of int
        Springs that were taken out, in their order.

    Raises
    ------
    GivesWayError
        If the springs do not resist, at first or once one is broken.
    """

    def __init__(self, network: SpringNetwork, limits: Floats) -> None:
        self.network = network
        self._assembler = Assembler(network)
        self._solver = DirectSolver()
        self._geometry = self._assembler.geometry(np.zeros_like(network.positions))
        ends = np.sort(network.springs, axis=1)
        _, first, joint = np.unique(ends, axis=0, return_index=True, return_inverse=True)
        self._order = np.lexsort((limits, joint.ravel()))  # by joint, the weakest first
        self._count = np.bincount(joint.ravel())
        self._start = np.cumsum(self._count) - self._count
        self._limits = limits
        # Summed from the strongest on: what is left has no rounding of what was there before.
        self._left = np.concatenate(
            [
                np.cumsum(network.stiffness[members][::-1])[::-1]
                for members in np.split(self._order, self._start[1:])
            ]
        )
        self.stiffness: Floats = self._left[self._start].copy()
        self.limit: Floats = limits[self._order[self._start]]
        self.broken: list[int] = []
        self._gone = np.zeros(len(first), dtype=np.int64)
        direction = self._geometry.direction[first]
        self._strain = _strain_matrix(self._assembler, network.springs[first], direction)
        self._force = self._assembler.restrict(network.forces[-1])
        moved = along_springs(network, network.displacements[-1])[first]
        self._given: Floats = np.einsum("ij,ij->i", moved, direction)
        self._response = np.empty((len(first), _MOST_WEAKENED), order="F")
        self._factorise()
        self._unbroken = float(np.abs(self.elongation).max())

    @property
    def stored(self) -> float:
        """Energy in the springs (J)."""
        return 0.5 * float(self.stiffness @ self.elongation**2)

    @property
    def pushed(self) -> float:
        """Work that the supports' final forces would do on their displacements (J)."""
        return float((self.stiffness * self.elongation) @ self._given)

    def break_weakest(self, joint: int) -> int:
        """Take the weakest spring out of a joint; return its number.

        Raises
        ------
        GivesWayError
            If what is left does not resist.
        """
        place = self._start[joint] + self._gone[joint]
        self._gone[joint] += 1
        spring = int(self._order[place])
        self.broken.append(spring)
        emptied = self._gone[joint] == self._count[joint]
        self.stiffness[joint] = 0.0 if emptied else self._left[place + 1]
        self.limit[joint] = np.inf if emptied else self._limits[self._order[place + 1]]
        if joint not in self._weakened and len(self._weakened) < _MOST_WEAKENED:
            self._weaken(joint)
        if joint not in self._weakened or not self._correct():
            self._factorise()
        if not np.abs(self.elongation).max() * _RESISTING <= self._unbroken:
            raise GivesWayError(self._solution / np.linalg.norm(self._solution))
        return spring

    def displacement(self) -> Floats:
        """Return the displacement of the nodes (m), shape (n, dimension)."""
        if self._weakened:
            self._factorise()
        moved = self._assembler.expand(self._solution)
        return np.where(self.network.held, self.network.displacements[-1], moved)

    def _factorise(self) -> None:
        """Factorise what is left, and solve with it."""
        kept = self.intact * self.network.stiffness
        tangent = self._assembler.tangent(self._geometry, np.zeros(len(kept)), kept)
        self._solver.factorise(tangent)
        self._basis = self.stiffness.copy()
        load = self._force - self._strain.T @ (self.stiffness * self._given)
        self._solution = self._solver.solve(load)
        self.elongation = self._first = self._strain @ self._solution + self._given
        self.yielded = self._first_yielded = float(self._force @ self._solution)
        self._weakened: list[int] = []
        self._yielded_by: list[float] = []

    def _weaken(self, joint: int) -> None:
        """Find what a pair of forces along a joint does to the network."""
        pulled = self._solver.solve(self._strain[[joint]].toarray().ravel())
        self._response[:, len(self._weakened)] = self._strain @ pulled
        self._yielded_by.append(float(self._force @ pulled))
        self._weakened.append(joint)

    def _correct(self) -> bool:
        """Correct the answer for the weakened joints; tell whether that was precise."""
        root = np.sqrt((self._basis - self.stiffness)[self._weakened])
        response = self._response[:, : len(root)]
        resistance = np.eye(len(root)) - root[:, None] * response[self._weakened] * root
        lower, back, failed = dposv(resistance, root * self._first[self._weakened], lower=1)
        if failed or lower.diagonal().min() ** 2 < _PRECISE:
            return False
        back *= root
        self.elongation = self._first + response @ back
        self.yielded = self._first_yielded + float(np.dot(self._yielded_by, back))
        return True

    @property
    def intact(self) -> Flags:
        """Which springs are left, shape (m,)."""
        left = np.ones(len(self.network.springs), dtype=bool)
        left[self.broken] = False
        return left


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
