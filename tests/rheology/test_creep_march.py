"""Marching through time: tolerance, order, energy, and taking a run up again."""

import numpy as np
import pytest

from kaju.errors import ConvergenceError, ParameterError, ResultError, ResultFileError
from kaju.model.rheology.creep_result import CreepState
from kaju.model.rheology.creeping import creep
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.load_history import History

ELEMENT = ThreeElement(K_f=2.0, D_f=3.0, D_d=5.0)
BITE = History().ramp(1.0, 0.2).hold(5.0).release(0.1).hold(20.0)
TIMES = np.array([0.1, 0.2, 1.0, 3.0, 5.2, 5.3, 6.0, 10.0, 25.3])


@pytest.mark.parametrize(
    ("scheme", "tolerance"),
    [("sdirk2", 1e-2), ("sdirk2", 1e-3), ("sdirk2", 1e-4), ("backward_euler", 1e-2)],
)
@pytest.mark.parametrize("drive", ["forces", "displacements"])
def test_the_tolerance_is_kept_and_the_estimate_stands_above_the_error(scheme, tolerance, drive):
    result = creep(ELEMENT, BITE, times=TIMES, tolerance=tolerance, scheme=scheme, drive=drive)
    if drive == "forces":
        exact = ELEMENT.creep(force=BITE, times=TIMES, scheme="exact")
        error = np.abs(result.displacement - exact).max() / np.abs(exact).max()
    else:
        exact = ELEMENT.relaxation(displacement=BITE, times=TIMES, scheme="exact")
        error = np.abs(result.force - exact).max() / np.abs(exact).max()
    assert error < tolerance
    assert error < result.state.error_estimate / result.state.scale


def test_a_fast_and_a_slow_process_take_few_steps():
    element = ThreeElement(K_f=1.0, D_f=1e-6, D_d=1e6)
    result = creep(element, History.step(), 1.0, times=[1e-6, 1.0], tolerance=1e-3)
    exact = element.creep(force=1.0, times=[1e-6, 1.0], scheme="exact")
    np.testing.assert_allclose(result.displacement, exact, atol=1e-3)
    assert result.state.steps < 200


@pytest.mark.parametrize("scheme", ["sdirk2", "backward_euler"])
@pytest.mark.parametrize("drive", ["forces", "displacements"])
def test_work_is_stored_dissipated_or_the_schemes_own(scheme, drive):
    result = creep(ELEMENT, BITE, times=TIMES, step=0.05, scheme=scheme, drive=drive)
    left = result.work - result.stored - result.dissipated - result.numerical
    np.testing.assert_allclose(left, 0.0, atol=1e-13 * np.abs(result.work).max())
    assert np.all(np.diff(result.dissipated) >= 0.0)
    if scheme == "backward_euler":
        assert np.all(np.diff(result.numerical) >= 0.0)
    else:
        assert np.all(np.abs(result.numerical) < 2e-4 * np.abs(result.work).max())


def test_the_schemes_own_energy_vanishes_with_the_step():
    def own(scheme, step):
        result = creep(ELEMENT, BITE, times=[25.3], step=step, scheme=scheme)
        return abs(result.numerical[-1])

    assert own("backward_euler", 0.025) / own("backward_euler", 0.0125) == pytest.approx(2, abs=0.1)
    assert own("sdirk2", 0.025) / own("sdirk2", 0.0125) == pytest.approx(8.0, abs=0.3)


def test_equal_steps_are_those_of_the_element_itself():
    times = np.linspace(0.5, 10.0, 20)
    for scheme in ("sdirk2", "backward_euler"):
        result = creep(ELEMENT, History.step(7.0), 10.0, times=times, step=0.5, scheme=scheme)
        alone = ELEMENT.creep(force=7.0, times=times, scheme=scheme)
        np.testing.assert_allclose(result.displacement, alone, rtol=1e-13)


@pytest.mark.parametrize("options", [{"step": 0.07}, {"tolerance": 1e-4}])
def test_a_run_taken_up_again_gives_the_same_numbers(tmp_path, options):
    unbroken = creep(ELEMENT, BITE, times=TIMES, **options)
    first = creep(ELEMENT, BITE, 5.2, times=TIMES[:5], **options)
    state = CreepState.load(first.state.save(tmp_path / "pause.npz"))
    second = creep(ELEMENT, BITE, times=TIMES[5:], resume=state, **options)
    for name in ("displacement", "force", "work", "dissipated", "numerical", "stored"):
        joined = np.concatenate([getattr(first, name), getattr(second, name)])
        np.testing.assert_array_equal(joined, getattr(unbroken, name))
    assert second.state.steps == unbroken.state.steps


def test_what_was_not_asked_for_is_refused():
    result = creep(ELEMENT, BITE, times=TIMES)
    assert result.record_at(5.2) == 4
    with pytest.raises(ResultError, match=r"nearest is 5\.2"):
        result.record_at(5.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 0.0}, "step: must be above 0"),
        ({"tolerance": 0.0}, "tolerance: must lie between"),
        ({"times": [2.0, 1.0]}, "times: must rise"),
        ({"times": [1.0, 99.0]}, "times: must rise"),
        ({"duration": -1.0}, "duration: must be later"),
        ({"drive": "loads"}, "drive: must be"),
        ({"resume": CreepState((np.zeros(3),))}, "resume: the state is of something else"),
    ],
)
def test_impossible_arguments_are_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        creep(ELEMENT, BITE, **options)


def test_a_history_that_only_jumps_needs_a_duration():
    with pytest.raises(ParameterError, match="needs a duration"):
        creep(ELEMENT, History.step())


def test_too_many_steps_are_an_error_that_says_what_to_do():
    with pytest.raises(ConvergenceError, match="larger tolerance"):
        creep(ELEMENT, BITE, tolerance=1e-6, scheme="backward_euler", most_steps=500)


def test_a_file_that_is_no_state_is_refused(tmp_path):
    path = tmp_path / "no.npz"
    path.write_bytes(b"nothing")
    with pytest.raises(ResultFileError, match=r"no\.npz: is not a result"):
        CreepState.load(path)


def test_times_asked_for_and_points_on_a_straight_piece_do_not_move_the_answer():
    few, many = np.array([1.0, 3.0, 10.0]), np.union1d([1.0, 3.0, 10.0], np.linspace(0, 25.3, 301))
    plain = creep(ELEMENT, BITE, times=few)
    asked = creep(ELEMENT, BITE, times=many)
    at = np.searchsorted(many, few)
    np.testing.assert_allclose(asked.displacement[at], plain.displacement, rtol=1e-13)
    np.testing.assert_allclose(asked.dissipated[at], plain.dissipated, rtol=1e-13)
    points = np.linspace(0.01, 25.2, 50)
    times = np.union1d(BITE.times, points)
    dotted = creep(ELEMENT, History(tuple(times), tuple(BITE.at(times))), times=few)
    np.testing.assert_allclose(dotted.displacement, plain.displacement, rtol=1e-10)
    exact = ELEMENT.creep(force=BITE, times=many, scheme="exact")
    assert np.abs(asked.displacement - exact).max() < 1e-3 * np.abs(exact).max()
    assert np.all(np.diff(asked.dissipated) >= 0.0)
