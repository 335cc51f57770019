"""The Mesa model: steps, stages, ends."""

import numpy as np
from plates import plate as pressed
from transfer_answers import ENGINES

from kaju import LoadModel, PrescribedRule


def plate(steps=1, **rule):
    how = {"size": [0.2, 0.2], "thickness": 0.002, "rule": PrescribedRule(**rule)}
    return pressed([20, 20], [10, 19], steps=steps, **how)


@ENGINES
def test_a_step_is_one_generation(engine):
    model = LoadModel(plate(), engine=engine)
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
    result = LoadModel(plate(steps=20), engine=engine).run()
    assert len(result.stages) == 20
    np.testing.assert_allclose(
        [stage.ledger.applied for stage in result.stages], np.linspace(0.1, 2.0, 20)
    )
    alone = LoadModel(plate(), engine=engine).run()
    assert result.summary() | {"seconds": 0} == alone.summary() | {"seconds": 0}
    reached = [len(stage.cells) for stage in result.stages]
    assert reached == sorted(reached)
    assert result.at_stage(20).last is result.last
    taken = np.array([stage.ledger.taken for stage in result.stages])
    assert not np.allclose(taken, np.linspace(0.05, 1, 20) * taken[-1], rtol=0.05), "not linear"


@ENGINES
def test_below_the_threshold_nothing_happens(engine):
    result = LoadModel(plate(threshold=2.0), engine=engine).run()
    stage = result.last
    assert (len(stage.cells), stage.generations) == (0, 0)
    assert stage.outcome == "no load exceeds the threshold of 2 N: nothing happens"
    assert stage.ledger.dropped == 2.0
    assert result.summary()["max_displacement"] == 0.0
    assert np.all(result.displacement_at(np.array([[0.1, 0.1]])) == 0.0)


@ENGINES
def test_a_run_can_be_looked_at_half_way(engine):
    model = LoadModel(plate(), engine=engine)
    for _ in range(3):
        model.step()
    stage = model.result().last
    assert stage.outcome == "interrupted after 3 generations"
    assert stage.ledger.pending > 0.0
    assert stage.ledger.imbalance < 1e-12
    assert stage.history.generation.max() == 3
