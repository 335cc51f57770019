"""The spring network as a Mesa model: every step is one increment of the load.

The nodes are agents. In each step the loads grow, the model asks all nodes at once where
balance lies (one linear system, or a few), and every node moves there. Between steps a node
can tell from its own springs and neighbours alone whether it is in balance.
"""

from __future__ import annotations

from inspect import signature
from typing import Any, Literal

import numpy as np

from kaju._mesa import FixedAgent, Network
from kaju.arrays import Floats
from kaju.errors import ParameterError, TangentError
from kaju.mesa_model import SteppedModel
from kaju.stepping import Until

from .increments import IncrementalLoading
from .network_result import NetworkResult, Scheme
from .springs import Method, SpringNetwork

_AGENTS_UP_TO = 10_000
"""Nodes up to which they become agents by themselves; above, arrays alone are quick."""


class NodeAgent(FixedAgent):
    """A node in its cell of Mesa's space: where it is now (m), its springs and their other ends."""

    def __init__(self, model: NetworkModel, node: int, springs: list[tuple[int, int]]) -> None:
        super().__init__(model)
        self.node = node
        self.springs = springs
        self.position = model.network.positions[node].copy()

    @property
    def name(self) -> Any:
        """The node's name in the network."""
        names: tuple[Any, ...] = self.model.network.names
        return names[self.node]

    @property
    def displacement(self) -> Floats:
        """How far it has moved (m), shape (dimension,)."""
        return np.asarray(self.position - self.model.network.positions[self.node])

    def move(self) -> None:
        """Go where the loads and springs now balance."""
        self.position = self.model.positions[self.node].copy()

    def pull(self) -> Floats:
        """Return the force of its springs on it (N), from its neighbours' places alone."""
        network = self.model.network
        force: Floats = np.zeros_like(self.position)
        for spring, neighbour in self.springs:
            away = self.position - self.model.node_agents[neighbour].position
            length = np.linalg.norm(away)
            stretch = length - network.rest_length[spring]
            force -= network.stiffness[spring] * stretch * away / length
        return force


class NetworkModel(SteppedModel):
    """A spring network that is loaded one increment per step.

    Parameters
    ----------
    network : SpringNetwork
        What is loaded.
    increments : int
        Number of increments in every stage.
    scheme : {"newton", "euler"}
        With corrections to balance, or the plain linearised step.
    method : {"auto", "direct", "multigrid"}
        How the linear systems are solved.
    agents : bool or "auto"
        Whether nodes become agents; "auto": up to 10,000 of them.
    rng : int or numpy Generator, optional
        Mesa's random numbers; the model draws none.

    Attributes
    ----------
    running : bool
        Whether a step is left.
    space : mesa.discrete_space.Network or None
        The nodes' cells, joined as the springs join them; None without agents.
    node_agents : list of NodeAgent
        The nodes by number; empty without agents.
    datacollector : mesa.DataCollector
        Stage, largest displacement (m), stored energy (J) and residual after every step.

    Raises
    ------
    ParameterError
        If an argument is outside its rule.
    MechanismError, BucklingError
        If the network gives way before it is loaded.

    Examples
    --------
    >>> from kaju import NetworkModel
    >>> from kaju.model.network import triangular
    >>> model = NetworkModel(triangular(5, force=0.1), increments=4)
    >>> model.step()
    >>> model.running
    True
    >>> model.run().summary()["increments"]
    4
    """

    def __init__(
        self,
        network: SpringNetwork,
        increments: int = 20,
        scheme: Scheme = "newton",
        method: Method = "auto",
        agents: bool | Literal["auto"] = "auto",
        rng: Any = None,
        seed: int | None = None,
    ) -> None:
        super().__init__(rng, seed)
        if agents not in (True, False, "auto"):
            raise ParameterError(f"agents: must be True, False or 'auto', got {agents!r}")
        self.running: bool = True
        self.network = network
        self.increments = increments
        self.scheme: Scheme = scheme
        self.method: Method = method
        few = len(network.positions) <= _AGENTS_UP_TO
        self.space: Network | None = None
        self.node_agents: list[NodeAgent] = []
        if few if agents == "auto" else agents:
            self._make_agents()
        self.reset()

    def step(self) -> None:
        """Take one increment of the load; does nothing once all stages are done.

        Raises
        ------
        MechanismError, BucklingError
            If the network gives way; the model then stops, and its `result` is what was
            reached.
        ConvergenceError
            If the increment is too large.
        """
        try:
            self.loading.step()
        except TangentError:
            self.running = False
            self._observe()
            self._note()
            raise
        self.running = not self.loading.finished
        self._observe()

    def run(self, until: Until | None = None) -> NetworkResult:
        """Take the steps that are left, or those before `until` is true; return the result."""
        return self._run(until, lambda: self.result)

    def reset(self) -> None:
        """Take all loads off and start again."""
        self._start_again()
        self.loading = IncrementalLoading(
            self.network, self.increments, scheme=self.scheme, method=self.method
        )
        self.running = not self.loading.finished
        self._observe()
        self._note()

    def checkpoint_options(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and those that no file can hold."""
        options = {
            "increments": self.increments,
            "scheme": self.scheme,
            "method": self.method,
            "agents": bool(self.node_agents),
        }
        return options, {}

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step: lengths (m), energy (J)."""
        return {
            "stage": self.stage,
            "largest_displacement": self.largest_displacement,
            "strain_energy": self.strain_energy,
            "residual": self.loading.records[-1].residual,
        }

    @property
    def increment(self) -> int:
        """Number of increments taken."""
        return self.loading.steps

    @property
    def stage(self) -> float:
        """Point of the load path: 1 is the end of the first stage."""
        return self.loading.records[-1].stage

    @property
    def positions(self) -> Floats:
        """Where the nodes are now (m), shape (n, dimension)."""
        return self.network.positions + self.loading.records[-1].displacement

    @property
    def tension(self) -> Floats:
        """Force in the springs now (N), shape (m,)."""
        return self.loading.records[-1].tension

    @property
    def largest_displacement(self) -> float:
        """How far the node that moved most has moved (m)."""
        return float(np.linalg.norm(self.loading.records[-1].displacement, axis=1).max())

    @property
    def strain_energy(self) -> float:
        """Energy stored in the springs (J)."""
        return float((self.tension**2 / (2.0 * self.network.stiffness)).sum())

    @property
    def result(self) -> NetworkResult:
        """What has been computed so far."""
        return self.loading.result()

    def _make_agents(self) -> None:
        """Put an agent into every cell of a space that is joined as the springs are."""
        places: dict[str, Any] = {}
        if "layout" in signature(Network.__init__).parameters:  # Mesa 3.5 would draw one at random
            places["layout"] = dict(zip(self.network.names, self.network.positions, strict=True))
        graph = self.network.to_graph()
        self.space = Network(graph, capacity=1, random=self.random, **places)
        springs: list[list[tuple[int, int]]] = [[] for _ in self.network.names]
        for spring, (first, second) in enumerate(self.network.springs.tolist()):
            springs[first].append((spring, second))
            springs[second].append((spring, first))
        for node, name in enumerate(self.network.names):
            agent = NodeAgent(self, node, springs[node])
            agent.cell = self.space[name]
            self.node_agents.append(agent)

    def _observe(self) -> None:
        if self.node_agents:
            self.agents.do("move")
