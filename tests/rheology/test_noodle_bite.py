"""The noodle example: it runs, and shows what its page says it shows."""

import json
from pathlib import Path

import numpy as np
import pytest
from scripts import script

FOLDER = Path(__file__).parents[2] / "examples" / "noodle_bite"
noodle = script(FOLDER / "noodle.py")
SHORT = noodle.Meal(chews=2, hold=2.0, rest=3.0)


@pytest.fixture(scope="module")
def firm():
    return noodle.eat(noodle.FIRM, 5, SHORT)


@pytest.fixture(scope="module")
def soft():
    return noodle.eat(noodle.SOFT, 5, SHORT)


@pytest.mark.slow
def test_a_held_noodle_gives_on_and_what_flowed_stays(firm, soft):
    for bite in (firm, soft):
        times, dent = bite.course.times, bite.dent
        held = (times >= SHORT.press) & (times <= SHORT.press + SHORT.hold)
        assert np.all(np.diff(dent[held]) > 0.0)
        assert np.all(bite.force[bite.released + 1 : bite.rested] == 0.0)
        assert dent[bite.released] > dent[bite.released + 1] > dent[bite.rested] > 0.0
        first, second, third = bite.deepest
        assert second < third < first
        assert dent[-1] > dent[bite.rested]
    assert firm.deepest[0] < soft.deepest[0]
    assert firm.dent[-1] / firm.deepest[0] < soft.dent[-1] / soft.deepest[0]


@pytest.mark.slow  # draws a film of half a minute
def test_the_script_writes_pictures_and_figures(tmp_path):
    summary = script(FOLDER / "run.py").main(["--out", str(tmp_path), "--rows", "3"])
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    for name in ("force_time.png", "shapes.png", "bite.gif"):
        assert (tmp_path / name).stat().st_size > 1000
