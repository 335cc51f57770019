"""Examples of agents of one's own: all run and pin a number, and each hook has a short one."""

import runpy

import numpy as np
import pytest
from exact_creep import exactly_crept
from plates import loaded
from plates import plate as pressed
from strategies import EXAMPLES

from kaju import Cubes, LoadModel, ThreeElement, load_result
from kaju.errors import SceneError

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


@pytest.mark.parametrize("name", ["breaking", "memory"])
def test_a_whole_example_runs_as_its_folder_says(name, capsys):
    runpy.run_path(str(EXAMPLES / name / "run.py"), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) >= 2
    assert "python run.py" in (EXAMPLES / name / "README.md").read_text()


def test_a_tenth_less_from_cell_to_cell():
    reaches = example("own_agents/pass_on.py")["reaches"]
    # 2 N * (1 - loss)^n falls to 0.1 N or below after n cells.
    for loss, cells in ((0.3, 9), (0.5, 5)):
        assert reaches(loss) == cells == 1 + int(np.log(20.0) / -np.log(1.0 - loss))


def test_a_seed_is_kept_with_what_was_drawn_from_it(tmp_path):
    own, scene = example("own_agents/random_shares.py")["Fickle"], pressed([6, 6], [3, 5])
    first = load_result(LoadModel(scene, material_agent=own).run().save(tmp_path / "first.npz"))
    again = LoadModel(scene, material_agent=own, rng=first.summary()["seed"]).run()
    np.testing.assert_array_equal(again.states["left"].values(), first.states["left"].values())
    assert "seed" not in LoadModel(scene, rng=3).run().summary()


def test_an_order_changes_who_acts_when_and_not_how_much_in_all():
    own = example("own_agents/own_order.py")
    once, lowest = (own["run"](own[name]).last for name in ("all_at_once", "lowest_first"))
    assert (once.generations, lowest.generations) == (7, 84)
    assert lowest.ledger.taken == pytest.approx(once.ledger.taken, rel=1e-12)


def test_who_looks_at_cracks_of_earlier_steps_need_not_act_in_an_order():
    cracks = example("own_agents/neighbours.py")["cracks"]
    assert [sum(map(bool, cracks(left))) for left in (1.0, 0.5, 0.2)] == [1, 6, 8]
    assert cracks(0.2, order=lambda waiting: waiting[::-1]) == cracks(0.2)


def test_a_diamond_has_two_neighbours_ahead():
    result = example("own_agents/lattice_in_the_plane.py")["run"]()
    assert len(result.last.cells) == 31
    assert result.last.ledger.imbalance < 1e-12


def test_ways_that_name_no_face_are_refused():
    class Wrong(Cubes):
        kind = "wrong cube"

        def way(self, direction, form):
            return super().way(direction, form)._replace(ahead=((9, 1.0),))

    with pytest.raises(SceneError, match="way of Wrong: along direction 0 must name faces"):
        loaded([2, 2, 2], lattice=Wrong)


def test_memory_creeps_as_the_element_does():
    memory = example("memory/run.py")
    ages = np.array([0.5, 1.0, 4.0])
    element = ThreeElement(K_f=1.0, D_f=2.0, D_d=40.0)
    exact = exactly_crept(element, 1.0, ages)
    np.testing.assert_allclose(memory["compliance"](ages), exact, rtol=1e-12)
    sunk = [memory["run"](until) for until in (200, 240, 280)]
    assert 0.0 < sunk[0] < sunk[1] < sunk[2]
    assert sunk[2] - sunk[1] == pytest.approx(sunk[1] - sunk[0], rel=1e-9), "a steady pace"
