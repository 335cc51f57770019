"""Networks from networkx graphs, and graphs from networks."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

import networkx as nx
import numpy as np

from kaju.arrays import Floats
from kaju.errors import ResultError, SceneError

from .springs import SpringNetwork


def network_from_graph(
    graph: nx.Graph,
    *,
    position: str = "pos",
    stiffness: str | float = "stiffness",
    rest_length: str | float | None = "rest_length",
    held: str | Iterable[Hashable] = "held",
    force: str | Mapping[Hashable, Any] = "force",
    displacement: str | Mapping[Hashable, Any] = "given_displacement",
) -> SpringNetwork:
    """Read a spring network off a graph.

    Parameters
    ----------
    graph : networkx.Graph or MultiGraph
        Every edge is a spring; the nodes keep their names.
    position : str
        Node attribute with 2 or 3 coordinates (m); every node needs it.
    stiffness : str or float
        Edge attribute K (N/m) that every edge needs, or one number for all.
    rest_length : str, float or None
        Edge attribute λ (m) that every edge needs, or one number for all; None: the length
        each edge has at first.
    held : str or collection of nodes
        Node attribute (true, or one truth value per axis; missing: free), or the held nodes.
    force, displacement : str or mapping
        Node attribute, or a mapping from nodes, with one vector (N, m) or one per stage;
        missing: 0.
    """
    if graph.is_directed():
        raise SceneError(
            "graph: springs have no direction; make it undirected with graph.to_undirected()"
        )
    if graph.number_of_nodes() == 0:
        raise SceneError("graph: has no nodes")
    names = tuple(graph.nodes)
    number = {name: index for index, name in enumerate(names)}
    positions = _positions(graph, position)
    edges = list(graph.edges(data=True))
    return SpringNetwork.build(
        positions,
        [(number[first], number[second]) for first, second, _ in edges],
        _edge_values(edges, stiffness, "stiffness"),
        None if rest_length is None else _edge_values(edges, rest_length, "rest_length"),
        held=_held(graph, number, held, positions.shape),
        forces=_vectors(graph, number, force, positions.shape, "force"),
        displacements=_vectors(graph, number, displacement, positions.shape, "displacement"),
        names=names,
    )


def graph_from_network(
    network: SpringNetwork,
    node_fields: Mapping[str, Floats] | None = None,
    spring_fields: Mapping[str, Floats] | None = None,
) -> nx.Graph:
    """Return a network's graph: vectors as tuples, and a MultiGraph if springs lie side by side."""
    pairs = np.sort(network.springs, axis=1)
    several = len(np.unique(pairs, axis=0)) < len(pairs)
    graph = nx.MultiGraph() if several else nx.Graph()
    nodes: dict[str, Any] = {"pos": network.positions, "held": network.held}
    if network.forces.any():
        nodes["force"] = np.moveaxis(network.forces, 0, 1)
    if network.displacements.any():
        nodes["given_displacement"] = np.moveaxis(network.displacements, 0, 1)
    nodes |= node_fields or {}
    springs = {"stiffness": network.stiffness, "rest_length": network.rest_length}
    springs |= spring_fields or {}
    node_rows = {key: _plain(field) for key, field in nodes.items()}
    spring_rows = {key: _plain(field) for key, field in springs.items()}
    for index, name in enumerate(network.names):
        graph.add_node(name, **{key: rows[index] for key, rows in node_rows.items()})
    for index, (first, second) in enumerate(network.springs.tolist()):
        graph.add_edge(
            network.names[first],
            network.names[second],
            **{key: rows[index] for key, rows in spring_rows.items()},
        )
    return graph


def encoded(name: Hashable) -> Any:
    """Write the name of a node as JSON can hold it: tuples become lists."""
    if isinstance(name, tuple):
        return [encoded(part) for part in name]
    if name is None or isinstance(name, str | bool | int | float):
        return name
    if isinstance(name, np.integer | np.floating):
        return name.item()
    raise ResultError(
        f"the node {name!r} cannot be saved: names must be strings, numbers or tuples of them; "
        "rename it with networkx.relabel_nodes"
    )


def decoded(name: Any) -> Hashable:
    """Read back what `encoded` wrote."""
    return tuple(decoded(part) for part in name) if isinstance(name, list) else name


