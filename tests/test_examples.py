"""Every example runs, and each pins one number."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import kaju
from kaju import LoadModel, creep, load_scene

EXAMPLES = Path(__file__).parents[1] / "examples"
HEADINGS = ["What is it?", "How it works", "How to use it", "Things to notice"]
HEADINGS += ["Things to try", "Extending the model", "Related models", "Credits"]
AGENTS = {"plate": 34, "punch": 44, "layers": 112, "cube": 60, "honeycomb": 39, "arch": 54}
CREEPING = {"jelly": 3.4555e-4}
"""Scenes with a history: what stays of the displacement (m)."""
OUTLINED = {"lug": 0.09758, "pore": 0.2226}
"""Scenes with true outlines: the energy (J)."""


@pytest.mark.parametrize(("name", "tolerance"), [("lug", 0.1), ("pore", None)])
def test_an_example_is_solved_within_its_outlines(name, tolerance):
    answer = kaju.solve(load_scene(EXAMPLES / f"{name}.toml"), tolerance=tolerance)
    assert answer.strain_energy == pytest.approx(OUTLINED[name], rel=0.02)
    if answer.scene.lattice.dimension == 2:
        assert answer.energy_bounds[0] < OUTLINED[name] < answer.energy_bounds[1]


@pytest.mark.parametrize("name", sorted(CREEPING))
def test_an_example_creeps(name):
    course = creep(load_scene(EXAMPLES / f"{name}.toml"))
    assert course.what_stays() == pytest.approx(CREEPING[name], rel=1e-3)


@pytest.mark.parametrize("name", sorted(AGENTS))
def test_an_example_runs(name):
    result = LoadModel(load_scene(EXAMPLES / f"{name}.toml")).run()
    assert len(result.last.cells) == AGENTS[name]
    assert result.last.outcome.startswith("at rest")


def test_every_scene_is_among_them():
    assert {path.stem for path in EXAMPLES.glob("*.toml")} == {*AGENTS, *CREEPING, *OUTLINED}


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("*.toml")), ids=lambda path: path.stem)
def test_an_example_is_told(path):
    text = path.with_suffix(".md").read_text()
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == HEADINGS


def test_the_arch_is_what_its_script_draws():
    drawn = runpy.run_path(str(EXAMPLES / "draw_arch.py"))["draw"]()
    kept = Image.open(EXAMPLES / "arch.png").convert("RGB")
    np.testing.assert_array_equal(np.asarray(drawn), np.asarray(kept))


def test_the_plate_of_the_package_is_the_example():
    installed = Path(kaju.__file__).with_name("plate.toml")
    assert installed.read_bytes() == (EXAMPLES / "plate.toml").read_bytes()
