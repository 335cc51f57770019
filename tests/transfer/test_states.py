"""What agents of one's own know, and agents that live on from one step of the loads to the next."""

import numpy as np
import pytest
from plates import plate as pressed

import kaju
from kaju import LoadModel, MaterialAgent
from kaju.errors import AgentError, ParameterError, ResultError


class Tired(MaterialAgent):
    """Breaks when it has taken more than 0.9 N in all."""

    broken = kaju.State(False, "passes nothing on")
    burden = kaju.State(0.0, "loads taken (N)")

    def take(self, load):
        super().take(load)
        self.burden += load.total

    def pass_on(self, load):
        self.broken = self.burden > 0.9
        if not self.broken:
            super().pass_on(load)


def plate(**changes):
    return pressed([6, 6], [3, 5], [0.0, -0.8], **changes)


@pytest.fixture(scope="module")
def result():
    return LoadModel(plate(), material_agent=Tired, threshold=0.005).run()


def test_states_are_those_of_the_agents_after_every_generation(result):
    model = LoadModel(plate(), material_agent=Tired, threshold=0.005)
    burden, broken = result.states["burden"], result.states["broken"]
    while model.running:
        model.step()
        now = burden.values(model.generation), broken.values(model.generation)
        for row, cell in enumerate(result.last.cells.tolist()):
            agent = model.agent_at(tuple(cell))
            known = (agent.burden, agent.broken) if agent else (0.0, False)
            assert (now[0][row], now[1][row]) == known
    assert broken.values().dtype == np.bool_
    assert 0 < broken.values().sum() < len(broken.values())
    np.testing.assert_allclose(burden.values(), result.last.taken.sum(axis=1))
    assert burden.meaning == "loads taken (N)"
    with pytest.raises(ResultError, match="generation: must be 0 to "):
        burden.values(model.generation + 1)
    with pytest.raises(ResultError, match="did you mean 'broken'"):
        result.states["brokn"]


def test_states_are_columns_pictures_films_and_are_stored(result, tmp_path):
    again = kaju.load_result(result.save(tmp_path / "tired"))
    with pytest.raises(kaju.KajuError, match=r"did you mean .tired\.npz"):
        kaju.load_result(tmp_path / "tired")
    assert len(repr(again.last)) < 1500 > len(repr(again.states))
    frame = again.to_dataframe()
    for name in ("broken", "burden"):
        np.testing.assert_array_equal(frame[name], result.states[name].values())
        np.testing.assert_array_equal(again.states[name].values(2), result.states[name].values(2))
        assert name in again.pictures
        assert name in again.films
        assert name in kaju.plot(again, name, generation=1).axes[0].get_title(loc="left")
    assert kaju.animate(again, tmp_path / "broken.gif", "broken").stat().st_size > 0
    fading = {"left": kaju.State(2.0), "take": lambda self, load: setattr(self, "left", 0.1)}
    model = LoadModel(plate(), material_agent=type("Fading", (Tired,), fading), threshold=0.005)
    faded = model.run()
    drawn = (
        kaju.plot(faded, "left", generation=2)
        .axes[0]
        .findobj(lambda one: one.get_gid() == "states")
    )
    assert drawn[0].get_array().size == (faded.last.spawn_step <= 2).sum()  # who sleeps is not
    assert drawn[0].get_clim() == (0.1, 2.0)  # of all generations


@pytest.mark.parametrize(("default", "value", "kind"), [
    (False, "yes", "bool"), (0, 0.5, "whole number"), (0.0, np.nan, "finite number"),
    (0.0, np.ones(2), "finite number"), (0, 2**70, "whole number up to"),
])  # fmt: skip
def test_a_state_of_another_kind_is_refused_by_name(default, value, kind):
    def take(self, load):
        self.broken = value

    wrong = type("Wrong", (MaterialAgent,), {"broken": kaju.State(default), "take": take})
    with pytest.raises(AgentError, match=f"broken: Wrong at cell .* must be a {kind}"):
        LoadModel(plate(), material_agent=wrong).run()


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_agents_live_on_and_what_a_step_adds_is_added(engine):
    steps = pressed([6, 6], [3, 5], [0.0, -2.0], steps=4, loading="continue")
    one = LoadModel(pressed([6, 6], [3, 5], [0.0, -0.5]), engine=engine).run().last
    stages = LoadModel(steps, engine=engine).run().stages
    assert len(stages) == 4
    for number, stage in enumerate(stages, start=1):
        assert stage.generations == number * one.generations
        assert stage.ledger.applied == pytest.approx(0.5 * number)
        np.testing.assert_allclose(stage.kept, number * one.kept)
        assert stage.ledger.imbalance < 1e-12
    assert kaju.Scene.from_toml(steps.to_toml()) == steps


def test_the_numbers_of_a_scenario_are_read():
    class Scenario:  # as Mesa's keeps its numbers, from 3.5 on
        def __init__(self, **numbers):
            self.__dict__.update(rng=None, _scenario_id=3, **numbers)

    with pytest.raises(ParameterError, match=r"treshold: .*did you mean 'threshold'"):
        LoadModel(plate(), scenario=Scenario(treshold=0.1))
    of_class = type("Mine", (), {"threshold": 0.1})()
    for given in (Scenario(threshold=0.1), of_class, {"threshold": 0.1}):
        assert LoadModel(plate(), scenario=given).threshold == 0.1
    for given in (Scenario(seed=5), {"seed": 5}, {"rng": 5}):
        assert [LoadModel(plate(), scenario=given, rng=rng).seed for rng in (None, 6)] == [5, 6]
