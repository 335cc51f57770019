"""A body's equations, which stay as long as it does, and the loads on it as vectors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg.blas import dasum
from scipy.sparse.linalg import SuperLU

from kaju.arrays import first_largest
from kaju.compiling import njit

from .fallback import algebraic_preconditioner, factorise
from .hierarchy import Hierarchy
from .incompressible import MixedForm
from .krylov import dot
from .problem import ACTIVE, ElasticProblem, FaceFields
from .staggered import Numbering, internal_force, stiffness_matrix

Vector = NDArray[np.float64]
Index = NDArray[np.int64]
KEPT = {2: 1_000_000, 3: 500_000}
"""Bodies of more faces give back their memory: parents take 0.1 kB a face (in
space 0.5 kB), a matrix 1 kB."""


def same_body(ours: ElasticProblem, theirs: ElasticProblem) -> bool:
    """Tell whether two problems are of the same body, alike supported, whatever their loads."""
    same = ours.plane == theirs.plane and np.array_equal(ours.kinds, theirs.kinds)
    pairs = (*zip(ours.moduli, theirs.moduli, strict=True),)
    pairs += (*zip(ours.spring, theirs.spring, strict=True),)
    return same and all(np.array_equal(a, b) for a, b in pairs)


class Prepared:
    """Parents, matrices and factors of a body and its supports, each made when first needed.

    Attributes
    ----------
    body : ElasticProblem
        The problem without loads and given displacements.
    slow : str
        Why geometric multigrid does not serve, in words; empty while it does.
    """

    def __init__(self, problem: ElasticProblem) -> None:
        self.body = replace(problem, force=(), fixed=(), surface_shear={})
        self.slow = ""

    @cached_property
    def numbering(self) -> Numbering:
        """Numbers of the faces that are free to move."""
        return Numbering(self.body.face_states())

    @cached_property
    def matrix(self) -> sp.csr_array:
        """Stiffness of the free faces."""
        return stiffness_matrix(self.body, self.numbering)

    @cached_property
    def hierarchy(self) -> Hierarchy:
        """The body's hierarchy; of a nearly incompressible one, without the pressures."""
        return self.mixed.block if self.body.needs_mixed_form else Hierarchy(self.body)

    @cached_property
    def mixed(self) -> MixedForm:
        """Displacements and pressures of a nearly incompressible body."""
        return MixedForm(self.body, self.numbering)

    @cached_property
    def factor(self) -> SuperLU:
        """The factors of the stiffness."""
        return factorise(self.matrix)

    @cached_property
    def smallest_pivot(self) -> float:
        """The least that elimination leaves of a face's stiffness, as a share of it."""
        own = self.matrix.diagonal()[np.argsort(self.factor.perm_c)]
        return float(np.min(np.abs(self.factor.U.diagonal()) / own))

    def spread(self, values: Vector) -> Vector:
        """Return a vector of the free faces alone as one of the hierarchy's."""
        vector = np.zeros(self.hierarchy.moving.size)
        vector[self.hierarchy.moving] = values
        return vector

    @cached_property
    def algebraic(self) -> Callable[[Vector], Vector] | None:
        """A cycle of algebraic multigrid; None if pyamg is not installed."""
        cycle = algebraic_preconditioner(self.matrix, self.numbering)
        if cycle is None:
            return None
        return lambda load: self.spread(cycle(load[self.hierarchy.moving]))

    @property
    def worth_keeping(self) -> bool:
        """Whether the next problem may have it: not if it is large."""
        d, faces = self.body.dimension, self.body.dimension * self.body.kinds.size
        return self.hierarchy.plain or faces <= KEPT[d]


@njit(cache=True)
def _compare(a, b):  # type: ignore[no-untyped-def]
    """Return a·b, a·a, b·b and max|a − b|."""
    both = first = second = gap = 0.0
    for i in range(len(a)):
        both += a[i] * b[i]
        first += a[i] * a[i]
        second += b[i] * b[i]
        gap = max(gap, abs(a[i] - b[i]))
    return both, first, second, gap


def likeness(old: FaceFields, new: FaceFields) -> tuple[float, float]:
    """Return how far values are from others, and (relative) from the nearest multiple of them.

    The first is the largest difference, the second one in the mean.
    """
    pairs = zip(old, new, strict=True)
    both, first, second, gaps = np.array([_compare(a.ravel(), b.ravel()) for a, b in pairs]).T
    square, products = second.sum(), first.sum() * second.sum()
    rest = 1.0 - both.sum() ** 2 / products if products > 0.0 else float(square > 0.0)
    return float(gaps.max()), float(np.sqrt(max(rest, 0.0)))


