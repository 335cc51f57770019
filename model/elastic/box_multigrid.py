"""Multigrid for a full box of one material: no matrix is stored.

Parents obey the same law as their children, on cells twice as large. Below the finest
grid that can still be halved, `Hierarchy` takes over; it also copes with odd numbers of
cells. The V-cycle is symmetric, so it may precondition conjugate gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene.kinds import AIR, FOUNDATION, RIGID

from .fallback import factorise
from .hierarchy import Hierarchy
from .krylov import best_of, dot
from .moduli import Moduli
from .problem import (
    ElasticProblem,
    FaceFields,
    Floats,
    Scales,
    rim_layer,
)
from .staggered import Numbering, stiffness_matrix

Vector = NDArray[np.float64]
SMALLEST = 8
DIRECT = 2_000
"""A last box of at most so many faces is solved by factors of its matrix."""


@dataclass
class BoxLevel:
    """One grid of the box.

    Attributes
    ----------
    shape : tuple of int
        Number of cells along each axis.
    law : array
        C₁₁, C₁₂ and μ times the grid's scale.
    spring : array
        Stiffness of the foundation per face of each side.
    u, load : arrays
        Work space: displacement and load of all faces in one vector (not on the finest level).
    """

    shape: tuple[int, ...]
    law: Floats
    spring: Floats
    u: Vector
    load: Vector

    def views(self, vector: Vector) -> FaceFields:
        """Return a vector of all faces as one array per axis."""
        return face_views(vector, self.shape)


def face_views(vector: Vector, shape: tuple[int, ...]) -> FaceFields:
    """Return a vector of all faces of a box as one array per axis, without copying."""
    views, start = [], 0
    for axis in range(len(shape)):
        faces = tuple(n + (a == axis) for a, n in enumerate(shape))
        size = prod(faces)
        views.append(vector[start : start + size].reshape(faces))
        start += size
    return tuple(views)


def face_count(shape: tuple[int, ...]) -> int:
    """Return the number of faces of a box of cells."""
    return sum(prod(n + (a == axis) for a, n in enumerate(shape)) for axis in range(len(shape)))


def is_box(problem: ElasticProblem) -> bool:
    """Tell whether a problem is a full box of one material whose sides are of one kind each."""
    kinds = problem.kinds
    inside = kinds[problem.inner]
    if not np.all(inside == inside.flat[0]) or inside.flat[0] < 0:
        return False
    for index in range(2 * problem.dimension):
        layer = kinds[rim_layer(problem.dimension, index)]
        if not np.all(layer == layer.flat[0]):
            return False
    return all(n % 2 == 0 and n >= 2 * SMALLEST for n in problem.shape)


class BoxMultigrid:
    """Multigrid on a full box.

    Parameters
    ----------
    problem : ElasticProblem
        A problem for which `is_box` holds.
    sweeps : int
        Gauss-Seidel sweeps before and after the visit to the parents.
    """

    def __init__(self, problem: ElasticProblem, sweeps: int = 2) -> None:
        self.sweeps = sweeps
        d = problem.dimension
        self._kernels = _kernels(d)
        sides = [int(problem.kinds[rim_layer(d, s)].flat[0]) for s in range(2 * d)]
        self.wall = np.array([2.0 * (kind == RIGID) for kind in sides])
        self.held = np.array([kind not in (AIR, FOUNDATION) for kind in sides])
        rigid = np.array([kind == RIGID for kind in sides])
        self.own, self.far = np.where(rigid, 0.5, 1.25), np.where(rigid, 0.0, -0.25)
        material = int(problem.kinds[problem.inner].flat[0])
        law = np.array([m[material] for m in problem.moduli])
        self.levels = [_level(problem.shape, law, _springs(problem), work=False)]
        while all(n % 2 == 0 and n >= 2 * SMALLEST for n in self.levels[-1].shape):
            fine = self.levels[-1]
            half = tuple(n // 2 for n in fine.shape)
            scale = 2.0 ** (d - 2)
            self.levels.append(_level(half, scale * fine.law, 2.0 ** (d - 1) * fine.spring))
        self._coarsest = _Coarsest(self.levels[-1], sides, problem.plane)
        self._side = (self.wall, self.held)

    @property
    def depth(self) -> int:
        """Number of levels, those of the hierarchy beneath included."""
        return len(self.levels) + self._coarsest.depth - 1

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which entries of a vector are faces that can move."""
        vector = np.ones(face_count(self.levels[0].shape))
        self.clear_fixed(0, vector)
        return vector > 0.0

    @property
    def stiffness(self) -> float:
        """A face's own stiffness, inside."""
        stretch, _, shear = self.levels[0].law
        return float(2.0 * stretch + 2.0 * (len(self.levels[0].shape) - 1) * shear)

    def gather(self, fields: FaceFields) -> Vector:
        """Return the faces' values as a vector; 0 where they cannot move."""
        shape = self.levels[0].shape
        vector = np.empty(face_count(shape))
        for view, values in zip(self.views(vector), fields, strict=True):
            view[:] = values[(slice(1, -1),) * len(shape)]
        self.clear_fixed(0, vector)
        return vector

    def scatter(self, vector: Vector, fields: FaceFields) -> None:
        """Add a vector to arrays of all faces."""
        for view, values in zip(self.views(vector), fields, strict=True):
            values[(slice(1, -1),) * len(fields)] += view

    def views(self, vector: Vector) -> FaceFields:
        """Return a vector as one array per axis."""
        return tuple(face_views(vector, self.levels[0].shape))

    def apply(self, x: Vector) -> Vector:
        """Return the stiffness times x."""
        return self.apply_at(0, x)

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
            vector = np.empty(face_count(coarse.shape))
            nothing = fine.views(np.empty_like(loads[-1]))
            self._cross(fine, nothing, fine.views(loads[-1]), coarse.views(vector), 0, False)
            loads.append(vector)
        x, energy = self._coarsest.solve(loads[-1]), 0.0
        for at in range(len(self.levels) - 2, -1, -1):
            level, below = self.levels[at], self.levels[at + 1]
            coarser = np.zeros_like(loads[at])
            forces = level.views(loads[at])
            self._cross(level, level.views(coarser), forces, below.views(x), 0, True)
            left = self.apply_at(at, coarser)
            np.subtract(loads[at], left, out=left)
            self.clear_fixed(at, left)
            energy = -0.5 * float(dot(loads[at], coarser) + dot(left, coarser))
            if at == 0 and guess is not None:
                coarser, force = best_of(load, coarser, load - left, guess, self.apply(guess))
                left = load - force
                self.clear_fixed(0, left)
            x = np.empty_like(left)
            self._cycle(at, left, x)
            x += coarser
        return x, energy

    def clear_fixed(self, at: int, vector: Vector) -> None:
        """Set the entries of fixed faces to zero."""
        for axis, field in enumerate(self.levels[at].views(vector)):
            lines = np.moveaxis(field, axis, 0)
            if self.held[2 * axis]:
                lines[0] = 0.0
            if self.held[2 * axis + 1]:
                lines[-1] = 0.0

    def apply_at(self, at: int, x: Vector) -> Vector:
        """Return a level's stiffness times x."""
        level, out = self.levels[at], np.empty_like(x)
        sides = (level.law, *self._side, level.spring)
        self._kernels.apply(level.views(x), level.views(out), *sides)
        return out

    def _cycle(self, at: int, load: Vector, u: Vector) -> None:
        level = self.levels[at]
        if at == len(self.levels) - 1:
            u[:] = self._coarsest.solve(load)
            return
        below = self.levels[at + 1]
        fields, forces = level.views(u), level.views(load)
        self._cross(level, fields, forces, below.views(below.load), self.sweeps, False)
        self._cycle(at + 1, below.load, below.u)
        self._cross(level, fields, forces, below.views(below.u), self.sweeps, True)

    def _cross(
        self, level: BoxLevel, u: FaceFields, load: FaceFields, parents: FaceFields, sweeps: int,
        back: bool,
    ) -> None:  # fmt: skip
        """Go to the parents or back, see `kernels_2d.cross`; without sweeps hand over all."""
        sides = (level.law, *self._side, level.spring, self.own, self.far)
        self._kernels.cross(u, load, parents, *sides, sweeps, back)


