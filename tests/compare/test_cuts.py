"""Force through every cut: elasticity holds up what lies on it, the prescribed rule does not."""

import numpy as np
import pytest
from plates import loaded
from plates import plate as pressed

from kaju import LoadModel, solve
from kaju.errors import ParameterError


def plate(**given):
    return pressed([20, 20], [10, 19], size=[0.2, 0.2], thickness=0.002, **given)


HEXAGONS = pressed([5, 4], [2, 3], lattice="hexagon")


def test_the_rule_carries_ever_less_of_two_newtons():
    cuts = LoadModel(plate()).run().cuts()
    assert cuts.axis == "y"
    np.testing.assert_allclose(cuts.at, 0.01 * np.arange(20) + 0.005)
    np.testing.assert_allclose(
        cuts.carried[::-1][:8],
        [1.8862, 1.6362, 1.0, 0.6875, 0.2187, 0.125, 0.0156, 0.0078],
        atol=6e-5,
    )
    np.testing.assert_array_equal(cuts.carried[:12], 0.0)
    np.testing.assert_allclose(cuts.balance, 2.0)
    np.testing.assert_allclose(cuts.missing, 2.0 - cuts.carried)


@pytest.mark.parametrize("how", [{}, {"resolution": 2}, {"tolerance": 0.2}])
def test_elasticity_carries_all_of_it_at_every_cut(how):
    cuts = solve(plate(), **how).cuts()
    assert len(cuts.at) > 5
    np.testing.assert_allclose(cuts.carried, 2.0, atol=2e-10)
    np.testing.assert_allclose(cuts.missing, 0.0, atol=2e-10)


def test_a_shear_force_goes_through_every_cut_of_a_cantilever():
    load = {"side": "right", "force": [0.0, -3.0]}
    held = {"sides": {"left": "rigid"}, "loads": [load], "thickness": 0.002}
    cuts = solve(pressed([12, 4], None, **held)).cuts("x")
    # The part before each cut is held, so the part beyond it says what is needed.
    np.testing.assert_allclose(cuts.needed, np.tile([0.0, -3.0], (12, 1)), atol=1e-12)
    np.testing.assert_allclose(cuts.force[:10], cuts.needed[:10], atol=1e-9)
    # A surface that is dragged takes its shear over two cells.
    np.testing.assert_allclose(cuts.force[10:].mean(axis=0), cuts.needed[10], atol=1e-9)


@pytest.mark.parametrize(("side", "sign"), [("bottom", -1), ("top", 1)])
def test_weight_grows_downwards_and_hangs_from_the_top(side, sign):
    of = {"cell_size": 0.1, "thickness": 0.1, "material": "a", "gravity": [0.0, -10.0]}
    of |= {"materials": {"a": {"base": "steel", "density": 1000.0}}}
    cuts = solve(loaded([3, 4], sides={side: "rigid"}, **of)).cuts()
    rows = (np.arange(4) + 0.5)[::sign] * 30.0  # a row weighs 30 N
    np.testing.assert_allclose(cuts.force[:, 1], sign * rows, rtol=1e-9)
    np.testing.assert_allclose(cuts.needed[:, 1], sign * rows, rtol=1e-12)
    np.testing.assert_allclose(cuts.carried, rows)


def test_where_supports_hold_both_parts_nothing_is_called_missing():
    cuts = LoadModel(plate(sides={"bottom": "rigid", "left": "rigid"})).run().cuts()
    assert np.isnan(cuts.missing).all()
    rollers = solve(plate(sides={"bottom": "rigid", "left": "roller", "right": "roller"})).cuts()
    np.testing.assert_allclose(rollers.missing, 0.0, atol=2e-10)  # they let slide along
    assert np.isnan(rollers.needed[:, 0]).all()
    ledge = LoadModel(loaded("##\n##\n#=\n#.", sides={})).run().cuts("y")  # beside and below
    assert np.isnan(ledge.needed[:, 1]).tolist() == [False, True, False, False]


@pytest.mark.parametrize(
    ("scene", "axis"), [(plate(), "z"), (plate(), "xy"), (plate(), 1), (HEXAGONS, "x")]
)
def test_cuts_that_are_none_are_refused(scene, axis):
    with pytest.raises(ParameterError, match="axis"):
        LoadModel(scene).run().cuts(axis)
