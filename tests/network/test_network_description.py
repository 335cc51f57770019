"""What a spring network accepts, and how it says what is wrong."""

import json
from dataclasses import replace
from inspect import signature

import networkx as nx
import numpy as np
import pytest
from plates import loaded

from kaju import SpringNetwork
from kaju.errors import ParameterError, SceneError, SupportError
from kaju.model import network
from kaju.model.network import cut, hexagon_body, solve, spring_lengths_and_directions, triangular

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
RING = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]]
HELD = [True, True, False, False]


def square(**changes):
    described = {"positions": SQUARE, "springs": RING, "stiffness": 2.0, "held": HELD} | changes
    return SpringNetwork.build(**described)


@pytest.mark.parametrize(("changes", "error", "message"), [
    ({"positions": SQUARE * [1.0, np.nan]}, ParameterError, r"positions\[0, 1\]: must be"),
    ({"stiffness": [1, 1, -3, 1, 1]}, ParameterError, "stiffness of spring 2 .* got -3"),
    ({"springs": [[0, 1], [2, 2]]}, SceneError, "spring 1 .* joins a node to itself"),
    ({"springs": [[0, 7]], "rest_length": 1.0}, SceneError, "count from 0 to 3"),
    ({"positions": SQUARE[[0, 0, 2, 3]]}, SceneError, "spring 0 .* both ends lie at"),
    ({"names": ["a", "b", "b", "c"]}, SceneError, "which 3 differ"),
    ({"forces": np.ones((3, 2))}, SceneError, r"forces: must have the shape \(4, 2\)"),
    ({"forces": [[0, 1], [0, 0], [0, 0], [0, 0]]}, SceneError, "straight into the supports"),
    ({"springs": [[0, 1], [2, 3]]}, SupportError, "nothing holds the nodes 2, 3"),
    (
        {"forces": np.zeros((2, 4, 2)), "displacements": np.zeros((3, 4, 2))},
        SceneError,
        "2 stages and displacements 3",
    ),
    ({"held": [[1, 0], [0, 0], [0, 0], [0, 0]]}, SupportError, "along y"),
])  # fmt: skip
def test_what_is_wrong_is_named(changes, error, message):
    with pytest.raises(error, match=message):
        square(**changes)


def written(kind, graph, tmp_path):
    """Write a graph to a file, and read it again."""
    path = tmp_path / "net"
    if kind == "json":
        # What the list of links is called has two names in NetworkX.
        key = "edges" if "edges" in signature(nx.node_link_data).parameters else "link"
        path.write_text(json.dumps(nx.node_link_data(graph, **{key: "links"})))
        return nx.node_link_graph(json.loads(path.read_text()), **{key: "links"})
    getattr(nx, f"write_{kind}")(graph, path)
    return getattr(nx, f"read_{kind}")(path)


def test_inner_nodes_are_moved_by_chance_and_springs_are_bars_of_one_cross_section():
    moved = network.jittered(4, 4, jitter=0.2, spacing=2.0, stiffness=3.0)
    shift = np.abs(moved.positions - triangular(4, 4, spacing=2.0).positions)
    assert np.array(moved.names)[shift.any(axis=1)].tolist() == [[1, 1], [2, 1], [2, 2]]
    assert 0.2 < shift.max() <= 0.4
    long = spring_lengths_and_directions(moved.positions, moved.springs)[0]
    np.testing.assert_allclose(moved.stiffness * long, 6.0)


def test_a_graph_comes_back_as_it_went():
    network = triangular(4, 5)
    again = SpringNetwork.from_graph(network.to_graph())
    assert again.names == network.names
    graph = network.with_loads(np.ones_like(network.positions)).to_graph()
    assert graph.nodes[network.names[0]]["force"] == (1.0, 1.0)
    with pytest.raises(SceneError, match="attribute 'forces', but there is 'force'"):
        SpringNetwork.from_graph(graph, forces="forces")
    assert again.node((2, 1)) == network.node((2, 1))
    with pytest.raises(SceneError, match="there is no 'x'; the nodes are named"):
        again.node("x")
    ends = {frozenset(pair) for pair in network.springs.tolist()}
    assert {frozenset(pair) for pair in again.springs.tolist()} == ends
    graph.graph["name"] = graph.nodes[0, 0]["colour"] = "a"
    nx.set_edge_attributes(graph, dict(zip(graph.edges, np.arange(99), strict=False)), "number")
    kept = SpringNetwork.from_graph(graph).with_loads()
    same = solve(cut(kept, (0.6, 0.4), (0.9, 0.4))).network.to_graph()
    assert (same.name, same.nodes[0, 0]["colour"]) == ("a", "a")
    assert json.dumps(kept.attributes)
    assert 0 < same.number_of_edges() < graph.number_of_edges()
    assert all(same.edges[one]["number"] == graph.edges[one]["number"] for one in same.edges)
    assert "force" not in same.nodes[0, 0]
    assert "nothing is applied" in solve(network.with_loads()).notes[0]
    assert solve(network.with_loads(-1e-3 * network.forces[-1])).notes == ()
    double = square(springs=[*RING, [0, 2]], stiffness=[1, 1, 1, 1, 1, 4]).to_graph()
    assert double.is_multigraph()
    assert sorted(SpringNetwork.from_graph(double).stiffness) == [1, 1, 1, 1, 1, 4]


