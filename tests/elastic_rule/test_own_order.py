"""Elastic agents that act in an order of one's own."""

import numpy as np
import pytest
from elastic_scenes import block, plate, ragged, relative_error

from kaju import ElasticModel, load_result
from kaju.errors import ParameterError


def largest(agents):
    """Southwell's order, told by what an agent knows of itself."""
    return [max(agents, key=lambda agent: agent.left**2 / agent.place.stiffness)]


def topmost(agents):
    """All agents of the highest row that waits, the last one first."""
    row = max(agent.place.position[-1] for agent in agents)
    return [agent for agent in agents[::-1] if agent.place.position[-1] == row]


def test_the_largest_first_is_the_order_of_that_name_push_by_push():
    scene = plate(6, force=(0.3, -2.0), order="largest first", tolerance=1e-2)
    named, told = ElasticModel(scene), ElasticModel(scene, order=largest)
    for _ in range(60):
        named.step()
        told.step()
    np.testing.assert_array_equal(named.state.levels[0].taken, told.state.levels[0].taken)
    assert named.history == told.history


@pytest.mark.parametrize(
    ("make", "size", "order"),
    [(plate, 4, topmost), (block, (2, 2, 2), topmost), (ragged, "stress", list)],
)
def test_in_any_order_the_energy_falls_to_the_direct_solution(make, size, order):
    """The rule's own order and its parents take no part."""
    model = ElasticModel(make(size, order="multilevel", tolerance=1e-2), order=order)
    run = model.run()
    assert run.outcome == f"at rest after {run.pushes} pushes"
    assert run.pushes > len(run.history)
    assert run.summary()["order"] == "own"
    assert run.summary()["levels"] == 1
    assert np.all(np.diff([0.0, *run.energy]) < 0.0)
    assert run.ledger.imbalance < 1e-12
    assert relative_error(model) < 0.03


def test_an_order_may_draw_from_the_models_seed(tmp_path):
    def someone(agents):
        return [agents[model.rng.integers(len(agents))]]

    scene = plate(4, tolerance=1e-2)
    taken = []
    for seed in (1, 1, 2):
        model = ElasticModel(scene, order=someone, seed=seed)
        for _ in range(40):
            model.step()
        taken.append(model.state.levels[0].taken.copy())
    assert np.array_equal(taken[0], taken[1])
    assert not np.array_equal(taken[0], taken[2])


def test_it_is_stored(tmp_path):
    whole = ElasticModel(plate(5, tolerance=1e-2), order=topmost).run()
    assert load_result(whole.save(tmp_path / "run")).summary()["order"] == "own"


def test_what_is_no_order_is_said():
    scene = plate(4)
    with pytest.raises(ParameterError, match=r"order: must return at least one of the \d+ agents"):
        ElasticModel(scene, order=lambda agents: []).step()
    stranger = ElasticModel(scene)
    stranger.step()
    with pytest.raises(ParameterError, match="and no others; it returned 1"):
        ElasticModel(scene, order=lambda agents: [next(iter(stranger.agents))]).step()
    with pytest.raises(ParameterError, match="'arrays' knows no topmost"):
        ElasticModel(scene, engine="arrays", order=topmost)
