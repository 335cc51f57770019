"""Networks as graphs of networkx: what their attributes say, and back.

Files of graphs (GraphML, GML, JSON) hold numbers and texts, no tuples. So a vector may also be a
text such as "(0.5, 1.0)", or stand in one attribute for each axis, such as "x" and "y".
"""

from __future__ import annotations

from ast import literal_eval
from collections.abc import Hashable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from math import inf
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import SceneError, brief, suggestion
from kaju.model.scene.validation import plain

Vectors = str | tuple[str, ...] | Mapping[Hashable, Any]
"""A node attribute with a vector, one attribute for each axis, or vectors by node."""


def read_graph(
    graph: nx.Graph,
    positions: str | tuple[str, ...],
    stiffness: str | float,
    rest_length: str | float | None,
    held: str | Iterable[Hashable],
    forces: Vectors,
    displacements: Vectors,
) -> dict[str, Any]:
    """Return what `SpringNetwork.build` takes; arguments as of `SpringNetwork.from_graph`."""
    if not hasattr(graph, "is_directed"):
        raise SceneError(
            f"graph: must be a graph of networkx, got {brief(graph)}; networkx reads files, "
            "such as networkx.read_graphml(path)"
        )
    if graph.is_directed():
        raise SceneError(
            "graph: springs have no direction; make it undirected with graph.to_undirected()"
        )
    if graph.number_of_nodes() == 0:
        raise SceneError("graph: has no nodes")
    number = {name: index for index, name in enumerate(graph.nodes)}
    places = _positions(graph, positions)
    edges = list(graph.edges(data=True))
    lengths = None if rest_length is None else _edge_values(edges, rest_length, "rest_length")
    given = (positions, stiffness, rest_length, held, forces, displacements)
    read = {
        key
        for one in given
        for key in (one if isinstance(one, tuple) else (one,))
        if isinstance(key, str)
    }

    def others(attributes: Mapping[str, Any]) -> dict[str, Any]:
        return {key: plain(value, inf) for key, value in attributes.items() if key not in read}

    return {
        "positions": places,
        "springs": [(number[first], number[second]) for first, second, _ in edges],
        "stiffness": _edge_values(edges, stiffness, "stiffness"),
        "rest_length": lengths,
        "held": _held(graph, number, held, places.shape),
        "forces": _vectors(graph, number, forces, places.shape, "forces"),
        "displacements": _vectors(graph, number, displacements, places.shape, "displacements"),
        "names": tuple(graph.nodes),
        "attributes": {
            "graph": plain(graph.graph, inf),
            "nodes": [others(attributes) for _, attributes in graph.nodes(data=True)],
            "springs": [others(attributes) for *_, attributes in edges],
        },
    }


def graph_of(
    names: tuple[Hashable, ...],
    springs: Ints,
    nodes: Mapping[str, NDArray[Any]],
    edges: Mapping[str, NDArray[Any]],
    attributes: Mapping[str, Any],
    *,
    texts: bool,
) -> nx.Graph:
    """Return a graph with attributes; a MultiGraph if springs lie side by side."""
    several = len(np.unique(np.sort(springs, axis=1), axis=0)) < len(springs)
    graph = nx.MultiGraph() if several else nx.Graph()
    graph.graph.update(attributes.get("graph", {}))
    rows = _rows(attributes.get("nodes", [{}] * len(names)), nodes, texts)
    graph.add_nodes_from(zip(names, rows, strict=True))
    rows = _rows(attributes.get("springs", [{}] * len(springs)), edges, texts)
    for (first, second), row in zip(springs.tolist(), rows, strict=True):
        graph.add_edge(names[first], names[second], **row)
    return graph


def _rows(
    others: list[dict[str, Any]], fields: Mapping[str, NDArray[Any]], texts: bool
) -> Iterator[dict[str, Any]]:
    """Yield the attributes of each node or spring: numbers and (nested) tuples, or their texts."""

    def tuples(value: Any) -> Any:
        return tuple(map(tuples, value)) if isinstance(value, list | tuple) else value

    columns = {key: field.tolist() for key, field in fields.items()}
    for index, other in enumerate(others):
        row = other | {key: column[index] for key, column in columns.items()}
        row = {key: tuples(value) for key, value in row.items()}
        yield {k: str(v) if texts and isinstance(v, tuple) else v for k, v in row.items()}


