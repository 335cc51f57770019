"""Loads and unknowns of a problem as vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.model.compiling import njit

from .krylov import dot
from .prepared import Prepared
from .problem import ElasticProblem, FaceFields
from .staggered import internal_force

Vector = NDArray[np.float64]


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
    """

    def __init__(self, problem: ElasticProblem, prepared: Prepared) -> None:
        self.problem, self.prepared = problem, prepared
        self.load = self.gather(problem.force)
        self.right = self.load
        self._given = 0.0
        if any(values.any() for values in problem.fixed):
            pull = internal_force(problem, problem.fixed)
            self._given = sum(
                float(np.vdot(a, b)) for a, b in zip(pull, problem.fixed, strict=True)
            )
            self.right = self.load - self.gather(pull)

    def gather(self, fields: FaceFields) -> Vector:
        """Return the free faces' values as a vector of the hierarchy."""
        return self.prepared.hierarchy.gather(fields)

    def scatter(self, vector: Vector) -> FaceFields:
        """Return displacements of all faces, the given ones included."""
        fields = tuple(values.copy() for values in self.problem.fixed)
        self.prepared.hierarchy.scatter(vector, fields)
        return fields

    def energy(self, x: Vector) -> float:
        """Return twice the stored energy of a solution x (or of what is nearly one)."""
        if self.right is self.load:
            return float(dot(x, self.load))
        return 2 * float(dot(x, self.load)) - float(dot(x, self.right)) + self._given
