"""What a creeping network returns, ready for the pictures of loaded networks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.model.archive import Archive
from kaju.model.formats import NETWORK_IN_TIME
from kaju.model.network.assembler import spring_forces, spring_geometry
from kaju.model.network.network_result import (
    NetworkResult,
    network_archive,
    network_from,
    sizes_of_network,
)
from kaju.model.network.springs import SpringNetwork
from kaju.model.result import Curves

from .state import Course, times_of


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class NetworkCreepResult(Course):
    """What became of a spring network in time.

    Attributes
    ----------
    network : SpringNetwork
        What crept.
    displacement : (k, n, dimension) floats
        Displacement of the nodes (m).
    force : (k, m) floats
        Tension of the springs (N).
    """

    kind: ClassVar[str] = "network in time"
    pictures: ClassVar[tuple[str, ...]] = ("curves", "deformed")
    films: ClassVar[tuple[str, ...]] = ("times", "curves")
    network: SpringNetwork
    displacement: Floats
    force: Floats

    def largest_displacement(self) -> Floats:
        """Return how far the node that ever moves most has moved (m) at every time."""
        moved: Floats = np.linalg.norm(self.displacement, axis=2)
        return moved[:, int(moved.max(axis=0).argmax())]

    def grip_force(self) -> Floats:
        """Return the force (N) of what moves held nodes, along their way, at every time.

        Multiplied by the largest given displacement's rate it is the power that goes in.
        """
        given = self.network.displacements[-1]
        way = given / (np.linalg.norm(given, axis=1).max() or 1.0)
        records = range(len(self.times))
        return np.array([float((self.outside_forces(k) * way).sum()) for k in records])

    def largest_force(self) -> Curves:
        """Return the force of the grip over time, or else the largest tension and pressure."""
        time = ("time", "s", self.times)
        if self.network.displacements[-1].any():
            return Curves("Force", *time, {"force of the grip": self.grip_force()}, "N")
        lines = {"largest pull": self.force.max(axis=1), "largest push": self.force.min(axis=1)}
        return Curves("Tension", *time, lines, "N")

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = network_archive(self.network)
        return {**arrays, "displacement": self.displacement, "force": self.force}, about

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        network = network_from(archive)
        sizes = sizes_of_network(network) | times_of(archive)
        return {"network": network, **archive.columns(NETWORK_IN_TIME, sizes)}

    def outside_forces(self, record: int = -1) -> Floats:
        """Return what acts on every node from outside (N), shape (n, dimension).

        Where a node is held, that is the force of its support; where it is free, its load
        (less mass times acceleration).
        """
        geometry = spring_geometry(self.network, self.displacement[record])
        return -spring_forces(self.network, geometry, self.force[record])

    def to_network_result(self, seconds: float = 0.0) -> NetworkResult:
        """Return the moments as the records of a loaded network, for plots and animations.

        The factor of the history stands for the point of the load path. Energies of that
        result are those of elastic springs, and so mean nothing here.
        """
        return NetworkResult(
            network=self.network,
            stage=self.factors,
            displacement=self.displacement,
            tension=self.force,
            residual=np.zeros(len(self.times)),
            corrections=np.zeros(len(self.times), dtype=np.int64),
            scheme="newton",
            method="creep",
            seconds=seconds,
        )
