"""What a network's result answers, and that it survives being saved."""

import networkx as nx
import numpy as np
import pytest

from kaju import NetworkResult, Result, SpringNetwork
from kaju.errors import ResultError
from kaju.model.network import solve, triangular


@pytest.fixture(scope="module")
def result():
    return solve(triangular(5), 4)


def test_it_is_a_result_like_the_others(result):
    assert isinstance(result, Result)
    assert result.increments == 4
    assert result.stage.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert result.displacement.shape == (5, 23, 2)
    assert result.tension.shape == (5, len(result.network.springs))
    assert not result.displacement[0].any()


def test_the_summary_holds_plain_values(result):
    summary = result.summary()
    assert summary["nodes"] == 23
    assert summary["increments"] == 4
    assert summary["largest_displacement_node"] in ("(4, 2)", "(0, 2)")
    assert summary["largest_displacement_m"] == pytest.approx(0.114478, abs=1e-6)
    assert summary["work_J"] == pytest.approx(summary["strain_energy_J"], rel=1e-5)
    assert {type(value) for value in summary.values()} <= {str, int, float, list}


def test_one_row_per_node_and_one_per_spring(result):
    nodes, springs = result.to_dataframe(), result.springs_to_dataframe()
    assert nodes["node"].tolist() == list(result.network.names)
    assert nodes["displacement_y_m"].to_numpy() == pytest.approx(result.displacement[-1, :, 1])
    assert nodes["reaction_x_N"].sum() == pytest.approx(0.0, abs=1e-14)
    assert len(springs) == len(result.network.springs)
    expected = springs["stiffness_N_per_m"] * (springs["length_m"] - springs["rest_length_m"])
    assert springs["tension_N"].to_numpy() == pytest.approx(expected.to_numpy())


def test_the_graph_comes_back_with_the_answer(result):
    graph = result.to_graph()
    assert isinstance(graph, nx.Graph)
    top = graph.nodes[4, 2]
    assert top["position"][1] == pytest.approx(top["pos"][1] + top["displacement"][1])
    tension = graph.edges[(4, 2), (4, 1)]["tension"]
    spring = [set(pair) for pair in result.network.springs.tolist()].index(
        {result.network.node((4, 2)), result.network.node((4, 1))}
    )
    assert tension == result.tension[-1, spring]
    again = solve(SpringNetwork.from_graph(graph), 4)
    assert again.displacement[-1] == pytest.approx(result.displacement[-1], abs=1e-13)


def test_a_saved_result_is_the_same(result, tmp_path):
    path = result.save(tmp_path / "pressed")
    assert path.name == "pressed.npz"
    again = NetworkResult.load(path)
    assert again.network.names == result.network.names
    for name in ("stage", "displacement", "tension", "residual", "corrections"):
        assert np.array_equal(getattr(again, name), getattr(result, name))
    assert again.summary() == result.summary()


def test_displacements_between_nodes_are_interpolated(result):
    middle = result.network.positions[[11, 12]].mean(axis=0)
    expected = result.displacement[-1, [11, 12]].mean(axis=0)
    assert result.displacement_at(middle[None])[0] == pytest.approx(expected, abs=1e-12)
    with pytest.raises(ResultError, match="outside the network"):
        result.displacement_at(np.array([[99.0, 0.0]]))


def test_a_flat_network_has_no_share_of_height():
    flat = solve(SpringNetwork.build([[0, 0], [1, 0]], [[0, 1]], held=[1, 1]), 1)
    with pytest.raises(ResultError, match="one height"):
        flat.share_of_height()


def test_names_survive_a_file_or_are_refused(tmp_path):
    names = ["a", 3, (1, 2), ("a", (0, 1.5))]
    corners = [[0, 0], [1, 0], [0, 1], [1, 1]]
    how = {"springs": [[0, 1], [2, 3]], "held": [1] * 4}
    net = SpringNetwork.build(corners, names=names, **how)
    again = NetworkResult.load(solve(net, 1).save(tmp_path / "net"))
    assert again.network.names == tuple(names)
    odd = solve(SpringNetwork.build(corners, names=[frozenset({1}), *names[1:]], **how), 1)
    with pytest.raises(ResultError, match="relabel_nodes"):
        odd.save(tmp_path / "odd")
