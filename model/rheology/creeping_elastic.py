"""An elastic body whose materials creep: one problem by correspondence, or one a step.

Every material follows its law tensor-wise with constant Poisson's ratio: the stress is C(ν)
of a unit modulus applied to *element forces* s, one for each component of the strain, and
each obeys the three-element law with K_f in Pa (R. M. Christensen, *Theory of
Viscoelasticity*, section 1.4: one relaxation function for shear and volume). Over one
implicit step a cell is thus an elastic cell of modulus k with a strain at rest, so the step
is an elastic problem whose extra load is the force of the rests.

At an edge the cells round it share one shear stress and add up their shears; each keeps its
own history. All steps whose moduli are alike but for a common factor and a factor of two
share one factorisation, or one multigrid hierarchy where the body is large.

If all materials take the same time, nothing but loads acts (no given displacement, no elastic
bed), then the stresses are those without time, and displacements are those without time,
multiplied by E · (creep under the history of a unit stress): the *correspondence principle*
(section 2.1 there). One elastic problem answers for all times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np

from kaju.arrays import Flags, Floats, spread
from kaju.errors import ConvergenceError, ResultError
from kaju.factors import factors_of
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal import fields, staggered
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.direct import DIRECT_LIMIT
from kaju.model.elastic.equal.krylov import Iteration, conjugate_gradients
from kaju.model.elastic.equal.problem import ElasticProblem
from kaju.model.elastic.equal.staggered import Numbering, Strains, axis_pairs, edge_modulus
from kaju.model.elastic.moduli import Moduli, moduli_at, moduli_of
from kaju.model.results.stored import Column

from .creep_result import BodyTimeResult
from .creeping_elements import GrowingElements, law_of
from .creeping_step import Borne, Creeping, Fields
from .element import Laws, ThreeElement, laws_of


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ElasticCreepResult(BodyTimeResult):
    """What became of an elastic body in time.

    In every query `record` is the index of a time asked for; the default -1 is the last.
    """

    kind: ClassVar[str] = "elasticity in time"
    static: ElasticResult  # the same scene without time, at a factor of 1
    # Where the correspondence principle holds, displacement as a multiple of the static one,
    # shape (k, 1). Elsewhere, in the scaled units of ``static.found.problem``, a row for each time:
    growth: Annotated[Floats, Column("times 1")] | None = None
    faces: Annotated[Floats, Column("times faces")] | None = None  # displacement of those that move
    # Stress of the cells along each axis, and shear of the edges.
    cells: Annotated[Floats, Column("times dimension solid")] | None = None
    edges: Annotated[Floats, Column("times edges")] | None = None

    def __post_init__(self) -> None:
        problem = cells_of(self.static).problem
        solid = int(np.count_nonzero(problem.kinds >= 0))
        sizes = {
            "faces": (self._numbering.size,),
            "cells": (problem.dimension, solid),
            "edges": (sum(map(np.count_nonzero, _stiff_edges(problem).values())),),
        }
        for name, shape in sizes.items() if self.growth is None else ():
            if self._stepped(name).shape[1:] != shape:
                raise ResultError(f"{name!r} must hold {shape} numbers for each time")

    @cached_property
    def _numbering(self) -> Numbering:
        return Numbering(cells_of(self.static).problem.face_states)

    def max_displacement(self, record: int = -1) -> float:
        """Return how far the corner of a cell has moved that has moved most (m)."""
        if self.growth is not None:
            return float(abs(self.growth[record, 0])) * self.static.max_displacement
        return self._moved(record).max_displacement

    def displacement_at(self, points: Floats, record: int = -1) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        if self.growth is not None:
            return np.asarray(self.growth[record, 0] * self.static.displacement_at(points))
        return self._moved(record).displacement_at(points)

    def stress(self, record: int = -1) -> Floats:
        """Return the stress tensors of the cells (Pa), shape (n, ..., dimension, dimension)."""
        if self.growth is not None:
            return np.asarray(self.factors[record] * self.static.cells().stress)
        problem = cells_of(self.static).problem
        solid, stiff = problem.kinds >= 0, _stiff_edges(problem)
        cells = [spread(values, solid)[problem.inner] for values in self._stepped("cells")[record]]
        # Edges are stored pair by pair of axes, of each pair those that carry shear.
        ends = np.cumsum([np.count_nonzero(there) for there in stiff.values()])
        shears = np.split(self._stepped("edges")[record], ends[:-1])
        edges = {}
        for (pair, there), values in zip(stiff.items(), shears, strict=True):
            on_surface = float(self.factors[record]) * problem.surface_shear.get(pair, 0.0)
            inner = (slice(1, -1),) * problem.dimension
            edges[pair] = (spread(values, there) + on_surface)[inner]
        return problem.scales.stress * fields.cell_tensor(problem, Strains(tuple(cells), edges))

    def _moved(self, record: int) -> ElasticResult:
        """Return a result with the displacements of a moment; its stresses mean nothing."""
        found = cells_of(self.static)
        moved = tuple(float(self.factors[record]) * values for values in found.problem.fixed)
        self._numbering.scatter(self._stepped("faces")[record], moved)
        solution = replace(found.solution, displacement=moved)
        return replace(self.static, found=replace(found, solution=solution, known=found.posed))

    def _stepped(self, name: str) -> Floats:
        values: Floats | None = getattr(self, name)
        if values is None:
            raise ResultError(
                "all displacements grow alike here: multiply those of `static` by `growth`"
            )
        return values


def cells_of(static: ElasticResult) -> CellAgents:
    """Return the equal cells of an elastic answer."""
    if not isinstance(static.found, CellAgents):
        raise ResultError("creep: needs an answer on equal cells; solve without a tolerance")
    return static.found


def _stiff_edges(problem: ElasticProblem) -> dict[tuple[int, int], Flags]:
    """Return which edges carry shear, for every pair of axes."""
    return {pair: edge_modulus(problem, pair) > 0 for pair in axis_pairs(problem.dimension)}


class CreepingBody(Creeping):
    """A body on the staggered grid that creeps; every implicit step is one elastic problem.

    Its elements are every cell along each axis, every material at every edge, and the springs of an
    elastic bed. Its other fields, in the problem's scaled units: displacement of the active faces;
    stress of the cells along each axis; shear of the edges.
    """

    result = ElasticCreepResult

    def __init__(self, static: ElasticResult) -> None:
        problem, materials = cells_of(static).problem, static.grid.cell_materials
        self.problem, self.unit = problem, problem.scales.energy
        self.parts: dict[str, Any] = {"static": static}
        kind = self.kind = problem.kinds[problem.kinds >= 0]
        ratios = np.array([material.poissons_ratio for material in materials])
        self.unit_moduli = moduli_of(np.ones(len(materials)), ratios, problem.plane)
        self.moduli_of_cells = moduli_at(self.unit_moduli, kind)
        self.shear = self.unit_moduli.shear[:, None]
        self.share = _shares_of_edges(problem, len(materials))
        self.counted = slice(problem.dimension * len(kind))
        self.numbering, self.rows, self.given, bed, self.load = staggered.rows_of(problem)
        self.columns = self.rows.T.tocsr()
        edges = self.share.shape[1]
        of_materials = laws_of([law_of(material) for material in materials])
        springs = laws_of([ThreeElement.spring(stiffness) for stiffness in bed])
        parts = [
            (np.tile(law[kind], problem.dimension), np.repeat(law, edges), own)
            for law, own in zip(
                [number / problem.scales.modulus for number in of_materials], springs, strict=True
            )
        ]
        self.laws = Laws(*map(np.concatenate, parts))
        self._prepared: tuple[Floats, Callable[[Floats], Floats]] | None = None

    def start(self) -> Fields:
        """Return the state at time 0: nothing stretched."""
        elements = np.zeros_like(self.laws.K_f)
        faces, strains = np.zeros(self.numbering.size), np.zeros(self.rows.shape[0])
        cells, edges, _ = self._rows(strains)
        return (elements, elements, faces, cells, edges)

    def solve(self, stiffness: Floats, rest: Floats, factor: float, before: Fields) -> Borne:
        """Return the forces of all elements, from the displacement of the step before."""
        cell_modulus, at_edges, bed = self._elements(stiffness)
        cell_rest, edge_rest, bed_rest = self._elements(rest)
        # Of an edge, its materials lie in a row: compliances and rests add up.
        edge_modulus = 1.0 / np.sum(self.share / (self.shear * at_edges), axis=0)
        rests = _join(cell_rest, np.sum(self.share * edge_rest, axis=0), bed_rest)
        free = factor * self.given - rests

        def stress(strain: Floats) -> Floats:
            cells, edges, faces = self._rows(strain)
            normal = normal_stress(self.moduli_of_cells, cell_modulus * cells)
            return _join(normal, edge_modulus * edges, bed * faces)

        load = factor * self.load - self.columns @ stress(free)
        # A body without stiff edges has cells of every material that counts.
        modulus = np.full(len(self.share), cell_modulus[0, 0])
        modulus[self.kind] = cell_modulus[0]
        after = self._solve(stress, modulus, load, before[0])
        cells, edges, faces = self._rows(self.rows @ after + free)
        borne, shear = cell_modulus * cells, edge_modulus * edges
        force = _join(borne, shear / self.shear, bed * faces)
        return Borne(force, (after, normal_stress(self.moduli_of_cells, borne), shear))

    def metric(self, stretch: Floats) -> Floats:
        """Return the stresses of unit modulus of strains of cells, and of edges by their share."""
        cells, edges, faces = self._elements(stretch)
        normal = normal_stress(self.moduli_of_cells, cells)
        return _join(normal, self.share * self.shear * edges, faces)

    def record(self, fields: Fields) -> dict[str, Floats]:
        """Return displacement of the active faces, stress of cells and shear of edges."""
        return dict(zip(("faces", "cells", "edges"), fields[2:], strict=True))

    def _elements(self, values: Floats) -> tuple[Floats, Floats, Floats]:
        """Split values of elements: cells (axes, cells), edges (materials, edges), and the bed."""
        cells, edges, bed = np.split(values, np.cumsum([self.counted.stop, self.share.size]))
        return cells.reshape(self.problem.dimension, -1), edges.reshape(self.share.shape), bed

    def _rows(self, values: Floats) -> tuple[Floats, Floats, Floats]:
        """Split values of rows: cells (axes, cells), edges, and the bed."""
        cells, edges, bed = np.split(values, np.cumsum([self.counted.stop, self.share.shape[1]]))
        return cells.reshape(self.problem.dimension, -1), edges, bed

    def _solve(
        self, stress: Callable[[Floats], Floats], modulus: Floats, load: Floats, start: Floats
    ) -> Floats:
        """Solve the elastic problem of an implicit step, from where the last one ended."""

        def apply(displacement: Floats) -> Floats:
            return np.asarray(self.columns @ stress(self.rows @ displacement))

        def done(run: Iteration) -> bool:
            return run.residuals[-1] <= 1e-9

        run = conjugate_gradients(apply, self._precondition(modulus), load, start.copy(), done)
        if run.converged:
            return run.solution
        raise _unsolved(run.residuals)

    def _precondition(self, modulus: Floats) -> Callable[[Floats], Floats]:
        """Return a solver for moduli that are alike but for a common factor and one of two."""
        if self._prepared is not None:
            ratio = modulus / self._prepared[0]
            if any(springs.any() for springs in self.problem.spring):
                ratio = np.append(ratio, 1.0)
            if ratio.max() <= 2.0 * ratio.min():
                return self._prepared[1]
        solver = self._solver(Moduli(*(modulus * values for values in self.unit_moduli)))
        self._prepared = (modulus.copy(), solver)
        return solver

    def _solver(self, moduli: Moduli) -> Callable[[Floats], Floats]:
        """Return the factors of the matrix if they fit in memory, or else a multigrid cycle."""
        if self.numbering.size <= DIRECT_LIMIT[self.problem.dimension]:
            problem = replace(self.problem, moduli=moduli)
            try:
                factors = factors_of(staggered.stiffness_matrix(problem, self.numbering))
            except RuntimeError as singular:
                raise _unsolved([1.0]) from singular
            return lambda load: np.asarray(factors.solve(load))
        from kaju.model.elastic.equal.hierarchy import Hierarchy  # It holds compiled loops.

        cells = Hierarchy(self.problem, moduli)

        def cycle(load: Floats) -> Floats:
            vector = np.zeros(cells.moving.size)
            vector[cells.moving] = load
            return cells.precondition(vector)[cells.moving]

        return cycle


def _unsolved(residuals: list[float]) -> ConvergenceError:
    """Return the error of a step whose loads do not come to balance."""
    return ConvergenceError(
        f"creep: after {len(residuals) - 1} iterations {residuals[-1]:.3g} of the load are still "
        "unbalanced; supports or hinges may be too soft, members too thin, or materials too far "
        "apart or too nearly incompressible for so large a body",
        tuple(residuals),
    )


def _join(*parts: Floats) -> Floats:
    return np.concatenate([part.ravel() for part in parts])


def _shares_of_edges(problem: ElasticProblem, materials: int) -> Floats:
    """Return the share of each material in the compliance of edges, shape (materials, edges).

    An edge's compliance is a weighted sum of its cells' compliances 1/μ; a material's weight is
    the compliance when all others are made rigid.
    """
    stiff = _stiff_edges(problem)
    shares = []
    for material in range(materials):
        shear = np.where(np.arange(materials) == material, 1.0, 1e300)
        alone = replace(problem, moduli=problem.moduli._replace(shear=shear))
        edges = [edge_modulus(alone, pair)[there] for pair, there in stiff.items()]
        compliance = 1.0 / np.concatenate(edges)
        shares.append(np.where(compliance > 1e-200, compliance, 0.0))
    return np.array(shares)


def elastic_body(static: ElasticResult) -> Creeping:
    """Return what costs least to take through time for an elastic scene."""
    materials, problem = static.grid.cell_materials, cells_of(static).problem
    modulus = np.array([material.youngs_modulus for material in materials])
    law = laws_of([law_of(material) for material in materials])
    table = np.array([law.K_f / modulus, law.D_f / modulus, modulus / law.D_d])
    alike = np.allclose(table, table[:, :1], rtol=1e-12, atol=0.0)
    given = any(values.any() for values in (*problem.fixed, *problem.spring))
    if given or not alike:
        return CreepingBody(static)
    size = np.array([2.0 * static.strain_energy / modulus[0]])
    return GrowingElements(static, ElasticCreepResult, materials[:1], size)


def normal_stress(law: Moduli, strain: Floats) -> Floats:
    """Return normal stresses by normal strains, both axis by axis."""
    volume = law.lateral * strain.sum(axis=0)
    return np.asarray(volume + (law.stretch - law.lateral) * strain)
