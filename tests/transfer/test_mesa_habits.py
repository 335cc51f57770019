"""What somebody who knows Mesa tries first: thirty snippets that work, or say what to do."""

import copy
import pickle

import mesa
import pytest
from mesa import DataCollector
from plates import plate as pressed

from kaju import FreeBoundaryAgent, LoadModel, MaterialAgent, Parameter
from kaju.errors import KajuError


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


class Shuffling(LoadModel):
    def step(self):
        self.agents.select(lambda a: isinstance(a, MaterialAgent)).shuffle_do("step")


LIVING = []  # Mesa's sets hold agents weakly: without its model a set empties at any collection


def stepped(count=3, **more):
    model = LoadModel(plate(), threshold=0.01, **more)
    LIVING.append(model)
    for _ in range(count):
        model.step()
    return model


def material(model):
    return model.agents.select(lambda agent: isinstance(agent, MaterialAgent))


def a_loop_of_steps():
    assert stepped(4).steps == 4


def until_it_is_no_longer_running():
    model = stepped(0)
    while model.running:
        model.step()
    assert model.at_rest


def run_model():
    model = stepped(0)
    model.run_model()
    assert not model.running


def a_number_of_steps():
    model = stepped(0)
    model.run(5)
    assert model.steps == 5


def start_again():
    model = stepped(4)
    model.reset()
    assert (model.steps, len(material(model))) == (0, len(material(stepped(0))))


def count_agents():
    assert len(stepped().agents) > 5


def agents_by_type():
    assert set(stepped().agents_by_type) >= {MaterialAgent}
    assert FreeBoundaryAgent in stepped().agents_by_type


def get_an_attribute():
    kept = material(stepped(1)).get("kept")
    assert max(kept) == pytest.approx(1.0)


def add_an_attribute_up():
    model = stepped()
    assert material(model).agg("kept", sum) == pytest.approx(0.5 * model.figures()["load_taken"])


def select_agents():
    model = stepped()
    assert 0 < len(material(model).select(lambda a: a.kept > 0.1)) < len(model.agents)


def select_at_most():
    assert len(material(stepped()).select(at_most=2)) == 2


def sort_agents():
    kept = material(stepped()).sort("kept").get("kept")
    assert kept == sorted(kept, reverse=True)


def group_agents():
    groups = material(stepped()).groupby(lambda agent: agent.spawn_step).count()
    assert groups[1] == 1


def map_a_function():
    squeezed = material(stepped()).map(lambda agent: agent.shortening(1))
    assert max(squeezed) > 0.0


def set_an_attribute():
    agents = material(stepped())
    agents.set("mood", "calm")
    assert set(agents.get("mood")) == {"calm"}


def do_a_method_of_ones_own():
    model = LoadModel(plate(), material_agent=Counting, songs=2)
    model.run(2)
    assert set(material(model).map("sing")) == {"lala"}


def where_an_agent_is():
    for agent in stepped().agents:
        assert tuple(agent.cell.coordinate) == tuple(agent.index) == tuple(agent.pos)


def every_agent_has_a_number():
    numbers = stepped().agents.get("unique_id")
    assert len(set(numbers)) == len(numbers)


def look_at_a_cell_of_the_space():
    model = stepped()
    assert [type(a) for a in model.space[(3, 4)].agents] == [MaterialAgent]


def look_at_the_neighbourhood():
    model = stepped()
    beside = model.space[(3, 4)].neighborhood
    assert {(2, 4), (4, 4), (3, 3)} <= {tuple(cell.coordinate) for cell in beside}


def cells_that_somebody_lives_in():
    model = stepped()
    lived_in = model.space.all_cells.select(lambda cell: not cell.is_empty)
    assert len(list(lived_in)) == len(material(model))  # boundaries stand beside the grid


def data_after_every_step():
    model = stepped(3)
    frame = model.datacollector.get_model_vars_dataframe()
    assert list(frame["generation"]) == [1, 2, 3]