class _Coarsest:
    """The last box: by factors of its matrix, or handed to the hierarchy for any body."""

    def __init__(
        self, level: BoxLevel, sides: list[int], plane: Literal["stress", "strain"] | None
    ) -> None:
        problem = _describe(level, sides, plane)
        self._shape = level.shape
        numbering = Numbering(problem.face_states())
        # Factors serve small boxes without the loops for any body, which compile for long.
        if numbering.size <= DIRECT:
            factor = factorise(stiffness_matrix(problem, numbering))
            self._gather, self._scatter = numbering.gather, numbering.scatter
            self._solve: Callable[[Vector], Vector] = factor.solve
            self.depth = 1
        else:
            hierarchy = Hierarchy(problem)
            self._gather, self._scatter = hierarchy.gather, hierarchy.scatter
            self._solve, self.depth = hierarchy.precondition, hierarchy.depth

    def solve(self, load: Vector) -> Vector:
        out = np.zeros_like(load)
        inner = (slice(1, -1),) * len(self._shape)
        loads = tuple(np.pad(view, 1) for view in face_views(load, self._shape))
        fields = tuple(np.zeros_like(values) for values in loads)
        self._scatter(self._solve(self._gather(loads)), fields)
        for view, values in zip(face_views(out, self._shape), fields, strict=True):
            view[:] = values[inner]
        return out


def _describe(
    level: BoxLevel, sides: list[int], plane: Literal["stress", "strain"] | None
) -> ElasticProblem:
    kinds = np.full([n + 2 for n in level.shape], AIR, dtype=np.int32)
    kinds[(slice(1, -1),) * kinds.ndim] = 0
    for index, kind in enumerate(sides):
        kinds[rim_layer(kinds.ndim, index)] = kind
    shapes = [
        tuple(n + (a == axis) for a, n in enumerate(kinds.shape)) for axis in range(kinds.ndim)
    ]
    spring = tuple(np.zeros(shape) for shape in shapes)
    for index, stiffness in enumerate(level.spring):
        layer = list(rim_layer(kinds.ndim, index))
        layer[index // 2] = -2 if index % 2 else 1
        spring[index // 2][tuple(layer)] = stiffness
    zeros = tuple(np.zeros(shape) for shape in shapes)
    moduli = Moduli(*(np.array([value]) for value in level.law))
    return ElasticProblem(kinds, moduli, zeros, zeros, spring, {}, Scales(1, 1, 1, 1), plane)


def _level(shape: tuple[int, ...], law: Floats, spring: Floats, *, work: bool = True) -> BoxLevel:
    size = face_count(shape) if work else 0
    return BoxLevel(shape, law, spring, np.empty(size), np.empty(size))


def _springs(problem: ElasticProblem) -> Floats:
    values = []
    for index in range(2 * problem.dimension):
        layer = list(rim_layer(problem.dimension, index))
        layer[index // 2] = -2 if index % 2 else 1
        values.append(float(problem.spring[index // 2][tuple(layer)].flat[0]))
    return np.array(values)


def _kernels(dimension: int) -> Any:
    if dimension == 2:
        from . import kernels_2d

        return kernels_2d
    from . import kernels_3d

    return kernels_3d
