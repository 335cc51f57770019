"""A linear body in small strain that loses stiffness, its factors kept and corrected.

Every strain is a *row*: K = Bᵀ k B with a stiffness k for every row of B. With factors of K at
hand, K + V d Vᵀ (a column of V and a loss d < 0 of stiffness for every weakened row) is solved by
putting the lost forces back as loads: u = u₀ − K⁻¹V d e, where the elongations e of those rows
solve (1 + VᵀK⁻¹V d) e = e₀.

References
----------
W. W. Hager, "Updating the inverse of a matrix", SIAM Review 31 (1989) 221-239.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar, Literal

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.sparse import csc_array, csr_array, diags_array

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.network.linear import DirectSolver, SingularTangentError

Measure = Literal["force", "stress", "strain", "energy"]
"""What is exceeded: a spring's tension (N) or a cell's largest principal stress (Pa), the largest
strain, or the energy (J) of either."""

_RESISTING = 1e-6
"""Share of the unbroken body's resistance below which a body has parted: the equations of a body
that hardly resists lose the digits by which its parts differ."""


class WeakeningBody:
    """A body under its whole load (a load factor of 1), of parts that break.

    `strain`, shape (r, f): B, elongation of the rows by displacement of the free coordinates;
    `stiffness`, shape (r,): k, energy of a row over half the square of its elongation; `given`,
    shape (r,): elongation by what supports are moved by; `force`, shape (f,): of the load, such
    that F·u is its work (J); `most`: weakened rows from which on there are new factors, in the
    `order` of `splu`. A body that does not resist raises `SingularTangentError`.

    `yielded`: F·u, the work (J) that the final forces would do on the displacements; `pull`,
    `shift`: size of the load, Σ |F| (N), or how far supports are moved at most (m).
    """

    precise: ClassVar[float]
    """Share of its resistance that the body must keep for corrections to be precise."""
    parted: ClassVar[float]
    """Share of its first resistance to moved supports below which a body has parted."""
    pull: float
    shift: float

    def __init__(
        self,
        strain: csr_array,
        stiffness: Floats,
        given: Floats,
        force: Floats,
        most: int,
        order: str,
    ) -> None:
        self._strain, self.stiffness = strain, stiffness
        self._given, self._force = given, force
        self._solver = DirectSolver(order)
        self._response = np.empty((len(stiffness), most), order="F")
        self._place = np.full(len(stiffness), -1)
        self._weakened: list[int] = []
        self._yielded_by: Floats = np.empty(0)
        self.broken: list[int] = []
        self._factorise()
        self._unbroken = float(np.abs(self.elongation).max())

    @property
    def stored(self) -> float:
        """Energy in the body (J)."""
        return 0.5 * float(self.stiffness @ self.elongation**2)

    @property
    def pushed(self) -> float:
        """Work that the supports' final forces would do on their displacements (J)."""
        return float((self.stiffness * self.elongation) @ self._given)

    @property
    @abstractmethod
    def shares(self) -> Floats:
        """How much of the load that it survives every part bears; negative: it is pressed."""

    @abstractmethod
    def break_part(self, place: int) -> tuple[int, float]:
        """Break the part at a place of the shares; return its number and the energy (J) freed."""

    @abstractmethod
    def place_of(self, part: int) -> int:
        """Return the place among the shares that stands for a part."""

    @property
    @abstractmethod
    def points(self) -> tuple[Floats, Ints]:
        """Places of nodes or corners (m), and which of them every spring or cell has."""

    @abstractmethod
    def displacement(self) -> Floats:
        """Return the displacement of the points (m), shape (n, dimension)."""

    @abstractmethod
    def borne(self) -> Floats:
        """Return what every part bears: tension (N) or largest principal stress (Pa)."""

    def weaken(self, rows: Ints, stiffness: Floats) -> float:
        """Give rows less stiffness; return the energy (J) that this releases."""
        lost, before = self.stiffness[rows] - stiffness, self.elongation[rows]
        self.stiffness[rows] = stiffness
        fresh = rows[self._place[rows] < 0]
        first, last = len(self._weakened), len(self._weakened) + len(fresh)
        if last > self._response.shape[1]:
            self._factorise()
        else:
            if len(fresh):
                pulled = self._solver.solve(self._strain[fresh].toarray().T)
                self._response[:, first:last] = self._strain @ pulled
                self._yielded_by = np.append(self._yielded_by, self._force @ pulled)
                self._place[fresh] = np.arange(first, last)
                self._weakened.extend(fresh.tolist())
            if not self._correct():
                self._factorise()
        if not np.abs(self.elongation).max() * _RESISTING <= self._unbroken:
            raise SingularTangentError(self._solution / np.linalg.norm(self._solution))
        return 0.5 * float(np.sum(lost * before * self.elongation[rows]))

    def solution(self) -> Floats:
        """Return the displacement of the free coordinates, shape (f,)."""
        if self._weakened:
            self._factorise()
        return self._solution

    def _factorise(self) -> None:
        """Factorise the weakened body, and solve with it."""
        matrix = self._strain.T @ (diags_array(self.stiffness) @ self._strain)
        self._solver.factorise(csc_array(matrix))
        self._basis = self.stiffness.copy()
        load = self._force - self._strain.T @ (self.stiffness * self._given)
        self._solution = self._solver.solve(load)
        # A body that hardly resists costs digits: a second step wins them back.
        self._solution += self._solver.solve(load - matrix @ self._solution)
        self.elongation = self._first = self._strain @ self._solution + self._given
        self.yielded = self._first_yielded = float(self._force @ self._solution)
        self._place[self._weakened] = -1
        self._weakened = []
        self._yielded_by = np.empty(0)

    def _correct(self) -> bool:
        """Correct the answer for the weakened rows; tell whether that was precise."""
        root = np.sqrt((self._basis - self.stiffness)[self._weakened])
        response = self._response[:, : len(root)]
        resistance = np.eye(len(root)) - root[:, None] * response[self._weakened] * root
        lower, back, failed = dposv(resistance, root * self._first[self._weakened], lower=1)
        if failed or lower.diagonal().min() ** 2 < self.precise:
            return False
        back *= root
        # Not by BLAS, whose threads wait for each other where others are at work.
        self.elongation = self._first + np.einsum("rw,w->r", response, back)
        self.yielded = self._first_yielded + float(self._yielded_by @ back)
        return True


def measured(measure: str, known: Mapping[str, Callable[[], Floats]]) -> Callable[[], Floats]:
    """Return the function of a measure, of those that a body has."""
    if measure not in known:
        raise ParameterError(f"measure: {', '.join(map(repr, known))}, got {measure!r}")
    return known[measure]
