"""Objects and arrays are two tellings of one story, for the elastic rule as well."""

from dataclasses import fields

import numpy as np
import pytest
from elastic_scenes import block, plate, ragged, run, run_random, scenes
from hypothesis import given, settings

from kaju import ElasticModel, FaceAgent
from kaju.errors import ParameterError
from kaju.model.elastic.relaxation.face_agent_engine import AgentPushEngine

ORDERS = ["wave", "largest first", "multilevel"]


def assert_close(one, other, name):
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    assert one.shape == other.shape, name
    scale = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * scale, err_msg=name)


def assert_same(one, other):
    assert one.outcome == other.outcome
    for table in ("agents", "boundary", "ledger"):
        a, b = getattr(one, table), getattr(other, table)
        for field in fields(a):
            assert_close(getattr(a, field.name), getattr(b, field.name), field.name)
    for axis, (a, b) in enumerate(zip(one.displacement, other.displacement, strict=True)):
        assert_close(a, b, f"displacement {axis}")
    for column in ("level", "energy", "loudest", "error_estimate", "pushes"):
        a, b = ([getattr(record, column) for record in r.history] for r in (one, other))
        assert_close(a, b, column)


@settings(max_examples=30)
@given(scene=scenes())
def test_both_engines_give_the_same_numbers(scene):
    _, arrays = run_random(scene, max_steps=150)
    _, agents = run_random(scene, engine="agents", max_steps=150)
    assert_same(agents, arrays)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [ragged, block])
def test_both_engines_give_the_same_numbers_to_the_end(make, order):
    scene = make(order=order, threshold=0.05)
    assert_same(run(scene, engine="agents")[1], run(scene, engine="arrays")[1])


class StubbornAgent(FaceAgent):
    """Takes but half of its load."""

    def due(self, asked):
        return 0.5 * super().due(asked)


def test_agents_of_ones_own_are_objects_and_do_as_they_like():
    scene = plate(order="largest first", threshold=0.05)
    stubborn, slow = run(scene, engine="auto", face_agent=StubbornAgent)
    _, eager = run(scene, engine="auto")
    assert isinstance(stubborn.engine, AgentPushEngine)
    assert slow.pushes > eager.pushes
    assert np.all(np.diff(slow.energy) < 0.0)
    assert slow.ledger.imbalance < 1e-12
    with pytest.raises(ParameterError, match="'arrays' knows no StubbornAgent"):
        ElasticModel(scene, engine="arrays", face_agent=StubbornAgent)