def _positions(graph: nx.Graph, positions: str | tuple[str, ...]) -> Floats:
    rows = []
    for name, attributes in graph.nodes(data=True):
        keys = [positions] if isinstance(positions, str) else positions
        for key in keys:
            if key not in attributes:
                raise SceneError(
                    f"positions: node {name!r} has no attribute {key!r}"
                    f"{_nearby(key, attributes)}; name one attribute with all coordinates, or one "
                    'for each axis, such as positions=("x", "y")'
                )
        row = [_numbers(attributes[key], f"node {name!r}, {key}") for key in keys]
        rows.append(row[0] if isinstance(positions, str) else np.array(row))
    if {row.shape for row in rows} not in ({(2,)}, {(3,)}):
        found = sorted({row.size for row in rows})
        raise SceneError(
            f"positions: all nodes need 2 coordinates, or all need 3; got {found} in {positions!r}"
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
        found.append(float(_numbers(attributes[value], f"edge {first!r} to {second!r}, {value}")))
    return found


def _held(
    graph: nx.Graph,
    number: Mapping[Hashable, int],
    held: str | Iterable[Hashable],
    shape: tuple[int, ...],
) -> Any:
    holds = np.zeros(shape, dtype=bool)
    if isinstance(held, str):
        _refuse_near(graph, held, "held")
        for name, value in graph.nodes(data=held, default=False):
            try:
                holds[number[name]] = literal_eval(value) if isinstance(value, str) else value
            except (ValueError, SyntaxError) as error:
                raise SceneError(
                    f"node {name!r}, {held}: must be true or false, or one of these for each of "
                    f"the {shape[1]} axes, got {value!r}"
                ) from error
        return holds
    for name in held:
        holds[_numbered(number, name, "held")] = True
    return holds


def _vectors(
    graph: nx.Graph,
    number: Mapping[Hashable, int],
    vectors: Vectors,
    shape: tuple[int, ...],
    key: str,
) -> Any:
    """Collect vectors per node, or None if there are none: shape (stages, n, dimension)."""
    rows = {}
    if isinstance(vectors, str):
        _refuse_near(graph, vectors, key)
    for name, value in _given(graph, vectors).items():
        row = np.atleast_2d(_numbers(value, f"node {name!r}, {key}"))
        if row.ndim != 2 or row.shape[1] != shape[1]:
            raise SceneError(
                f"node {name!r}, {key}: must be {shape[1]} numbers, or a row of these for every "
                f"stage, got {value!r}"
            )
        rows[_numbered(number, name, key)] = row
    if not rows:
        return None
    stages = max(len(row) for row in rows.values())
    if wrong := [node for node, row in rows.items() if len(row) not in (1, stages)]:
        raise SceneError(
            f"node {list(number)[wrong[0]]!r}, {key}: has {len(rows[wrong[0]])} stages, others "
            f"have {stages}; give one vector for all stages or one for each"
        )
    field = np.zeros((stages, *shape))
    for node, row in rows.items():
        field[:, node] = row
    return field


def _refuse_near(graph: nx.Graph, attribute: str, key: str) -> None:
    """Refuse nodes none of which has an attribute, but some one that is nearly called so."""
    names = {str(name) for _, attributes in graph.nodes(data=True) for name in attributes}
    near = get_close_matches(attribute, names, n=1, cutoff=0.85)
    if near and near[0] != attribute:
        raise SceneError(
            f"{key}: no node has an attribute {attribute!r}, but there is {near[0]!r}; rename it, "
            f"or pass {key}={near[0]!r}"
        )


def _given(graph: nx.Graph, vectors: Vectors) -> Mapping[Hashable, Any]:
    """Return the vectors of the nodes that have one; an axis without an attribute is 0."""
    if isinstance(vectors, str):
        return {name: value for name, value in graph.nodes(data=vectors) if value is not None}
    if isinstance(vectors, tuple):
        return {
            name: [_numbers(attributes.get(key, 0.0), f"node {name!r}, {key}") for key in vectors]
            for name, attributes in graph.nodes(data=True)
            if any(key in attributes for key in vectors)
        }
    return vectors


def _numbers(value: Any, place: str) -> Floats:
    try:
        read = literal_eval(value) if isinstance(value, str) else value
        return np.asarray(read, dtype=np.float64)
    except (TypeError, ValueError, SyntaxError) as error:
        raise SceneError(f"{place}: must be made of numbers, got {value!r}") from error


def _numbered(number: Mapping[Hashable, int], name: Hashable, key: str) -> int:
    if name not in number:
        near = suggestion(str(name), map(str, number))
        raise SceneError(f"{key}: the graph has no node {name!r}{near}")
    return number[name]


def _nearby(key: str, attributes: Mapping[str, Any]) -> str:
    if not attributes:
        return " (nor any other)"
    near = suggestion(key, map(str, attributes))
    return f"{near}; it has {', '.join(map(repr, attributes))}"
