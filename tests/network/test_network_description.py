"""What a spring network accepts, and how it says what is wrong."""

import json
from dataclasses import replace

import networkx as nx
import numpy as np
import pytest

from kaju import SpringNetwork
from kaju.errors import ParameterError, SceneError, SupportError
from kaju.model.network import triangular

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
RING = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]]
HELD = [True, True, False, False]


def square(**changes):
    described = {"positions": SQUARE, "springs": RING, "stiffness": 2.0, "held": HELD} | changes
    return SpringNetwork.build(**described)


def test_one_number_holds_for_all_springs_and_the_rest_length_is_the_first():
    network = square()
    assert network.stiffness.tolist() == [2.0] * 5
    assert network.rest_length.tolist() == [1.0, 1.0, 1.0, 1.0, np.sqrt(2.0)]
    assert network.stages == 1
    assert network.dimension == 2


def test_the_load_path_runs_evenly_through_its_stages():
    forces = np.zeros((2, 4, 2))
    forces[0, 2], forces[1, 2] = (4.0, 0.0), (0.0, 8.0)
    network = square(forces=forces)
    path = {0.0: [0, 0], 0.25: [1, 0], 1.0: [4, 0], 1.5: [2, 4], 2: [0, 8]}
    assert {stage: network.force_at(stage)[2].tolist() for stage in path} == path


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"positions": SQUARE * [1.0, np.nan]}, ParameterError, r"positions\[0, 1\]: must be"),
        ({"stiffness": [1, 1, -3, 1, 1]}, ParameterError, "stiffness of spring 2 .* got -3"),
        ({"stiffness": [1, 1, np.inf, 1, 1]}, ParameterError, r"stiffness\[2\]"),
        ({"rest_length": -1.0}, ParameterError, "rest_length of spring 0"),
        ({"springs": [[0, 1], [2, 2]]}, SceneError, "spring 1 .* joins a node to itself"),
        ({"springs": [[0, 7]], "rest_length": 1.0}, SceneError, "count from 0 to 3"),
        ({"springs": np.empty((0, 2), int)}, SceneError, "there are none"),
        ({"positions": SQUARE[[0, 0, 2, 3]]}, SceneError, "spring 0 .* both ends lie at"),
        ({"names": ["a", "b", "b", "c"]}, SceneError, "which 3 differ"),
        ({"forces": np.ones((3, 2))}, SceneError, r"forces: must have the shape \(4, 2\)"),
        ({"displacements": np.ones((4, 2))}, SceneError, "is not held there"),
        ({"forces": [[0, 1], [0, 0], [0, 0], [0, 0]]}, SceneError, "straight into the supports"),
        ({"held": False}, SupportError, "nothing holds the nodes 0, 1, 2, 3 along x"),
        ({"held": [[1, 0], [0, 0], [0, 0], [0, 0]]}, SupportError, "along y"),
    ],
)
def test_what_is_wrong_is_named(changes, error, message):
    with pytest.raises(error, match=message):
        square(**changes)


def test_a_part_that_is_joined_to_nothing_held_is_named():
    with pytest.raises(SupportError, match="nothing holds the nodes 2, 3"):
        square(springs=[[0, 1], [2, 3]])


def test_a_node_is_found_by_its_name():
    network = square(names=["a", "b", "c", "d"])
    assert network.node("c") == 2
    with pytest.raises(SceneError, match="there is no 'x'; the nodes are named 'a', 'b'"):
        network.node("x")


def test_loads_that_disagree_in_stages_are_refused():
    with pytest.raises(SceneError, match="2 stages and displacements 3"):
        square(forces=np.zeros((2, 4, 2)), displacements=np.zeros((3, 4, 2)))


def test_attributes_of_a_graph_are_read_node_by_node():
    graph = nx.Graph()
    graph.add_node("foot", pos=(0, 0, 0), held=True)
    graph.add_node("head", pos=(0, 0, 2), held=(True, True, False), force=[(0, 0, 1), (0, 0, 3)])
    graph.add_edge("foot", "head", stiffness=5.0, rest_length=1.5)
    network = SpringNetwork.from_graph(graph)
    assert network.held.tolist() == [[True] * 3, [True, True, False]]
    assert network.forces[:, 1].tolist() == [[0, 0, 1], [0, 0, 3]]
    assert network.stiffness.tolist() == [5.0]
    assert network.prestretch.tolist() == [0.5]


def test_supports_and_loads_may_come_beside_the_graph():
    given = {"held": [(0, 0), (1, 0)], "forces": {(0, 1): (0.0, -1.0)}}
    graph = nx.triangular_lattice_graph(2, 3)
    network = SpringNetwork.from_graph(graph, stiffness=1.0, rest_length=None, **given)
    assert network.held.all(axis=1).sum() == 2
    assert network.forces[0, network.node((0, 1))].tolist() == [0.0, -1.0]


