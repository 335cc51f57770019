"""Through time by steps that keep a tolerance: one element, and what every run in time promises."""

import numpy as np
import pytest
from exact_creep import exactly_crept
from plates import loaded

from kaju import CreepModel, History, ThreeElement, creep
from kaju.errors import ParameterError
from kaju.model.network import triangular

ELEMENT = ThreeElement(K_f=2.0, D_f=3.0, D_d=5.0)
DOUGH = ThreeElement(K_f=2.0, D_f=1.0, D_d=20.0)
BITE = History().ramp(1.0, 0.2).hold(5.0).release(0.1).hold(20.0)
PUSH = History().ramp(0.9, 0.7).hold(1.3).release(0.6).hold(1.4)
TIMES = np.array([0.1, 0.2, 1.0, 3.0, 5.2, 5.3, 6.0, 10.0, 25.3])


def slab(rule="elastic", **material):
    gel = {"youngs_modulus": 2e3, "poissons_ratio": 0.3, **material}
    told = {"kind": rule} | ({"threshold": 1e-6} if rule == "prescribed" else {})
    of = {"material": "gel", "materials": {"gel": gel}, "thickness": 0.5, "rule": told}
    return loaded([3, 3], {"side": "top", "force": [0.0, -5e-4]}, **of)


CREEPING = {"rheology": {"K_f": 2e3, "D_f": 1e3, "D_d": 2e4}}
SUBJECTS = {
    "element": (DOUGH, {}),
    "agents": (slab("prescribed", **CREEPING), {}),
    "elastic": (slab(**CREEPING), {}),
    "moved": (slab(**CREEPING).replace(loads=[], sides={"bottom": "rigid", "top": {
        "displacement": [0.0, -1e-4]}}), {}),
    "network": (triangular(3, force=0.01), {"rheology": DOUGH}),
}  # fmt: skip
subjects = pytest.mark.parametrize("name", sorted(SUBJECTS))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(
    "history",
    [BITE, History.step(7.0).hold(4.0).release().hold(20.0), History().cycles(3, 2.0).hold(9.0)],
)
def test_the_tolerance_is_kept_and_the_estimate_stands_above_the_error(history, tolerance):
    times = TIMES[history.duration >= TIMES]
    result = creep(ELEMENT, history, times=times, tolerance=tolerance)
    exact = exactly_crept(ELEMENT, history, times)
    error = np.abs(result.displacement - exact).max() / np.abs(exact).max()
    assert error < tolerance
    assert error < result.error_estimate
    np.testing.assert_allclose(result.force, history.at(times), atol=1e-12)


def test_it_is_of_second_order():
    """A hundredth of the tolerance takes ten times as many steps."""
    steps = [creep(ELEMENT, BITE, tolerance=tolerance).steps for tolerance in (1e-5, 1e-7)]
    assert np.log(steps[1] / steps[0]) / np.log(100.0) == pytest.approx(1.0 / 2.0, abs=0.04)


def test_a_fast_and_a_slow_process_take_few_steps():
    element = ThreeElement(K_f=1.0, D_f=1e-6, D_d=1e6)
    result = creep(element, History.step(), 1.0, times=[1e-6, 1.0], tolerance=1e-3)
    exact = exactly_crept(element, 1.0, [1e-6, 1.0])
    np.testing.assert_allclose(result.displacement, exact, atol=1e-3)
    assert result.steps < 200


@subjects
def test_work_is_stored_dissipated_or_the_schemes_own(name):
    subject, more = SUBJECTS[name]
    result = creep(subject, PUSH, **more)
    left = result.work - result.stored - result.dissipated - result.numerical
    np.testing.assert_allclose(left, 0.0, atol=1e-12 * np.abs(result.work).max())
    assert np.all(np.diff(result.dissipated) >= 0.0)
    assert np.abs(result.numerical[-1]) < 2e-3 * np.abs(result.work).max()
    assert all(check.holds for check in result.checks())


