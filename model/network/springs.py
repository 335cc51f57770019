"""What a spring network is: nodes, the springs between them, what holds and what presses it.

`SpringNetwork` only describes. The engines that load it stand on this description, in the
modules beside, and are called from here when they are asked for.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kaju.errors import SceneError

from .validation import as_stages, check_network

if TYPE_CHECKING:
    import networkx as nx

    from kaju.model.scene import Scene

    from .linear import Method
    from .network_result import NetworkResult

Floats = NDArray[np.float64]
Springs = NDArray[np.int64]


def spring_lengths_and_directions(positions: Floats, springs: Springs) -> tuple[Floats, Floats]:
    """Return length (m,) in m and unit direction (m, dimension) of every spring.

    The direction points from the spring's second node to its first.
    """
    ends = positions[springs[:, 0]] - positions[springs[:, 1]]
    lengths = np.sqrt(np.einsum("ij,ij->i", ends, ends))
    return lengths, ends / lengths[:, None]


@dataclass(frozen=True, eq=False)
class SpringNetwork:
    """Nodes in the plane or in space, joined by springs, held and loaded.

    `SpringNetwork.build` and `SpringNetwork.from_graph` fill in what is left out.

    Parameters
    ----------
    positions : (n, dimension) floats
        Where the nodes lie before any load (m); dimension 2 or 3.
    springs : (m, 2) ints
        The two nodes of every spring. Two springs between the same nodes act side by side.
    stiffness : (m,) floats
        K (N/m), above 0.
    rest_length : (m,) floats
        Length λ (m) at which a spring is free of force, from 0 upwards.
    held : (n, dimension) bools
        Which coordinates of which nodes do not answer to forces.
    forces : (stages, n, dimension) floats
        External force on every node (N) at the end of each stage. Within a stage it grows
        evenly from that of the stage before; the first stage starts from no force. On a held
        coordinate it goes straight into the support.
    displacements : (stages, n, dimension) floats
        Displacement (m) given to the held coordinates at the end of each stage.
    names : tuple of hashable
        Names of the nodes.
    notes : tuple of str
        Remarks on how the network stands for something else; results repeat them.

    Raises
    ------
    SceneError
        If arrays disagree in shape, a spring joins a node to itself or two nodes in one
        place, a free coordinate is given a displacement, or all forces act on held ones.
    ParameterError
        If a number is NaN, infinite or outside its rule.
    SupportError
        If a connected part of the network is held along none of its coordinates.

    Notes
    -----
    A spring between the nodes i and j pulls i by −K (|xᵢ−xⱼ| − λ) (xᵢ−xⱼ)/|xᵢ−xⱼ|.
    """

    positions: Floats
    springs: Springs
    stiffness: Floats
    rest_length: Floats
    held: NDArray[np.bool_]
    forces: Floats
    displacements: Floats
    names: tuple[Hashable, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_network(self)

    @classmethod
    def build(
        cls,
        positions: ArrayLike,
        springs: ArrayLike,
        stiffness: ArrayLike = 1.0,
        rest_length: ArrayLike | None = None,
        *,
        held: ArrayLike = False,
        forces: ArrayLike | None = None,
        displacements: ArrayLike | None = None,
        names: Sequence[Hashable] | None = None,
        notes: tuple[str, ...] = (),
    ) -> SpringNetwork:
        """Make a network from lists and single numbers.

        Parameters
        ----------
        positions, springs
            As the class says.
        stiffness, rest_length : float or (m,) floats
            One number holds for all springs. No rest length: each spring's length at first.
        held : (n,) or (n, dimension) bools
            Whole nodes or single coordinates.
        forces, displacements : (n, dimension) or (stages, n, dimension) floats, optional
            One stage or several; none: 0.
        names : sequence of hashable, optional
            None: 0, 1, 2, ...
        notes : tuple of str
            Remarks that results repeat.
        """
        points = np.array(positions, dtype=np.float64, ndmin=2)
        links = np.array(springs, dtype=np.int64).reshape(-1, 2)
        if rest_length is None:
            ends = points[links[:, 0]] - points[links[:, 1]]
            rest_length = np.sqrt((ends**2).sum(axis=1))
        held_nodes = np.array(held, dtype=bool)
        if held_nodes.ndim == 1:
            held_nodes = held_nodes[:, None]
        force, shift = as_stages(forces, displacements, points.shape)
        return cls(
            positions=points,
            springs=links,
            stiffness=np.broadcast_to(np.asarray(stiffness, dtype=np.float64), len(links)).copy(),
            rest_length=np.broadcast_to(
                np.asarray(rest_length, dtype=np.float64), len(links)
            ).copy(),
            held=np.broadcast_to(held_nodes, points.shape).copy(),
            forces=force,
            displacements=shift,
            names=tuple(range(len(points)) if names is None else names),
            notes=notes,
        )

    @classmethod
    def from_graph(cls, graph: nx.Graph, **attributes: Any) -> SpringNetwork:
        """Read a network off any networkx graph; see `kaju.model.network.graphs`."""
        from .graphs import network_from_graph

        return network_from_graph(graph, **attributes)

    @classmethod
    def from_scene(cls, scene: Scene) -> SpringNetwork:
        """Return the network of a hexagon-celled body; see `kaju.model.network.hexagon_body`."""
        from .hexagon_body import hexagon_body

        return hexagon_body(scene)

    def to_graph(self) -> nx.Graph:
        """Return a networkx graph that `from_graph` reads back as this network."""
        from .graphs import graph_from_network

        return graph_from_network(self)

    def with_loads(
        self, forces: ArrayLike | None = None, displacements: ArrayLike | None = None
    ) -> SpringNetwork:
        """Return the same network under other forces (N) and given displacements (m)."""
        force, shift = as_stages(forces, displacements, self.positions.shape)
        return replace(self, forces=force, displacements=shift)

    def load_in_increments(self, increments: int = 20, **options: Any) -> NetworkResult:
        """Load step by step without correction; see `kaju.model.network.increments`."""
        from .increments import load_in_increments

        return load_in_increments(self, increments, **options)

    def solve(
        self, increments: int = 10, *, method: Method = "auto", **options: Any
    ) -> NetworkResult:
        """Load step by step, each step in equilibrium; see `kaju.model.network.increments`."""
        from .increments import solve

        return solve(self, increments, method=method, **options)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.positions.shape[1])

    @property
    def stages(self) -> int:
        """Number of load stages."""
        return len(self.forces)

    @cached_property
    def initial_length(self) -> Floats:
        """Length of every spring before any load (m), shape (m,)."""
        return spring_lengths_and_directions(self.positions, self.springs)[0]

    @cached_property
    def prestretch(self) -> Floats:
        """Elongation over the rest length before any load (m), shape (m,)."""
        return self.initial_length - self.rest_length

    def force_at(self, stage: float) -> Floats:
        """Return the external force (n, dimension) at a point of the load path.

        `stage` runs from 0 (no load) over 1 (end of the first stage) to `stages`.
        """
        return _between(self.forces, stage)

    def displacement_at(self, stage: float) -> Floats:
        """Return the given displacement (n, dimension) at a point of the load path."""
        return _between(self.displacements, stage)

    def node(self, name: Hashable) -> int:
        """Return the number of the node of that name.

        Raises
        ------
        SceneError
            If there is none.
        """
        if name not in self._numbers:
            some = ", ".join(repr(known) for known in self.names[:4])
            raise SceneError(f"node: there is no {name!r}; the nodes are named {some}, ...")
        return self._numbers[name]

    @cached_property
    def _numbers(self) -> dict[Hashable, int]:
        return {name: number for number, name in enumerate(self.names)}


def _between(stages: Floats, stage: float) -> Floats:
    """Interpolate evenly between the ends of the stages, from zero."""
    last = min(int(np.ceil(stage)), len(stages))
    if last == 0:
        return np.zeros_like(stages[0])
    before = stages[last - 2] if last > 1 else np.zeros_like(stages[0])
    share = stage - (last - 1)
    between: Floats = before + share * (stages[last - 1] - before)
    return between
