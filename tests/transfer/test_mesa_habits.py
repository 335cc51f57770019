"""What somebody who knows Mesa tries first: it works, or says what to do."""

import copy
import pickle

import mesa
import pytest
from mesa import DataCollector
from plates import plate as pressed

from kaju import FreeBoundaryAgent, LoadModel, MaterialAgent, Parameter


def plate(**more):
    return pressed([7, 5], [3, 4], **more)


class Counting(MaterialAgent):
    """Counts the loads that it takes, and can be told to sing."""

    songs = Parameter(1, 1, 5, "songs")
    heard = 0

    def take(self, load):
        super().take(load)
        self.heard += 1

    def sing(self):
        return self.songs * "la"


class Own(LoadModel):
    """A model with its own arguments, its own step and its own data."""

    def __init__(self, width=7, threshold=0.05, seed=None):
        scene = plate().with_overrides({"body.cells": [width, 5]})
        super().__init__(scene, threshold=threshold, seed=seed)
        self.beats = 0

    def step(self):
        super().step()
        self.beats += 1


def stepped(count=3, **more):
    model = LoadModel(plate(), threshold=0.01, **more)
    for _ in range(count):
        model.step()
    return model


def material(model):
    return model.agents.select(lambda agent: isinstance(agent, MaterialAgent))


def test_sets_of_agents_are_mesas():
    model = stepped()
    agents = material(model)
    assert set(model.agents_by_type) >= {MaterialAgent, FreeBoundaryAgent}
    kept = agents.sort("kept").get("kept")
    assert kept == sorted(kept, reverse=True)
    assert agents.agg("kept", sum) == pytest.approx(0.5 * model.figures()["load_taken"])
    assert 0 < len(agents.select(lambda a: a.kept > 0.1)) < len(model.agents)
    assert len(agents.select(at_most=2)) == 2
    assert agents.groupby(lambda agent: agent.spawn_step).count()[1] == 1
    assert max(agents.map(lambda agent: agent.shortening(1))) > 0.0
    agents.set("mood", "calm")
    assert set(agents.get("mood")) == {"calm"}
    numbers = model.agents.get("unique_id")
    assert len(set(numbers)) == len(numbers)


def test_cells_of_the_space():
    model = stepped()
    cell = model.space[(3, 4)]
    assert [type(a) for a in cell.agents] == [MaterialAgent]
    assert {(2, 4), (4, 4), (3, 3)} <= {tuple(other.coordinate) for other in cell.neighborhood}
    lived_in = model.space.all_cells.select(lambda cell: not cell.is_empty)
    assert len(list(lived_in)) == len(material(model))  # boundaries stand beside the grid
    for agent in model.agents:
        assert tuple(agent.cell.coordinate) == tuple(agent.index) == tuple(agent.pos)


def test_a_data_collector_of_ones_own():
    model = stepped(0)
    model.datacollector = DataCollector(
        model_reporters={"kept": lambda m: material(m).agg("kept", sum)},
        agent_reporters={"spawned": "spawn_step", "kept": "kept"},
    )
    model.run(3)
    assert len(model.datacollector.get_model_vars_dataframe()) == 3
    frame = model.datacollector.get_agent_vars_dataframe()
    assert frame["spawned"].max() == 4
    assert frame.loc[3]["kept"].sum() == pytest.approx(model.result().last.ledger.kept)


def test_a_model_of_ones_own():
    model = Own(width=9, threshold=0.02, seed=3)
    model.run(2)
    assert (model.beats, model.steps, model.scene.rule.threshold) == (2, 2, 0.02)


def test_copies():
    model = stepped(2)
    for again in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert again.run().last.ledger.taken == stepped(0).run().last.ledger.taken


@pytest.mark.skipif(not hasattr(mesa, "batch_run"), reason="Mesa 4 has none")
def test_batch_run():
    rows = mesa.batch_run(
        LoadModel,
        {"scene": [plate()], "threshold": [0.01, 0.1], "material_agent": [Counting], "songs": [2]},
        max_steps=50,
        number_processes=1,
        display_progress=False,
    )
    assert {row["threshold"] for row in rows} == {0.01, 0.1}
    assert {row["songs"] for row in rows} == {2}


def test_the_scenario_of_mesas_page():
    model = LoadModel(plate(), seed=7)
    if not hasattr(model, "scenario"):
        pytest.skip("Mesa knows scenarios from 3.5 on")
    again = LoadModel(plate(), scenario=type(model.scenario)(rng=7))
    assert again.random.random() == model.random.random()
