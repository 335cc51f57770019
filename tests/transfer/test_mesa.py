"""The models as Mesa's own tools see them, and what somebody who knows Mesa tries first."""

import copy
import gc
import pickle
import subprocess
import sys
import weakref
from functools import partial
from types import SimpleNamespace

import mesa
import numpy as np
import pytest
from mesa import DataCollector
from plates import plate as pressed
from transfer_answers import ENGINES

import kaju
from kaju import ElasticModel, ElasticRule, FreeBoundaryAgent, LoadModel, MaterialAgent, Parameter
from kaju.errors import AgentError, ParameterError


def plate(steps=1, rule=None, cells=20, sense=False):
    rule = rule or kaju.PrescribedRule(threshold=1e-3, sense=sense)
    place = [cells // 2, cells - 1]
    return pressed([cells, cells], place, steps=steps, cell_size=0.2 / cells, rule=rule)


def test_rows_of_arrays_are_no_agents_and_say_so():
    model = LoadModel(plate(), engine="arrays")
    model.run()
    for ask in (lambda: model.agents, lambda: model.agents_by_type, lambda: model.agent_at((9, 9))):
        with pytest.raises(ParameterError, match="engine='agents'"):
            ask()


@ENGINES
def test_the_data_collector_follows_every_step(engine):
    model = LoadModel(plate(steps=3), engine=engine)
    model.run()
    table = model.datacollector.get_model_vars_dataframe()
    assert (len(table), model.space is None) == (model.steps, engine == "arrays")
    assert table["stage"].tolist() == sorted(table["stage"])
    last = table.iloc[-1]
    told = model.result().summary()
    assert {name: told[name] for name in last.index[2:]} == pytest.approx(dict(last[2:]))
    assert last["load_absorbed"] == last["load_waiting"] == 0.0 < last["load_dropped"]


def test_a_step_in_which_no_agent_acts_is_refused_at_once():
    idle, late = (type("Mine", (LoadModel,), {"step": step}) for step in (
        lambda model: None, lambda model: LoadModel.step(model) if model.steps > 1 else None
    ))  # fmt: skip
    for engine in ("agents", "arrays"):
        with pytest.raises(AgentError, match=r"Mine.step lets no agent act; call super\(\).step"):
            idle(plate(), engine=engine).run()
    assert late(plate()).run().last.outcome.startswith("at rest")
    for name in ("setp", "on_step"):
        with pytest.raises(ParameterError, match=rf"Mine has a method '{name}', .* mean 'step'\?"):
            type("Mine", (LoadModel,), {name: LoadModel.step})(plate())
    helps = {"on_step": LoadModel.step, "step": lambda model: model.on_step(), "go": LoadModel.run}
    assert type("Mine", (LoadModel,), helps)(plate()).go().last.outcome.startswith("at rest")


def test_a_step_ends_the_run_by_setting_running_to_false():
    class Enough(LoadModel):
        def step(self):
            super().step()
            self.running = self.generation < 3

    class Full(MaterialAgent):
        def take(self, load):
            super().take(load)
            self.model.running = len(self.model.agents_by_type[Full]) < 9

    model = Enough(plate())
    last = model.run(1).last
    assert (model.outcome, last.outcome) == ("", "interrupted after 1 generation")
    last = model.run().last
    assert model.outcome == last.outcome == "interrupted after 3 generations"
    row = mesa.batch_run(Enough, {"scene": [plate()]}, display_progress=False)[-1]
    assert row["load_taken"] == last.ledger.taken
    full = LoadModel(plate(), material_agent=Full)
    full.run()
    assert (full.running, full.generation) == (False, 3)
    due = {"due": lambda self, asked: setattr(self.model, "running", False) or asked}
    rule = ElasticRule(order="wave", threshold=0.05)
    elastic = ElasticModel(plate(rule=rule), face_agent=type("Face", (kaju.FaceAgent,), due))
    assert elastic.run().outcome == elastic.outcome == "interrupted after 1 step"


def test_agents_may_wait_and_an_order_decides_how_soon_loads_end():
    class Late(MaterialAgent):
        def step(self):
            if self.model.generation > 2:
                super().step()

        def emissions(self, load):  # an array of single precision is told, too
            return [row._replace(share=np.float32(row.share)) for row in super().emissions(load)]

    usual, late = LoadModel(plate()).run(), LoadModel(plate(), material_agent=Late).run()
    assert late.last.outcome == f"at rest after {usual.last.generations + 2} generations"
    assert late.last.ledger.taken == pytest.approx(usual.last.ledger.taken, rel=1e-6)
    assert type(late.last.ledger.taken) is float
    one = LoadModel(plate(), order=lambda waiting: waiting[:1])
    told = None, "every load ends; an order of your own decides how soon"
    assert (one.certificate.generations, one.certificate.verdict) == told
    assert one.run().last.generations > usual.last.generations


@ENGINES
def test_until_pauses_and_a_finished_model_counts_nothing(engine):
    model = LoadModel(plate(), engine=engine)
    model.run(until=lambda model: model.generation == 4)
    told = r"until: a function of the model \(until=lambda model"
    with pytest.raises(ParameterError, match=told):
        model.run(until=lambda: True)
    asked = {
        3: "got 3",
        (3, 4, 0): "got",
        (1.5, 2): "got",
        (-1, 22): r"\(-1, 22\) is far outside of the 20 x 20",
    }
    for index, told in asked.items():
        with pytest.raises(ParameterError, match=f"^index: .*{told}"):
            model.agent_at(index)
    assert LoadModel(plate()).agent_at((-1, 20)) is None
    assert (model.steps, model.running) == (4, True)
    model.run()
    steps = model.steps
    model.step()
    assert model.steps == model.generation == steps == 11
    model.reset()
    assert (model.steps, model.generation, model.running) == (0, 0, True)
    assert len(model.datacollector.get_model_vars_dataframe()) == 0


def test_runs_leave_nothing_behind():
    """Mesa 3.3 keeps the models of its own agents for ever."""
    left, elastic = [], plate(rule=ElasticRule(order="wave", threshold=0.05))
    some = partial(kaju.SpawningModel, plate(cells=8), tolerance=0.02)
    for make in (partial(LoadModel, plate()), partial(ElasticModel, elastic), some):
        model = make(seed=1)
        model.run()
        left.append(weakref.ref(model))
    del model
    gc.collect()
    assert [ref() for ref in left] == [None] * 3


def test_a_run_on_arrays_and_its_picture_import_little():
    code = (
        "import sys; from kaju import Scene; from kaju.model.transfer.load_transfer import *;"
        "scene = Scene(body={'cell_size': 1e-2, 'cells': [5, 5], 'material': 'steel'},"
        " sides={'bottom': 'rigid'}, loads=[{'cell': [2, 4], 'force': [0, -2]}]);"
        "import kaju; kaju.plot(LoadTransfer(scene).reset().run());"
        "late = {'mesa', 'pandas', 'scipy', 'networkx', 'numba'} & set(sys.modules);"
        "assert not late, late"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def small(**more):
    return pressed([7, 5], [3, 4], **more)


class Singing(MaterialAgent):
    songs = Parameter(1, 1, 5, "songs")


def stepped(count=3, **more):
    model = LoadModel(small(), threshold=0.01, **more)
    for _ in range(count):
        model.step()
    return model


def material(model):
    return model.agents.select(lambda agent: isinstance(agent, MaterialAgent))


def test_sets_of_agents_are_mesas():
    model = stepped()
    agents = material(model)
    assert set(model.agents_by_type) >= {MaterialAgent, FreeBoundaryAgent}
    assert len(model.space.all_cells) == 7 * 5  # boundary agents stand beside the array
    kept = agents.sort("kept").get("kept")
    assert kept == sorted(kept, reverse=True)
    assert agents.agg("kept", sum) == pytest.approx(0.5 * model.figures()["load_taken"])
    numbers = model.agents.get("unique_id")
    assert len(set(numbers)) == len(numbers)


def test_a_data_collector_of_ones_own():
    model = stepped(0)
    model.datacollector = type("Mine", (DataCollector,), {})(
        model_reporters={"kept": lambda m: material(m).agg("kept", sum)},
        agent_reporters={"spawned": "spawn_step", "kept": "kept"},
    )
    model.run(3)
    assert len(model.datacollector.get_model_vars_dataframe()) == 3
    frame = model.datacollector.get_agent_vars_dataframe()
    assert frame["spawned"].max() == 4
    assert frame.loc[3]["kept"].sum() == pytest.approx(model.result().last.ledger.kept)
    model.reset()
    model.run(3)
    again = model.datacollector.get_agent_vars_dataframe()  # agents have new numbers
    assert again.values.tolist() == frame.values.tolist()


def test_copies():
    model = stepped(2)
    for again in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert again.run().last.ledger.taken == stepped(0).run().last.ledger.taken


@pytest.mark.skipif(not hasattr(mesa, "batch_run"), reason="Mesa 4 has none")
def test_batch_run():
    numbers = {"threshold": [0.01, 0.1], "material_agent": [Singing], "songs": [2], "rng": [7, 8]}
    rows = mesa.batch_run(LoadModel, {"scene": [small()], **numbers}, display_progress=False)
    assert [row["rng"] for row in rows] == [7, 8, 7, 8]
    assert {row["threshold"] for row in rows} == {0.01, 0.1}
    assert {row["songs"] for row in rows} == {2}


def test_whatever_collects_is_asked_after_every_step():
    seen, model = [], LoadModel(small())
    model.datacollector = SimpleNamespace(collect=lambda model: seen.append(model.steps))
    model.run()
    assert seen == [*range(1, model.generation + 1)]


class Collected(LoadModel):
    def __init__(self, scene, **more):
        super().__init__(scene, **more)
        reporters = {"clock": "generation", "all": lambda model: material(model).agg("kept", sum)}
        agents = {"kept": lambda agent: agent.kept if isinstance(agent, MaterialAgent) else 0.0}
        self.datacollector = DataCollector(reporters, agents)


@pytest.mark.skipif(not hasattr(mesa, "batch_run"), reason="Mesa 4 has none")
@pytest.mark.parametrize("period", [1, -1])
def test_rows_of_batch_run_are_of_one_generation_each(period):
    rows = mesa.batch_run(Collected, {"scene": [small()]}, data_collection_period=period)
    end = LoadModel(small()).run().last.generations
    clocks = {row["clock"] for row in rows}
    assert clocks == ({*range(1, end + 1)} if period == 1 else {end})
    for clock in clocks:
        here = [row for row in rows if row["clock"] == clock]
        assert sum(row["kept"] for row in here) == pytest.approx(here[0]["all"])


def test_the_scenario_of_mesas_page():
    model = LoadModel(small(), seed=7)
    if not hasattr(model, "scenario"):
        pytest.skip("Mesa knows scenarios from 3.5 on")
    of_mesa = type(model.scenario)
    again = LoadModel(small(), scenario=of_mesa(rng=7))
    assert again.random.random() == model.random.random()
    given = of_mesa(rng=3, threshold=0.1)  # the keyword counts, and what is given stays as it is
    assert (LoadModel(small(), scenario=given, seed=7).seed, given.rng) == (7, 3)
    both = [of_mesa(threshold=gamma) for gamma in (0.01, 0.1)]
    table = kaju.sweep(small(), {"run.scenario": both}, run=LoadModel, workers=1)
    assert table["material_agents"][0] > table["material_agents"][1]


def test_a_recorder_of_mesas_takes_the_figures():
    of_mesa = pytest.importorskip("mesa.experimental.data_collection", reason="Mesa from 3.5 on")
    model = LoadModel(plate(), engine="arrays")
    recorder = of_mesa.DataRecorder(model, {"figures": {}})
    result = model.run()
    recorder.finalise()
    table = recorder.get_table_dataframe("figures")
    assert table["load_taken"].iloc[-1] == pytest.approx(result.last.ledger.taken, rel=1e-12)
    assert len(table) == model.generation + 1


def test_what_collects_twice_or_too_early_is_told():
    steps = {"step": lambda self: (LoadModel.step(self), self.datacollector.collect(self))}
    for own in (None, DataCollector({"g": "generation"}), DataCollector({}, {"kept": "kept"})):
        model = type("Twice", (LoadModel,), steps)(small())
        if own:
            model.datacollector = own
        with pytest.raises(ParameterError, match=r"leave collect\(\) out of step"):
            model.run()
    early = {"__init__": lambda self: setattr(self, "datacollector", own)}
    with pytest.raises(ParameterError, match=r"set it after super\(\).__init__\(scene\)"):
        type("Early", (LoadModel,), early)()
