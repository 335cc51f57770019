"""What is handed over by mistake is named, with what would be right."""

import os
from pathlib import Path

import pytest

import kaju
from kaju import LoadModel, Scene, creep, solve
from kaju.errors import KajuError, ParameterError, ResultError
from kaju.model.scene.shared_materials import shared_materials


def block(**more):
    return Scene(
        body={"cell_size": 0.01, "cells": [4, 3], "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [1, 2], "force": [0.0, -2.0]}],
        **more,
    )


@pytest.mark.parametrize(
    "taker", [LoadModel, kaju.ElasticModel, kaju.SpawningModel, kaju.stability]
)
def test_a_file_name_is_no_scene(taker):
    with pytest.raises(
        ParameterError, match=r"a Scene is needed, got 'plate.toml'; kaju.load_scene"
    ):
        taker("plate.toml")


@pytest.mark.parametrize("given", ["plate.toml", Path("plate.toml"), 3])
def test_a_file_name_is_no_text(given):
    with pytest.raises(ParameterError, match=r"text: .*kaju.load_scene"):
        kaju.Scene.from_toml(given)


def test_other_things_that_are_no_scene_or_result(tmp_path):
    with pytest.raises(ParameterError, match="scene: a Scene is needed, got 1"):
        kaju.fit_rule(1, 2)
    with pytest.raises(ParameterError, match="a scene, a model or a result is needed, got 3"):
        kaju.export_page(3, tmp_path / "x.html")
    with pytest.raises(ParameterError, match="history: a History is needed, got 'step'"):
        creep(block(), "step")
    with pytest.raises(ParameterError, match=r"until: a function of the model, or .*, got 0.5"):
        LoadModel(block()).run(until=0.5)
    with pytest.raises(ResultError, match="points: must be numbers"):
        solve(block()).displacement_at("middle")


@pytest.mark.parametrize(
    ("what", "option", "told"),
    [
        ("agents", "generation", "'agents' has no such option; it has cut, crop"),
        ("loads", "generatoin", "did you mean 'generation'"),
        ("ledger", "cut", "it has none"),
        ("stress", "components", "did you mean 'component'"),
    ],
)
def test_pictures_name_the_options_that_they_have(what, option, told):
    with pytest.raises(ParameterError, match=f"{option}: .*{told}"):
        kaju.plot(LoadModel(block()).run(), what, **{option: 1})


@pytest.mark.parametrize(
    "options",
    [
        {"title": 5},
        {"title": "\ud800"},
        {"text": [1]},
        {"presets": [1]},
        {"presets": {"a": "b"}},
        {"presets": {1: "b"}},
        {"language": "fr"},
    ],
)
def test_options_of_pages_are_checked_by_type(tmp_path, options):
    with pytest.raises(ParameterError, match=f"{next(iter(options))}: "):
        kaju.export_page(block(), tmp_path / "x.html", **options)
    assert not list(tmp_path.iterdir())


def test_a_sweep_of_more_points_than_anybody_waits_for_is_refused():
    many = {f"loads.0.force.{axis}": range(10**6) for axis in range(2)}
    with pytest.raises(ParameterError, match=r"1,000,000,000,000 combinations"):
        kaju.sweep(block(), many)


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "pipe", "/dev/zero", "."])
@pytest.mark.parametrize(
    "reader",
    [
        kaju.load_scene,
        kaju.load_result,
        shared_materials,
        lambda path: Scene.from_array(path, legend={1: "steel"}, cell_size=0.1),
        lambda path: Scene.from_image(path, legend={"black": "steel"}, cell_size=0.1),
    ],
)
def test_what_is_no_file_to_read_is_refused_at_once(tmp_path, monkeypatch, name, reader):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    with pytest.raises(KajuError, match="cannot be read: "):
        reader(name)
