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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.agents.materials import Material
from kaju.arrays import Floats
from kaju.errors import ConvergenceError, ResultError
from kaju.factors import factors_of
from kaju.model.elastic import fields
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import Moduli, moduli_of
from kaju.model.elastic.multigrid.hierarchy import Hierarchy
from kaju.model.elastic.multigrid.krylov import Iteration, conjugate_gradients
from kaju.model.elastic.problem import ElasticProblem
from kaju.model.elastic.solver import DIRECT_LIMIT
from kaju.model.elastic.staggered import (
    Numbering,
    Strains,
    axis_pairs,
    edge_modulus,
    strain_matrix,
    strains,
)
from kaju.model.results.archive import Archive
from kaju.model.results.formats import ELASTIC_IN_TIME, sizes_of
from kaju.model.results.result import BodyResult
from kaju.model.rheology.integrate import Fields, SubStep
from kaju.model.rheology.schemes import (
    Energy,
    Laws,
    Stretch,
    as_spring,
    rates,
    stage_energy,
    stored_energy,
)

from .creep_result import BodyCourse, times_of
from .creeping_body import Elements, law_of

_FACTORISED_UP_TO = {2: DIRECT_LIMIT[2], 3: 13_000}
"""Faces up to which factors, which serve many steps, are worth their making, by dimension."""


