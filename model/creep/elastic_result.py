"""An elastic scene in time: by correspondence where that is exact, else step by step.

If all materials take the same time, nothing but loads acts (no given displacement, no elastic
bed), then the stresses are those without time, and displacements are those without time,
multiplied by E · (creep under the history of a unit stress): the *correspondence principle*
(R. M. Christensen, *Theory of Viscoelasticity*, section 2.1). One elastic problem answers for
all times.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju.agents.rheology_steps import Laws
from kaju.arrays import Floats
from kaju.errors import ResultError
from kaju.model.archive import Archive
from kaju.model.elastic import fields
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.problem import ElasticProblem
from kaju.model.elastic.staggered import Numbering, Strains, axis_pairs, edge_modulus
from kaju.model.formats import ELASTIC_IN_TIME, sizes_of
from kaju.model.result import BodyResult

from .body import law_of
from .elastic import CreepingBody
from .elements import Elements
from .state import BodyCourse, times_of


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ElasticCreepResult(BodyCourse):
    """What became of an elastic body in time.

    In every query `record` is the index of a time asked for; the default -1 is the last.

    Attributes
    ----------
    static : ElasticResult
        The same scene without time, at a factor of 1.
    growth : (k,) floats or None
        Displacement as a multiple of the static one, where the correspondence principle holds.
    body : SteppedBody or None
        What was marched through time where it does not.
    faces, cells, edges : arrays or None
        Then: displacement of the active faces, stress of the cells along each axis, and shear
        of the edges, in the scaled units of ``static.found.problem``, one row for each time.
    """

    kind: ClassVar[str] = "elasticity in time"
    _static: ClassVar[type[BodyResult]] = ElasticResult
    static: ElasticResult
    growth: Floats | None = None
    body: SteppedBody | None = None
    faces: Floats | None = None
    cells: Floats | None = None
    edges: Floats | None = None

    def _sizes(self, record: int) -> Floats:
        sizes: Floats = np.linalg.norm(self.cell_displacement(record), axis=-1)
        return sizes

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

    def displacement_at(self, points: NDArray[np.float64], record: int = -1) -> Floats:
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
        scales = problem.scales
        unit = scales.modulus * scales.displacement / scales.length
        return unit * fields.cell_tensor(problem, Strains(tuple(cells), edges))

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
