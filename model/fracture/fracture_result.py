"""What breaking a spring network, or the cells of a body, returns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError, ResultError
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.solve import solve_cells
from kaju.model.network import NetworkResult, SpringNetwork
from kaju.model.network.springs import with_some
from kaju.model.results.result import Check, Result, in_columns
from kaju.model.results.stored import Column
from kaju.model.scene import Scene

from .breaking_bodies import KEPT, BreakingCells, BreakingNetwork, Measure, WeakeningBody

if TYPE_CHECKING:
    import pandas

COLUMNS = ("broken", "load_factor", "displacement", "force", "stored", "released", "work")


@dataclass(frozen=True, eq=False, repr=False)
class FractureResult(Result):
    """Which springs of a network, or cells of a body, broke, in which order, and at which loads.

    Examples
    --------
    >>> import kaju
    >>> fibres = kaju.SpringNetwork.build(
    ...     [[0, 0], [1, 0]], [[0, 1]] * 4, held=[[1, 1], [0, 1]], forces=[[0, 0], [1, 0]]
    ... )
    >>> broken = kaju.FractureModel(fibres, strength=[1, 1.2, 2.5, 3], scatter=0).run()
    >>> broken.avalanche_sizes
    array([2, 2])
    >>> broken.state(2).tension[-1].round(2)
    array([1.8, 1.8])
    """

    kind: ClassVar[str] = "fracture"
    subject: SpringNetwork | Scene
    """What was loaded."""
    strengths: Annotated[Floats, Column("parts", 0.0)]
    """Of the springs, or of the cells of material row by row, in the unit of the measure. Shape
    (m,)."""
    measure: Measure
    """What is exceeded where one breaks: N, Pa, a share, or J."""
    broken: Annotated[Ints, Column("breaks", 0, "parts")]
    """Numbers of the springs or cells that broke, in their order. Shape (b,), as all below."""
    load_factor: Annotated[Floats, Column("breaks", 0.0)]
    """Share of the load at which each broke."""
    displacement: Annotated[Floats, Column("breaks")]
    """How far the load had moved along itself then (m): Σ F·u / Σ |F| of forces; of given
    displacements the largest."""
    force: Annotated[Floats, Column("breaks")]
    """The load then (N): Σ |F|; of given displacements the force that moves them so."""
    stored: Annotated[Floats, Column("breaks", 0.0)]
    """Energy in the body right after each break (J)."""
    released: Annotated[Floats, Column("breaks", 0.0)]
    """Energy released by all breaks until then (J). A body that parts releases what it held."""
    work: Annotated[Floats, Column("breaks")]
    """Work of the load until then (J)."""
    outcome: str
    """Why nothing more broke; "" if nobody asked."""
    seconds: float
    """Time that the computation took (s)."""

    def __post_init__(self) -> None:
        if len(self.strengths) != parts_of(self.subject):
            raise ResultError(
                f"'strengths' must hold one for each of {parts_of(self.subject)} {self.parts}s, "
                f"and holds {len(self.strengths)}"
            )

    @property
    def network(self) -> SpringNetwork:
        """What was loaded, if that is a network."""
        if isinstance(self.subject, Scene):
            raise ParameterError(
                "network: cells of a scene broke, not springs; the scene is result.subject"
            )
        return self.subject

    @property
    def parts(self) -> str:
        """What broke: "spring" or "cell"."""
        return "cell" if isinstance(self.subject, Scene) else "spring"

    @property
    def breaks(self) -> int:
        """Number of springs or cells that broke."""
        return len(self.broken)

    @property
    def largest_load_factor(self) -> float:
        """Largest share of the load that the body bore."""
        return float(self.load_factor.max(initial=0.0))

    @property
    def avalanche(self) -> Ints:
        """Number of the avalanche of every break, shape (b,).

        A break at a larger load than all before begins an avalanche; those that follow without
        a larger load belong to it.
        """
        highest = np.maximum.accumulate(self.load_factor)
        before = np.concatenate([[0.0], highest[:-1]])
        return np.cumsum(self.load_factor > before * (1.0 + 1e-9)) - 1

    @property
    def avalanche_sizes(self) -> Ints:
        """Number of breaks in every avalanche, the last one included: it may part the network."""
        return np.bincount(self.avalanche)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a row for each break: what and where, load, displacement, energies, avalanche."""
        import pandas

        columns: dict[str, Any] = {self.parts: self.broken, **self._where()}
        units = {"load_factor": "", "displacement": "_m", "force": "_N"}
        for name in COLUMNS[1:]:
            columns[name + units.get(name, "_J")] = getattr(self, name)
        columns["avalanche"] = self.avalanche
        return pandas.DataFrame(columns)

    history = property(to_dataframe)

    def _where(self) -> dict[str, Any]:
        """Return the nodes of the springs, or the middles of the cells (m), that broke."""
        if isinstance(self.subject, Scene):
            cells = np.argwhere(self.subject.rasterise() >= 0)[self.broken]
            return in_columns("{}_m", self.subject.lattice.centres(cells))
        ends, names = self.subject.springs[self.broken], self.subject.names
        return {
            "first": [names[node] for node in ends[:, 0]],
            "second": [names[node] for node in ends[:, 1]],
        }

    def state(self, breaks: int | None = None) -> NetworkResult | ElasticResult:
        """Return what is left after so many breaks, and the load that it bears.

        Of a network at the load of the last of them; of the cells of a scene under its whole load
        (a load factor of 1), as `kaju.solve` answers. 0: before the first break and at its load;
        none: the last state that resisted.
        """
        count = self._counted(breaks)
        if isinstance(self.subject, Scene):
            solid = self.subject.rasterise() >= 0
            stiffness = np.ones(solid.shape)
            stiffness[tuple(np.argwhere(solid)[self.broken[:count]].T)] = KEPT
            return solve_cells(self.subject, stiffness=stiffness)
        whole, factor, body = self.network, self.factor_after(count), next(self.replayed([count]))
        kept = np.ones(len(whole.springs), dtype=np.bool_)
        kept[self.broken[:count]] = False
        left = with_some(whole, kept)
        moved = factor * body.displacement()
        tension = factor * body.borne()[kept]
        return NetworkResult(
            network=left.with_loads(factor * whole.forces, factor * whole.displacements),
            stage=np.array([0.0, 1.0]),
            displacement=np.stack([np.zeros_like(moved), moved]),
            tension=np.stack([np.zeros_like(tension), tension]),
            residual=np.zeros(2),
            corrections=np.array([0, 1]),
            scheme="euler",
            seconds=0.0,
        )

    def replayed(self, counts: Iterable[int]) -> Iterator[WeakeningBody]:
        """Break the body again; yield it after so many breaks (`counts`), under its whole load."""
        body = body_of(self.subject, self.strengths, self.measure)
        for count in counts:
            self._counted(count)
            while len(body.broken) < count:
                body.break_part(body.index_of(int(self.broken[len(body.broken)])))
            yield body

    def factor_after(self, count: int) -> float:
        """Return the load factor after so many breaks; before the first, that of the first."""
        return float(self.load_factor[max(count - 1, 0)]) if self.breaks else 1.0

    @property
    def breaks_resisted(self) -> int:
        """Number of breaks after which the body still resisted."""
        return self.breaks - (1 if self.outcome.startswith("parted") else 0)

    def _counted(self, breaks: int | None) -> int:
        """Return a number of breaks after which the body still resisted."""
        last = self.breaks_resisted
        count = last if breaks is None else breaks
        if not 0 <= count <= last:
            parted = " (with the next one it parted)" if last < self.breaks else ""
            raise ParameterError(f"breaks: 0 to {last}{parted}, got {breaks}")
        return count

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        at = int(np.argmax(self.load_factor)) if self.breaks else 0
        notes = self.subject.notes if isinstance(self.subject, SpringNetwork) else ()
        if isinstance(self.subject, Scene):
            farthest = float(np.abs(self.displacement).max(initial=0.0))
            size = (
                "the strength is one of cells of this size: where stress is singular, cells break "
                "at a load that falls as the root of their size"
            )
            notes = (*self.subject.notes_on(farthest), size)
        return {
            "model": "fracture",
            "kaju_version": __version__,
            "parts": f"{self.parts}s",
            f"{self.parts}s": len(self.strengths),
            "measure": self.measure,
            "breaks": self.breaks,
            "largest_load_factor": self.largest_load_factor,
            "largest_force_N": float(self.force.max(initial=0.0)),
            "breaks_before_the_largest_load": at,
            "avalanches": len(self.avalanche_sizes),
            "largest_avalanche": int(self.avalanche_sizes.max(initial=0)),
            "work_J": float(self.work[-1]) if self.breaks else 0.0,
            "stored_J": float(self.stored[-1]) if self.breaks else 0.0,
            "released_J": float(self.released[-1]) if self.breaks else 0.0,
            "outcome": self.outcome,
            "notes": list(notes),
            "seconds": self.seconds,
        }

    def checks(self) -> list[Check]:
        """Return whether the work of the load is what is stored and what was released."""
        off = np.abs(self.work - self.stored - self.released).max(initial=0.0)
        met = np.abs(self.work).max(initial=0.0)
        # Shortly before a network parts, its equations are ill-conditioned.
        return [Check("work is stored or released", float(off / (met or 1.0)), 1e-5)]


def body_of(subject: SpringNetwork | Scene, strengths: Floats, measure: str) -> WeakeningBody:
    """Return the unbroken body, of springs or of cells."""
    if isinstance(subject, Scene):
        return BreakingCells(subject, strengths, measure)
    return BreakingNetwork(subject, strengths, measure)


def parts_of(subject: SpringNetwork | Scene) -> int:
    """Return how many springs, or cells of material, there are."""
    if isinstance(subject, Scene):
        return int(np.count_nonzero(subject.rasterise() >= 0))
    return len(subject.springs)