@pytest.mark.parametrize("kind", ["graphml", "gml", "json"])
def test_a_network_comes_back_from_a_file_of_a_graph(kind, tmp_path):
    network = square(held=[[1, 1], [0, 1], [0, 0], [0, 0]], forces=np.eye(4)[:, 1:3] * [0.0, -0.1])
    network = replace(network, names=tuple("abcd"), rest_length=0.1 * np.arange(8, 13))
    again = SpringNetwork.from_graph(written(kind, network.to_graph(texts=True), tmp_path))
    assert again.names == network.names
    for name in ("positions", "held", "forces"):
        assert np.array_equal(getattr(again, name), getattr(network, name)), name
    assert sorted(again.rest_length) == pytest.approx(network.rest_length)


# Lattices, and the continuum that they stand for.


def springs_per_node(network):
    return np.bincount(network.springs.ravel(), minlength=len(network.positions))


def test_the_triangular_lattice_of_the_description():
    network = triangular(5, force=0.1)
    names = np.array(network.names)
    held = names[network.held.all(axis=1)].tolist()
    assert held == [[0, 0], [0, 4], [2, 0], [2, 4], [4, 0], [4, 4]]
    force = zip(names, network.forces[0].tolist(), strict=True)
    pressed = {tuple(node): f for node, f in force if any(f)}
    assert pressed == {(0, 2): [0.0, 0.1], (4, 2): [0.0, -0.1]}
    assert set(network.stiffness) == {1.0}
    assert np.array_equal(network.rest_length, network.initial_length)
    assert springs_per_node(network)[network.node((2, 2))] == 6
    nodes = {(3, 3): 8, (5, 5): 23, (9, 9): 77, (4, 2): 7, (3, 2): 5}
    assert {size: len(triangular(*size).positions) for size in nodes} == nodes
    shared = triangular(4, 5, force=0.1).forces[0, :, 1]  # of two middle nodes
    assert sorted(shared[shared != 0.0]) == [-0.05, -0.05, 0.05, 0.05]


def affine_energy(network, gradient):
    """Energy that a small even strain stores in the springs of an inner part, per node."""
    inner = springs_per_node(network) == springs_per_node(network).max()
    _, direction = spring_lengths_and_directions(network.positions, network.springs)
    stretch = network.initial_length * np.einsum("ia,ab,ib->i", direction, gradient, direction)
    energy = 0.5 * network.stiffness * stretch**2
    per_node = np.zeros(len(network.positions))
    for end in (0, 1):
        np.add.at(per_node, network.springs[:, end], 0.5 * energy)
    return per_node[inner].mean()


def test_the_lattice_is_an_isotropic_sheet_with_a_poissons_ratio_of_a_third():
    network, area = triangular(9, stiffness=3.0), np.sqrt(3.0) / 2.0
    stretch, shear = np.diag([1.0, 0.0]), np.array([[0.0, 0.5], [0.5, 0.0]])
    c11 = 2.0 * affine_energy(network, stretch) / area
    c66 = 2.0 * affine_energy(network, shear) / area
    both = 2.0 * affine_energy(network, np.eye(2)) / area
    c12 = both / 2.0 - c11
    assert c12 / c11 == pytest.approx(1.0 / 3.0)
    assert c66 == pytest.approx((c11 - c12) / 2.0)
    assert c11 - c12**2 / c11 == pytest.approx(2.0 * 3.0 / np.sqrt(3.0))


# Bodies of hexagons as spring networks.

LOAD = {"cell": [3, 4], "force": [0.0, -0.5]}


def body(load=LOAD, cells=(6, 5), ratio=1.0 / 3.0, **changes):
    """Hexagons of rubber on rigid ground, as a network."""
    rubber = {"youngs_modulus": 1e6, "poissons_ratio": ratio}
    usual = {"material": "rubber", "materials": {"rubber": rubber}, "thickness": 0.002}
    scene = loaded(list(cells), load, lattice="hexagon", **usual | changes)
    return hexagon_body(scene)


def test_a_sheet_under_even_pressure_has_the_materials_constants():
    pressure = 100.0
    load, sides = {"side": "top", "pressure": pressure}, dict.fromkeys(["bottom", "left"], "roller")
    network = body(load, (24, 25), sides=sides)
    result = solve(network, 1)
    x, y = network.positions.T
    inner = (np.abs(x - x.mean()) < 0.04) & (np.abs(y - y.mean()) < 0.04)
    plane = np.stack([x, y, 0 * x + 1], axis=1)[inner]
    strain = np.linalg.lstsq(plane, result.displacement[-1][inner], rcond=None)[0]
    assert pressure / -strain[1, 1] == pytest.approx(1e6, rel=0.03)
    assert -strain[0, 0] / strain[1, 1] == pytest.approx(1.0 / 3.0, rel=0.05)


def test_a_wall_that_moves_takes_the_body_along():
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, -0.001]}}
    network = body({"cell": [3, 2], "force": [0.0, -1e-9]}, sides=sides)
    moved = network.displacements[0][:, 1]
    assert sorted(set(moved.tolist())) == [-0.001, 0.0]
    assert (moved != 0.0).sum() == 12
    assert solve(network, 1).reactions()[moved != 0.0, 1].sum() < 0.0
    steps = body(LOAD | {"steps": 5})
    assert steps.forces[:, steps.node((3, 4)), 1] == pytest.approx([-0.1, -0.2, -0.3, -0.4, -0.5])
    stress, strain = (body(plane=plane, ratio=0.25) for plane in ("stress", "strain"))
    assert strain.stiffness[0] / stress.stiffness[0] == pytest.approx(1.0 / (1.0 - 0.25**2))
    assert strain.notes == ()
    assert "ratio 0.25" in stress.notes[0]


def test_squares_and_elastic_foundations_are_refused():
    with pytest.raises(SceneError, match='set lattice = "hexagon"'):
        hexagon_body(loaded([3, 3]))
    with pytest.raises(SceneError, match=r"sides\.bottom: a spring network has no"):
        body(sides={"bottom": {"stiffness": 1e6}})
