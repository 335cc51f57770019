"""Objects and arrays are two tellings of one story, for the elastic rule as well."""

from dataclasses import fields

import numpy as np
import pytest
from elastic_scenes import block, plate, ragged, run, run_random, scenes
from hypothesis import given, settings

from kaju import ElasticModel, FaceAgent, FreeBoundaryAgent
from kaju.agents.face_agent import SupportAgent
from kaju.errors import ParameterError
from kaju.model.elastic.relaxation.face_agent_engine import AgentPushEngine
from kaju.model.elastic.relaxation.face_array_engine import ArrayPushEngine
from kaju.model.scene.cell_types import AIR

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


def test_objects_are_what_the_tables_say():
    model, result = run(ragged(threshold=0.02), engine="agents")
    by_type = model.agents_by_type
    assert len(by_type[FaceAgent]) == len(result.agents.level)
    supports = by_type[SupportAgent]
    assert len(supports) + len(by_type[FreeBoundaryAgent]) == len(result.boundary.cells)
    for axis in range(2):
        total = sum(agent.reaction.get(axis, 0.0) for agent in supports)
        assert total == pytest.approx(result.reaction[axis], rel=1e-12)
    returned = sum(agent.returned for agent in by_type[FreeBoundaryAgent])
    assert returned == pytest.approx(result.boundary.returned.sum(), rel=1e-12)
    assert returned > 0.0
    for name, column in (("taken", result.agents.taken), ("left", result.agents.left)):
        total = sum(getattr(agent, name) for agent in by_type[FaceAgent])
        assert total == pytest.approx(column.sum(), rel=1e-9, abs=1e-12)


def test_agents_know_where_they_stand_and_whom_they_touch():
    model, _ = run(ragged(threshold=0.02), engine="agents")
    agents = model.agents_by_type[FaceAgent]
    parents = [agent for agent in agents if agent.level > 0]
    assert {agent.level for agent in parents} == set(range(1, len(model.table.levels)))
    assert all(not agent.place.materials for agent in parents)
    for agent in agents:
        if agent.level == 0:
            assert agent.place.materials[0].name in ("steel", "soft")
            low = list(agent.place.index)
            low[agent.place.axis] -= 1
            cells = np.array([low, agent.place.index])
            assert (model.scene.kinds(cells) > AIR).any()
            middle = model.scene.lattice.centres(cells).mean(axis=0)
            np.testing.assert_allclose(agent.place.position, middle, atol=1e-15)
    neighbours = [len(agent.cell.connections) for agent in agents]
    assert max(neighbours) >= 8


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


def test_the_engine_is_chosen_by_size():
    assert isinstance(ElasticModel(plate(8)).engine, AgentPushEngine)
    assert isinstance(ElasticModel(plate(80)).engine, ArrayPushEngine)
    with pytest.raises(ParameterError, match="engine: 'auto', 'agents' or 'arrays', got 'fast'"):
        ElasticModel(plate(), engine="fast")
    with pytest.raises(ParameterError, match="pushes_per_step: must be 1 or more, got 0"):
        ElasticModel(plate(), pushes_per_step=0)
