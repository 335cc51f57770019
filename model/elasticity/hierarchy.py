"""Multigrid for equal cells: any form of the body and any mix of materials.

The finest level stores no matrix, only the moduli of cells and edges; a parents' level stores
what its faces feel when their children follow them (`stencils`), which is robust where the
moduli jump by 10⁶ and next to holes. What a face cannot do is said on the finest level alone: its
parents need no case of their own. One symmetric V-cycle with Gauss-Seidel sweeps is the
preconditioner.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene.kinds import AIR, FOUNDATION, RIGID, ROLLER

from . import sweeps
from .krylov import best_of, dot
from .moduli import REENTRANT_WEIGHT, Moduli
from .problem import ElasticProblem, FaceFields, rim_layer
from .stencils import Stencil, coarsening, finest_entries

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]

FIRST = 4
"""Place of the body's first cell: ghosts and what looks beyond them lie before it.

Even, so that children and parents agree on which places are even.
"""
SMALLEST = {2: 8, 3: 4}
"""A level of at most so many cells along every axis is solved by its inverse."""
SWEEPS = {2: (2, 2), 3: (3, 1)}
"""Gauss-Seidel sweeps before and after the visit to the parents: on the finest level, below it.

In space a parent feels 235 faces, eleven times as many as a face of the finest level.
"""
GUARD = 1e-11
"""Share of its own stiffness by which every face of the smallest level is held: ghosts may follow
from each other, which leaves a load in balance but not their places."""


class Level(NamedTuple):
    """One grid, as `sweeps` wants it, and the space to work in."""

    cells: tuple[int, ...]
    arrays: tuple[Any, ...]
    stencil: Stencil | None
    u: Vector
    load: Vector


class Hierarchy:
    """Multigrid on the equal cells of a body.

    Its vectors hold all components' places with ghosts around them; see `gather` and `scatter`.

    Parameters
    ----------
    problem : ElasticProblem
    moduli : Moduli, optional
        Instead of the problem's own: the mixed form leaves the pressure's part out.
    """

    def __init__(self, problem: ElasticProblem, moduli: Moduli | None = None) -> None:
        self.dimension, self.sweeps = problem.dimension, SWEEPS[problem.dimension]
        self.levels = [_finest(problem, moduli or problem.moduli)]
        while len(self.levels) == 1 or max(self.levels[-1].cells) > SMALLEST[self.dimension]:
            self.levels.append(_parents(self.levels[-1], len(self.levels)))
        self._parity = np.resize([1.0, 0.0], max(level.arrays[7][2] for level in self.levels) + 2)
        self._direct = _Direct(self.levels[-1])

    @property
    def depth(self) -> int:
        """Number of levels."""
        return len(self.levels)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which entries of a vector are faces that can move."""
        return np.asarray(self.levels[0].arrays[2] > 0.0)

    @property
    def stiffness(self) -> Vector:
        """A face's own stiffness; 0 where it cannot move."""
        inverse: Vector = self.levels[0].arrays[2]
        return np.divide(1.0, inverse, out=np.zeros_like(inverse), where=self.moving)

    def gather(self, fields: FaceFields) -> Vector:
        """Return the values of the faces that can move; all else is 0."""
        level = self.levels[0]
        vector = np.zeros(level.arrays[2].size)
        for view, values in zip(self.views(vector), fields, strict=True):
            view[:] = values
        vector *= self.moving
        return vector

    def scatter(self, vector: Vector, fields: FaceFields) -> None:
        """Add the values of the faces that can move to arrays of all faces."""
        for view, values in zip(self.views(vector), fields, strict=True):
            values += view

    def views(self, vector: Vector) -> FaceFields:
        """Return a vector as one array per axis, the rim included."""
        level = self.levels[0]
        box = level.arrays[7]
        shape = (box[0], box[2]) if self.dimension == 2 else tuple(box[:3])
        part = vector.reshape(self.dimension, *shape)
        views = []
        for axis in range(self.dimension):
            ends = [FIRST + n + 1 + (a == axis) for a, n in enumerate(level.cells)]
            views.append(part[axis][tuple(slice(FIRST - 1, end) for end in ends)])
        return tuple(views)

    def apply(self, x: Vector) -> Vector:
        """Return the stiffness times x."""
        out = np.empty_like(x)
        sweeps.residual(x, x, 0.0, self.levels[0].arrays, out)
        return np.negative(out, out=out)

    def precondition(self, load: Vector) -> Vector:
        """Return one V-cycle's answer to a load."""
        out = np.empty_like(load)
        self._cycle(0, load, out)
        return out

    def full_multigrid(self, load: Vector, guess: Vector | None = None) -> tuple[Vector, float]:
        """Start from the coarsest answer and improve it level by level.

        On the finest level from the best combination of the parents' answer and the guess.

        Returns
        -------
        start : array
            The finest grid's first answer.
        energy : float
            Potential energy, on the finest grid, of the parents' answer before it was improved.
        """
        loads = [load]
        for fine, coarse in zip(self.levels, self.levels[1:], strict=False):
            loads.append(np.empty_like(coarse.load))
            sweeps.restrict(loads[-2], loads[-1], fine.arrays, coarse.arrays[7])
        x, energy = self._direct.solve(loads[-1]), 0.0
        for at in range(len(self.levels) - 2, -1, -1):
            coarser, left = self.follow(at, x), np.empty_like(loads[at])
            sweeps.residual(coarser, loads[at], 1.0, self.levels[at].arrays, left)
            if at == 0:
                energy = -0.5 * float(dot(load, coarser) + dot(left, coarser))
                if guess is not None:
                    held = load - left, self.apply(guess)
                    coarser, force = best_of(load, coarser, held[0], guess, held[1])
                    left = load - force
            x = np.empty_like(left)
            self._cycle(at, left, x)
            x += coarser
        return x, energy

    def follow(self, at: int, parents: Vector) -> Vector:
        """Return where the children on a level are if they follow their parents."""
        level = self.levels[at]
        x = np.zeros(level.arrays[2].size)
        sweeps.prolong(x, parents, level.arrays, self.levels[at + 1].arrays[7])
        return x

    def rough(self, x: Vector) -> Vector:
        """Return what the parents cannot represent of x, all but: x less its mean over each."""
        fine, coarse = self.levels[0].arrays, self.levels[1].arrays[7]
        weight, mean = np.empty_like(self.levels[1].load), np.empty_like(self.levels[1].load)
        sweeps.restrict(self.moving.astype(np.float64), weight, fine, coarse)
        sweeps.restrict(x, mean, fine, coarse)
        np.divide(mean, weight, out=mean, where=weight > 0.1)
        mean[weight <= 0.1] = 0.0
        return np.asarray(x - self.follow(0, mean))

    def _cycle(self, at: int, load: Vector, u: Vector) -> None:
        if at == len(self.levels) - 1:
            u[:] = self._direct.solve(load)
            return
        level, below = self.levels[at], self.levels[at + 1]
        rest = (level.arrays, below.arrays[7], self._parity, self.sweeps[at > 0])
        sweeps.descend(u, load, below.load, *rest)
        self._cycle(at + 1, below.load, below.u)
        sweeps.ascend(u, load, below.u, *rest)


