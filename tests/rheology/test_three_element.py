"""One element and one history: responses, limits, and what is refused."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kaju import History, ThreeElement
from kaju.errors import ParameterError

ELEMENT = ThreeElement(K_f=2.0, D_f=3.0, D_d=5.0)


@pytest.mark.parametrize(("numbers", "message"), [
    ((0.0, 0.0, 1.0), "K_f and D_f: both are 0"),
    ((-1.0, 0.0, 1.0), "K_f: must be 0, or from"),
    ((inf, 0.0, 1.0), "K_f: must be 0, or from"),
    ((9e-101, 1.0, 1.0), "K_f: must be 0, or from"),
    ((1.0, nan, 1.0), "D_f: must be 0, or from"),
    ((1.0, 1.0, 0.0), "D_d: must be from"),
    ((1.0, 1.0, nan), "D_d: must be from"),
])  # fmt: skip
def test_impossible_elements_are_refused(numbers, message):
    with pytest.raises(ParameterError, match=message):
        ThreeElement(*numbers)


def test_each_limit_is_exact():
    assert ThreeElement(2.0, 3.0) == ThreeElement(2.0, 3.0, inf)
    assert ELEMENT.retardation_time == 1.5
    t = np.linspace(0.0, 6.0, 7)

    def creep(element):
        return element.creep(force=3.0, times=t)

    np.testing.assert_allclose(creep(ThreeElement.spring(2.0))[1:], 1.5, rtol=1e-14)
    np.testing.assert_allclose(creep(ThreeElement(0.0, 4.0)), 0.75 * t, rtol=1e-14)
    np.testing.assert_allclose(
        creep(ThreeElement(2.0, 0.0, 4.0))[1:], (1.5 + 0.75 * t)[1:], rtol=1e-14
    )
    np.testing.assert_allclose(creep(ThreeElement(0.0, 4.0, 12.0)), 0.75 * t + 0.25 * t, rtol=1e-14)


PACES = 10.0 ** np.arange(-6, 13, 3)


@pytest.mark.parametrize("pace", PACES)
def test_backward_euler_is_the_discrete_creep_formula(pace):
    step, n = pace * ELEMENT.retardation_time, np.arange(1, 1001)
    uneven = 1.0 - 1.0 / ((1.0 + 0.3 * 2.0 / 3.0) * (1.0 + 0.2 * 2.0 / 3.0))
    two = ELEMENT.creep(force=7.0, times=[0.3, 0.5])[-1]
    assert two == pytest.approx(7.0 * (0.5 / 5.0 + uneven / 2.0), rel=1e-14)
    formula = 7.0 * (n * step / 5.0 - np.expm1(-n * np.log1p(step * 2.0 / 3.0)) / 2.0)
    crept = ELEMENT.creep(force=7.0, times=step * n)
    np.testing.assert_allclose(crept, formula, rtol=1e-12)


@pytest.mark.parametrize("pace", PACES)
def test_creep_relaxation_and_recovery_never_turn_back(pace):
    step, n = pace * ELEMENT.retardation_time, np.arange(1, 301)
    assert np.all(np.diff(ELEMENT.creep(force=7.0, times=step * n), prepend=0.0) > 0.0)
    unloading = History.step(7.0).hold(100 * step).release()
    recovering = ThreeElement(2.0, 3.0).creep(force=unloading, times=step * n)
    rounding = 1e-15 * recovering.max()
    assert np.all(np.diff(recovering[100:]) <= rounding)
    assert np.all(recovering >= -rounding)
    force = ELEMENT.relaxation(displacement=History().ramp(1.0, 100 * step), times=step * n)
    rounding = 1e-13 * force.max()
    assert np.all(np.diff(force[:100]) >= -rounding)
    assert np.all(np.diff(force[100:]) <= rounding)
    assert np.all(force >= -rounding)


def test_words_make_a_chain_of_straight_pieces():
    history = History().ramp(1.0, 2.0).hold(3.0).release(1.0).cycles(2, 4.0, high=0.5)
    assert history.times == (0.0, 2.0, 5.0, 6.0, 8.0, 10.0, 12.0, 14.0)
    assert history.factors == (0.0, 1.0, 1.0, 0.0, 0.5, 0.0, 0.5, 0.0)
    np.testing.assert_array_equal(
        history.at([0.0, 1.0, 2.0, 4.0, 5.5, 7.0, 99.0]), [0.0, 0.5, 1.0, 1.0, 0.5, 0.25, 0.0]
    )


def test_at_a_jump_the_value_before_it_counts():
    history = History.step(2.0).hold(3.0).release()
    np.testing.assert_array_equal(history.at([0.0, 1e-300, 3.0, 3.1]), [0.0, 2.0, 2.0, 0.0])
    np.testing.assert_array_equal(history.after([0.0, 3.0]), [2.0, 0.0])
    assert History((0.0, 1.0, 1.0), (0.0, 1.0, 0.5)).duration == 1.0
    first = History((0.0, 1.0), (1.0, 1.0))  # a first factor is a jump at the start
    assert (first.at(0.0), first.at(0.5), first.corners()[1][0]) == (0.0, 1.0, 1.0)


WRONG = (1.0,), (1.0, 2.0), (0.0, 2.0, 1.0), (-1.0, 0.0), (0.5, 0.5), (0.0, 1.0, 0.5, 2.0)


@pytest.mark.parametrize(("times", "factors", "message"), [
    ((0.0, 1.0), (0.0,), "as many factors"),
    *((times, (0.0,) * len(times), "times must start at 0 and never fall") for times in WRONG),
    ((0.0, float("inf")), (0.0, 1.0), "finite"),
])  # fmt: skip
def test_impossible_histories_are_refused(times, factors, message):
    with pytest.raises(ParameterError, match=message):
        History(times, factors)


pieces = st.lists(st.tuples(st.integers(0, 5), st.integers(-4, 4)), min_size=1, max_size=6)


@given(pieces, st.integers(0, 200))
def test_jumps_and_bends_superpose_to_the_history(moves, eighths):
    history = History()
    for duration, factor in moves:
        history = history.ramp(factor, duration)
    t = eighths / 8.0
    at, jumps, bends = history.corners()
    superposed = jumps @ (t > at) + bends @ np.maximum(t - at, 0.0)
    assert history.at(t) == pytest.approx(superposed, abs=1e-9)
