"""Every example runs, and each pins one number."""

import sys
from pathlib import Path

import pytest

from kaju import LoadModel, creep, load_scene

EXAMPLES = Path(__file__).parents[1] / "examples"
HEADINGS = (
    "What is it?",
    "How it works",
    "How to use it",
    "Things to notice",
    "Things to try",
    "Extending the model",
    "Related models",
    "Credits",
)
AGENTS = {"plate": 34, "punch": 44, "layers": 112, "cube": 60, "honeycomb": 39, "arch": 54}
CREEPING = {"jelly": 3.2147e-4}
"""Scenes with a history: what stays of the displacement (m)."""


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
    assert {path.stem for path in EXAMPLES.glob("*.toml")} == {*AGENTS, *CREEPING}


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("*.toml")), ids=lambda path: path.stem)
def test_an_example_is_told(path):
    text = path.with_suffix(".md").read_text()
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == list(HEADINGS)


def test_the_arch_is_what_its_script_draws(monkeypatch):
    import numpy as np
    from PIL import Image

    monkeypatch.syspath_prepend(str(EXAMPLES))
    import draw_arch

    drawn = np.asarray(draw_arch.draw())
    np.testing.assert_array_equal(
        drawn, np.asarray(Image.open(EXAMPLES / "arch.png").convert("RGB"))
    )
    del sys.modules["draw_arch"]
