"""Pushes and pulls: what changes when loads have a sense."""

import numpy as np
import pytest
from plates import loaded
from transfer_answers import ENGINES, of_cells

from kaju import LoadModel, PrescribedRule
from kaju.errors import ParameterError

STRAIGHT = PrescribedRule(alpha=(0.5, 0.8, 0.0), beta=1.0, threshold=0.05, sense=True)
DOWN, UP = 2, 3


def column(force, rule=STRAIGHT, cells=4, bottom="rigid"):
    sides, load = {"bottom": bottom}, {"side": "top", "force": [0.0, force]}
    return loaded([1, cells], load, sides=sides, rule=rule, allow_floating=True)


def test_shares_are_0_or_more_with_a_sense_too(monkeypatch):
    own = PrescribedRule.shares
    monkeypatch.setattr(PrescribedRule, "shares", lambda *of: own(*of)._replace(forward=-0.1))
    with pytest.raises(ParameterError, match=r"the share 'forward' = -0\.1"):
        LoadModel(column(-1.0))


def assert_negative(pulled, pushed):
    for name in ("displacement", "stress", "strain"):
        one, other = (of_cells(result, getattr(result, name)) for result in (pulled, pushed))
        assert one.keys() == other.keys()
        for cell, value in one.items():
            np.testing.assert_allclose(value, -other[cell], rtol=1e-12, atol=1e-30)


@ENGINES
def test_a_column_of_four(engine):
    """The reference of an independent program."""
    pushed = LoadModel(column(-1.0), engine=engine).run()
    stage = pushed.last
    assert (stage.generations, len(stage.cells), len(stage.boundary_cells)) == (14, 4, 2)
    assert stage.ledger.taken == pytest.approx(4.780098, abs=5e-7)
    from_the_top = np.argsort(-stage.cells[:, 1])
    push_less_pull = (stage.taken - 2.0 * stage.pulled).sum(axis=1)[from_the_top]
    np.testing.assert_allclose(push_less_pull, [1.041943, 0.927926, 0.80533, 0.766981], atol=5e-7)
    top, bottom = from_the_top[[0, -1]]
    pushes = stage.taken - stage.pulled
    np.testing.assert_allclose(pushes[top], [0, 0, 1.0, 0.209715], atol=5e-7)
    np.testing.assert_allclose(stage.pulled[top], [0, 0, 0, 0.167772], atol=5e-7)
    np.testing.assert_allclose(pushes[bottom], [0, 0, 0.512, 0.4096], atol=5e-7)
    np.testing.assert_allclose(stage.pulled[bottom], [0, 0, 0.068719, 0.085899], atol=5e-7)
    pulled = LoadModel(column(1.0), engine=engine).run()
    assert pulled.last.generations == 14
    assert pulled.last.ledger.taken == stage.ledger.taken
    assert_negative(pulled, pushed)
    assert pulled.displacement[0, 1] > 0.0, "the bar gets longer"


@ENGINES
def test_supports_answer_what_reached_them(engine):
    """The ground gave back all that the bottom cell of the column took upwards, and downwards."""
    pushed, pulled = (LoadModel(column(force), engine=engine).run() for force in (-1.0, 1.0))
    assert list(pushed.reactions) == ["bottom"]
    np.testing.assert_allclose(pushed.reactions["bottom"], [0, 0.4096 - 0.068719], atol=5e-7)
    np.testing.assert_allclose(pulled.reactions["bottom"], -pushed.reactions["bottom"])
    assert pushed.summary()["reaction"] == {"bottom": pushed.reactions["bottom"].tolist()}
    # A roller answers across its side alone, rigid ground along it, too.
    load, sides = {"cell": [1, 2], "force": [-2.0, -3.0]}, {"bottom": "rigid", "left": "roller"}
    rule = PrescribedRule(alpha=(0.5, 0.5, 0.25), beta=0.5, threshold=0.01)
    found = LoadModel(loaded([5, 5], load, sides=sides, rule=rule), engine=engine).run().reactions
    assert found["left"][0] > 0.0 == found["left"][1]
    assert found["bottom"].min() > 0.0


@ENGINES
@pytest.mark.parametrize(
    ("side", "sense", "direction"), [("free", "pull", DOWN), ("rigid", "push", UP)]
)
def test_what_comes_back_from_an_end(engine, side, sense, direction):
    """A free end answers as a wave's does; a rigid one keeps the sense and turns the force."""
    rule = PrescribedRule(alpha=(0.5, 0.8, 0.0), beta=1.0, threshold=0.7, sense=True)
    stage = LoadModel(column(-1.0, rule, cells=1, bottom=side), engine=engine).run().last
    assert stage.generations == 2
    last = stage.history.generation == 2
    assert stage.history.load[last].tolist() == [0.8]
    assert stage.history.direction[last].tolist() == [direction]
    assert stage.history.pull[last].tolist() == [sense == "pull"]
    stretched = stage.kept[0, 1]
    assert stretched == pytest.approx(0.5 * (1.0 + (-0.8 if sense == "pull" else 0.8)))


@ENGINES
def test_a_stretched_cell_pulls_its_neighbours_inwards(engine):
    load = {"cell": [1, 0], "side": "top", "force": [0.0, 1.0]}
    rule = PrescribedRule(alpha=(0.5, 0.0, 0.0), beta=0.0, threshold=0.1, sense=True)
    scene = loaded([3, 1], load, sides={}, allow_floating=True, rule=rule)
    result = LoadModel(scene, engine=engine).run()
    pulled = of_cells(result, result.last.pulled.tolist())
    assert pulled[1, 0] == [0, 0, 0, 1.0]
    assert pulled[0, 0] == [0, 0.15, 0, 0], "the force on the left cell points right, inwards"
    assert pulled[2, 0] == [0.15, 0, 0, 0]


@pytest.mark.parametrize(("load", "pulls"), [
    ({"cell": [2, 4], "force": [0.0, 1.0]}, True),
    ({"cell": [2, 4], "force": [0.0, -1.0]}, False),
    ({"cell": [2, 4], "side": "top", "force": [1.0, 0.0]}, False),
    ({"cell": [4, 2], "force": [1.0, 0.0]}, True),
    ({"cell": [2, 2], "force": [0.0, 1.0], "sense": "pull"}, True),
    ({"cell": [2, 4], "force": [0.0, 1.0], "sense": "push"}, False),
    ({"side": "top", "pressure": -1e4}, True),
    ({"side": "top", "pressure": 1e4}, False),
    ({"region": {"box": [[0.0, 0.05], [0.05, 0.05]]}, "force": [0.0, 1.0]}, True),
])  # fmt: skip
def test_which_forces_pull(load, pulls):
    scene = loaded([5, 5], load, rule=PrescribedRule(threshold=0.01, sense=True), thickness=1.0)
    model = LoadModel(scene, engine="arrays")
    model.step()
    assert model.result().last.history.pull.all() == pulls
    literal = LoadModel(scene.replace(rule=PrescribedRule(threshold=0.01))).run()
    assert any("every load squeezes" in note for note in literal.notes) == pulls
    (note,) = LoadModel(scene).run().notes
    assert note.startswith("the prescribed rule keeps no equilibrium")
