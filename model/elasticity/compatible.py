"""A displacement field without gaps: from the faces' displacements to the corners of the cells.

Every corner takes the mean of the faces round it, weighted by their stiffness, and what the
supports give; between the corners it is linear along every axis. Such a field is kinematically
admissible, so its potential energy is never below that of the true one. A few steps of conjugate
gradients let it sink further.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene.kinds import RIGID, ROLLER

from .balanced import Law
from .problem import ABSENT, ElasticProblem, FaceFields, Floats
from .staggered import cell_modulus, cut

Index = NDArray[np.int64]

STEPS = 4
"""Of conjugate gradients: more lower the energy by little."""


class CompatibleField:
    """Displacements of the corners of a body's cells.

    Parameters
    ----------
    problem : ElasticProblem
    u : tuple of arrays
        Face displacements, scaled.
    cells : int array, shape (cells, dimension)
        Cells of material, rim counted.
    law : Law
    side, traction : arrays
        Forces by sides of cells: which (cell, direction) and the vectors, shape (n, dimension).
    body : array, shape (dimension, cells)
        Forces within the cells.

    Attributes
    ----------
    displacement : array, shape (corners, dimension)
        Of all corners of the box round the body, flattened.
    jumps : bool
        Whether supports give a corner two displacements at once: no field without gaps has that.
    """

    def __init__(
        self,
        problem: ElasticProblem,
        u: FaceFields,
        cells: Index,
        law: Law,
        side: tuple[Index, Index],
        traction: Floats,
        body: Floats,
    ) -> None:
        d = problem.dimension
        self.problem, self.cells, self.law = problem, cells, law
        self._shape = tuple(n + 1 for n in problem.kinds.shape)
        self._ends = np.array(list(product((0, 1), repeat=d)))
        self._corner = np.stack(
            [np.ravel_multi_index(tuple((cells + end).T), self._shape) for end in self._ends]
        )
        self._strain, self._stiffness = _element(self._ends)
        self._load = self._forces(side, traction, body)
        self._given, self.jumps = self._supports()
        self._bed = self._beds()
        values = _corner_means(problem, u)
        self.displacement = np.where(np.isnan(self._given), values, self._given)

    def _forces(self, side: tuple[Index, Index], traction: Floats, body: Floats) -> Floats:
        load = np.zeros((int(np.prod(self._shape)), self.problem.dimension))
        each = body.T / len(self._ends)
        for corner in self._corner:
            np.add.at(load, corner, each)
        cell, direction = side
        for corner, end in zip(self._corner, self._ends, strict=True):
            on = end[direction // 2] == direction % 2
            np.add.at(load, corner[cell[on]], 2.0 * traction[on] / len(self._ends))
        return load

    def _beyond(self, direction: int) -> NDArray[np.int32]:
        beyond = self.cells.copy()
        beyond[:, direction // 2] += 2 * (direction % 2) - 1
        return np.asarray(self.problem.kinds[tuple(beyond.T)])

    def _supports(self) -> tuple[Floats, bool]:
        """Return the given displacements (NaN where free), and whether they contradict."""
        given = np.full((int(np.prod(self._shape)), self.problem.dimension), np.nan)
        jumps = False
        for kind in (ROLLER, RIGID):
            for direction in range(2 * self.problem.dimension):
                at = np.flatnonzero(self._beyond(direction) == kind)
                axis, upper = divmod(direction, 2)
                value = np.stack(self.side_displacement(at, direction), axis=1)
                for corner, end in zip(self._corner, self._ends, strict=True):
                    if end[axis] != upper:
                        continue
                    for component in [axis] if kind == ROLLER else range(value.shape[1]):
                        old = given[corner[at], component]
                        new = value[:, component]
                        jumps |= bool(np.any(~np.isnan(old) & (old != new)))
                        given[corner[at], component] = new
        return given, jumps

    def side_displacement(self, at: Index, direction: int) -> list[Floats]:
        """Return the displacement that supports give the sides of cells, by component."""
        axis, upper = divmod(direction, 2)
        found = []
        for component, fixed in enumerate(self.problem.fixed):
            place = self.cells[at].copy()
            if component == axis:
                place[:, axis] += upper
            else:
                place[:, axis] += 2 * upper - 1
            found.append(fixed[tuple(place.T)])
        return found

    def _beds(self) -> list[tuple[Index, int, Floats]]:
        """Return cells, direction and stiffness of the sides that stand on a bed."""
        beds = []
        for direction in range(2 * self.problem.dimension):
            axis, upper = divmod(direction, 2)
            place = self.cells.copy()
            place[:, axis] += upper
            stiffness = self.problem.spring[axis][tuple(place.T)]
            on = np.flatnonzero((stiffness > 0) & (self._beyond(direction) < 0))
            if len(on):
                beds.append((on, direction, stiffness[on]))
        return beds

    @property
    def beds(self) -> list[tuple[Index, int, Floats]]:
        """Cells, direction and stiffness (scaled) of the sides that stand on a bed."""
        return self._bed

    def force(self, v: Floats) -> Floats:
        """Return the forces that hold corners at a displacement."""
        out = np.zeros_like(v)
        d = v.shape[1]
        moved = v[self._corner].transpose(0, 2, 1).reshape(-1, len(self.cells))
        held = sum(
            (matrix @ moved) * modulus
            for matrix, modulus in zip(self._stiffness, self._moduli, strict=True)
        )
        for k, corner in enumerate(self._corner):
            np.add.at(out, corner, held[k * d : (k + 1) * d].T)
        for cell, direction, stiffness in self._bed:
            axis, on = divmod(direction, 2)
            ends = [k for k, end in enumerate(self._ends) if end[axis] == on]
            for i in ends:
                for j in ends:
                    apart = int(np.abs(self._ends[i] - self._ends[j]).sum())
                    weight = 2.0**-apart / 3.0 ** (d - 1)
                    pull = weight * stiffness * v[self._corner[j][cell], axis]
                    np.add.at(out[:, axis], self._corner[i][cell], pull)
        return out

    @property
    def _moduli(self) -> tuple[Floats, Floats, Floats]:
        return self.law.stretch, self.law.lateral, self.law.shear

    def settle(self, steps: int = STEPS) -> None:
        """Take some steps of conjugate gradients towards the least potential energy."""
        free = np.isnan(self._given)
        diagonal = self._diagonal()
        free &= diagonal > 0.0
        weight = np.where(free, 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
        left = np.where(free, self._load - self.force(self.displacement), 0.0)
        z = weight * left
        way, before = z.copy(), float(np.vdot(left, z))
        for _ in range(steps):
            if before <= 0.0:
                return
            pull = np.where(free, self.force(way), 0.0)
            step = before / float(np.vdot(way, pull))
            self.displacement += step * way
            left -= step * pull
            z = weight * left
            now = float(np.vdot(left, z))
            way, before = z + now / before * way, now

    def _diagonal(self) -> Floats:
        d = self.problem.dimension
        out = np.zeros_like(self._given)
        for k, corner in enumerate(self._corner):
            for a in range(d):
                own = sum(
                    matrix[k * d + a, k * d + a] * modulus
                    for matrix, modulus in zip(self._stiffness, self._moduli, strict=True)
                )
                np.add.at(out[:, a], corner, own)
        for cell, direction, stiffness in self._bed:
            axis, on = divmod(direction, 2)
            for k, end in enumerate(self._ends):
                if end[axis] == on:
                    np.add.at(out[:, axis], self._corner[k][cell], stiffness / 3.0 ** (d - 1))
        return out

    def energies(self) -> Floats:
        """Return the strain energy of every cell, scaled."""
        moved = self.displacement[self._corner].transpose(0, 2, 1).reshape(-1, len(self.cells))
        return np.asarray(
            0.5
            * sum(
                np.einsum("in,in->n", moved, matrix @ moved) * modulus
                for matrix, modulus in zip(self._stiffness, self._moduli, strict=True)
            )
        )

    def work(self) -> float:
        """Return the work of the loads."""
        return float(np.vdot(self._load, self.displacement))

    def whole_energy(self) -> float:
        """Return the energy in body and bed."""
        return 0.5 * float(np.vdot(self.displacement, self.force(self.displacement)))

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the cells, shape (cells, d, d)."""
        moved = self.displacement[self._corner]  # ends, cells, component
        gradient = np.einsum("kb,kna->nab", self._strain, moved)
        return np.asarray(0.5 * (gradient + gradient.transpose(0, 2, 1)))


