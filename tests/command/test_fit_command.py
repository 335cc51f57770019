"""The verb `fit`: several scenes and quantities from the command line."""

import json

import pytest
from plates import plate

from kaju import LoadModel, PrescribedRule, load_scene
from kaju.errors import ParameterError


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "plate.toml"
    path.write_text(plate([6, 6], [3, 5], rule=PrescribedRule(threshold=0.02)).to_toml())
    return path


def test_it_writes_the_fitted_scene_and_tells_what_it_gained(typed, scene, tmp_path):
    told = typed("fit", scene, "--runs", 60, "--out", tmp_path, "--json")
    assert told.exit_code == 0
    figures = json.loads(told.stdout)
    assert [row["quantity"] for row in figures["misfits"]] == ["displacement", "stress"]
    assert figures["misfit_after"] < figures["misfit_before"]
    fitted = load_scene(tmp_path / "plate-fitted.toml")
    assert list(fitted.rule.alpha) == figures["alpha"]
    assert fitted.rule.threshold == 0.02
    with pytest.raises(ParameterError, match="exists already"):
        typed("fit", scene, "--out", tmp_path)


def test_it_comes_close_to_a_stored_result(typed, scene, tmp_path):
    made = load_scene(scene, {"rule.alpha": [0.3, 0.6, 0.15], "rule.beta": 0.9})
    stored = LoadModel(made).run().save(tmp_path / "made.npz")
    options = ["--runs", 200, "--weigh", "displacement=1", "--out", tmp_path]
    told = typed("fit", scene, "--reference", stored, *options)
    before, after = (float(word) for word in told.stdout.splitlines()[2].split()[-2:])
    assert after < 0.3 * before


@pytest.mark.parametrize("weigh", ["stress", "stress=much", "pressure=1"])
def test_wrong_weights_are_named(typed, scene, weigh):
    with pytest.raises(ParameterError, match=r"weigh|quantity"):
        typed("fit", scene, "--weigh", weigh)