def _plain(field: Floats) -> list[Any]:
    """Turn rows of an array into numbers and (nested) tuples."""

    def row(value: Any) -> Any:
        return tuple(row(part) for part in value) if isinstance(value, list) else value

    return [row(value) for value in field.tolist()]


def _positions(graph: nx.Graph, position: str) -> Floats:
    rows = []
    for name, attributes in graph.nodes(data=True):
        if position not in attributes:
            raise SceneError(
                f"node {name!r}: has no attribute {position!r}{_nearby(position, attributes)}; "
                "networkx.set_node_attributes(graph, positions, "
                f"{position!r}) gives every node its place"
            )
        rows.append(_vector(attributes[position], f"node {name!r}, {position}"))
    lengths = {len(row) for row in rows}
    if lengths not in ({2}, {3}):
        raise SceneError(
            f"{position}: all nodes need 2 coordinates, or all need 3; got {sorted(lengths)}"
        )
    return np.array(rows)


def _edge_values(edges: list[Any], value: str | float, key: str) -> Any:
    if not isinstance(value, str):
        return value
    found = []
    for first, second, attributes in edges:
        if value not in attributes:
            raise SceneError(
                f"edge {first!r} to {second!r}: has no attribute {value!r}"
                f"{_nearby(value, attributes)}; set it, or pass {key}= a number"
                + (" or None" if key == "rest_length" else "")
            )
        found.append(float(_vector(attributes[value], f"edge {first!r} to {second!r}")))
    return found


def _held(
    graph: nx.Graph,
    number: Mapping[Hashable, int],
    held: str | Iterable[Hashable],
    shape: tuple[int, ...],
) -> Any:
    holds = np.zeros(shape, dtype=bool)
    if isinstance(held, str):
        for name, value in graph.nodes(data=held, default=False):
            try:
                holds[number[name]] = value
            except ValueError as error:
                raise SceneError(
                    f"node {name!r}, {held}: must be true or false, or that for each of the "
                    f"{shape[1]} axes, got {value!r}"
                ) from error
        return holds
    for name in held:
        holds[_numbered(number, name, "held")] = True
    return holds


def _vectors(
    graph: nx.Graph,
    number: Mapping[Hashable, int],
    vectors: str | Mapping[Hashable, Any],
    shape: tuple[int, ...],
    key: str,
) -> Any:
    """Collect vectors per node, or None if there are none: shape (stages, n, dimension)."""
    if isinstance(vectors, str):
        given = {n: value for n, value in graph.nodes(data=vectors) if value is not None}
    else:
        given = dict(vectors)
    if not given:
        return None
    rows = {}
    for name, value in given.items():
        row = np.atleast_2d(_vector(value, f"node {name!r}, {key}"))
        if row.ndim != 2 or row.shape[1] != shape[1]:
            raise SceneError(
                f"node {name!r}, {key}: must be {shape[1]} numbers, or that for every stage, "
                f"got {value!r}"
            )
        rows[_numbered(number, name, key)] = row
    stages = max(len(row) for row in rows.values())
    wrong = [node for node, row in rows.items() if len(row) not in (1, stages)]
    if wrong:
        raise SceneError(
            f"node {list(number)[wrong[0]]!r}, {key}: has {len(rows[wrong[0]])} stages, others "
            f"have {stages}; give one vector for all stages or one for each"
        )
    field = np.zeros((stages, *shape))
    for node, row in rows.items():
        field[:, node] = row
    return field


def _vector(value: Any, place: str) -> Floats:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SceneError(f"{place}: must be made of numbers, got {value!r}") from error


def _numbered(number: Mapping[Hashable, int], name: Hashable, key: str) -> int:
    if name not in number:
        near = get_close_matches(str(name), list(map(str, number)), n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise SceneError(f"{key}: the graph has no node {name!r}{hint}")
    return number[name]


def _nearby(key: str, attributes: Mapping[str, Any]) -> str:
    if not attributes:
        return " (nor any other)"
    near = get_close_matches(key, list(map(str, attributes)), n=1)
    names = ", ".join(map(repr, attributes))
    return f" (it has {names}{f'; did you mean {near[0]!r}?' if near else ''})"