class System:
    """A problem's loads on the faces that are free to move.

    Attributes
    ----------
    problem : ElasticProblem
    prepared : Prepared
        What solves it.
    load, right : arrays
        External forces, and these without what the given displacements take.

    The unknown is what is missing to a displacement that leads smoothly from moved sides to those
    opposite. Were it the displacement itself, it would jump at a moved side, and the parents'
    answer with it, by more the finer the grid.
    """

    def __init__(self, problem: ElasticProblem, prepared: Prepared) -> None:
        self.problem, self.prepared = problem, prepared
        self.load = self.gather(problem.force)
        self.right = self.load
        self._given, self._lead = 0.0, problem.fixed
        if any(values.any() for values in problem.fixed):
            origin = np.zeros(problem.dimension, dtype=np.int64)
            cells = np.array(problem.shape)
            self._lead = lead(problem, _moved(problem), origin, cells)
            pull = internal_force(problem, self._lead)
            self._given = sum(float(np.vdot(a, b)) for a, b in zip(pull, self._lead, strict=True))
            self.right = self.load - self.gather(pull)

    def gather(self, fields: FaceFields) -> Vector:
        """Return the free faces' values as a vector of the hierarchy."""
        return self.prepared.hierarchy.gather(fields)

    def unknown(self, displacement: FaceFields) -> Vector:
        """Return the vector that `displacement` takes back."""
        found = self.gather(displacement)
        return found if self.right is self.load else found - self.gather(self._lead)

    def displacement(self, unknown: Vector) -> FaceFields:
        """Return displacements of all faces, the given ones included."""
        if self.right is not self.load:
            unknown = unknown + self.gather(self._lead)
        fields = tuple(values.copy() for values in self.problem.fixed)
        self.prepared.hierarchy.scatter(unknown, fields)
        return fields

    def unheld(self, left: Vector) -> float:
        """Return by how much supports and loads differ where forces are left, as a share of all."""
        most = float(np.abs(left.reshape(self.problem.dimension, -1).sum(axis=1)).max())
        return most / (self._loads or 1.0)

    @cached_property
    def _loads(self) -> float:
        return float(dasum(self.right))

    def energy(self, x: Vector) -> float:
        """Return twice the stored energy of a solution x (or of what is nearly one)."""
        if self.right is self.load:
            return float(dot(x, self.load))
        return 2 * float(dot(x, self.load)) - float(dot(x, self.right)) + self._given


def lead(problem: ElasticProblem, moved: Vector, origin: Index, cells: Index) -> FaceFields:
    """Return displacements that fall linearly from those of moved sides to the sides opposite.

    Parameters
    ----------
    problem : ElasticProblem
        A whole body, or a window of one.
    moved : array
        Displacement of the body's sides, shape (axis, end, component).
    origin : array
        The window's first cell, counted from the body's.
    cells : array
        Cells of the body along each axis.
    """
    fields = []
    for component, fixed in enumerate(problem.fixed):
        field = np.zeros_like(fixed)
        for axis, (lower, upper) in enumerate(moved[:, :, component]):
            # Faces along the axis lie between the cells, those across in their middle.
            last = max(cells[axis] - (axis != component), 1)
            share = (np.arange(fixed.shape[axis]) - 1 + origin[axis]) / last
            share = np.clip(share, 0.0, 1.0)
            along = lower * (1.0 - share) + upper * share
            field += along.reshape([-1 if a == axis else 1 for a in range(problem.dimension)])
        fields.append(np.where(problem.face_states()[component] == ACTIVE, field, fixed))
    return tuple(fields)


def _moved(problem: ElasticProblem) -> Vector:
    """Return by what the sides of a body are moved."""
    d = problem.dimension
    moved = np.zeros((d, 2, d))
    for component, fixed in enumerate(problem.fixed):
        for axis in range(d):
            lines = np.moveaxis(fixed, axis, 0)
            # The wall's own faces along the axis, ghosts beyond it across.
            first, last = (1, -2) if axis == component else (0, -1)
            # The rim's corners, and the walls at both ends of a side, belong to other sides.
            beside = tuple(
                slice(2, -2) if a == component else slice(1, -1) for a in range(d) if a != axis
            )
            moved[axis, :, component] = [_largest(lines[layer][beside]) for layer in (first, last)]
    return moved


def _largest(values: Vector) -> float:
    """Return the value of largest size: what a side is moved by where nothing else holds it."""
    return float(values.flat[first_largest(np.abs(values.ravel()))]) if values.size else 0.0