def test_a_graph_comes_back_as_it_went():
    network = triangular(4, 5)
    again = SpringNetwork.from_graph(network.to_graph())
    assert again.names == network.names
    assert np.array_equal(again.positions, network.positions)
    assert np.array_equal(again.forces, network.forces)
    assert np.array_equal(again.held, network.held)
    ends = {frozenset(pair) for pair in network.springs.tolist()}
    assert {frozenset(pair) for pair in again.springs.tolist()} == ends


def test_springs_side_by_side_stay_two():
    network = square(springs=[*RING, [0, 2]], stiffness=[1, 1, 1, 1, 1, 4])
    graph = network.to_graph()
    assert graph.is_multigraph()
    assert sorted(SpringNetwork.from_graph(graph).stiffness) == [1, 1, 1, 1, 1, 4]


def spoil(kind):
    graph = nx.triangular_lattice_graph(2, 3)
    nx.set_edge_attributes(graph, 1.0, "stiffness")
    if kind == "misspelt":
        nx.set_edge_attributes(graph, 1.0, "rest_lenght")
    if kind == "place":
        del graph.nodes[0, 0]["pos"]
    if kind == "dimension":
        graph.nodes[0, 0]["pos"] = (0.0, 0.0, 0.0)
    if kind == "text":
        graph.nodes[0, 0]["pos"] = "here"
    if kind == "loop":
        graph.add_edge((0, 0), (0, 0), stiffness=1.0)
    if kind == "directed":
        return graph.to_directed()
    return graph


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("misspelt", "no attribute 'rest_length' .*did you mean 'rest_lenght'"),
        ("place", r"node \(0, 0\) has no attribute 'pos'"),
        ("dimension", "2 coordinates, or all need 3"),
        ("text", "must be made of numbers, got 'here'"),
        ("directed", "to_undirected"),
    ],
)
def test_what_a_graph_lacks_is_named(kind, message):
    with pytest.raises(SceneError, match=message):
        SpringNetwork.from_graph(spoil(kind), held=[(0, 0)])


def test_loops_and_unknown_nodes_of_a_graph_are_refused():
    with pytest.raises(SceneError, match="joins a node to itself"):
        SpringNetwork.from_graph(spoil("loop"), rest_length=None, held=[(0, 0)])
    given = {"held": [(0, 0), (2, 0)], "forces": {(9, 9): (0, 1)}}
    with pytest.raises(SceneError, match=r"no node \(9, 9\)"):
        SpringNetwork.from_graph(spoil("nothing"), rest_length=None, **given)


def written(kind, graph, tmp_path):
    """Write a graph to a file, and read it again."""
    path = tmp_path / "net"
    if kind == "json":
        path.write_text(json.dumps(nx.node_link_data(graph, edges="links")))
        return nx.node_link_graph(json.loads(path.read_text()), edges="links")
    getattr(nx, f"write_{kind}")(graph, path)
    return getattr(nx, f"read_{kind}")(path)


@pytest.mark.parametrize("kind", ["graphml", "gml", "json"])
def test_a_network_comes_back_from_a_file_of_a_graph(kind, tmp_path):
    network = square(held=[[1, 1], [0, 1], [0, 0], [0, 0]], forces=np.eye(4)[:, 1:3] * [0.0, -0.1])
    network = replace(network, names=tuple("abcd"))
    again = SpringNetwork.from_graph(written(kind, network.to_graph(texts=True), tmp_path))
    assert again.names == network.names
    for name in ("positions", "held", "forces"):
        assert np.array_equal(getattr(again, name), getattr(network, name)), name
    assert sorted(again.rest_length) == sorted(network.rest_length)


def test_coordinates_may_stand_in_attributes_of_their_own(tmp_path):
    graph = nx.Graph()
    graph.add_node("a", x=0.0, y=0.0, held=True)
    graph.add_node("b", x=1.0, y=0.0, held=True)
    graph.add_node("c", x=0.5, y=1.0, fy=-0.01)
    graph.add_edges_from([("a", "b"), ("b", "c"), ("a", "c")], stiffness=2.0)
    graph = written("graphml", graph, tmp_path)
    axes = {"positions": ("x", "y"), "forces": ("fx", "fy")}
    network = SpringNetwork.from_graph(graph, rest_length=None, **axes)
    assert network.positions.tolist() == [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]]
    assert network.forces.tolist() == [[[0.0, 0.0], [0.0, 0.0], [0.0, -0.01]]]
    assert network.held.all(axis=1).tolist() == [True, True, False]
    with pytest.raises(SceneError, match=r"has no attribute 'pos' .*positions=\("):
        SpringNetwork.from_graph(graph, rest_length=None)