@subjects
def test_times_asked_for_and_points_on_a_straight_piece_do_not_move_the_answer(name):
    subject, more = SUBJECTS[name]
    few = np.array([0.3, 1.0, 2.2, 4.0])
    many = np.union1d(few, np.linspace(0.0, 4.0, 101))
    plain = creep(subject, PUSH, times=few, **more)
    asked = creep(subject, PUSH, times=many, **more)
    at = np.searchsorted(many, few)
    points = np.union1d(PUSH.times, [0.1, 0.1 + 1e-7, 0.3, 1.2, 1.2 + 1e-9, 2.1, 2.3, 3.9])
    dotted = creep(subject, History(tuple(points), tuple(PUSH.at(points))), times=few, **more)
    for key in ("work", "stored", "dissipated", "numerical"):
        scale = np.abs(plain.work).max()
        np.testing.assert_allclose(getattr(asked, key)[at], getattr(plain, key), atol=1e-13 * scale)
        np.testing.assert_allclose(getattr(dotted, key), getattr(plain, key), atol=1e-10 * scale)
    moved = plain.largest_displacement()
    np.testing.assert_allclose(asked.largest_displacement()[at], moved, atol=1e-13 * moved.max())
    np.testing.assert_allclose(dotted.largest_displacement(), moved, atol=1e-10 * moved.max())


@subjects
def test_steps_of_the_model_are_the_times_asked_for(name):
    subject, more = SUBJECTS[name]
    times = [0.0, 0.5, 1.0, 2.0, 4.0]
    model, course = (
        CreepModel(subject, PUSH, times=times, **more),
        creep(subject, PUSH, times=times, **more),
    )
    while model.running:
        model.step()
    model.step()
    assert model.steps == len(times) - 1, "nothing is left to step to"
    assert model.moment == 4.0
    found = model.result()
    for key in ("times", "factors", "work", "stored", "dissipated", "at_jumps", "numerical"):
        np.testing.assert_array_equal(getattr(found, key), getattr(course, key))
    np.testing.assert_array_equal(found.largest_displacement(), course.largest_displacement())


def test_half_the_work_of_a_sudden_load_on_springs_is_set_free_and_said():
    sudden = creep(slab(), History.step().hold(1.0))
    assert sudden.at_jumps[-1] == pytest.approx(0.5 * sudden.work[-1], rel=1e-9)
    assert sudden.stored[-1] == pytest.approx(0.5 * sudden.work[-1], rel=1e-9)
    assert "released where the load jumps" in sudden.notes[0]
    assert sudden.summary()["numerical_J"] == pytest.approx(0.0, abs=1e-12 * sudden.work[-1])
    slow = creep(slab(), History().ramp(1.0, 1.0).hold(1.0))
    assert slow.at_jumps[-1] == 0.0
    assert not slow.notes
    assert slow.stored[-1] == pytest.approx(slow.work[-1], rel=1e-2)
    damped = creep(DOUGH, History.step().hold(4.0))  # a damper beside the spring takes it up
    assert abs(damped.at_jumps[-1]) < 1e-6 * damped.work[-1]
    assert not damped.notes


@pytest.mark.parametrize(("options", "message"), [
    ({"tolerance": 0.0}, "tolerance: must lie between"),
    ({"times": [2.0, 1.0]}, "times: must rise"),
    ({"times": [1.0, 99.0]}, "times: must rise"),
    ({"duration": -1.0}, "duration: must be above 0"),
    ({"rheology": DOUGH}, "rheology: is for spring networks"),
    ({"history": History.step()}, "needs a duration"),
    ({"history": None}, "history: must be a History"),
    ({"subject": "dough"}, "subject: a Scene, a SpringNetwork or a ThreeElement"),
])  # fmt: skip
def test_impossible_arguments_are_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        creep(**{"subject": ELEMENT, "history": BITE} | options)
