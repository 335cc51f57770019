"""What breaking a spring network returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.network import NetworkResult, SpringNetwork
from kaju.model.network.assembler import along_springs
from kaju.model.network.network_result import network_archive, network_from, sizes_of_network
from kaju.model.network.springs import spring_lengths_and_directions
from kaju.model.results.archive import Archive
from kaju.model.results.formats import BREAKS
from kaju.model.results.result import Check, Result

from .breaking import BreakingNetwork
from .strength import Measure

if TYPE_CHECKING:
    import pandas

COLUMNS = ("spring", "load_factor", "displacement", "force", "stored", "released", "work")

_DIGITS_LEFT = 1e-5
"""Share of the work that may be missed: shortly before it parts, a network's equations are bad."""

_RECORD = 1e-9
"""Loads that differ by less than this share are the same, but for rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class FractureResult(Result):
    """Which springs of a network broke, in which order, and at which loads.

    Attributes
    ----------
    network : SpringNetwork
        What was loaded.
    strengths : (m,) floats
        Of the springs, in the unit of the measure.
    measure : {"force", "strain", "energy"}
        What is exceeded where a spring breaks: N, a share, or J.
    spring : (b,) ints
        The springs that broke, in their order.
    load_factor : (b,) floats
        Share of the network's load at which each broke.
    displacement : (b,) floats
        How far the load had moved along itself then (m): Σ F·u / Σ |F| of forces; of given
        displacements the largest.
    force : (b,) floats
        The load then (N): Σ |F|; of given displacements the force that moves them so.
    stored : (b,) floats
        Energy in the springs right after each break (J).
    released, work : (b,) floats
        Energy released by all breaks, and work of the load, until then (J). Where a network
        parts, what its springs held is released.
    outcome : str
        Why no further spring broke; "" if nobody asked.
    seconds : float
        Time that the computation took (s).

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
    pictures: ClassVar[tuple[str, ...]] = ("crack", "response", "avalanches")
    films: ClassVar[tuple[str, ...]] = ("breaks",)
    network: SpringNetwork
    strengths: Floats
    measure: Measure
    spring: Ints
    load_factor: Floats
    displacement: Floats
    force: Floats
    stored: Floats
    released: Floats
    work: Floats
    outcome: str
    seconds: float

    @property
    def breaks(self) -> int:
        """Number of springs that broke."""
        return len(self.spring)

    @property
    def strength(self) -> float:
        """Largest share of the load that the network bore."""
        return float(self.load_factor.max(initial=0.0))

    @property
    def avalanche(self) -> Ints:
        """Number of the avalanche of every break, shape (b,).

        A break at a larger load than all before begins an avalanche; those that follow without
        a larger load belong to it.
        """
        highest = np.maximum.accumulate(self.load_factor)
        before = np.concatenate([[0.0], highest[:-1]])
        return np.cumsum(self.load_factor > before * (1.0 + _RECORD)) - 1

    @property
    def avalanche_sizes(self) -> Ints:
        """Number of breaks in every avalanche, the last one included: it may part the network."""
        return np.bincount(self.avalanche)

    @property
    def history(self) -> pandas.DataFrame:
        """One row per break: spring, its nodes, load, displacement, energies, avalanche."""
        import pandas

        names = self.network.names
        ends = self.network.springs[self.spring]
        units = {"displacement": "_m", "force": "_N", "stored": "_J", "released": "_J"}
        columns: dict[str, Any] = {
            "spring": self.spring,
            "first": [names[node] for node in ends[:, 0]],
            "second": [names[node] for node in ends[:, 1]],
        }
        for name in COLUMNS[1:]:
            unit = "" if name == "load_factor" else units.get(name, "_J")
            columns[name + unit] = getattr(self, name)
        columns["avalanche"] = self.avalanche
        return pandas.DataFrame(columns)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the history."""
        return self.history

    def state(self, breaks: int | None = None) -> NetworkResult:
        """Return the network after so many breaks, at the load of the last of them.

        Parameters
        ----------
        breaks : int, optional
            From 0, before the first break and at its load; none: the last state that the
            network resisted in.

        Raises
        ------
        ParameterError
            If there were fewer, or the network had parted by then.
        """
        last = self.standing
        count = last if breaks is None else breaks
        if not 0 <= count <= last:
            parted = " (with the next one it parted)" if last < self.breaks else ""
            raise ParameterError(f"breaks: 0 to {last}{parted}, got {breaks}")
        kept = np.ones(len(self.network.springs), dtype=bool)
        kept[self.spring[:count]] = False
        whole = self.network
        left = SpringNetwork(
            positions=whole.positions,
            springs=whole.springs[kept],
            stiffness=whole.stiffness[kept],
            rest_length=whole.rest_length[kept],
            held=whole.held,
            forces=whole.forces,
            displacements=whole.displacements,
            names=whole.names,
            notes=whole.notes,
        )
        factor = float(self.load_factor[max(count - 1, 0)]) if self.breaks else 1.0
        standing = BreakingNetwork(left, np.full(len(left.springs), np.inf))
        moved = factor * standing.displacement()
        _, direction = spring_lengths_and_directions(left.positions, left.springs)
        stretch = np.einsum("ij,ij->i", along_springs(left, moved), direction)
        rest = np.zeros_like(moved)
        return NetworkResult(
            network=left.with_loads(factor * whole.forces, factor * whole.displacements),
            stage=np.array([0.0, 1.0]),
            displacement=np.stack([rest, moved]),
            tension=np.stack([np.zeros(len(left.springs)), left.stiffness * stretch]),
            residual=np.zeros(2),
            corrections=np.array([0, 1]),
            scheme="euler",
            method="sparse LU, small strain",
            seconds=0.0,
        )

    @property
    def standing(self) -> int:
        """Number of breaks after which the network still resisted."""
        return self.breaks - (1 if self.outcome.startswith("parted") else 0)

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        at = int(np.argmax(self.load_factor)) if self.breaks else 0
        return {
            "model": "fracture",
            "kaju_version": __version__,
            "nodes": len(self.network.positions),
            "springs": len(self.network.springs),
            "dimension": self.network.dimension,
            "measure": self.measure,
            "breaks": self.breaks,
            "strength": self.strength,
            "largest_force_N": float(self.force.max(initial=0.0)),
            "breaks_before_the_largest_load": at,
            "avalanches": len(self.avalanche_sizes),
            "largest_avalanche": int(self.avalanche_sizes.max(initial=0)),
            "work_J": float(self.work[-1]) if self.breaks else 0.0,
            "stored_J": float(self.stored[-1]) if self.breaks else 0.0,
            "released_J": float(self.released[-1]) if self.breaks else 0.0,
            "outcome": self.outcome,
            "notes": list(self.network.notes),
            "seconds": self.seconds,
        }

    def checks(self) -> list[Check]:
        """Return whether the work of the load is what is stored and what was released."""
        off = np.abs(self.work - self.stored - self.released).max(initial=0.0)
        met = np.abs(self.work).max(initial=0.0)
        return [Check("work is stored or released", float(off / (met or 1.0)), _DIGITS_LEFT)]

    def _stored(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = network_archive(self.network)
        arrays |= {name: getattr(self, name) for name in BREAKS}
        told = {name: getattr(self, name) for name in ("measure", "outcome", "seconds")}
        return arrays, about | told

    @classmethod
    def _restored(cls, archive: Archive) -> Self:
        network = network_from(archive)
        return cls(
            network=network,
            **archive.columns(BREAKS, sizes_of_network(network)),
            measure=archive.value("measure", Measure),
            outcome=archive.value("outcome", str),
            seconds=archive.value("seconds", float),
        )
