"""What the loading of a spring network returns."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from scipy.interpolate import make_interp_spline

from kaju import __version__
from kaju.arrays import Floats, Ints, first_largest
from kaju.errors import ResultError
from kaju.model.results.result import BALANCE, Check, Result, in_columns
from kaju.model.results.stored import Column

from .assembler import Geometry, spring_forces, spring_geometry
from .springs import SpringNetwork

if TYPE_CHECKING:
    import networkx as nx
    import pandas as pd


Scheme = Literal["newton", "euler"]


@dataclass(frozen=True, eq=False, repr=False)
class NetworkResult(Result):
    """States of a spring network along its load path.

    Record 0 is the network before any load, record k the end of increment k. Where a record
    can be chosen, the default -1 is the last.

    Examples
    --------
    >>> from kaju.model.network import solve, triangular
    >>> result = solve(triangular(5, force=0.1))
    >>> round(float(result.displacement[-1, :, 1].min()), 4)
    -0.1145
    """

    kind: ClassVar[str] = "spring network"
    network: SpringNetwork
    """What was loaded."""
    stage: Annotated[Floats, Column("records", 0.0, "stages", order="rising")]
    """Point of the load path of every record: 1 is the end of the first stage. Shape (r,)."""
    displacement: Annotated[Floats, Column("records nodes dimension")]
    """Displacement of the nodes (m). Shape (r, n, dimension)."""
    tension: Annotated[Floats, Column("records springs")]
    """Force in the springs (N), positive when they pull. Shape (r, m)."""
    residual: Annotated[Floats, Column("records")]
    """Largest unbalanced force as a share of the largest force. Shape (r,)."""
    corrections: Annotated[Ints, Column("records", 0)]
    """Number of linear systems solved for every record. Shape (r,)."""
    scheme: Scheme
    """With or without corrections."""
    seconds: float
    """Time taken (s)."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the figures should know, in words."""
        given = self.network.forces.any() or self.network.displacements.any()
        said = "nothing is applied, so nothing moves: no node has a force (of a graph's nodes: "
        said += "`force`, or as forces= says) or a given displacement"
        idle = not (given or self.displacement.any())
        return (*self.network.notes, *([said] if idle else []))

    @property
    def increments(self) -> int:
        """Number of increments recorded."""
        return len(self.stage) - 1

    def positions(self, record: int = -1) -> Floats:
        """Return where the nodes lie (m), shape (n, dimension)."""
        return np.asarray(self.network.positions + self.displacement[record])

    def strain(self, record: int = -1) -> Floats:
        """Return the elongation of every spring as a share of its initial length, (m,)."""
        return self._geometry(record).elongation / self.network.initial_length

    def _geometry(self, record: int) -> Geometry:
        return spring_geometry(self.network, self.displacement[record])

    def _springs_pull(self, record: int) -> Floats:
        """Return the force of the springs on the nodes (N), shape (n, dimension)."""
        return spring_forces(self.network, self._geometry(record), self.tension[record])

    def reactions(self, record: int = -1) -> Floats:
        """Return the force of the supports on the held coordinates (N), (n, dimension)."""
        force = self.network.force_at(float(self.stage[record]))
        return np.where(self.network.held, -self._springs_pull(record) - force, 0.0)

    def strain_energy(self, record: int = -1) -> float:
        """Return the energy stored in elastic springs (J): Σ T²/2K."""
        return float((self.tension[record] ** 2 / (2.0 * self.network.stiffness)).sum())

    def work(self, stage: int | None = None) -> float:
        """Return the work of forces and moved supports up to the end of a stage (J).

        Within a stage all loads grow evenly, so the work is F·u at its end less ∫ u·dF, and
        likewise for the supports; the integrals run over a spline through the records.
        """
        network, done = self.network, 0.0
        for number in range(1, (network.stages if stage is None else stage) + 1):
            records = np.flatnonzero((self.stage >= number - 1) & (self.stage <= number))
            if len(records) < 2:
                break
            path = self.stage[records]
            forces = [network.force_at(at) for at in path[[0, -1]]]
            ends = [
                float(np.vdot(force, self.displacement[record]))
                for force, record in zip(forces, records[[0, -1]], strict=True)
            ]
            moved = network.displacement_at(path[-1]) - network.displacement_at(path[0])
            integrand = [
                float(np.vdot(self.reactions(record), moved))
                - float(np.vdot(forces[1] - forces[0], self.displacement[record]))
                for record in records.tolist()
            ]
            share = (path - path[0]) / (path[-1] - path[0])
            order = min(5, len(records) - 1)
            curve = make_interp_spline(share, integrand, k=order if order % 2 else order - 1)
            done += ends[1] - ends[0] + float(curve.integrate(0.0, 1.0))
        return done

    def largest_displacement(self, record: int = -1) -> tuple[Hashable, float]:
        """Return the name of the node that moved farthest, and how far (m).

        Of nodes that moved equally far (to 1e-9) the first in the order of the network's names.
        """
        moved = np.linalg.norm(self.displacement[record], axis=1)
        node = first_largest(moved)
        return self.network.names[node], float(moved[node])

    def share_of_height(self, record: int = -1) -> float:
        """Return the largest displacement as a share of the network's height.

        The height is the extent along the last axis before any load.
        """
        height = float(np.ptp(self.network.positions[:, -1]))
        if height == 0.0:
            raise ResultError("share_of_height: all nodes lie at one height")
        return self.largest_displacement(record)[1] / height

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        node, distance = self.largest_displacement()
        stretched, pressed = float(self.tension[-1].max()), float(self.tension[-1].min())
        return {
            "model": "spring network",
            "kaju_version": __version__,
            "nodes": len(self.network.positions),
            "springs": len(self.network.springs),
            "dimension": self.network.dimension,
            "scheme": self.scheme,
            "stages": self.network.stages,
            "increments": self.increments,
            "stage_reached": float(self.stage[-1]),
            "linear_systems_solved": int(self.corrections.sum()),
            "residual": float(self.residual.max()),
            "largest_displacement_m": distance,
            "largest_displacement_node": str(node),
            "largest_tension_N": max(stretched, 0.0),
            "largest_compression_N": max(-pressed, 0.0),
            "strain_energy_J": self.strain_energy(),
            "work_J": self.work(),
            "notes": list(self.notes),
            "seconds": self.seconds,
        }

    def to_dataframe(self, record: int = -1) -> pd.DataFrame:
        """Return one row per node: place, displacement, loads and reactions."""
        import pandas as pd

        columns: dict[str, Any] = {"node": list(self.network.names)}
        for name, field in (
            ("{}_m", self.network.positions),
            ("displacement_{}_m", self.displacement[record]),
            ("force_{}_N", self.network.force_at(float(self.stage[record]))),
            ("reaction_{}_N", self.reactions(record)),
            ("held_{}", self.network.held),
        ):
            columns |= in_columns(name, field)
        return pd.DataFrame(columns)

    def to_graph(self, record: int = -1, *, texts: bool = False) -> nx.Graph:
        """Return the network as a networkx graph that carries the answer as attributes.

        Nodes gain `displacement`, `position` and `reaction`, edges `tension`, `strain` and
        `length`; what `SpringNetwork.from_graph` reads is there too. `texts` as of
        `SpringNetwork.to_graph`.
        """
        return self.network.to_graph(
            texts=texts,
            nodes={
                "displacement": self.displacement[record],
                "position": self.positions(record),
                "reaction": self.reactions(record),
            },
            springs={
                "tension": self.tension[record],
                "strain": self.strain(record),
                "length": self._geometry(record).length,
            },
        )

    def checks(self) -> list[Check]:
        """Return whether the forces at free nodes balance, as well as the records say."""
        off = []
        for record in range(len(self.stage)):
            springs = self._springs_pull(record)
            force = springs + self.network.force_at(float(self.stage[record]))
            met = max(np.abs(springs).max(initial=0.0), np.abs(force).max(initial=0.0))
            free = np.abs(np.where(self.network.held, 0.0, force)).max(initial=0.0)
            off.append(float(free / met) if met > 0.0 else 0.0)
        return [Check("forces balance at free nodes", max(off), BALANCE)]
