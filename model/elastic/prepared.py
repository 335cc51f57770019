"""What solves a body's equations whatever its loads: it stays as long as the body does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU

from .fallback import algebraic_preconditioner, factorise
from .hierarchy import Hierarchy
from .incompressible import MixedForm
from .problem import ElasticProblem
from .staggered import Numbering, stiffness_matrix

Vector = NDArray[np.float64]

KEPT = 500_000
"""Bodies of more faces give back the memory of their matrices (about 1 kB a face)."""


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
        faces = self.body.dimension * self.body.kinds.size
        return self.hierarchy.plain or faces <= KEPT
