"""A scene's rule beside elasticity: what is found, drawn and said in one command."""

import json

import numpy as np
import pytest
from plates import plate as pressed

from kaju import LoadModel, compare, solve
from kaju.errors import KajuError
from kaju.model.study.rule_study import beside_elasticity
from kaju.view.comparison import words_beside


def plate(**changes):
    return pressed([10, 8], [4, 7], steps=4, thickness=0.002, **changes)


@pytest.fixture(scope="module")
def study():
    return beside_elasticity(plate(), resolution=4, evaluations=30)


def test_each_answer_is_compared_as_by_hand(study):
    by_hand = compare(LoadModel(plate()).run(), solve(plate(), resolution=4)).summary()
    assert list(study.comparisons)[1:] == ["prescribed rule, fitted", "elastic agents"]
    own, fitted, elastic = study.comparisons.values()
    assert own.summary() == by_hand
    before, after = study.fit.misfit
    assert own.displacement.misfit == before
    assert fitted.displacement.misfit == after <= before
    assert elastic.displacement.misfit < 0.1 < after


def test_where_the_error_lies(study):
    run = LoadModel(plate()).run()
    own = study.comparisons["prescribed rule"]
    pair, points = own.displacement, own.points
    awake = {tuple(cell) for cell in run.last.cells.tolist()}
    cells = plate().lattice.locate(points).tolist()
    asleep = np.array([tuple(cell) not in awake for cell in cells])
    expected = (pair.error[asleep] ** 2).sum() / (pair.error**2).sum()
    assert study.unreached()["prescribed rule"] == pytest.approx(expected)
    assert "elastic agents" not in study.unreached()
    told = "\n".join(words_beside(study))
    assert f"{expected:.0%} of the squared error" in told
    assert f"off by up to {pair.max_error:.1%} of the largest" in told
    worst = 1e3 * points[pair.error.argmax()]
    assert f"at ({worst[0]:.4g}, {worst[1]:.4g}) mm" in told


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "plate.toml"
    plate().save(path)
    return path


@pytest.mark.slow
def test_one_command_writes_figures_and_words(scene, tmp_path, study, typed):
    out = tmp_path / "beside"
    words = ("compare", scene, "--out", out, "--resolution", 4, "--fit", 30)
    done = typed(*words)
    assert done.exit_code == 0
    for line in words_beside(study):
        assert line in done.output
    names = {path.name for path in out.iterdir()}
    pictures = {"stress", "deformed", "displacement", "cuts"}
    assert names == {"comparison.json", *(f"{name}.png" for name in pictures)}
    with pytest.raises(KajuError, match="--force"):
        typed(*words)
    told = typed(*words, "--force", "--json", "--no-pictures")
    found = json.loads(told.output)
    expected = study.summary() | {"seconds": found["seconds"]}
    assert found == expected == json.loads((out / "comparison.json").read_text())


@pytest.mark.parametrize(("words", "told"), [
    (["plate.npz"], "REFERENCE: is needed"),
    (["a.npz", "b.npz", "--resolution", "2"], "--resolution: belongs to a scene"),
    (["SCENE", "other"], "a scene is compared with elasticity"),
])  # fmt: skip
def test_what_does_not_belong_together_is_refused(scene, tmp_path, monkeypatch, words, told, typed):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KajuError, match=told):
        typed("compare", *(scene if word == "SCENE" else word for word in words))
