"""A spring network loaded step by step: every step is one increment of the load."""

from __future__ import annotations

from kaju.arrays import Floats
from kaju.errors import TangentError
from kaju.model.stepper import Stepper

from .increments import IncrementalLoading
from .network_result import NetworkResult, Scheme
from .springs import SpringNetwork


class NetworkModel(Stepper[NetworkResult]):
    """A spring network that is loaded by one increment a step.

    Parameters
    ----------
    network : SpringNetwork
        What is loaded.
    increments : int
        Number of increments in every stage.
    scheme : {"newton", "euler"}
        With corrections to balance, or the plain linearised step.

    Attributes
    ----------
    running : bool
        Whether a step is left.

    Raises
    ------
    ParameterError
        If an argument is outside its rule.
    MechanismError, BucklingError
        If the network gives way; `result()` is then what was reached.
    ConvergenceError
        If an increment is too large.

    Examples
    --------
    >>> from kaju import NetworkModel
    >>> from kaju.model.network import triangular
    >>> model = NetworkModel(triangular(5, force=0.1), increments=4)
    >>> model.step()
    >>> model.running
    True
    >>> model.run().increments
    4
    """

    def __init__(
        self, network: SpringNetwork, increments: int = 20, scheme: Scheme = "newton"
    ) -> None:
        self.network = network
        self.loading = IncrementalLoading(network, increments, scheme=scheme)

    def advance(self) -> None:
        """Take one increment of the load."""
        try:
            self.loading.step()
        except TangentError:
            self.running = False
            raise
        self.running = not self.loading.finished

    @property
    def stage(self) -> float:
        """Point of the load path: 1 is the end of the first stage."""
        return self.loading.records[-1].stage

    @property
    def positions(self) -> Floats:
        """Where the nodes are now (m), shape (n, dimension)."""
        return self.network.positions + self.loading.records[-1].displacement

    def result(self) -> NetworkResult:
        """Return what has been computed so far."""
        return self.loading.result()

    def progress(self) -> str:
        """Return the line of progress."""
        return f"increment {self.steps}: stage {self.stage:.4g} of {self.network.stages}"
