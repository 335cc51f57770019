"""A model put aside half-way goes on as if it had never stopped."""

from dataclasses import replace

import pytest
from plates import plate as pressed
from transfer_answers import ENGINES, assert_same

from kaju import (
    ElasticModel,
    ElasticRule,
    FreeBoundaryAgent,
    LoadModel,
    MaterialAgent,
    PrescribedRule,
    SpawningModel,
)
from kaju.errors import ParameterError, ResultFileError


def plate(rule=None, steps=1, cells=10):
    rule = rule or PrescribedRule(threshold=1e-3, sense=True)
    place = [cells // 2, cells - 1]
    return pressed([cells, cells], place, steps=steps, cell_size=0.2 / cells, rule=rule)


class Scattered(MaterialAgent):
    """Every agent draws its own forward share."""

    def __init__(self, model, cell, material, shares):
        drawn = float(model.rng.uniform(0.3, 0.6))
        super().__init__(model, cell, material, replace(shares, forward=drawn))


class Felt(FreeBoundaryAgent):
    """Gives back a random part."""

    def give_back(self, load, arm):
        back = self.turn(load, arm)
        return back._replace(magnitude=self.model.random.random() * back.magnitude)


@ENGINES
@pytest.mark.parametrize("step", [0, 5, 19])
def test_load_transfer_goes_on_bit_for_bit(engine, step, tmp_path):
    model = LoadModel(plate(steps=3), engine=engine)
    model.run(until=lambda model: model.steps == step)
    path = model.save_checkpoint(tmp_path / "half")
    assert path == tmp_path / "half.npz"
    again = LoadModel.load_checkpoint(tmp_path / "half")
    assert (again.steps, again.stage, again.generation) == (step, model.stage, model.generation)
    assert type(again.engine) is type(model.engine)
    for one, other in zip(model.run().stages, again.run().stages, strict=True):
        assert_same(one, other)
    assert again.datacollector.model_vars == model.datacollector.model_vars


def test_own_agents_go_on_with_the_numbers_they_drew(tmp_path):
    own = {"material_agent": Scattered, "boundary_agents": {"free": Felt}}
    model = LoadModel(plate(), rng=7, **own)
    model.run(until=lambda model: model.steps == 4)
    path = model.save_checkpoint(tmp_path / "half.npz")
    again = LoadModel.load_checkpoint(path, **own)
    assert_same(model.run().last, again.run().last)
    assert model.rng.random() == again.rng.random()
    with pytest.raises(ParameterError, match="made with Scattered, got none; give"):
        LoadModel.load_checkpoint(path, boundary_agents={"free": Felt})


def test_a_step_that_led_elsewhere_is_told(tmp_path):
    model = LoadModel(plate())
    model.step()
    agent = model.agents[0]
    agent.inbox[2, 0.5] = 1.0
    model.step()
    path = model.save_checkpoint(tmp_path / "touched")
    with pytest.raises(ResultFileError, match="its 2 steps led elsewhere this time"):
        LoadModel.load_checkpoint(path)


MODELS = {
    "wave": lambda: ElasticModel(plate(ElasticRule(order="wave", threshold=0.02))),
    "multilevel": lambda: ElasticModel(plate(ElasticRule()), engine="arrays"),
    "spawning": lambda: SpawningModel(plate(), tolerance=0.02),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_sister_models_go_on_bit_for_bit(name, tmp_path):
    model = MODELS[name]()
    model.run(until=lambda model: model.steps == 2)
    again = type(model).load_checkpoint(model.save_checkpoint(tmp_path / name))
    assert again.steps == 2
    model.run()
    again.run()
    assert again.steps == model.steps > 2
    assert again.datacollector.model_vars == model.datacollector.model_vars
    with pytest.raises(ResultFileError, match=f"holds a {type(model).__name__}"):
        LoadModel.load_checkpoint(tmp_path / name)