def _element(ends: Index) -> tuple[Floats, tuple[Floats, Floats, Floats]]:
    """Return the mean gradients of the corners' functions, and the cell's three matrices.

    The stiffness of a cell of unit edge is C₁₁ times the first, C₁₂ the second, μ the third.
    """
    d = ends.shape[1]
    size = len(ends) * d
    matrices = [np.zeros((size, size)) for _ in range(3)]
    mean = np.zeros((len(ends), d))
    points = np.array(list(product((0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)), repeat=d)))
    for point in points:
        gradient = np.ones((len(ends), d))
        for axis in range(d):
            for other in range(d):
                value = np.where(ends[:, other] == 1, point[other], 1.0 - point[other])
                slope = 2.0 * ends[:, other] - 1.0
                gradient[:, axis] *= slope if other == axis else value
        mean += gradient / len(points)
        rows = np.zeros((d, size))
        for axis in range(d):
            rows[axis, axis::d] = gradient[:, axis]
        along = rows.T @ rows
        whole = rows.sum(axis=0)
        matrices[0] += along / len(points)
        matrices[1] += (np.outer(whole, whole) - along) / len(points)
        for a in range(d):
            for b in range(a + 1, d):
                shear = np.zeros(size)
                shear[a::d], shear[b::d] = gradient[:, b], gradient[:, a]
                matrices[2] += np.outer(shear, shear) / len(points)
    return mean, (matrices[0], matrices[1], matrices[2])


