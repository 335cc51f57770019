"""The worked examples of the method's description, and what steps, turns and stages do."""

import numpy as np
import pytest
from plates import PLATE, loaded, plate
from transfer_answers import ENGINES, of_cells

from kaju import LoadModel, PrescribedRule, Scene

DOWN = 2


@ENGINES
@pytest.mark.parametrize(("threshold", "generations", "agents", "boundary", "taken", "column"), [
    (1e-2, 8, 34, 4, 12.879375, [2.25, 1.375, 0.875, 0.5625, 0.125, 0.0625, 2**-5, 2**-6]),
    (1e-3, 11, 85, 13, 21.104765625, [2.296875, 1.5034375, 1.06765625, 0.5625, 0.359375]),
    (1e-4, 15, 149, 22, 31.9290087890625, [2.306640625, 1.5502734375, 1.148671875, 0.79078125]),
])  # fmt: skip
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


def worked(steps=1, **rule):
    how = {"size": [0.2, 0.2], "thickness": 0.002, "rule": PrescribedRule(**rule)}
    return plate([20, 20], [10, 19], steps=steps, **how)


@ENGINES
def test_a_step_is_one_generation(engine):
    model = LoadModel(worked(), engine=engine)
    reached = []
    while model.running:
        model.step()
        reached.append(len(model.result().last.cells))
    assert model.generation == model.steps == len(reached) == 8
    assert reached[0] == 4, "the pressed cell, and those ahead and beside that it has woken"
    assert reached == sorted(reached)
    assert reached[-1] == 34


@ENGINES
def test_stages_repeat_the_run_with_more_load(engine):
    result = LoadModel(worked(steps=20), engine=engine).run()
    assert len(result.stages) == 20
    np.testing.assert_allclose(
        [stage.ledger.applied for stage in result.stages], np.linspace(0.1, 2.0, 20)
    )
    alone = LoadModel(worked(), engine=engine).run()
    assert result.summary() | {"seconds": 0} == alone.summary() | {"seconds": 0}
    reached = [len(stage.cells) for stage in result.stages]
    assert reached == sorted(reached)
    assert result.at_stage(20).last is result.last
    taken = np.array([stage.ledger.taken for stage in result.stages])
    assert not np.allclose(taken, np.linspace(0.05, 1, 20) * taken[-1], rtol=0.05), "not linear"


def test_each_load_by_itself_is_superposition():
    """Judged one by one, two loads do exactly what they do alone, added up."""
    left, right = {"cell": [1, 3], "force": [0.0, -2.0]}, {"cell": [4, 3], "force": [0.5, -1.0]}

    def taken(*loads):
        scene = loaded([7, 4], *loads, thickness=0.01, rule=PrescribedRule(threshold=1e-3))
        result = LoadModel(scene, engine="arrays").run()
        return of_cells(result, result.last.taken)

    alone = [taken(left), taken(right)]
    for cell, values in taken(left, right).items():
        parts = [table[cell] for table in alone if cell in table]
        np.testing.assert_allclose(values, sum(parts), rtol=1e-13)
