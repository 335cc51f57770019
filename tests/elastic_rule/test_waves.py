"""How much all agents may yield at once, and what happens if they yield more."""

import numpy as np
import pytest
from elastic_scenes import plate, ragged, run, scenes
from hypothesis import given, reject, settings
from plates import loaded

from kaju import ElasticModel, ElasticRule, Material
from kaju.errors import SceneError, StabilityError
from kaju.model.elastic.relaxation.push_stability import certify_waves
from kaju.model.elastic.relaxation.push_table import PushTable


def sheet(cells, material, **body):
    rule = ElasticRule(order="wave")
    return loaded([cells] * 2, material="m", materials={"m": material}, rule=rule, **body)


def spectrum(table):
    """Eigenvalues of D⁻¹K of the scene's agents."""
    finest = table.levels[0]
    own = np.eye(finest.size) - finest.shares[:, : finest.size].toarray()
    return np.sort(np.linalg.eigvals(own).real)


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.45])
def test_the_formula_is_the_limit_of_large_plates(plane, ratio):
    material = Material("m", 1e9, ratio)
    found = []
    for cells in (8, 16, 32):
        scene = sheet(cells, material, plane=plane)
        found.append(certify_waves(PushTable(scene)).largest_eigenvalue)
    growth = ElasticRule.shares(material, 2, plane).growth
    gaps = growth - np.array(found)
    assert np.all(gaps > 0.0)
    assert np.all(np.diff(gaps) < 0.0)
    assert gaps[-1] < 0.01 * growth


@settings(max_examples=30)
@given(scene=scenes(order="wave"))
def test_the_certificate_is_right_for_any_mix_of_materials(scene):
    try:
        table = PushTable(scene)
    except SceneError:
        reject()
    certificate = certify_waves(table)
    assert certificate.largest_eigenvalue == pytest.approx(spectrum(table)[-1], rel=1e-6)
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


def test_the_share_is_chosen_stable_and_explained():
    certificate = ElasticModel(ragged(order="wave")).certificate
    assert certificate.share == pytest.approx(0.9 * certificate.limit)
    assert certificate.limit == pytest.approx(2.0 / certificate.largest_eigenvalue)
    assert f"any share below {certificate.limit:.4f} does" in certificate.verdict
    assert ElasticModel(plate()).certificate is None
