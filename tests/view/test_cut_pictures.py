"""The picture of the force through every cut."""

from functools import cache

import numpy as np
import pytest
from plates import plate as pressed

from kaju import LoadModel, plot, solve


@cache
def plate():
    return pressed([20, 20], [10, 19], size=[0.2, 0.2], thickness=0.002)


def widths(ax):
    return np.array([bar.get_width() for bar in ax.patches])


@pytest.mark.parametrize("answer", [lambda: LoadModel(plate()).run(), lambda: solve(plate())])
def test_bars_are_what_cuts_carry_and_stand_where_they_lie(answer):
    result = answer()
    (ax,), cuts = plot(result, "cuts").axes, result.cuts()
    np.testing.assert_array_equal(widths(ax), cuts.carried)
    middles = [bar.get_y() + 0.5 * bar.get_height() for bar in ax.patches]
    np.testing.assert_allclose(middles, cuts.at)
    (line,) = ax.lines
    np.testing.assert_array_equal(line.get_xdata(), cuts.balance)


def test_it_says_who_keeps_equilibrium():
    def told(result):
        (ax,) = plot(result, "cuts").axes
        return next(text.get_text() for text in ax.texts if text.get_gid() == "notes")

    assert "keeps no equilibrium" in told(LoadModel(plate()).run())
    assert "every cut carries" in told(solve(plate()))


def test_cuts_across_another_axis_stand_upright():
    (ax,) = plot(LoadModel(plate()).run(), "cuts", axis="x").axes
    assert ax.get_xlabel().startswith("x")
    assert ax.get_ylabel().startswith("force")
