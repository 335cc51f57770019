"""The examples of agents of one's own: each runs, and shows what it says."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from kaju import MaterialAgent, RigidBoundaryAgent, ThreeElement

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("absorbing_wall", "breaking", "memory", "random_shares", "tired")


def example(name):
    return runpy.run_path(str(EXAMPLES / name / "run.py"))


@pytest.mark.parametrize("name", NAMES)
def test_it_runs_as_its_folder_says(name, capsys):
    runpy.run_path(str(EXAMPLES / name / "run.py"), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) >= 2
    assert "python run.py" in (EXAMPLES / name / "README.md").read_text()


def test_a_bundle_breaks_bar_by_bar():
    applied, felt = example("breaking")["load_path"]()
    passed_down = 0.95**6
    bars = applied / 3.0
    whole = sum(np.where(bars <= strength, bars, 0.0) for strength in (1.0, 1.5, 2.0))
    np.testing.assert_allclose(felt, passed_down * whole, rtol=1e-12)
    assert (np.diff(felt) < 0.0).sum() == 3


def test_seeds_decide_where_the_load_leans():
    run = example("random_shares")["run"]
    one, again, other = run(1), run(1), run(2)
    np.testing.assert_array_equal(one.last.taken, again.last.taken)
    assert len(one.last.cells) != len(other.last.cells)


def test_felt_absorbs_seven_tenths_of_what_reaches_it():
    run = example("absorbing_wall")["run"]
    hard, felt = run(RigidBoundaryAgent).last, run().last
    assert hard.ledger.absorbed == 0.0
    reached = felt.ledger.absorbed / 0.7
    first = 0.9**8
    assert reached == pytest.approx(first * (1 + 0.3 * 0.9**16), rel=1e-9)
    assert felt.ledger.imbalance < 1e-12


def test_a_tired_plate_sinks_further_under_the_same_stress():
    run = example("tired")["run"]
    fresh, tired = run(MaterialAgent), run()
    np.testing.assert_array_equal(fresh.stress, tired.stress)
    assert tired.displacement[:, 1].min() < 2.0 * fresh.displacement[:, 1].min() < 0.0


def test_memory_creeps_as_the_element_does():
    memory = example("memory")
    ages = np.array([0.5, 1.0, 4.0])
    element = ThreeElement(K_f=1.0, D_f=2.0, D_d=40.0)
    exact = element.creep(force=1.0, times=ages, scheme="exact")
    np.testing.assert_allclose(memory["compliance"](ages), exact, rtol=1e-12)
    sunk = [memory["run"](until) for until in (200, 240, 280)]
    assert 0.0 < sunk[0] < sunk[1] < sunk[2]
    assert sunk[2] - sunk[1] == pytest.approx(sunk[1] - sunk[0], rel=1e-9), "a steady pace"
