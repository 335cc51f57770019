"""Verbs take a model, a scene or a path where the answer is at hand, and say what they need."""

import pytest
from plates import plate

import kaju
from kaju import LoadModel
from kaju.errors import KajuError, ParameterError
from kaju.model.network import triangular

BLOCK = plate([4, 3], [1, 2])


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    BLOCK.save(tmp_path / "block.toml")
    LoadModel(BLOCK).run().save(tmp_path / "result.npz")
    return tmp_path


def test_pictures_and_films_of_models_and_files(files, coarse):
    model = LoadModel(BLOCK)
    model.run(2)
    for subject in (model, files / "block.toml", str(files / "result.npz"), files):
        assert kaju.plot(subject).axes
    assert kaju.animate(model, files / "model.gif").exists()
    assert kaju.animate(files, files / "stored.gif").exists()
    with pytest.raises(ParameterError, match="a Scene has no film yet; run it first"):
        kaju.animate(BLOCK, files / "none.gif")


def test_models_and_files_are_solved(files):
    energy = kaju.solve(BLOCK).strain_energy
    for subject in (LoadModel(BLOCK), files / "block.toml", str(files / "block.toml")):
        assert kaju.solve(subject).strain_energy == pytest.approx(energy, rel=1e-12)
    for other in (3, triangular(3, force=0.01)):
        with pytest.raises(ParameterError, match=r"scene: .* kaju\.model\.network\.solve"):
            kaju.solve(other)


def test_shares_are_told_in_per_cent(files, typed):
    told = typed("solve", "block.toml", "--tolerance", "20%", "--no-pictures")
    assert told.exit_code == 0
    assert "solved as linear elasticity" in told.stdout
    with pytest.raises(KajuError, match="tolerance: must be a number from"):
        typed("solve", "block.toml", "--tolerance", "120%", "--out", "other")
    assert typed("solve", "block.toml", "--tolerance", "5x").exit_code == 2