class CreepingBody:
    """A body on the staggered grid as something that creeps.

    Its state, in the problem's scaled units: stretches of both parts for every cell and axis (axes,
    cells) and for every material at every edge (materials, edges); the displacement of the active
    faces; the stress of the cells along each axis, and the shear of the edges. `tolerance`:
    unbalanced force at which an elastic problem counts as solved, as a share of the load.
    """

    def __init__(
        self, problem: ElasticProblem, materials: Sequence[Material], tolerance: float = 1e-9
    ) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.numbering = Numbering(problem.face_states)
        self.rows = strain_matrix(problem, self.numbering)
        self.columns = self.rows.T.tocsr()
        self.kind = problem.kinds[problem.kinds >= 0]
        self.cells = len(self.kind)
        laws = Laws.of([law_of(material) for material in materials])
        self.edge_laws = Laws(*(number[:, None] / problem.scales.modulus for number in laws))
        self.cell_laws = Laws(*(number[self.kind, 0] for number in self.edge_laws))
        ratios = np.array([material.poissons_ratio for material in materials])
        self.unit = unit = moduli_of(np.ones(len(materials)), ratios, problem.plane)
        self.along, self.cross = unit.stretch[self.kind], unit.lateral[self.kind]
        self.shear = unit.shear[:, None]
        self.share = _shares_of_edges(problem, len(materials))
        self.given = self._strain_of_given()
        self.load = self.numbering.gather(problem.force)
        self.foundation = self.numbering.gather(problem.spring)
        self._tough = problem.needs_mixed_form
        self._prepared: tuple[Floats, Callable[[Floats], Floats]] | None = None

    def start(self) -> Fields:
        """Return the state at time 0: nothing stretched."""
        cells = np.zeros((self.problem.dimension, self.cells))
        edges = np.zeros_like(self.share)
        faces = np.zeros(self.numbering.size)
        return (cells, cells, edges, edges, faces, cells, np.zeros(edges.shape[1]))

    def rates(self, fields: Fields, push: SubStep) -> tuple[Fields, Energy]:
        """Return the rates in an implicit step, and what it adds to the balance."""
        in_cells, at_edges = Stretch(*fields[:2]), Stretch(*fields[2:4])
        substep, before = push.substep, fields[4]
        cell_modulus, cell_rest = as_spring(self.cell_laws, substep, in_cells)
        modulus, edge_rest = as_spring(self.edge_laws, substep, at_edges)
        edge_shear = 1.0 / np.sum(self.share / (self.shear * modulus), axis=0)
        rest = self._join(cell_rest, np.sum(self.share * edge_rest, axis=0))
        free = push.displacement_factor * self.given - rest

        def stress(strain: Floats) -> Floats:
            cells, edges = self._part(strain)
            return self._join(self._tensor(cell_modulus * cells), edge_shear * edges)

        load = push.factor * self.load - self.columns @ stress(free)
        after = self._solve(stress, modulus[:, 0], load, before)
        strain = self.rows @ after + free
        cells, edges = self._part(strain)
        force, shear = cell_modulus * cells, edge_shear * edges
        cell_rate = rates(self.cell_laws, substep, in_cells, force)
        edge_rate = rates(self.edge_laws, substep, at_edges, shear / self.shear)
        speed = (after - before) / substep
        carried = ((self._tensor(force) - fields[5]) / substep, (shear - fields[6]) / substep)
        energy = self._energies(
            push, (force, cell_rate), (shear / self.shear, edge_rate), after, speed
        )
        return (*cell_rate, *edge_rate, speed, *carried), energy

    def gauge(self, fields: Fields) -> Floats:
        """Return the stretches of both parts of all cells."""
        return np.stack(fields[:2])

    def stored(self, fields: Fields) -> float:
        """Return the energy of springs and foundation (J)."""
        cells, edges = Stretch(*fields[:2]), Stretch(*fields[2:4])
        energy = stored_energy(self.cell_laws, self._weigh_cells(cells))
        energy += stored_energy(self.edge_laws, self._weigh_edges(edges))
        energy += 0.5 * float(np.sum(self.foundation * np.square(fields[4])))
        return energy * self._joule

    def record(self, fields: Fields) -> tuple[Floats, ...]:
        """Return displacement of the active faces, stress of cells and shear of edges."""
        return fields[4:]

    @property
    def _joule(self) -> float:
        return self.problem.scales.energy

    def _part(self, strain: Floats) -> tuple[Floats, Floats]:
        normal = self.problem.dimension * self.cells
        return strain[:normal].reshape(-1, self.cells), strain[normal:]

    def _join(self, cells: Floats, edges: Floats) -> Floats:
        return np.concatenate([cells.ravel(), edges])

    def _tensor(self, force: Floats) -> Floats:
        """Apply C of a unit modulus to element forces."""
        return np.asarray((self.along - self.cross) * force + self.cross * force.sum(axis=0))

    def _strain_of_given(self) -> Floats:
        """Return the strains that the given displacements cause alone."""
        problem = self.problem
        strain = strains(problem.fixed)
        solid = problem.kinds >= 0
        pairs = axis_pairs(problem.dimension)
        edges = [strain.edges[p][edge_modulus(problem, p) > 0] for p in pairs]
        return np.concatenate([*(cells[solid] for cells in strain.cells), *edges])

    def _solve(
        self, stress: Callable[[Floats], Floats], modulus: Floats, load: Floats, start: Floats
    ) -> Floats:
        """Solve the elastic problem of an implicit step, from where the last one ended."""

        def apply(displacement: Floats) -> Floats:
            held: Floats = self.columns @ stress(self.rows @ displacement)
            return held + self.foundation * displacement

        def done(run: Iteration) -> bool:
            return run.residuals[-1] <= self.tolerance

        for _ in range(2):
            precondition = self._precondition(modulus)
            run = conjugate_gradients(apply, precondition, load, start.copy(), done)
            if run.converged:
                return run.solution
            # Thin members and near incompressibility are beyond geometric parents.
            self._tough, self._prepared = True, None
        raise ConvergenceError(
            f"creep: after {run.iterations} iterations {run.residuals[-1]:.3g} of the load are "
            "still unbalanced; the materials may be too far apart or too nearly incompressible",
            tuple(run.residuals),
        )

    def _precondition(self, modulus: Floats) -> Callable[[Floats], Floats]:
        """Return a solver for moduli that are alike but for a common factor and one of two."""
        if self._prepared is not None:
            ratio = modulus / self._prepared[0]
            if self.foundation.any():
                ratio = np.append(ratio, 1.0)
            if ratio.max() <= 2.0 * ratio.min():
                return self._prepared[1]
        solver = self._solver(modulus)
        self._prepared = (modulus.copy(), solver)
        return solver

    def _solver(self, modulus: Floats) -> Callable[[Floats], Floats]:
        """Return the factors of the matrix, or a multigrid cycle, by its size and difficulty."""
        limit = DIRECT_LIMIT if self._tough else _FACTORISED_UP_TO
        if self.numbering.size <= limit[self.problem.dimension]:
            factors = factors_of(self._matrix(modulus))
            return lambda load: np.asarray(factors.solve(load))
        cells = Hierarchy(self.problem, Moduli(*(modulus * values for values in self.unit)))

        def cycle(load: Floats) -> Floats:
            vector = np.zeros(cells.moving.size)
            vector[cells.moving] = load
            return cells.precondition(vector)[cells.moving]

        return cycle

    def _matrix(self, modulus: Floats) -> sp.csr_array:
        cell = modulus[self.kind]
        edge = 1.0 / np.sum(self.share / (self.shear * modulus[:, None]), axis=0)
        d = self.problem.dimension
        along, cross = sp.diags_array(cell * self.along), sp.diags_array(cell * self.cross)
        law = sp.block_array([[along if a == b else cross for b in range(d)] for a in range(d)])
        whole = sp.block_diag([law, sp.diags_array(edge)], format="csr")
        matrix = self.columns @ (whole @ self.rows) + sp.diags_array(self.foundation)
        return sp.csr_array(matrix)

    def _weigh_cells(self, stretch: Stretch) -> Stretch:
        """Return stretches whose plain square sum is the product with C of a unit modulus."""
        d = self.problem.dimension
        deviator = np.sqrt(self.along - self.cross)
        mean = (np.sqrt(self.along + (d - 1) * self.cross) - deviator) / d
        return Stretch(*(deviator * part + mean * part.sum(axis=0) for part in stretch))

    def _weigh_edges(self, stretch: Stretch) -> Stretch:
        weight = np.sqrt(self.share * self.shear)
        return Stretch(*(weight * part for part in stretch))

    def _energies(
        self,
        push: SubStep,
        cells: tuple[Floats, Stretch],
        edges: tuple[Floats, Stretch],
        displacement: Floats,
        speed: Floats,
    ) -> Energy:
        """Sum up cells, edges and the foundation."""
        booked = np.zeros(3)
        method, step, weight = push.method, push.step, push.weight
        for laws, (force, rate), weigh in (
            (self.cell_laws, cells, self._weigh_cells),
            (self.edge_laws, edges, self._weigh_edges),
        ):
            weighed, _ = weigh(Stretch(np.broadcast_to(force, rate.q.shape), rate.q))
            booked += stage_energy(laws, method, step, weight, weighed, weigh(rate))
        own = 0.5 * weight * (2.0 * method.gamma - weight)
        booked[0] += weight * step * float(np.sum(self.foundation * displacement * speed))
        booked[2] += own * float(np.sum(self.foundation * np.square(step * speed)))
        return Energy(*(booked * self._joule).tolist())


