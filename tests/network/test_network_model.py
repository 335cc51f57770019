"""The network as a Mesa model."""

import numpy as np
import pytest

from kaju import NetworkModel, SpringNetwork
from kaju.errors import BucklingError, ParameterError
from kaju.model.network import triangular


def test_a_step_is_an_increment():
    model = NetworkModel(triangular(5), increments=4, rng=1)
    assert (model.increment, model.stage, model.running) == (0, 0.0, True)
    model.step()
    assert (model.increment, model.stage, model.running) == (1, 0.25, True)
    result = model.run()
    assert (model.increment, model.stage, model.running) == (4, 1.0, False)
    assert np.array_equal(result.displacement, triangular(5).solve(4).displacement)
    model.step()
    assert model.increment == 4


def test_euler_is_a_scheme_of_the_model_too():
    result = NetworkModel(triangular(5), increments=4, scheme="euler").run()
    assert np.array_equal(result.displacement, triangular(5).load_in_increments(4).displacement)


def test_nodes_are_agents_in_cells_joined_as_the_springs_are():
    network = triangular(4)
    model = NetworkModel(network, increments=2)
    assert len(model.agents) == len(network.positions)
    agent = model.node_agents[network.node((2, 1))]
    assert agent.name == (2, 1)
    assert agent.cell.coordinate == (2, 1)
    neighbours = {other.name for other in agent.cell.neighborhood.agents}
    assert neighbours == {(2, 0), (2, 2), (1, 0), (1, 1), (3, 0), (3, 1)}


def test_agents_see_from_their_own_springs_that_they_are_in_balance():
    network = triangular(5)
    model = NetworkModel(network, increments=3)
    while model.running:
        model.step()
        pull = np.array([agent.pull() for agent in model.node_agents])
        unbalanced = pull + network.force_at(model.stage)
        assert np.abs(unbalanced[~network.held]).max() < 1e-13
        assert np.array([a.position for a in model.node_agents]) == pytest.approx(model.positions)
    tip = model.node_agents[network.node((4, 2))]
    assert np.linalg.norm(tip.displacement) == pytest.approx(model.largest_displacement)


def test_records_grow_with_the_steps():
    model = NetworkModel(triangular(5), increments=3)
    model.run()
    records = model.datacollector.get_model_vars_dataframe()
    assert records["stage"].tolist() == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert records["largest_displacement"].is_monotonic_increasing
    assert records["strain_energy"].iloc[-1] == pytest.approx(model.result.strain_energy())


@pytest.mark.parametrize("agents", [True, False])
def test_the_numbers_are_the_same_without_agents(agents):
    model = NetworkModel(triangular(4), increments=2, agents=agents)
    assert (model.space is not None) is agents
    assert bool(model.node_agents) is agents
    assert np.array_equal(model.run().displacement, triangular(4).solve(2).displacement)


def test_large_networks_have_no_agents_by_themselves(monkeypatch):
    monkeypatch.setattr("kaju.model.network.network_model._AGENTS_UP_TO", 10)
    assert NetworkModel(triangular(3)).node_agents
    assert not NetworkModel(triangular(5)).node_agents


def test_a_model_that_buckles_stops_at_what_it_reached():
    model = NetworkModel(triangular(5, force=1.0), increments=10)
    with pytest.raises(BucklingError):
        model.run()
    assert not model.running
    assert 0.39 < model.stage < 0.4
    assert model.node_agents[0].position == pytest.approx(model.positions[0])


def test_springs_side_by_side_are_one_neighbour():
    network = SpringNetwork.build(
        [[0, 0], [1, 0]], [[0, 1], [1, 0]], held=[[1, 1], [0, 1]], forces=[[0, 0], [0.1, 0]]
    )
    model = NetworkModel(network, increments=1)
    assert len(list(model.node_agents[0].cell.neighborhood)) == 1
    model.run()
    assert model.node_agents[1].pull() == pytest.approx([-0.1, 0.0])


def test_an_unknown_choice_is_refused():
    with pytest.raises(ParameterError, match="agents: must be"):
        NetworkModel(triangular(3), agents="some")
