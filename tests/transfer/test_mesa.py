"""The models as Mesa's own tools see them."""

import gc
import subprocess
import sys
import weakref

import mesa
import numpy as np
import pytest

from kaju import (
    ElasticModel,
    ElasticRule,
    LoadModel,
    NetworkModel,
    PrescribedRule,
    Scene,
    SpawningModel,
)
from kaju.model.network import triangular

ENGINES = pytest.mark.parametrize("engine", ["agents", "arrays"])


def plate(steps=1, rule=None, cells=20, sense=False):
    return Scene(
        body={"cell_size": 0.2 / cells, "cells": [cells, cells], "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [cells // 2, cells - 1], "force": [0.0, -2.0], "steps": steps}],
        rule=rule or PrescribedRule(threshold=1e-3, sense=sense),
    )


def told(agent):
    numbers = {
        f"{name} {key}": value
        for name in ("taken", "passed")
        for key, value in getattr(agent, name).items()
    }
    return numbers | {"kept": agent.kept, "since": agent.spawn_step}


@pytest.mark.parametrize("sense", [False, True])
def test_agents_of_arrays_tell_what_objects_tell(sense):
    models = [LoadModel(plate(sense=sense), engine=engine) for engine in ("agents", "arrays")]
    for _ in range(9):
        for model in models:
            model.step()
        objects, rows = ({agent.index: agent for agent in model.agents} for model in models)
        assert objects.keys() == rows.keys()
        for index, agent in objects.items():
            row = rows[index]
            assert told(row) == pytest.approx(told(agent), rel=1e-12)
            np.testing.assert_array_equal(row.position, agent.position)
    for index in [(10, 19), (9, 18)]:
        agent, row = objects[index], rows[index]
        assert (row.material, row.shares) == (agent.material, agent.shares)
        assert row.squeezed == pytest.approx(agent.squeezed)
        assert row.inbox == pytest.approx(agent.inbox)
        assert row.pulls == pytest.approx(agent.pulls)
        assert {a.index for a in row.woken_by} == {a.index for a in agent.woken_by}
        assert row is models[1].agent_at(index)
    assert models[1].agent_at((0, 0)) is models[0].agent_at((0, 0)) is None


@ENGINES
def test_an_agent_knows_its_place_in_the_scene(engine):
    model = LoadModel(plate(), engine=engine)
    model.step()
    first = model.agents[0]
    assert first.index == (10, 19)
    np.testing.assert_allclose(first.position, [0.105, 0.195])
    assert " at (10, 19): steel, took 2 N, kept 1 N, since generation 1>" in repr(first)
    model.run()
    assert all(kept >= 0.0 for kept in model.agents.get("kept"))
    edges = [agent for agent in model.agents if agent.index[1] == 20]
    assert {agent.name for agent in edges} == {"free"}
    assert "gave back" in repr(edges[0])


@ENGINES
def test_the_data_collector_follows_every_step(engine):
    model = LoadModel(plate(steps=3), engine=engine)
    model.run()
    table = model.datacollector.get_model_vars_dataframe()
    assert len(table) == model.steps
    assert table["stage"].tolist() == sorted(table["stage"])
    last = table.iloc[-1]
    assert last["load_taken"] == pytest.approx(model.result().last.ledger.taken)
    assert last["load_waiting"] == 0.0
    assert last["material_agents"] == len(model.result().last.cells)
    assert (model.space is None) == (engine == "arrays")


def test_a_collector_of_ones_own():
    model = LoadModel(plate())
    model.datacollector = mesa.DataCollector(agent_reporters={"kept": "kept"})
    model.run()
    frame = model.datacollector.get_agent_vars_dataframe()
    assert frame.loc[model.steps]["kept"].sum() == pytest.approx(model.result().last.ledger.kept)


@ENGINES
def test_until_pauses_and_a_finished_model_counts_nothing(engine):
    model = LoadModel(plate(), engine=engine)
    model.run(until=lambda model: model.generation == 4)
    assert (model.steps, model.running) == (4, True)
    model.run()
    steps = model.steps
    model.step()
    assert model.steps == model.generation == steps == 11
    model.reset()
    assert (model.steps, model.generation, model.running) == (0, 0, True)
    assert len(model.datacollector.get_model_vars_dataframe()) == 0


def test_batch_run():
    rows = mesa.batch_run(
        LoadModel, {"scene": plate(), "engine": ["agents", "arrays"]}, display_progress=False
    )
    assert [row["material_agents"] for row in rows] == [85, 85]
    assert rows[0]["load_taken"] == pytest.approx(21.104765625)


def sisters():
    elastic = plate(rule=ElasticRule(order="wave", threshold=0.05))
    network = triangular(3, force=0.05)
    return [
        lambda: ElasticModel(elastic, seed=1),
        lambda: SpawningModel(plate(cells=8), tolerance=0.3, seed=1),
        lambda: NetworkModel(network, increments=5, seed=1),
    ]


@pytest.mark.parametrize("number", range(3))
def test_the_sister_models_are_alike(number):
    model = sisters()[number]()
    model.run(until=lambda model: model.steps >= 2)
    assert model.steps == 2
    model.run()
    steps = model.steps
    model.step()
    assert model.steps == steps
    table = model.datacollector.get_model_vars_dataframe()
    assert len(table) in (steps, steps + 1)
    assert np.isfinite(table.to_numpy(dtype=float)).all()
    model.reset()
    assert model.steps == 0
    model.run()
    assert model.steps == steps


def test_runs_leave_nothing_behind():
    """Mesa keeps the models of its own agents, and the class of every grid's cells, for ever."""
    left = []
    for make in (lambda: LoadModel(plate()), *sisters()):
        model = make()
        model.run()
        left.append(weakref.ref(model))
        if isinstance(model, LoadModel):
            left.append(weakref.ref(model.space.cell_klass))
    del model
    gc.collect()
    gc.collect()  # the class goes after its grid
    assert [ref() for ref in left] == [None] * 5


def test_importing_leaves_multiprocessing_as_it_was():
    code = (
        "import multiprocessing as m; before = m.get_start_method(allow_none=True); import kaju;"
        "kaju.LoadModel, kaju.ElasticModel, kaju.SpawningModel, kaju.NetworkModel;"
        "assert m.get_start_method(allow_none=True) == before, m.get_start_method()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
