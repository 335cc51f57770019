"""The Mesa model of the elastic rule, as a class would watch it."""

import numpy as np
import pytest
from elastic_scenes import (
    block,
    direct_solution,
    displacement,
    drawn,
    energy_norm,
    plate,
    ragged,
    relative_error,
    run,
    run_random,
    scenes,
)
from hypothesis import given, settings
from plates import loaded

from kaju import ElasticModel, FaceAgent, load_result

ORDERS = ["wave", "largest first", "multilevel"]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [ragged, block])
def test_the_books_of_energy_agree_with_the_field(make, order):
    model, result = run(make(order=order, threshold=0.05))
    u = displacement(model)
    load = model.table.load[: len(u)]
    energy = 0.5 * energy_norm(model, u) ** 2 - load @ u
    assert result.energy[-1] == pytest.approx(energy, rel=1e-11)
    assert result.result.strain_energy == pytest.approx(0.5 * energy_norm(model, u) ** 2, rel=1e-11)


@settings(max_examples=20)
@given(scene=scenes(order="largest first"))
def test_largest_first_keeps_southwells_bound(scene):
    model, result = run_random(scene)
    load = model.table.load[: model.table.levels[0].size]
    work = load @ direct_solution(model)
    assert result.pushes == len(result.history)
    assert result.pushes <= work * model.table.reference / model.threshold**2
    assert result.pushes <= result.most_pushes
    assert result.most_pushes <= work * model.table.reference / model.threshold**2 * (1 + 1e-9)


def test_a_wave_starts_at_the_load_and_moves_one_link_a_step():
    model = ElasticModel(plate(16, order="wave", threshold=1e-6), engine="agents")
    assert len(model.agents) == 0
    model.step()
    (first,) = model.agents_by_type[FaceAgent]
    assert first.spawn_step == 1
    assert first.place.index == (8, 16)
    assert first.displacement == pytest.approx(-model.share * 2.0 / first.place.stiffness)
    linked = {link.target for link in first.place.links}
    model.step()
    second = {a.place.number for a in model.agents_by_type[FaceAgent] if a.spawn_step == 2}
    assert second == linked


@pytest.mark.parametrize("order", ORDERS)
def test_agents_spawn_only_above_the_threshold(order):
    model = ElasticModel(plate(order=order, threshold=0.1), engine="agents")
    while model.running:
        model.step()
        assert np.all(model.state.levels[0].taken[model.state.levels[0].spawn_step == 0] == 0.0)
    result = model.result()
    fine = result.agents.level == 0
    assert 0 < fine.sum() < model.table.levels[0].size
    # Each taken load exceeded γ, and in a wave the share of it that was taken.
    weight = model.state.levels[0].weight[result.agents.number[fine]]
    assert np.all(result.agents.taken[fine] * weight > model.share * model.threshold)


def test_parents_take_the_load_first_and_fine_agents_spawn_near_it():
    model = ElasticModel(plate(32, threshold=0.02), engine="arrays")
    model.step()
    top = len(model.table.levels) - 1
    assert model.visit == (top, "down")
    assert set(model.result().agents.level.tolist()) == {top}
    result = model.run()
    fine = result.agents.level == 0
    share = fine.sum() / model.table.levels[0].size
    assert share < 0.5
    distance = np.linalg.norm(result.agents.position[fine] - [0.103, 0.2], axis=1)
    assert np.median(distance) < 0.08
    assert relative_error(model) < 0.06


@pytest.mark.parametrize("make", [plate, ragged, block])
def test_with_parents_the_meter_shows_the_error(make):
    model, result = run(make(tolerance=1e-4))
    meter = result.history[-1].error_estimate
    assert meter <= 1e-4
    assert 0.3 < meter / relative_error(model) < 3.0


@pytest.mark.parametrize("rows", ["abb", "bba", "aba", "bab"])
def test_parents_cope_with_steel_on_rubber_and_rubber_on_steel(rows):
    loads = [{"cell": [6, 11], "side": "top", "force": [0.5, -2.0]}]
    drawing = "\n".join(12 * letter for letter in rows for _ in range(4))
    scene = drawn(drawing, loads, sides={"bottom": "rigid"}, tolerance=1e-4)
    soft = {"youngs_modulus": 206e3, "poissons_ratio": 0.45}
    scene = scene.replace(materials={"soft": soft})
    model, result = run(scene, max_steps=1000)
    assert result.outcome.startswith("at rest")
    # Where moduli jump by a million the meter is below the error by some tens of times.
    assert relative_error(model) < 5e-3


def test_summary_and_result():
    _, result = run(plate(threshold=0.01))
    summary = result.summary()
    assert summary["rule"] == "elastic"
    assert summary["order"] == "multilevel"
    assert summary["agents"] == sum(summary["agents_by_level"])
    assert summary["pushes"] == result.pushes
    assert summary["reaction"][1] == pytest.approx(2.0, abs=0.1)
    elastic = result.result
    assert elastic.summary()["method"] == "agents, multilevel"
    middle = elastic.displacement_at(np.array([[0.1, 0.1]]))
    assert middle[0, 1] == pytest.approx(-2.9e-9, rel=0.1)


def test_a_slender_member_is_divided_so_that_it_can_carry_shear():
    loads = [{"cell": [0, 3], "side": "top", "force": [0.1, -1.0]}]
    model, result = run(drawn("a\na\na\na\n=", loads, tolerance=1e-6))
    assert model.table.posed.division == 2
    assert result.displacement[0].shape == (3, 8)
    np.testing.assert_allclose(result.reaction, (-0.1, 1.0), atol=1e-4)


@pytest.mark.parametrize(("soft", "doubted"), [(2e9, False), (2e5, True)])
def test_a_meter_that_may_be_far_off_is_doubted(soft, doubted):
    moduli = {"steel": 2e11, "rubber": soft}
    materials = {n: {"youngs_modulus": e, "poissons_ratio": 0.3} for n, e in moduli.items()}
    how = {"materials": materials, "rule": {"kind": "elastic"}}
    scene = loaded("aab\nbba\naab", {"cell": [1, 2], "force": [0.0, -1.0]}, **how)
    result = ElasticModel(scene, max_steps=20).run()
    notes = result.result.summary()["notes"]
    assert any("tens of times the estimate" in note for note in notes) == doubted


def test_a_run_on_halved_cells_is_read_again(tmp_path):
    """Where a member is one cell wide its agents stand on halved cells, beyond the scene's."""
    rule = {"kind": "elastic", "tolerance": 0.1}
    told = ElasticModel(loaded([1, 6], {"side": "top", "force": [1.0, 0.0]}, rule=rule)).run()
    assert told.grid.lattice.shape == (2, 12)
    again = load_result(told.save(tmp_path / "run"))
    np.testing.assert_array_equal(again.boundary.cells, told.boundary.cells)
    assert again.boundary.cells.max() == 12
    assert again.summary() == told.summary()
