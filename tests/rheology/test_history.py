"""Histories: words in a row, jumps, and what superposes to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kaju import History
from kaju.errors import ParameterError


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
    first = History((0.0, 1.0), (1.0, 1.0))  # a first factor is a jump at the start
    assert (first.at(0.0), first.at(0.5), first.corners()[0].jump) == (0.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("times", "factors", "message"),
    [
        ((0.0, 1.0), (0.0,), "as many factors"),
        ((0.0, 2.0, 1.0), (0.0, 1.0, 2.0), "never fall"),
        ((1.0,), (0.0,), "start at 0"),
        ((0.0, float("inf")), (0.0, 1.0), "finite"),
    ],
)
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
    superposed = sum(
        (corner.jump if t > corner.time else 0.0) + corner.bend * max(t - corner.time, 0.0)
        for corner in history.corners()
    )
    assert history.at(t) == pytest.approx(superposed, abs=1e-9)


def test_endless_cycles_are_refused_by_name():
    with pytest.raises(ParameterError, match="cycles: from 1 to 10,000"):
        History().cycles(1_000_000, 1.0)
    with pytest.raises(ParameterError, match="cycles: from 1 to"):
        History().cycles(0, 1.0)
    with pytest.raises(ParameterError, match="duration"):
        History().ramp(1.0, -1.0)
    many = History().cycles(10_000, 0.5)
    assert many.duration == pytest.approx(5000.0)
    assert many.at([0.25, 0.5, 0.75]).tolist() == [1.0, 0.0, 1.0]
