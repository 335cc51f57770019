"""Where the agents of the elastic rule come to rest is linear elasticity, in every order."""

import elastic_scenes as known
import numpy as np
import pytest
from elastic_scenes import block, drawn, plate, ragged, run, run_random, scenes
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from plates import loaded

from kaju import ElasticModel, ElasticRule, FaceAgent, Material
from kaju.errors import ParameterError, SceneError, StabilityError

ORDERS = ["wave", "largest first", "multilevel"]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [plate, ragged, block])
def test_every_order_comes_to_rest_at_the_direct_solution(make, order):
    scene = make(order=order, tolerance=1e-5)
    model, result = run(scene, pushes_per_step=10_000 if order == "largest first" else 1)
    assert result.outcome.startswith("at rest")
    # One level's meter is a lower bound of the error, by the number of cells at most.
    assert known.relative_error(model) < (1.5e-5 if order == "multilevel" else 1e-4)


@settings(max_examples=30)
@given(scene=scenes())
def test_at_rest_the_error_keeps_the_bound_that_the_threshold_implies(scene):
    model, result = run_random(scene)
    assert result.outcome.startswith(("at rest", "no load"))
    finest = model.table.levels[0]
    n = finest.size
    assert model.state.levels[0].measured.max() <= model.threshold
    root = np.sqrt(finest.stiffness)
    scaled = root[:, None] * (np.eye(n) - finest.shares[:, :n].toarray()) / root
    smallest = np.linalg.eigvalsh(scaled)[0]
    error = known.energy_norm(model, known.displacement(model) - known.direct_solution(model))
    bound = model.threshold * np.sqrt(n / model.table.reference / smallest)
    assert error <= bound * (1 + 1e-9)


@settings(max_examples=40)
@given(scene=scenes())
def test_every_newton_is_accounted_for_and_energy_never_rises(scene):
    _, result = run_random(scene, max_steps=300)
    assert np.all(np.diff(result.energy, prepend=0.0) <= 0.0)
    assert result.ledger.imbalance < 1e-12
    assert [check.allowed for check in result.checks()] == [1e-6]
    left = result.ledger.applied - result.ledger.resting + result.reaction
    assert np.abs(left).max() <= 1e-12 * result.ledger.turnover
    total = sum(result.result.reactions.values(), start=np.zeros(2))
    np.testing.assert_allclose(total, result.reaction, atol=1e-12 * result.ledger.turnover)


def test_above_a_large_threshold_the_load_rests_before_it_reaches_the_ground():
    # Prescribed or elastic: below γ nothing more happens, and the books say so.
    _, result = run(plate(order="wave", threshold=0.2))
    assert not result.reaction.any()
    np.testing.assert_allclose(result.ledger.resting, (0.0, -2.0), atol=1e-12)
    _, parents = run(plate(order="multilevel", threshold=0.2))
    assert parents.reaction[1] == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [ragged, block])
def test_the_books_of_energy_agree_with_the_field(make, order):
    model, result = run(make(order=order, threshold=0.05))
    u = known.displacement(model)
    stored, work = 0.5 * known.energy_norm(model, u) ** 2, model.table.load[: len(u)] @ u
    assert result.energy[-1] == pytest.approx(stored - work, rel=1e-11)
    assert result.result.strain_energy == pytest.approx(stored, rel=1e-11)


@settings(max_examples=20)
@given(scene=scenes(order="largest first"))
def test_largest_first_keeps_southwells_bound(scene):
    model, result = run_random(scene)
    load = model.table.load[: model.table.levels[0].size]
    work = load @ known.direct_solution(model)
    assert len(result.history) == result.pushes <= work * model.table.reference / model.threshold**2


def test_a_wave_starts_at_the_load_and_moves_one_link_a_step():
    model = ElasticModel(plate(16, order="wave", threshold=1e-6), engine="agents")
    assert len(model.agents) == 0
    model.step()
    (first,) = model.agents_by_type[FaceAgent]
    assert (first.spawn_step, first.place.index) == (1, (8, 16))
    assert first.displacement == pytest.approx(-model.share * 2.0 / first.place.stiffness)
    model.step()
    second = {a.place.number for a in model.agents_by_type[FaceAgent] if a.spawn_step == 2}
    assert second == {target for target, _ in first.place.links}


@pytest.mark.parametrize("make", [plate, ragged, block])
def test_with_parents_the_meter_shows_the_error(make):
    model, result = run(make(tolerance=1e-4))
    meter = result.history[-1].error_estimate
    assert meter <= 1e-4
    assert 0.3 < meter / known.relative_error(model) < 3.0


@pytest.mark.parametrize("rows", ["abb", "bba", "aba", "bab"])
def test_parents_cope_with_steel_on_rubber_and_rubber_on_steel(rows):
    loads = [{"cell": [6, 11], "side": "top", "force": [0.5, -2.0]}]
    drawing = "\n".join(12 * letter for letter in rows for _ in range(4))
    scene = drawn(drawing, loads, sides={"bottom": "rigid"}, tolerance=1e-4)
    soft = {"youngs_modulus": 206e3, "poissons_ratio": 0.45}
    scene = scene.replace(materials={"soft": soft})
    model, result = run(scene, max_steps=1000)
    assert result.outcome.startswith("at rest")
    assert run(scene, max_steps=3)[0].generation == 3
    # Where moduli jump by a million the meter is below the error by some tens of times.
    assert known.relative_error(model) < 5e-3


