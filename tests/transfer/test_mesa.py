"""The models as Mesa's own tools see them."""

import gc
import runpy
import subprocess
import sys
import weakref

import numpy as np
import pytest
from plates import plate as pressed
from transfer_answers import ENGINES

from kaju import ElasticModel, ElasticRule, LoadModel, PrescribedRule, SpawningModel
from kaju.errors import ParameterError


def plate(steps=1, rule=None, cells=20, sense=False):
    rule = rule or PrescribedRule(threshold=1e-3, sense=sense)
    place = [cells // 2, cells - 1]
    return pressed([cells, cells], place, steps=steps, cell_size=0.2 / cells, rule=rule)


def test_rows_of_arrays_are_no_agents_and_say_so():
    model = LoadModel(plate(), engine="arrays")
    model.run()
    asked = (lambda: model.agents, lambda: model.agents_by_type, lambda: model.agent_at((10, 19)))
    for ask in asked:
        with pytest.raises(ParameterError, match="engine='agents'"):
            ask()


def test_an_agent_knows_its_place_in_the_scene():
    model = LoadModel(plate())
    model.step()
    first = next(iter(model.agents))
    assert first.index == first.pos == first.cell.coordinate == (10, 19)
    assert model.agent_at((10, 19)) is first
    assert model.agent_at((0, 0)) is model.agent_at((99, 99)) is None
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


def sisters():
    elastic = plate(rule=ElasticRule(order="wave", threshold=0.05))
    return [
        lambda: ElasticModel(elastic, seed=1),
        lambda: SpawningModel(plate(cells=8), tolerance=0.02, seed=1),
    ]


@pytest.mark.parametrize("number", range(2))
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
    """Mesa 3.3 keeps the models of its own agents for ever."""
    left = []
    for make in (lambda: LoadModel(plate()), *sisters()):
        model = make()
        model.run()
        left.append(weakref.ref(model))
    del model
    gc.collect()
    assert [ref() for ref in left] == [None] * 3


def test_importing_leaves_multiprocessing_as_it_was():
    code = (
        "import multiprocessing as m; before = m.get_start_method(allow_none=True); import kaju;"
        "kaju.LoadModel, kaju.ElasticModel, kaju.SpawningModel;"
        "assert m.get_start_method(allow_none=True) == before, m.get_start_method()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_run_on_arrays_imports_no_mesa():
    code = (
        "import sys; from kaju import Scene; from kaju.model.transfer.load_transfer import *;"
        "scene = Scene(body={'cell_size': 1e-2, 'cells': [5, 5], 'material': 'steel'},"
        " sides={'bottom': 'rigid'}, loads=[{'cell': [2, 4], 'force': [0, -2]}]);"
        "LoadTransfer(scene).reset().run().summary();"
        "late = {'mesa', 'pandas', 'scipy', 'networkx', 'numba'} & set(sys.modules);"
        "assert not late, late"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.filterwarnings("ignore")  # Solara's own
def test_the_example_app_moves_its_slider_steps_and_starts_again():
    solara = pytest.importorskip("solara", reason="Mesa's page needs Solara, which is not here")
    pytest.importorskip("altair")
    page = runpy.run_path("examples/solara_app/app.py")["page"]

    @solara.component
    def app():
        solara.AppLayout(children=[page])

    box, _ = solara.render(app(), handle_error=False)
    widgets, seen = [box], set()
    for widget in widgets:
        slots = [part.get("children", ()) for part in getattr(widget, "v_slots", ())]
        inner = [*getattr(widget, "children", ()), *slots]
        for child in inner:
            for each in child if isinstance(child, (list, tuple)) else [child]:
                if hasattr(each, "comm") and id(each) not in seen:
                    seen.add(id(each))
                    widgets.append(each)
    (slider,) = (w for w in widgets if getattr(w, "label", None) == "γ (N)")
    slider.v_model = 0.05
    for name in ("Step", "Reset"):
        (button,) = (w for w in widgets if getattr(w, "children", None) == [name])
        button.fire_event("click", {})