def _corner_means(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the displacement of all corners by the faces round them, stiff ones counting more."""
    d = problem.dimension
    stiffness = cell_modulus(problem, problem.moduli.stretch)
    found = []
    for axis, state in enumerate(problem.face_states()):
        width = [(1, 1) if a == axis else (0, 0) for a in range(d)]
        beside = np.pad(stiffness, width)
        weight = beside[cut(d, axis, slice(None, -1))] + beside[cut(d, axis, slice(1, None))]
        values, weight = (
            np.where(state == ABSENT, 0.0, u[axis]),
            np.where(state == ABSENT, 0.0, weight),
        )
        for across in range(d):
            if across != axis:
                values, weight = _between(values, weight, across)
        found.append(values.ravel())
    return np.stack(found, axis=1)


def _between(values: Floats, weight: Floats, axis: int) -> tuple[Floats, Floats]:
    """Return weighted means of neighbours along an axis; a line's end is prolonged."""
    width = [(2, 2) if a == axis else (0, 0) for a in range(values.ndim)]
    v, w = np.pad(values, width), np.pad(weight, width)
    n = values.shape[axis]

    def part(array: Floats, start: int) -> Floats:
        return array[cut(values.ndim, axis, slice(start, start + n + 1))]

    (before, low, high, after), (w0, w1, w2, w3) = (
        [part(array, k) for k in range(4)] for array in (v, w)
    )
    whole = w1 + w2
    mean = (w1 * low + w2 * high) / np.where(whole > 0, whole, 1.0)
    from_low = np.where(w0 > 0, 1.5 * low - 0.5 * before, low)
    from_high = np.where(w3 > 0, 1.5 * high - 0.5 * after, high)
    ends = np.where(w2 > 0, from_high, from_low)
    return np.where((w1 > 0) & (w2 > 0), mean, ends), whole
