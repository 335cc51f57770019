"""What a spring network is: nodes, the springs between them, what holds and what presses it.

It only describes; `kaju.model.network.solve` loads it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import Annotated, Any

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, PlainSerializer
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints, without_rows
from kaju.errors import ParameterError, ResultError, SceneError, SupportError
from kaju.model.results.stored import Column

from .graphs import Vectors, graph_of, read_graph


def as_stages(
    forces: ArrayLike | None, displacements: ArrayLike | None, shape: tuple[int, ...]
) -> tuple[Floats, Floats]:
    """Bring forces and given displacements to the shape (stages, n, dimension)."""
    arrays = []
    for key, given in (("forces", forces), ("displacements", displacements)):
        array = np.zeros(shape) if given is None else np.array(given, dtype=np.float64)
        given_shape = array.shape
        array = array[None] if array.ndim == 2 else array
        if array.ndim != 3 or array.shape[1:] != shape or len(array) == 0:
            raise SceneError(
                f"{key}: must have the shape {shape} or (stages, {shape[0]}, {shape[1]}), one "
                f"row for every node, got {given_shape}"
            )
        arrays.append(array)
    stages = max(len(array) for array in arrays)
    force, shift = (
        np.repeat(array, stages, axis=0) if given is None else array
        for array, given in zip(arrays, (forces, displacements), strict=True)
    )
    if len(force) != len(shift):
        raise SceneError(
            f"forces describe {len(force)} stages and displacements {len(shift)}: give both "
            "for every stage (repeat the last one where it stays)"
        )
    return force, shift


def _check_shapes(network: SpringNetwork) -> None:
    nodes, springs = len(network.positions), len(network.springs)
    if network.positions.ndim != 2 or network.positions.shape[1] not in (2, 3) or nodes == 0:
        raise SceneError(
            "positions: must have the shape (n, 2) or (n, 3) with at least one node, got "
            f"{network.positions.shape}"
        )
    if springs == 0:
        raise SceneError("springs: there are none, so no node can pass its load on; add springs")
    loads = (len(network.forces), *network.positions.shape)
    for key, shape in (
        ("springs", (springs, 2)),
        ("stiffness", (springs,)),
        ("rest_length", (springs,)),
        ("held", network.positions.shape),
        ("forces", loads),
        ("displacements", loads),
    ):
        got = getattr(network, key).shape
        if got != shape:
            raise SceneError(f"{key}: must have the shape {shape}, got {got}")
    if len(network.names) != nodes or len(set(network.names)) != nodes:
        raise SceneError(
            f"names: {nodes} nodes need as many different names, got {len(network.names)} of "
            f"which {len(set(network.names))} differ"
        )
    for key, count in (("nodes", nodes), ("springs", springs)):
        got = len(network.attributes.get(key, range(count)))
        if got != count:
            raise SceneError(
                f"attributes: {got} {key} are described and {count} there; give attributes={{}}, "
                "or those that belong to them"
            )


def _check_numbers(network: SpringNetwork) -> None:
    for key in ("positions", "stiffness", "rest_length", "forces", "displacements"):
        values = getattr(network, key)
        wrong = np.argwhere(~np.isfinite(values))
        if len(wrong):
            place = tuple(int(index) for index in wrong[0])
            raise ParameterError(
                f"{key}{list(place)}: must be a finite number, got {values[place]}"
            )
    for key, least, rule in (
        ("stiffness", np.nextafter(0.0, 1.0), "above 0 N/m; leave out a spring that carries none"),
        ("rest_length", 0.0, "a length from 0 m upwards"),
    ):
        values = getattr(network, key)
        low = np.flatnonzero(values < least)
        if len(low):
            raise ParameterError(
                f"{key} of {_spring(network, low[0])}: must be {rule}, got {values[low[0]]}"
            )


def _check_springs(network: SpringNetwork) -> None:
    springs, nodes = network.springs, len(network.positions)
    outside = np.flatnonzero(((springs < 0) | (springs >= nodes)).any(axis=1))
    if len(outside):
        raise SceneError(
            f"springs[{outside[0]}]: joins the nodes {springs[outside[0]].tolist()}, but nodes "
            f"count from 0 to {nodes - 1}"
        )
    loops = np.flatnonzero(springs[:, 0] == springs[:, 1])
    if len(loops):
        raise SceneError(
            f"{_spring(network, loops[0])}: joins a node to itself; remove it (a graph's "
            "self-loops: graph.remove_edges_from(list(networkx.selfloop_edges(graph))))"
        )
    ends = network.positions[springs]
    together = np.flatnonzero((ends[:, 0] == ends[:, 1]).all(axis=1))
    if len(together):
        place = ends[together[0], 0].tolist()
        raise SceneError(
            f"{_spring(network, together[0])}: both ends lie at {place}, so it points nowhere; "
            "merge the two nodes or move one"
        )


def _check_loads(network: SpringNetwork) -> None:
    wrong = np.argwhere((network.displacements != 0.0) & ~network.held)
    if len(wrong):
        stage, node, axis = (int(index) for index in wrong[0])
        raise SceneError(
            f"displacements, stage {stage + 1}: {network.displacements[stage, node, axis]} m along "
            f"{'xyz'[axis]} at node {network.names[node]!r}, which is not held there: hold it or "
            "leave the displacement out"
        )
    loaded = (network.forces != 0.0).any(axis=0)
    if loaded.any() and not (loaded & ~network.held).any():
        node = int(np.flatnonzero(loaded.any(axis=1))[0])
        raise SceneError(
            f"forces: all act on held coordinates (the first on node {network.names[node]!r}), so "
            "they go straight into the supports; press on a node that is free"
        )


def _check_supports(network: SpringNetwork) -> None:
    nodes = len(network.positions)
    first, second = network.springs.T
    links = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(nodes, nodes))
    parts, part = connected_components(links, directed=False)
    for axis in range(network.dimension):
        holds = np.bincount(part, weights=network.held[:, axis], minlength=parts)
        loose = np.flatnonzero(holds == 0)
        if len(loose):
            members = np.flatnonzero(part == loose[0])
            named = ", ".join(repr(network.names[node]) for node in members[:5])
            more = f" and {len(members) - 5} more" if len(members) > 5 else ""
            raise SupportError(
                f"held: nothing holds the nodes {named}{more} along {'xyz'[axis]}, so they "
                "would float away; hold one of them or join them to a part that is held"
            )


def _spring(network: SpringNetwork, spring: int) -> str:
    first, second = (network.names[int(node)] for node in network.springs[spring])
    return f"spring {spring} between the nodes {first!r} and {second!r}"


def spring_lengths_and_directions(positions: Floats, springs: Ints) -> tuple[Floats, Floats]:
    """Return length (m) and unit direction, from its second node to its first, of every spring."""
    ends = positions[springs[:, 0]] - positions[springs[:, 1]]
    lengths = np.sqrt(np.einsum("ij,ij->i", ends, ends))
    return lengths, ends / lengths[:, None]


def _encoded_names(name: Any) -> Any:
    """Write names of nodes as JSON can hold them: tuples become lists."""
    if isinstance(name, tuple):
        return [_encoded_names(part) for part in name]
    if name is None or isinstance(name, str | bool | int | float):
        return name
    if isinstance(name, np.integer | np.floating):
        return name.item()
    raise ResultError(
        f"of the node {name!r}: names must be strings, numbers or tuples of them; rename it with "
        "networkx.relabel_nodes"
    )


def _decoded_names(name: Any) -> Any:
    """Read back what `_encoded_names` wrote."""
    return tuple(_decoded_names(part) for part in name) if isinstance(name, list | tuple) else name


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
    attributes : dict
        What else the graph that it was read from says of itself, its nodes and its springs.

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

    Examples
    --------
    >>> from kaju import SpringNetwork
    >>> from kaju.model.network import solve
    >>> net = SpringNetwork.build(
    ...     positions=[[0.0, 0.0], [0.0, -1.0]], springs=[[0, 1]], stiffness=10.0,
    ...     held=[[True, True], [True, False]], forces=[[0.0, 0.0], [0.0, -2.0]],
    ... )
    >>> round(float(solve(net).displacement[-1, 1, 1]), 6)
    -0.2
    """

    positions: Annotated[Floats, Column("nodes dimension")]
    springs: Annotated[Ints, Column("springs 2", 0, "nodes")]
    stiffness: Annotated[Floats, Column("springs", 0.0)]
    rest_length: Annotated[Floats, Column("springs", 0.0)]
    held: Annotated[Flags, Column("nodes dimension")]
    forces: Annotated[Floats, Column("stages nodes dimension")]
    displacements: Annotated[Floats, Column("stages nodes dimension")]
    names: Annotated[
        tuple[Any, ...], AfterValidator(_decoded_names), PlainSerializer(_encoded_names)
    ]
    notes: tuple[str, ...] = ()
    attributes: dict[str, Any] = field(default_factory=dict)
    __repr__ = without_rows

    def __post_init__(self) -> None:
        _check_shapes(self)
        _check_numbers(self)
        _check_springs(self)
        _check_loads(self)
        _check_supports(self)

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
        attributes: dict[str, Any] | None = None,
    ) -> SpringNetwork:
        """Make a network from lists and single numbers; arguments are those of the class.

        One `stiffness` or `rest_length` holds for all springs; without a rest length a spring has
        the length that it begins with. `held` tells of whole nodes or of single coordinates,
        `forces` and `displacements` of one stage or several. Names count from 0 unless given.
        """
        points = np.array(positions, dtype=np.float64, ndmin=2)
        links = np.array(springs, dtype=np.int64).reshape(-1, 2)
        if rest_length is None:
            ends = points[links[:, 0]] - points[links[:, 1]]
            rest_length = np.linalg.norm(ends, axis=1)
        held_nodes = np.array(held, dtype=bool)
        if held_nodes.ndim == 1:
            held_nodes = held_nodes[:, None]
        force, shift = as_stages(forces, displacements, points.shape)
        return cls(
            positions=points,
            springs=links,
            stiffness=np.broadcast_to(np.array(stiffness, dtype=float), len(links)).copy(),
            rest_length=np.broadcast_to(np.array(rest_length, dtype=float), len(links)).copy(),
            held=np.broadcast_to(held_nodes, points.shape).copy(),
            forces=force,
            displacements=shift,
            names=tuple(range(len(points)) if names is None else names),
            notes=notes,
            attributes=attributes or {},
        )

    @classmethod
    def from_graph(
        cls,
        graph: nx.Graph,
        *,
        positions: str | tuple[str, ...] = "pos",
        stiffness: str | float = "stiffness",
        rest_length: str | float | None = "rest_length",
        held: str | Iterable[Hashable] = "held",
        forces: Vectors = "force",
        displacements: Vectors = "given_displacement",
    ) -> SpringNetwork:
        """Read a network off a graph of networkx: every edge is a spring.

        Vectors may be tuples, lists or texts such as "(0.5, 1.0)", as GraphML keeps them.

        Parameters
        ----------
        graph : networkx.Graph or MultiGraph
            The nodes keep their names.
        positions : str or tuple of str
            Node attribute with 2 or 3 coordinates (m), or one attribute for each axis.
        stiffness : str or float
            Edge attribute K (N/m), or one number for all.
        rest_length : str, float or None
            Edge attribute λ (m), or one number for all; None: the length that each has at first.
        held : str or collection of nodes
            Node attribute (true, or one truth value for each axis; missing: free), or the nodes.
        forces, displacements : str, tuple of str, or mapping
            Node attribute with a vector (N, m) or one for each stage, one attribute for each axis,
            or vectors by node; missing: 0.

        Raises
        ------
        SceneError
            If the graph is directed or empty, or an attribute is missing or not made of numbers.

        Examples
        --------
        >>> import networkx as nx
        >>> graph = nx.Graph()
        >>> graph.add_node("wall", x=0.0, y=0.0, held=True)
        >>> graph.add_node("end", x=1.0, y=0.0, held="(False, True)", fx=0.5)
        >>> graph.add_edge("wall", "end", stiffness=5.0)
        >>> from kaju import SpringNetwork
        >>> axes = {"positions": ("x", "y"), "forces": ("fx", "fy")}
        >>> SpringNetwork.from_graph(graph, rest_length=None, **axes).forces.tolist()
        [[[0.0, 0.0], [0.5, 0.0]]]
        """
        how = (positions, stiffness, rest_length, held, forces, displacements)
        return cls.build(**read_graph(graph, *how))

    def to_graph(
        self,
        *,
        texts: bool = False,
        nodes: Mapping[str, Floats] | None = None,
        springs: Mapping[str, Floats] | None = None,
    ) -> nx.Graph:
        """Return a networkx graph that `from_graph` reads back as this network.

        Colours, labels and what else the graph had that it was read from are kept.

        Parameters
        ----------
        texts : bool
            Write vectors as texts such as "(0.5, 1.0)": GraphML and GML keep no tuples.
        nodes, springs : mapping of str to arrays, optional
            More attributes, one row for each node or spring.
        """
        about: dict[str, NDArray[Any]] = {"pos": self.positions, "held": self.held}
        if self.forces.any():
            about["force"] = _by_node(self.forces)
        if self.displacements.any():
            about["given_displacement"] = _by_node(self.displacements)
        edges = {"stiffness": self.stiffness, "rest_length": self.rest_length}
        return graph_of(
            self.names,
            self.springs,
            {**about, **(nodes or {})},
            {**edges, **(springs or {})},
            self.attributes,
            texts=texts,
        )

    def with_loads(
        self, forces: ArrayLike | None = None, displacements: ArrayLike | None = None
    ) -> SpringNetwork:
        """Return the same network under other forces (N) and given displacements (m)."""
        force, shift = as_stages(forces, displacements, self.positions.shape)
        return replace(self, forces=force, displacements=shift)

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


def with_some(network: SpringNetwork, kept: Flags) -> SpringNetwork:
    """Return a network without the springs that are not kept."""
    attributes = dict(network.attributes)
    if "springs" in attributes:
        attributes["springs"] = [*compress(attributes["springs"], kept)]
    names = ("springs", "stiffness", "rest_length")
    some: dict[str, Any] = {name: getattr(network, name)[kept] for name in names}
    return replace(network, attributes=attributes, **some)


def _by_node(stages: Floats) -> Floats:
    """Return the vector of each node, or one for each of several stages."""
    return stages[0] if len(stages) == 1 else np.moveaxis(stages, 0, 1)


def _between(stages: Floats, stage: float) -> Floats:
    """Interpolate evenly between the ends of the stages, from zero."""
    last = min(int(np.ceil(stage)), len(stages))
    if last == 0:
        return np.zeros_like(stages[0])
    before = stages[last - 2] if last > 1 else np.zeros_like(stages[0])
    share = stage - (last - 1)
    return np.asarray(before + share * (stages[last - 1] - before))
