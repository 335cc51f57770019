"""The verb `break`: a body with a notch, pulled apart by its top."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import kaju
from kaju.cli import app

NOTCHED = """
[body]
lattice = "hexagon"
cell_size = 0.01
cells = [12, 10]
thickness = 0.005
material = "rubber"
[sides]
bottom = "rigid"
top = { displacement = [0.0, 1e-4] }
[[regions]]
box = [[0.0, 0.03], [0.03, 0.045]]
material = "air"
"""


def test_a_notched_body_parts_where_it_is_notched(tmp_path):
    scene = tmp_path / "notched.toml"
    scene.write_text(NOTCHED)
    words = ["break", scene, "--out", tmp_path / "broken", "--strength", 0.1, "--scatter", "20%"]
    told = CliRunner().invoke(app, [*map(str, words), "--json"], catch_exceptions=False)
    assert told.exit_code == 0
    figures = json.loads(told.stdout)
    assert figures["outcome"].startswith("parted")
    result = kaju.load_result(tmp_path / "broken")
    assert result.breaks == figures["breaks"] > 10
    ends = result.network.positions[result.network.springs[result.broken]]
    height = ends[:, :, 1].mean()
    assert 0.02 < height < 0.055
    assert sorted(path.name for path in (tmp_path / "broken").iterdir()) == [
        *("crack.png", "result.npz", "summary.json")
    ]


def test_the_example_cracks_from_its_notch_to_the_other_side(tmp_path):
    scene = Path(__file__).parents[2] / "examples" / "notch" / "notch.toml"
    words = ["break", scene, "--out", tmp_path / "broken", "--strength", 50e6, "--scatter", "20%"]
    told = CliRunner().invoke(app, [*map(str, words), "--json"], catch_exceptions=False)
    assert json.loads(told.stdout)["outcome"].startswith("parted")
    history = kaju.load_result(tmp_path / "broken").history
    assert history["x_m"].idxmin() == 0
    assert history["x_m"][0] == pytest.approx(0.0525)
    assert history["x_m"].max() > 0.19
    assert (abs(history["y_m"] - 0.105) < 0.02).all()