class _Direct:
    """The smallest level's inverse."""

    def __init__(self, level: Level) -> None:
        assert level.stencil is not None
        coefficients, inverse, (planes, rows, length) = (*level.arrays[1:3], level.arrays[7][:3])
        n = planes * rows * length
        self._there = np.flatnonzero(inverse)
        number = np.full(len(inverse), -1)
        number[self._there] = np.arange(len(self._there))
        matrix = np.zeros((len(self._there),) * 2)
        for a, b, *way, entry, p, q, j in level.stencil.couplings:
            here = self._there[(a * n <= self._there) & (self._there < (a + 1) * n)]
            other = here + (b - a) * n + (way[0] * rows + way[1]) * length + way[2]
            spot = here - a * n + (p * rows + q) * length + j
            some = number[other] >= 0
            value = coefficients[spot // length, entry, spot % length]
            matrix[number[here[some]], number[other[some]]] = value[some]
        size = np.sqrt(matrix.diagonal())
        matrix /= np.outer(size, size)
        matrix[np.diag_indices_from(matrix)] += GUARD
        self._inverse = np.linalg.inv(matrix) / np.outer(size, size)

    def solve(self, load: Vector) -> Vector:
        x = np.zeros_like(load)
        x[self._there] = self._inverse @ load[self._there]
        return x


def _box(cells: tuple[int, ...], first: int, reach: int) -> Integers:
    """Return the measures of a level's arrays; see `sweeps`."""
    sizes = [2 * ((n + 9) // 2) for n in cells]
    ranges = [(first, n + 5) for n in cells]
    if len(cells) == 2:
        sizes.insert(1, 1)
        ranges.insert(1, (0, 1))
    return np.array([*sizes, *(end for pair in ranges for end in pair), reach], dtype=np.int64)


def _steps(box: Integers, dimension: int) -> Integers:
    plane, length = box[1] * box[2], box[2]
    return np.array([plane, 1] if dimension == 2 else [plane, length, 1], dtype=np.int64)


_NO_INTEGERS = np.zeros(0, dtype=np.int64)
_NO_COUPLINGS = np.zeros((0, 4), dtype=np.int64)


def _finest(problem: ElasticProblem, moduli: Moduli) -> Level:
    d = problem.dimension
    box = _box(problem.shape, FIRST, 1)
    shape = (int(box[0]), int(box[2])) if d == 2 else tuple(int(n) for n in box[:3])
    n, steps = int(np.prod(shape)), _steps(box, d)
    kinds = np.full(shape, AIR, dtype=np.int32)
    body = tuple(slice(FIRST - 1, FIRST + size + 1) for size in problem.shape)
    kinds[body] = problem.kinds
    law, inverse = np.zeros((2 + d * (d - 1) // 2, n)), np.zeros(d * n)
    sweeps.lay_moduli(kinds.ravel(), _table(moduli), REENTRANT_WEIGHT, law, steps)
    _lay_beds(problem, law[0].reshape(shape)[body])
    holds = (kinds == RIGID) | (kinds == ROLLER)
    code = (kinds >= 0).view(np.int8) + 2 * holds.view(np.int8)
    sweeps.lay_faces(code.ravel(), law, steps, inverse)
    arrays = (law, np.zeros((0, 0, 0)), inverse, _NO_COUPLINGS, *[_NO_INTEGERS] * 3, box, steps)
    return Level(problem.shape, arrays, None, np.zeros(0), np.zeros(0))


def _table(moduli: Moduli) -> NDArray[np.float64]:
    """Return what `sweeps.lay_moduli` wants to know of every kind of cell."""
    table = np.zeros((len(moduli.shear) - min(AIR, RIGID, ROLLER, FOUNDATION), 5))
    table[:, 2] = np.inf
    count = len(moduli.shear)
    table[:count, 0], table[:count, 1] = moduli.stretch, moduli.lateral
    table[:count, 2] = 1.0 / moduli.shear
    table[RIGID, 2] = 0.0
    table[AIR, 3] = table[RIGID, 4] = 1.0
    return table


def _lay_beds(problem: ElasticProblem, stretch: NDArray[np.float64]) -> None:
    """Make every bed a ghost cell that can only be squeezed, and whose far face is held."""
    for side in range(2 * problem.dimension):
        axis, upper = divmod(side, 2)
        beyond = rim_layer(problem.dimension, side)
        face = list(beyond)
        face[axis] = -2 if upper else 1
        bed = problem.kinds[beyond] == FOUNDATION
        if bed.any():
            stretch[beyond][bed] = problem.spring[axis][tuple(face)][bed]


def _parents(fine: Level, depth: int) -> Level:
    cells = tuple((n + 1) // 2 for n in fine.cells)
    d = len(cells)
    box = _box(cells, FIRST - 1, 2)
    sums, stencil = coarsening(d, depth)
    coefficients = np.zeros((int(box[0] * box[1]), len(stencil.entries), int(box[2])))
    inverse = np.zeros(d * int(box[0] * box[1] * box[2]))
    if d == 2:
        sums = (sums[0], sums[1], sums[1])
    terms = tuple(part for step in sums for part in (step.place, step.weight, step.rows))
    entries, made = _flat_entries(d)
    sweeps.galerkin(fine.arrays, entries, made, terms, box, coefficients)
    sweeps.invert_own(coefficients, stencil.own, inverse)
    arrays = (
        np.zeros((0, 0)), coefficients, inverse, _flat(stencil, box), stencil.starts, stencil.own,
        stencil.next, box, _steps(box, d),
    )  # fmt: skip
    return Level(cells, arrays, stencil, np.zeros_like(inverse), np.zeros_like(inverse))


def _flat(stencil: Stencil, box: Integers) -> Integers:
    """Return couplings as distances: rows to the owner, entry, places along, to the other."""
    rows, length = int(box[1]), int(box[2])
    table = stencil.couplings
    n = int(box[0]) * rows * length
    far = (table[:, 2] * rows + table[:, 3]) * length + table[:, 4] + table[:, 1] * n
    return np.stack([table[:, 6] * rows + table[:, 7], table[:, 5], table[:, 8], far], axis=1)


def _flat_entries(dimension: int) -> tuple[Integers, Integers]:
    entries, made = finest_entries(dimension)
    return np.array([(a, b, *way) for a, b, way in entries], dtype=np.int64), made
