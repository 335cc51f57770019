"""Every hook for agents of one's own has an example that runs, is short, and pins a number."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from kaju import Cubes, LoadModel, MaterialAgent, Scene, solve
from kaju.errors import SceneError

EXAMPLES = Path(__file__).parents[2] / "examples"
HOOKS = sorted(path.stem for path in (EXAMPLES / "own_agents").glob("*.py"))


def example(name):
    return runpy.run_path(str(EXAMPLES / name))


@pytest.mark.parametrize("name", HOOKS)
def test_it_is_short_and_runs(name, capsys):
    path = EXAMPLES / "own_agents" / f"{name}.py"
    assert len(path.read_text().splitlines()) <= 40
    assert f"`{name}.py`" in (path.parent / "README.md").read_text()
    runpy.run_path(str(path), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) in (1, 2, 3)


def test_every_hook_has_one():
    text = "".join((EXAMPLES / "own_agents" / f"{name}.py").read_text() for name in HOOKS)
    for hook in ("take", "emissions", "pass_on", "shortening", "give_back"):
        assert f"def {hook}(self, " in text
    assert "order=" in text
    assert text.count('body={"lattice": ') == 2


def test_agents_that_yield_bear_no_more_than_their_limit():
    largest = example("own_agents/take.py")["largest_stress"]
    area = 0.01 * 0.002
    assert largest(0.2) == pytest.approx(0.2 / area, rel=1e-12)
    assert largest(10.0) == pytest.approx(1.125 / area, rel=1e-12), "as without a limit"


def test_wind_drives_loads_to_the_right():
    lean = example("own_agents/emissions.py")["lean"]
    assert lean(0.0) == pytest.approx(0.0, abs=1e-12)
    assert lean(0.2) == pytest.approx(3.61e-3, abs=0.01e-3)


def test_a_tenth_less_from_cell_to_cell():
    reaches = example("own_agents/pass_on.py")["reaches"]
    # 2 N * (1 - loss)^n falls to 0.1 N or below after n cells.
    for loss, cells in ((0.3, 9), (0.5, 5)):
        assert reaches(loss) == cells == 1 + int(np.log(20.0) / -np.log(1.0 - loss))


def test_agents_harden_after_so_many_loads():
    sinks = example("own_agents/shortening.py")["sinks"]
    assert sinks(3) == pytest.approx(3.127e-9, rel=1e-3)
    assert sinks(1) < sinks(3) < sinks(10)


def test_felt_keeps_what_it_does_not_give_back():
    absorbed = example("own_agents/give_back.py")["absorbed"]
    assert absorbed(0.0) == pytest.approx(0.9**8, rel=1e-12)
    assert absorbed(1.0) == pytest.approx(0.0, abs=1e-12)


def test_an_order_changes_who_acts_when_and_not_how_much_in_all():
    own = example("own_agents/own_order.py")
    once, lowest = (own["run"](own[name]).last for name in ("all_at_once", "lowest_first"))
    assert (once.generations, lowest.generations) == (7, 84)
    assert lowest.ledger.taken == pytest.approx(once.ledger.taken, rel=1e-12)


def test_a_diamond_has_two_neighbours_ahead():
    result = example("own_agents/lattice_in_the_plane.py")["run"]()
    assert len(result.last.cells) == 31
    assert result.last.ledger.imbalance < 1e-12


def test_cubes_with_a_grain_pass_on_along_it_alone():
    own = example("own_agents/lattice_in_space.py")
    assert own["spread"](own["run"](own["Grained"])) == (7, 1)
    assert own["spread"](own["run"](Cubes)) == (7, 7)
    scene = own["run"](own["Grained"]).scene
    arrays = LoadModel(scene, engine="arrays").run()
    objects = LoadModel(scene, material_agent=type("Own", (MaterialAgent,), {})).run()
    assert arrays.last.ledger.taken == pytest.approx(objects.last.ledger.taken, rel=1e-12)
    assert solve(scene).strain_energy > 0.0


def test_ways_that_name_no_face_are_refused():
    class Wrong(Cubes):
        kind = "wrong cube"

        def way(self, direction, form):
            return super().way(direction, form)._replace(ahead=((9, 1.0),))

    with pytest.raises(SceneError, match="way of Wrong: along direction 0 must name faces"):
        Scene(body={"lattice": Wrong, "cells": [2, 2, 2], "cell_size": 0.1, "material": "oak"})


def test_a_curve_loads_the_outer_half_of_the_ring():
    tyre = example("tyre/run.py")
    straight, curve = (tyre["outer_half"](tyre["run"](part)) for part in (0.0, 0.6))
    assert straight[0] == pytest.approx(0.5, abs=1e-9)
    assert curve[0] == pytest.approx(0.702, abs=5e-4)
    assert f"{curve[0]:.1%}".replace("%", " %") in (EXAMPLES / "tyre" / "README.md").read_text()


def test_a_tense_muscle_gives_less_and_less():
    stretch = example("muscle/run.py")["stretch"]
    for gain, times in ((0.0, 2.0), (2.0, 1.79), (10.0, 1.44)):
        assert stretch(1.0, gain) / stretch(0.5, gain) == pytest.approx(times, abs=5e-3)