def a_data_collector_of_ones_own():
    model = stepped(0)
    model.datacollector = DataCollector(
        model_reporters={"kept": lambda m: material(m).agg("kept", sum)},
        agent_reporters={"spawned": "spawn_step"},
    )
    model.run(3)
    assert len(model.datacollector.get_model_vars_dataframe()) == 3
    assert model.datacollector.get_agent_vars_dataframe()["spawned"].max() == 4


def a_model_of_ones_own():
    model = Own(width=9, threshold=0.02, seed=3)
    model.run(2)
    assert (model.beats, model.steps, model.scene.rule.threshold) == (2, 2, 0.02)


def shuffle_do_in_an_own_step():
    shuffled, usual = Shuffling(plate(), threshold=0.01, seed=4).run(), stepped(0).run()
    taken = [run.last.ledger.taken for run in (shuffled, usual)]
    assert taken[0] == pytest.approx(taken[1], rel=1e-12)


def numbers_by_keyword():
    model = LoadModel(plate(), threshold=0.05, alpha=(0.4, 0.5, 0.2), material_agent=Counting)
    assert model.scene.rule.alpha == (0.4, 0.5, 0.2)


def seeds():
    draws = [LoadModel(plate(), seed=seed).random.random() for seed in (1, 1, 2)]
    assert draws[0] == draws[1] != draws[2]
    with pytest.raises(KajuError, match="seed: is another word for rng"):
        LoadModel(plate(), rng=1, seed=2)


def copies():
    model = stepped(2)
    for again in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert again.run().last.ledger.taken == stepped(0).run().last.ledger.taken


def batch_run():
    if not hasattr(mesa, "batch_run"):
        pytest.skip("Mesa 4 has none")
    rows = mesa.batch_run(
        LoadModel,
        {"scene": [plate()], "threshold": [0.01, 0.1], "material_agent": [Counting], "songs": [2]},
        iterations=1,
        max_steps=50,
        number_processes=1,
        display_progress=False,
    )
    assert {row["threshold"] for row in rows} == {0.01, 0.1}
    assert {row["songs"] for row in rows} == {2}


def scenario_of_mesas_page():
    model = LoadModel(plate(), seed=7)
    if not hasattr(model, "scenario"):
        with pytest.raises(KajuError, match="scenario: LoadModel has no such argument"):
            LoadModel(plate(), scenario=None)
        return
    again = LoadModel(plate(), scenario=type(model.scenario)(rng=7))
    assert again.random.random() == model.random.random()


def sliders_for_solara():
    parameters = {"scene": plate(), "material_agent": Counting, **LoadModel.sliders(Counting)}
    chosen = {
        name: value["value"] if isinstance(value, dict) else value
        for name, value in parameters.items()
    }
    assert LoadModel(**chosen).parameters == {"songs": 1}


def width_and_height():
    with pytest.raises(KajuError, match=r"scene: a Scene is needed, got 20; kaju.load_scene"):
        LoadModel(20, 20)


def agents_instead_of_their_class():
    with pytest.raises(KajuError, match="material_agent: a subclass of MaterialAgent is needed"):
        LoadModel(plate(), material_agent=mesa.Agent)


def a_misspelt_keyword():
    with pytest.raises(KajuError, match=r"treshold: .*did you mean 'threshold'"):
        LoadModel(plate(), treshold=0.1)


def agents_of_arrays():
    with pytest.raises(KajuError, match=r"take LoadModel\(scene, engine='agents'\)"):
        list(LoadModel(plate(), engine="arrays").agents)


def what_agents_did_as_a_table():
    frame = stepped(1).result().to_dataframe()
    assert frame["taken_-y"].max() == 2.0


SNIPPETS = [
    value
    for name, value in list(globals().items())
    if callable(value)
    and getattr(value, "__module__", "") == __name__
    and not isinstance(value, type)
    and name not in ("plate", "stepped", "material")
]


@pytest.mark.parametrize("snippet", SNIPPETS, ids=lambda snippet: snippet.__name__)
def test_it_works_or_says_what_to_do(snippet):
    snippet()
    LIVING.clear()


def test_there_are_thirty_at_least():
    assert len(SNIPPETS) >= 30