def _shares_of_edges(problem: ElasticProblem, materials: int) -> Floats:
    """Return how much of an edge's shear each material makes, shape (materials, edges).

    An edge's compliance is a weighted sum of its cells' compliances 1/μ; the weights come to
    light when all materials but one are made rigid.
    """
    stiff = [edge_modulus(problem, pair) > 0 for pair in axis_pairs(problem.dimension)]
    shares = []
    for material in range(materials):
        shear = np.where(np.arange(materials) == material, 1.0, 1e300)
        alone = replace(problem, moduli=problem.moduli._replace(shear=shear))
        pairs = axis_pairs(problem.dimension)
        edges = [edge_modulus(alone, p)[s] for p, s in zip(pairs, stiff, strict=True)]
        compliance = 1.0 / np.concatenate(edges)
        shares.append(np.where(compliance > 1e-200, compliance, 0.0))
    return np.array(shares)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ElasticCreepResult(BodyCourse):
    """What became of an elastic body in time.

    In every query `record` is the index of a time asked for; the default -1 is the last.
    """

    kind: ClassVar[str] = "elasticity in time"
    _static: ClassVar[type[BodyResult]] = ElasticResult
    static: ElasticResult
    """The same scene without time, at a factor of 1."""
    growth: Floats | None = None
    """Displacement as a multiple of the static one, where the correspondence principle holds. Shape
    (k,)."""
    body: SteppedBody | None = None
    """What was marched through time where it does not."""
    faces: Floats | None = None
    cells: Floats | None = None
    edges: Floats | None = None
    """Then: displacement of the active faces, stress of the cells along each axis, and shear of the
    edges, in the scaled units of ``static.found.problem``, one row for each time."""

    def _sizes(self, record: int) -> Floats:
        return np.asarray(np.linalg.norm(self.cell_displacement(record), axis=-1))

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = super()._own()
        stored = {name: getattr(self, name) for name in ELASTIC_IN_TIME}
        return arrays | {name: v for name, v in stored.items() if v is not None}, about

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        own = super()._from_own(archive)
        sizes = sizes_of(own["static"].scene) | times_of(archive)
        if "growth" not in archive.arrays:
            own["body"] = SteppedBody(own["static"])
            sizes |= _sizes_of(cells_of(own["static"]).problem, own["body"].numbering)
        return own | archive.columns(ELASTIC_IN_TIME, sizes)

    def displacement_at(self, points: Floats, record: int = -1) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        if self.growth is not None:
            return np.asarray(self.growth[record] * self.static.displacement_at(points))
        return self._moved(record).displacement_at(points)

    def cell_displacement(self, record: int = -1) -> Floats:
        """Return the displacement of the cells' middles (m), as `ElasticResult` does."""
        if self.growth is not None:
            return np.asarray(self.growth[record] * self.static.cells().displacement)
        return self._moved(record).cells().displacement

    def stress(self, record: int = -1) -> Floats:
        """Return the stress tensors of the cells (Pa), shape (n, ..., dimension, dimension)."""
        if self.growth is not None:
            return np.asarray(self.factors[record] * self.static.cells().stress)
        problem = self._cells.problem
        solid = problem.kinds >= 0
        cells = []
        for values in self._stepped(self.cells)[record]:
            field = np.zeros(problem.kinds.shape)
            field[solid] = values
            cells.append(field[problem.inner])
        edges, start = {}, 0
        for pair in axis_pairs(problem.dimension):
            field = np.zeros_like(edge_modulus(problem, pair))
            stiff = edge_modulus(problem, pair) > 0
            count = int(np.count_nonzero(stiff))
            field[stiff] = self._stepped(self.edges)[record, start : start + count]
            start += count
            field += float(self.factors[record]) * problem.surface_shear.get(pair, 0.0)
            edges[pair] = field[(slice(1, -1),) * problem.dimension]
        return problem.scales.stress * fields.cell_tensor(problem, Strains(tuple(cells), edges))

    def _moved(self, record: int) -> ElasticResult:
        """Return a result with the displacements of a moment; its stresses mean nothing."""
        problem = self._cells.problem
        assert self.body is not None
        moved = tuple(float(self.factors[record]) * values for values in problem.fixed)
        self.body.numbering.scatter(self._stepped(self.faces)[record], moved)
        solution = replace(self._cells.solution, displacement=moved)
        return replace(self.static, found=replace(self._cells, solution=solution))

    @property
    def _cells(self) -> CellAgents:
        return cells_of(self.static)

    def _stepped(self, values: Floats | None) -> Floats:
        if values is None:
            raise ResultError("this run followed the correspondence principle: scale `static`")
        return values


