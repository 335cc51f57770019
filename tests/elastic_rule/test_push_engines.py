"""Objects and arrays are two tellings of one story; agents and orders may be one's own."""

from dataclasses import fields

import numpy as np
import pytest
from elastic_scenes import block, plate, ragged, relative_error, run, run_random, scenes
from hypothesis import given, settings

from kaju import ElasticModel, FaceAgent
from kaju.errors import ParameterError

ORDERS = ["wave", "largest first", "multilevel"]


def assert_close(one, other, name):
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    assert one.shape == other.shape, name
    scale = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * scale, err_msg=name)


def assert_same(one, other):
    assert one.outcome == other.outcome
    for table in ("agents", "ledger"):
        a, b = getattr(one, table), getattr(other, table)
        for field in fields(a):
            assert_close(getattr(a, field.name), getattr(b, field.name), field.name)
    assert_close(one.result.displacement, other.result.displacement, "displacement")
    for column in ("level", "energy", "loudest", "error_estimate", "pushes"):
        a, b = ([getattr(record, column) for record in r.history] for r in (one, other))
        assert_close(a, b, column)


@settings(max_examples=30)
@given(scene=scenes())
def test_both_engines_give_the_same_numbers(scene):
    one, other = (run_random(scene, engine=e, max_steps=150)[1] for e in ("agents", "arrays"))
    assert_same(one, other)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [ragged, block])
def test_both_engines_give_the_same_numbers_to_the_end(make, order):
    scene = make(order=order, threshold=0.05)
    assert_same(*(run(scene, engine=engine)[1] for engine in ("agents", "arrays")))


class StubbornAgent(FaceAgent):
    def due(self, asked):
        return 0.5 * super().due(asked)


def test_agents_of_ones_own_are_objects_and_do_as_they_like():
    scene = plate(order="largest first", threshold=0.05)
    stubborn, slow = run(scene, engine="auto", face_agent=StubbornAgent)
    _, eager = run(scene, engine="auto")
    assert len(stubborn.agents_by_type[StubbornAgent]) > 0
    assert slow.pushes > eager.pushes
    assert np.all(np.diff(slow.energy) < 0.0)
    assert slow.ledger.imbalance < 1e-12
    idle = type("IdleAgent", (FaceAgent,), {"due": lambda agent, asked: 0.0})
    for order in ORDERS:
        _, ended = run(plate(order=order, threshold=0.05), engine="auto", face_agent=idle)
        assert ended.outcome.endswith("no agent has taken any for 100 steps")


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
    for model in (named, told):
        model.run(60)
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
    assert (run.summary()["order"], run.summary()["levels"]) == ("own", 1)
    assert np.all(np.diff([0.0, *run.energy]) < 0.0)
    assert run.ledger.imbalance < 1e-12
    assert relative_error(model) < 0.03


def test_what_is_no_order_is_said():
    scene = plate(4)
    with pytest.raises(ParameterError, match="order: a function"):
        ElasticModel(scene, order="random")
    with pytest.raises(ParameterError, match=r"order: must return at least one of the \d+ agents"):
        ElasticModel(scene, order=lambda agents: []).step()
    with pytest.raises(ParameterError, match="'arrays' knows no topmost"):
        ElasticModel(scene, engine="arrays", order=topmost)
