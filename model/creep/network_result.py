"""What a creeping network returns, ready for the pictures of loaded networks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju.model.network.geometry import spring_forces, spring_geometry
from kaju.model.network.network_result import NetworkResult
from kaju.model.network.springs import SpringNetwork

from .state import CreepResult

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class NetworkCreepResult(CreepResult):
    """What became of a spring network in time.

    Attributes
    ----------
    network : SpringNetwork
        What crept. `displacement` has shape (k, n, dimension); `force`, the tension of its
        springs, (k, m).
    """

    network: SpringNetwork

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
