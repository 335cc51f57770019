"""The verb `grow`: a bridge that designs itself, from its file to a folder."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import kaju
from kaju.cli import app

BRIDGE = Path(__file__).parents[2] / "examples" / "bridge" / "bridge.toml"


def told(*words):
    answer = CliRunner().invoke(app, [*map(str, words)], catch_exceptions=False)
    assert answer.exit_code == 0
    return answer.stdout


def test_the_bridge_grows(tmp_path):
    out = tmp_path / "grown"
    words = ["--volume", "30%", "--radius", 2, "--steps", 12, "--json"]
    figures = json.loads(told("grow", BRIDGE, "--out", out, *words))
    assert figures["outcome"] == "ended after 12 steps, as asked"
    assert figures["volume"] == pytest.approx(0.3, rel=1e-12)
    assert figures["compliance_J"] < 0.2 * figures["compliance_at_first_J"]
    result = kaju.load_result(out)
    assert result.compliance == figures["compliance_J"]
    density = result.density
    # The right abutment slides, so a tie holds the feet of the arch together.
    assert density[30:50, 1].min() > 0.9
    assert density[20:60, 5:12].mean() < 0.2 < density[20:60, 25:].mean()
    assert sorted(path.name for path in out.iterdir()) == [
        *("design.png", "result.npz", "summary.json")
    ]
    assert "the volume is held" in told("check", out)


def test_what_has_grown_is_kept_after_ctrl_c(monkeypatch):
    model = kaju.GrowthModel(kaju.load_scene(BRIDGE), volume=0.3, most_steps=50)
    monkeypatch.setattr("kaju.stepping.interrupt_requested", lambda: model.steps >= 3)
    result = model.run()
    assert result.steps == 3
    assert result.outcome == ""
    assert result.compliance == model.compliance
