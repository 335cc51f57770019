"""The worked examples of the method's description, to the last digit."""

import numpy as np
import pytest
from plates import PLATE, plate
from transfer_answers import ENGINES, of_cells

from kaju import LoadModel, PrescribedRule, Scene

DOWN = 2


@ENGINES
@pytest.mark.parametrize(
    ("threshold", "generations", "agents", "boundary", "taken", "column"),
    [
        (1e-2, 8, 34, 4, 12.879375, [2.25, 1.375, 0.875, 0.5625, 0.125, 0.0625, 2**-5, 2**-6]),
        (1e-3, 11, 85, 13, 21.104765625, [2.296875, 1.5034375, 1.06765625, 0.5625, 0.359375]),
        (1e-4, 15, 149, 22, 31.9290087890625, [2.306640625, 1.5502734375, 1.148671875, 0.79078125]),
    ],
)
def test_the_plate(engine, threshold, generations, agents, boundary, taken, column):
    model = LoadModel(Scene(**PLATE, rule=PrescribedRule(threshold=threshold)), engine=engine)
    stage = model.run().last
    assert stage.generations == generations
    assert len(stage.cells) == agents
    assert len(stage.boundary_cells) == boundary
    assert stage.ledger.taken == pytest.approx(taken, rel=1e-13)
    under = stage.cells[:, 0] == 10
    down = dict(zip(stage.cells[under, 1], stage.taken[under, DOWN], strict=True))
    found = [down[19 - depth] for depth in range(len(column))]
    np.testing.assert_allclose(found, column, rtol=1e-13)
    if threshold == 1e-2:
        assert set(down) == set(range(12, 20)), "eight cells of the column are reached"


@ENGINES
def test_the_cube(engine):
    cube = plate([10] * 3, [5, 5, 9], [0.0, 0.0, -2.0], size=[0.1] * 3)
    stage = LoadModel(cube, engine=engine).run().last
    assert stage.generations == 8
    assert len(stage.cells) == 60
    assert len(stage.boundary_cells) == 4
    assert stage.ledger.taken == pytest.approx(11.526875, rel=1e-13)


def test_one_step_of_the_rule_by_hand():
    """Of 2 N, 1 N goes ahead, 0.5 N to each side downwards and 0.15 N to each side outwards."""
    result = LoadModel(Scene(**PLATE, rule=PrescribedRule(threshold=0.4))).run()
    table = of_cells(result, result.last.taken)
    assert table[10, 19].tolist() == [0, 0, 2.0, 0]
    assert table[10, 18].tolist() == [0, 0, 1.0, 0]
    assert table[9, 19].tolist() == table[11, 19].tolist() == [0, 0, 0.5, 0]
    assert table[10, 17].tolist() == [0, 0, 0.5, 0]
    assert len(table) == 5
