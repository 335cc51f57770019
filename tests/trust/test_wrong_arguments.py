"""Verbs take a model, a scene or a path; what is handed over by mistake is named."""

import os

import pytest
from plates import plate

import kaju
from kaju import LoadModel, Scene, creep, solve
from kaju.errors import KajuError, ParameterError, ResultError
from kaju.model.network import triangular

BLOCK = plate([4, 3], [1, 2])


@pytest.mark.parametrize("of", [LoadModel, kaju.ElasticModel, kaju.SpawningModel, kaju.stability])
def test_a_file_name_is_no_scene(of):
    with pytest.raises(ParameterError, match=r"needed, got 'plate.toml'; kaju.load_scene"):
        of("plate.toml")


@pytest.mark.parametrize(("call", "kind", "told"), [
    (lambda: kaju.fit_rule(1, 2), ParameterError, "scene: a Scene is needed, got 1"),
    (lambda: kaju.export_page(3, "x.html"), ParameterError, "a result is needed, got 3"),
    (lambda: creep(BLOCK, "step"), ParameterError, "history: must be a History.* got 'step'"),
    (lambda: solve(BLOCK, tolerence=0.1), ParameterError, "did you mean 'tolerance'"),
    (lambda: LoadModel(BLOCK).run(until=0.5), ParameterError, "until: .*, got 0.5"),
    (lambda: solve(BLOCK).displacement_at("middle"), ResultError, "points: must be numbers"),
    (lambda: solve(BLOCK).displacement_at((0, 0)), ResultError, r"such as \[\(x, y\)\]"),
    (lambda: solve(BLOCK, goal="bottom"), ParameterError, "bottom is held, and has no deflection"),
])  # fmt: skip
def test_other_things_that_are_no_scene_or_result(call, kind, told):
    with pytest.raises(kind, match=told):
        call()


@pytest.mark.parametrize(("what", "option", "told"), [
    ("agents", "magnification", "'agents' has no such argument"),
    ("agents", "generatoin", "did you mean 'generation'"),
    ("stress", "components", "did you mean 'component'"),
])  # fmt: skip
def test_pictures_name_the_options_that_they_have(what, option, told):
    with pytest.raises(ParameterError, match=f"{option}: .*{told}"):
        kaju.plot(LoadModel(BLOCK).run(), what, **{option: 1})


def test_a_sweep_of_more_points_than_anybody_waits_for_is_refused():
    many = {f"loads.0.force.{axis}": range(10**6) for axis in range(2)}
    with pytest.raises(ParameterError, match=r"1,000,000,000,000 combinations"):
        kaju.sweep(BLOCK, many)


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "pipe", "/dev/zero", "."])
@pytest.mark.parametrize("reader", [
    kaju.load_scene,
    kaju.load_result,
    lambda path: Scene.from_array(path, legend={1: "steel"}, cell_size=0.1),
    lambda path: Scene.from_image(path, legend={"black": "steel"}, cell_size=0.1),
])  # fmt: skip
def test_what_is_no_file_to_read_is_refused_at_once(tmp_path, monkeypatch, name, reader):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    with pytest.raises(KajuError, match="cannot be read: "):
        reader(name)


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    BLOCK.save(tmp_path / "block.toml")
    LoadModel(BLOCK).run().save(tmp_path / "result.npz")
    return tmp_path


@pytest.mark.slow
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
