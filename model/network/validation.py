"""What a spring network must obey before anything is computed with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from kaju.errors import ParameterError, SceneError, SupportError

if TYPE_CHECKING:
    from .springs import SpringNetwork

Floats = NDArray[np.float64]


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


def check_network(network: SpringNetwork) -> None:
    """Raise the error that says what is wrong with a network, if something is."""
    _check_shapes(network)
    _check_numbers(network)
    _check_springs(network)
    _check_loads(network)
    _check_supports(network)


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