def _sizes_of(problem: ElasticProblem, numbering: Numbering) -> dict[str, int]:
    """Return how many faces, cells and edges of a body are marched through time."""
    moduli = [edge_modulus(problem, pair) for pair in axis_pairs(problem.dimension)]
    edges = sum(int(np.count_nonzero(modulus)) for modulus in moduli)
    solid = int(np.count_nonzero(problem.kinds >= 0))
    return {"faces": numbering.size, "solid": solid, "edges": edges}


def cells_of(static: ElasticResult) -> CellAgents:
    """Return the equal cells of an elastic answer."""
    if not isinstance(static.found, CellAgents):
        raise ResultError("creep: is worked out on equal cells; take strategy='uniform'")
    return static.found


class CorrespondingBody(Elements):
    """A body whose displacements all grow alike, as one element.

    Its stretch is the growth; it is as large as the body, so that its energies are the body's.
    """

    def __init__(self, static: ElasticResult) -> None:
        self.static = static
        material = static.grid.cell_materials[0]
        size = 2.0 * static.strain_energy / material.youngs_modulus
        law = Laws.of([law_of(material)])
        used = size or 1.0
        share = np.array([size * material.youngs_modulus])
        super().__init__(Laws(*(number * used for number in law)), share)


class SteppedBody(CreepingBody):
    """A body of several materials, which is solved anew in every step."""

    def __init__(self, static: ElasticResult) -> None:
        self.static = static
        super().__init__(cells_of(static).problem, static.grid.cell_materials)


def elastic_body(static: ElasticResult) -> CorrespondingBody | SteppedBody:
    """Return the cheapest thing to march for an elastic scene."""
    materials, problem = static.grid.cell_materials, cells_of(static).problem
    table = np.array(
        [
            np.array([law.K_f, law.D_f, 1.0 / law.D_d]) * [1 / e, 1 / e, e]
            for law, e in ((law_of(m), m.youngs_modulus) for m in materials)
        ]
    )
    alike = np.allclose(table, table[0], rtol=1e-12, atol=0.0)
    given = any(values.any() for values in (*problem.fixed, *problem.spring))
    if alike and not given:
        return CorrespondingBody(static)
    return SteppedBody(static)
