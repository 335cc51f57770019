"""The network step by step."""

import numpy as np
import pytest

from kaju import NetworkModel
from kaju.errors import BucklingError
from kaju.model.network import load_in_increments, solve, triangular


def test_a_step_is_an_increment():
    model = NetworkModel(triangular(5), increments=4)
    assert (model.steps, model.stage, model.running) == (0, 0.0, True)
    model.step()
    assert (model.steps, model.stage, model.running) == (1, 0.25, True)
    assert model.result().increments == 1
    result = model.run(progress=False)
    assert (model.steps, model.stage, model.running) == (4, 1.0, False)
    assert np.array_equal(result.displacement, solve(triangular(5), 4).displacement)
    assert np.array_equal(model.positions, result.positions())
    model.step()
    assert model.steps == 4


def test_it_runs_so_many_steps_or_until_a_yes():
    model = NetworkModel(triangular(5), increments=6)
    assert model.run(2).increments == 2
    assert model.run(lambda now: now.stage > 0.6).increments == 4


def test_euler_is_a_scheme_of_the_model_too():
    result = NetworkModel(triangular(5), increments=4, scheme="euler").run()
    assert np.array_equal(result.displacement, load_in_increments(triangular(5), 4).displacement)


def test_a_model_that_buckles_stops_at_what_it_reached():
    model = NetworkModel(triangular(5, force=1.0), increments=10)
    with pytest.raises(BucklingError):
        model.run()
    assert not model.running
    assert 0.39 < model.stage < 0.4
    assert model.result().stage[-1] == model.stage
