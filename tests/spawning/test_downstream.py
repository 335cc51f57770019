"""Spawned agents compared with other answers, and on the command line."""

import json
from pathlib import Path

import pytest
from PIL import Image

from kaju import ElasticResult, Reference, compare, load_scene, solve

ROOT = Path(__file__).parents[2]
PLATE = str(ROOT / "examples" / "plate.toml")
ELEMENTS = ROOT / "tests" / "data" / "plate_finite_elements.npz"


@pytest.fixture(scope="module")
def scene():
    return load_scene(PLATE).with_overrides({"loads.0.steps": 1})


@pytest.fixture(scope="module")
def spawned(scene):
    return solve(scene, tolerance=0.005)


def test_spawned_agents_and_equal_cells_tell_the_same(scene, spawned):
    uniform = solve(scene, resolution=16)
    for found in (compare(spawned, uniform), compare(uniform, spawned)):
        assert set(found.names) == {"spawned agents", "elasticity"}
        assert len(found.points) == 400
        assert found.displacement.max_error < 3e-3
        assert found.stress.l2_error < 3e-3
        assert found.energy_error < 0.02


def test_spawned_agents_are_judged_by_finite_elements(spawned):
    found = compare(spawned, Reference.load(ELEMENTS))
    assert found.names[0] == "spawned agents"
    assert found.displacement.l2_error < 2e-3


@pytest.mark.slow
def test_scene_is_solved_by_spawning_as_the_command_asks(kaju):
    before = Path(PLATE).read_bytes()
    spawning_words = ("--tolerance", "0.1", "--pictures", "all")
    code, out, _ = kaju("solve", PLATE, "--out", "agents", *spawning_words)
    assert code == 0
    summary = json.loads(Path("agents/summary.json").read_text())
    assert (summary["method"], summary["tolerance"]) == ("agents with two opinions", 0.1)
    assert summary["error_bound"] <= 0.1
    names = {path.name for path in Path("agents").iterdir()}
    assert {"result.npz", "agents.png", "von_mises.png", "deformed.png"} <= names
    assert ElasticResult.load("agents/result.npz").spawned
    assert Path(PLATE).read_bytes() == before

    assert kaju("solve", PLATE, "--out", "cells", "--no-pictures")[0] == 0
    code, out, _ = kaju("compare", "agents", "cells", "--out", "errors")
    assert code == 0
    assert "spawned agents against elasticity, 400 points" in out
    assert Path("errors/error_displacement.png").is_file()

    code, out, _ = kaju("animate", "agents", "--what", "gaps", "--fps", "4")
    assert code == 0
    with Image.open(out.strip()) as film:
        assert film.n_frames == summary["generations"]


def test_what_was_computed_short_of_the_tolerance_is_kept(kaju, monkeypatch):
    monkeypatch.setattr("kaju.model.elastic.pair.loop.MOST_AGENTS", 300)
    code, out, err = kaju("solve", PLATE, "--tolerance", "0.001", "--out", "here")
    assert code == 2
    assert "more than the 300 allowed" in err
    assert str(Path("here/result.npz")) in out
    assert 100 < ElasticResult.load("here/result.npz").agents <= 300