def test_a_slender_member_is_divided_so_that_it_can_carry_shear():
    loads = [{"cell": [0, 3], "side": "top", "force": [0.1, -1.0]}]
    model, result = run(drawn("a\na\na\na\n=", loads, tolerance=1e-6))
    assert model.table.posed.division == 2
    assert result.result.cells(2).body.shape == (2, 8)
    np.testing.assert_allclose(result.reaction, (-0.1, 1.0), atol=1e-4)


def spectrum(table):
    """Eigenvalues of D⁻¹K of the scene's agents."""
    finest = table.levels[0]
    own = np.eye(finest.size) - finest.shares[:, : finest.size].toarray()
    return np.sort(np.linalg.eigvals(own).real)


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.45])
def test_the_formula_is_the_limit_of_large_plates(plane, ratio):
    material, found = Material("m", 1e9, ratio), []
    given = {"material": "m", "materials": {"m": material}, "plane": plane}
    for cells in (8, 16, 32):
        scene = loaded([cells] * 2, rule=ElasticRule(order="wave"), **given)
        found.append(ElasticModel(scene).certificate.largest_eigenvalue)
    growth = 2.0 + 4.0 * ElasticRule.shares(material, 2, plane).poisson
    gaps = growth - np.array(found)
    assert np.all(gaps > 0.0)
    assert np.all(np.diff(gaps) < 0.0)
    assert gaps[-1] < 0.01 * growth


@settings(max_examples=30)
@given(scene=scenes(order="wave"))
def test_the_certificate_is_right_for_any_mix_of_materials(scene):
    try:
        model = ElasticModel(scene)
    except SceneError:
        reject()
    certificate = model.certificate
    assert certificate.largest_eigenvalue == pytest.approx(spectrum(model.table)[-1], rel=1e-6)
    assert certificate.largest_eigenvalue <= certificate.bound <= 4.0 + 1e-12
    assert certificate.stable


def test_undamped_waves_are_refused_with_the_reason_and_the_remedy():
    told = r"(?s)waves would grow by a factor of up to 1\.9.*set share \(ω\) below 0\.68"
    with pytest.raises(StabilityError, match=told):
        ElasticModel(plate(order="wave", share=1.0))


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_undamped_waves_diverge_and_are_stopped(engine):
    scene = plate(order="wave", share=1.0, threshold=0.01)
    model, result = run(scene, engine=engine, allow_unstable=True)
    assert not model.at_rest
    assert "the largest load has grown to" in result.outcome
    energy = result.energy
    assert energy[-1] > 1e15 * abs(energy[0])
    growth = (result.history[-1].loudest / result.history[-6].loudest) ** 0.2
    assert growth == pytest.approx(abs(1 - model.certificate.largest_eigenvalue), rel=0.02)


@pytest.mark.parametrize("part", [0.5, 0.9, 0.99])
def test_waves_below_the_limit_calm_down(part):
    limit = ElasticModel(plate(order="wave")).certificate.limit
    _, result = run(plate(order="wave", share=part * limit, threshold=0.01))
    assert result.outcome.startswith("at rest after")
    assert np.all(np.diff(result.energy) < 0.0)


# The numbers of the rule: from the material, for a student to compare.


PLANES = [(2, "stress"), (2, "strain"), (3, None)]


@given(ratio=st.floats(-0.95, 0.49), shape=st.sampled_from(PLANES))
def test_what_is_taken_is_passed_on_whole(ratio, shape):
    dimension, plane = shape
    shares = ElasticRule.shares(Material("m", 3e9, ratio), dimension, plane)
    passed = shares.forward + shares.backward + 2 * (dimension - 1) * shares.friction
    assert passed == pytest.approx(1.0, rel=1e-14)
    assert 0.0 < shares.poisson < 0.5


@pytest.mark.parametrize(("arguments", "message"), [
    ({"threshold": 0.0}, "threshold: must be a load above 0 N, got 0.0"),
    ({"share": 0.5}, "share: belongs to the order 'wave'"),
    ({"tolerance": 2.0}, "tolerance: must lie between 0 and 1, got 2.0"),
])  # fmt: skip
def test_a_rule_out_of_range_is_refused(arguments, message):
    with pytest.raises(ParameterError, match=message):
        ElasticRule(**arguments)


def test_incompressible_material_is_refused_where_it_has_no_stiffness():
    water = Material("gel", 1e4, 0.5)
    assert ElasticRule.shares(water).forward == pytest.approx(0.4)
    with pytest.raises(ParameterError, match=r"poissons_ratio: must be below 0\.5 .* got 0\.5"):
        ElasticRule.shares(water, 3)
    with pytest.raises(ParameterError, match="dimension: "):
        ElasticRule.shares(water, 3, "stress")
