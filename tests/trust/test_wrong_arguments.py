"""What is handed over by mistake is named, with what would be right."""

import os

import pytest
from plates import plate

import kaju
from kaju import LoadModel, Scene, creep, solve
from kaju.errors import KajuError, ParameterError, ResultError

BLOCK = plate([4, 3], [1, 2])


@pytest.mark.parametrize("of", [LoadModel, kaju.ElasticModel, kaju.SpawningModel, kaju.stability])
def test_a_file_name_is_no_scene(of):
    with pytest.raises(ParameterError, match=r"needed, got 'plate.toml'; kaju.load_scene"):
        of("plate.toml")


@pytest.mark.parametrize(
    ("call", "kind", "told"),
    [
        (lambda: kaju.fit_rule(1, 2), ParameterError, "scene: a Scene is needed, got 1"),
        (lambda: kaju.export_page(3, "x.html"), ParameterError, "a result is needed, got 3"),
        (lambda: creep(BLOCK, "step"), ParameterError, "history: must be a History.* got 'step'"),
        (lambda: solve(BLOCK, tolerence=0.1), ParameterError, "did you mean 'tolerance'"),
        (lambda: LoadModel(BLOCK).run(until=0.5), ParameterError, "until: .*, got 0.5"),
        (lambda: solve(BLOCK).displacement_at("middle"), ResultError, "points: must be numbers"),
    ],
)
def test_other_things_that_are_no_scene_or_result(call, kind, told):
    with pytest.raises(kind, match=told):
        call()


@pytest.mark.parametrize(
    ("what", "option", "told"),
    [
        ("agents", "magnification", "'agents' has no such argument"),
        ("agents", "generatoin", "did you mean 'generation'"),
        ("stress", "components", "did you mean 'component'"),
    ],
)
def test_pictures_name_the_options_that_they_have(what, option, told):
    with pytest.raises(ParameterError, match=f"{option}: .*{told}"):
        kaju.plot(LoadModel(BLOCK).run(), what, **{option: 1})


def test_a_sweep_of_more_points_than_anybody_waits_for_is_refused():
    many = {f"loads.0.force.{axis}": range(10**6) for axis in range(2)}
    with pytest.raises(ParameterError, match=r"1,000,000,000,000 combinations"):
        kaju.sweep(BLOCK, many)


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "pipe", "/dev/zero", "."])
@pytest.mark.parametrize(
    "reader",
    [
        kaju.load_scene,
        kaju.load_result,
        lambda path: Scene.from_array(path, legend={1: "steel"}, cell_size=0.1),
        lambda path: Scene.from_image(path, legend={"black": "steel"}, cell_size=0.1),
    ],
)
def test_what_is_no_file_to_read_is_refused_at_once(tmp_path, monkeypatch, name, reader):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    with pytest.raises(KajuError, match="cannot be read: "):
        reader(name)
