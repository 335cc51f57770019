"""The picture of the force through every cut."""

from functools import cache

import numpy as np
import pytest
from artists import notes
from plates import plate

from kaju import LoadModel, plot, solve

PLATE = plate([20, 20], [10, 19], size=[0.2, 0.2], thickness=0.002)


@cache
def rule():
    return LoadModel(PLATE).run()


@cache
def elasticity():
    return solve(PLATE)


@pytest.mark.parametrize(
    ("answer", "said"), [(rule, "keeps no equilibrium"), (elasticity, "every cut carries")]
)
def test_bars_are_what_cuts_carry_and_stand_where_they_lie(answer, said):
    """And it says who keeps equilibrium."""
    result = answer()
    (ax,), cuts = plot(result, "cuts").axes, result.cuts()
    np.testing.assert_array_equal([bar.get_width() for bar in ax.patches], cuts.carried)
    middles = [bar.get_y() + 0.5 * bar.get_height() for bar in ax.patches]
    np.testing.assert_allclose(middles, cuts.at)
    (line,) = ax.lines
    np.testing.assert_array_equal(line.get_xdata(), cuts.balance)
    assert said in notes(ax)


def test_cuts_across_another_axis_stand_upright():
    (ax,) = plot(rule(), "cuts", axis="x").axes
    assert ax.get_xlabel().startswith("x")
    assert ax.get_ylabel().startswith("force")
