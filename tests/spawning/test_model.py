"""Spawning as a Mesa model: a step is a generation, agents know where they come from."""

from contextlib import nullcontext

import numpy as np
import pytest
from spawning_bodies import BRASS, STEEL, under_a_patch

from kaju import Scene, SpawningModel, load_result, solve
from kaju.errors import ParameterError, ResultError


def assert_same_rows(one, other):
    for name in one.rows.dtype.names:
        np.testing.assert_array_equal(one.rows[name], other.rows[name])


def within_outlines():
    """A quarter of a steel disk round one of brass, squeezed."""
    regions = [
        {"disk": {"centre": at, "radius": size}, "material": name, "name": name, "outline": "true"}
        for name, at, size in (("steel", [0.0, 0.0], 0.9), ("brass", [0.1, 0.1], 0.5))
    ]
    return Scene(
        body={"size": [1.0, 1.0], "cells": [8, 8], "material": "air", "regions": regions},
        materials={"steel": STEEL, "brass": BRASS},
        sides={"left": "roller", "bottom": "rigid"},
        loads=[{"outline": "steel", "pressure": 1.0}],
    )


BODIES = {"plane": under_a_patch(), "space": under_a_patch(3), "outlines": within_outlines()}
TOLERANCE = {"plane": 0.01, "space": 0.25, "outlines": 0.03}


@pytest.fixture(scope="module", params=BODIES)
def model(request):
    model = SpawningModel(BODIES[request.param], TOLERANCE[request.param])
    assert len(model.agents)  # objects that are made early go along
    model.run()
    return model


def test_generations_are_shown_as_they_come(monkeypatch):
    said = []
    for module in ("stepping", "model.elastic.solve"):
        lines = nullcontext(lambda line: said.append(line()))
        monkeypatch.setattr(f"kaju.{module}.progress_line", lambda _=None, lines=lines: lines)
    answer = solve(under_a_patch(), 0.01)
    told = f"{answer.agents} agents, proved error {answer.error_bound:.2g}, tolerance 0.01"
    assert said[-1] == f"generation {len(answer.generations)}: {told}"
    SpawningModel(under_a_patch(), 0.01).run()
    assert said == said[: len(answer.generations)] * 2


def test_a_step_is_a_generation():
    model = SpawningModel(under_a_patch(), 0.01)
    assert (model.generation, model.running) == (0, True)
    assert np.isnan(model.error)
    errors, counts = [], [len(model.agents)]
    while model.running:
        model.step()
        errors.append(model.error)
        counts.append(len(model.agents))
    assert model.generation == len(errors) == model.steps > 2
    assert errors == sorted(errors, reverse=True)
    assert model.result().error_bound <= 0.01 < errors[-2]
    assert counts[0] == counts[1], "in the first step the first agents find their opinions"
    assert counts == sorted(counts)
    assert model.outcome == f"within the tolerance of 0.01 after {model.generation} steps"
    model.step()
    assert model.generation == len(errors)


def test_model_and_solver_give_the_same_numbers(model):
    found = model.result()
    solved = solve(model.scene, tolerance=model.tolerance)
    np.testing.assert_array_equal(found.displacement, solved.displacement)
    assert_same_rows(found.family, model.family)


def test_agents_know_parents_children_and_why_they_spawned(model):
    retired = [agent for agent in model.agents if not agent.alive]
    parents = [agent for agent in retired if agent.children]
    # within outlines agents that hold nothing of the body vanish
    assert (len(parents) < len(retired)) == model.scene.outlined
    for agent in parents:
        family = agent.children
        assert len(family) == 2 ** len(agent.lower)
        for child in family:
            assert child.parent is agent
            assert child.level == agent.level + 1
            assert child.size == pytest.approx(0.5 * agent.size)
            assert child.spawn_step == agent.retired_step
            assert child.cause == agent.gap or np.isnan(child.cause)
        middle = np.mean([child.lower for child in family], axis=0)
        np.testing.assert_allclose(middle, np.array(agent.lower) + 0.25 * agent.size)
    for agent in model.working:
        assert agent.alive
        assert agent.children == []
    first = [agent for agent in model.agents if agent.parent is None]
    assert all(agent.spawn_step == 0 and agent.cause == 0.0 for agent in first)
    assert min(agent.level for agent in first) == 0


def test_working_agents_are_those_of_the_result(model):
    found, working = model.result(), model.working
    np.testing.assert_allclose([agent.lower for agent in working], found.lower)
    for name in ("size", "level", "spawn_step", "gap"):
        values = [getattr(agent, name) for agent in working]
        np.testing.assert_array_equal(values, getattr(found, name))
    names = [material.name for material in model.scene.cell_materials]
    assert [agent.material.name for agent in working] == [names[k] for k in found.material]


def test_those_whose_opinions_differ_most_spawn_for_it(model):
    retired = model.family.rows["retired_step"]
    for step, generation in enumerate(model.result().generations):
        gap, chosen = generation.gap, generation.chosen
        assert np.all(retired[model.family.standing(step)][chosen] == step + 1)
        assert chosen.any() == (step + 1 < model.generation)
        assert not chosen.any() or gap[chosen].mean() > gap[~chosen].mean()


def test_generations_can_be_looked_at_before_the_end(tmp_path):
    model = SpawningModel(under_a_patch(), 0.01)
    with pytest.raises(ResultError, match="take a step first"):
        model.result()
    for _ in range(2):
        model.step()
    early = model.result()
    count, energy = early.agents, early.strain_energy
    assert "above the tolerance" in early.summary()["notes"][0]
    again = load_result(early.save(tmp_path / "early.npz"))
    late = model.run()
    assert early.agents == count == early.generations[-1].agents < late.agents
    assert early.strain_energy == energy
    assert len(early.generations) == 2
    assert repr(late.generations[-1]).startswith(f"Generation(agents={late.agents}, error=")
    assert len(repr(late.generations)) < 100 * len(late.generations)
    assert late.notes == late.caveats + late.scene.notes
    assert_same_rows(again.family, early.family)
    points = early.lower + 0.5 * early.size[:, None]
    np.testing.assert_array_equal(again.displacement_at(points), early.displacement_at(points))
    assert len(late.family.standing(1)) == count


def test_run_that_may_not_have_enough_agents_says_so():
    model = SpawningModel(under_a_patch(), 0.01, most_agents=150)
    found = model.run()
    assert model.outcome.startswith(f"stopped after {model.generation} steps: more agents")
    assert found.agents <= 150
    coarse = SpawningModel(under_a_patch(), 0.01, resolution=1)
    coarse.run()
    assert "a larger resolution" in coarse.outcome
    with pytest.raises(ParameterError, match="tolerance"):
        SpawningModel(under_a_patch(), 2.0)
