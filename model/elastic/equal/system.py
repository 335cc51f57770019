"""A problem's loads on the faces that can move, and what a solution of them is."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import TYPE_CHECKING, Annotated

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.results.stored import Column

from .krylov import Iteration, dot
from .problem import ACTIVE, FIXED, ElasticProblem, FaceFields
from .staggered import Numbering, internal_force

if TYPE_CHECKING:
    from .hierarchy import Hierarchy

NOTEWORTHY = 1e-5  # Share of the loads that rounding leaves unbalanced; refused from 0.1 on


@dataclass
class Solution:
    """Displacements of all faces and how they were found; all scaled."""

    displacement: tuple[Annotated[Floats, Column("...")], ...]  # Of faces, ghost cells included
    energy: float  # Energy stored in body and foundation
    method: str  # "direct", "full multigrid", "Galerkin multigrid", "mixed form"
    discretisation: float  # Estimated relative error in the energy norm: of the grid,
    algebraic: float  # and of the iteration
    residuals: list[float]
    converged: bool
    notes: list[str] = field(default_factory=list)  # What the solver decided by itself

    @property
    def iterations(self) -> int:
        """Number of iterations after the start."""
        return max(len(self.residuals) - 1, 0)

    @property
    def error(self) -> float:
        """Estimated relative error in the energy norm."""
        return float(np.hypot(self.discretisation, self.algebraic))


class System:
    """A problem's loads on the faces that are free to move, for the displacement less a lift.

    The lift falls linearly from moved sides to those opposite. Without it the unknown would jump at
    a moved side, and the coarse levels' answer with it, by more the finer the grid.
    """

    def __init__(self, problem: ElasticProblem, space: Hierarchy | Numbering) -> None:
        self.problem, self._space = problem, space
        self.load = space.gather(problem.force)
        self.right = self.load  # less the forces that hold the lift
        self._lift_energy, self._lift = 0.0, problem.fixed
        if any(values.any() for values in problem.fixed):
            origin = np.zeros(problem.dimension, dtype=np.int64)
            self._lift = lift(problem, origin, np.array(problem.shape))
            force = internal_force(problem, self._lift)
            pairs = zip(force, self._lift, strict=True)
            self._lift_energy = sum(float(np.vdot(a, b)) for a, b in pairs)
            self.right = self.load - space.gather(force)

    def unknown(self, displacement: FaceFields) -> Floats:
        """Return the vector of which `displacement` is the inverse."""
        found = self._space.gather(displacement)
        return found if self.right is self.load else found - self._space.gather(self._lift)

    def displacement(self, unknown: Floats) -> FaceFields:
        """Return displacements of all faces, the given ones included."""
        if self.right is not self.load:
            unknown = unknown + self._space.gather(self._lift)
        fields = tuple(values.copy() for values in self.problem.fixed)
        self._space.scatter(unknown, fields)
        return fields

    @cached_property
    def loads(self) -> float:
        """The sum of all forces' sizes."""
        return float(np.abs(self.right).sum()) or 1.0

    def energy(self, x: Floats) -> float:
        """Return twice the stored energy of a solution x (or of what is nearly one)."""
        if self.right is self.load:
            return dot(x, self.load)
        return 2 * dot(x, self.load) - dot(x, self.right) + self._lift_energy

    def unbalanced(self, displacement: FaceFields) -> float:
        """Return the residual of the faces that can move, as a share of loads and reactions."""
        inner = internal_force(self.problem, displacement)
        held = (f[s == FIXED] for f, s in zip(inner, self.problem.face_states, strict=True))
        borne = sum(float(np.vdot(force, force)) for force in held)
        whole = max(borne, dot(self.load, self.load))
        residual = self.load - self._space.gather(inner)
        return float(np.sqrt(dot(residual, residual) / whole)) if whole > 0.0 else 0.0

    def solution(self, run: Iteration, method: str, missed: float) -> Solution:
        """Return an iteration that has ended as a solution."""
        return Solution(
            displacement=self.displacement(run.solution),
            energy=0.5 * self.energy(run.solution),
            method=method,
            discretisation=missed,
            algebraic=run.errors[-1],
            residuals=run.residuals,
            converged=run.converged,
        )


def lift(problem: ElasticProblem, origin: Ints, cells: Ints) -> FaceFields:
    """Return displacements that fall linearly from those of moved sides to the sides opposite."""
    # Of a body of so many cells, or of a window whose first cell is `origin`.
    fields = []
    for component, fixed in enumerate(problem.fixed):
        field = np.zeros_like(fixed)
        for axis, (lower, upper) in enumerate(problem.moved[:, :, component]):
            # Faces along the axis lie between the cells, those across in their middle.
            last = max(cells[axis] - (axis != component), 1)
            share = (np.arange(fixed.shape[axis]) - 1 + origin[axis]) / last
            share = np.clip(share, 0.0, 1.0)
            along = lower * (1.0 - share) + upper * share
            field += along.reshape([-1 if a == axis else 1 for a in range(problem.dimension)])
        fields.append(np.where(problem.face_states[component] == ACTIVE, field, fixed))
    return tuple(fields)


def judge_rounding(system: System, solution: Solution, resisted: Floats, lost: float = 0.0) -> None:
    """Say, or refuse, where so many digits are lost that forces do not balance."""
    loads = sqrt(dot(system.right, system.right))
    if loads == 0.0:
        return
    if system.problem.needs_mixed_form:
        lost = system.unbalanced(solution.displacement)
    else:
        # A face's force is the difference of far larger ones where the body hardly resists (a soft
        # bed, a hinge) or hardly shrinks (a pressure λ div u).
        rounding = float(np.finfo(np.float64).eps * np.linalg.norm(resisted))
        lost = max(lost, rounding / loads)
        if solution.method == "direct":
            lost = max(lost, solution.residuals[-1])
    if lost > 0.1:
        share = f"about {lost:.1g}" if lost < 1.0 else "all"
        raise SceneError(
            f"body: it resists its loads so little that rounding leaves {share} of them "
            "unbalanced: stiffen the support, bed or hinge that yields, or bring the stiffnesses "
            "of materials and supports nearer to each other"
        )
    if lost > NOTEWORTHY:
        solution.notes.append(f"rounding leaves about {lost:.1g} of the loads unbalanced")


def missed(energy: float, whole: float) -> float:
    """Return the relative error of an answer by the energy it misses; `whole` is twice all."""
    return sqrt(max(2.0 * energy / whole, 0.0)) if whole > 0.0 else 0.0
