"""Force through every cut: elasticity holds up what lies on it, the prescribed rule does not."""

import numpy as np
import pytest
from plates import plate as pressed

from kaju import ElasticModel, LoadModel, Scene, solve
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


def test_a_cut_is_the_squeeze_of_its_row():
    result = LoadModel(plate()).run()
    kept, row = result.last.kept[:, 1], result.last.cells[:, 1]
    squeeze = np.bincount(row, kept, minlength=20)
    np.testing.assert_allclose(result.cuts().carried, squeeze, rtol=1e-12)


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"resolution": 2},
        {"tolerance": 0.2},
    ],
)
def test_elasticity_carries_all_of_it_at_every_cut(how):
    cuts = solve(plate(), **how).cuts()
    assert len(cuts.at) > 5
    np.testing.assert_allclose(cuts.carried, 2.0, atol=2e-10)
    np.testing.assert_allclose(cuts.missing, 0.0, atol=2e-10)


def test_no_layer_ends_within_an_agent():
    answer = solve(pressed([64, 64], [32, 63]), tolerance=0.3)
    assert answer.size.max() == pytest.approx(0.08)
    assert answer.cuts().at == pytest.approx(0.08 * np.arange(8) + 0.04)


def test_agents_of_the_elastic_rule_come_to_equilibrium():
    rules = [{"kind": "elastic", "tolerance": tolerance} for tolerance in (1e-2, 1e-12)]
    far, near = (ElasticModel(plate(rule=r), engine="arrays").run().cuts() for r in rules)
    assert np.abs(near.missing).max() < 1e-10 < np.abs(far.missing).max()


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
    scene = Scene(
        body={"cell_size": 0.1, "cells": [3, 4], "thickness": 0.1, "material": "a"}
        | {"gravity": [0.0, -10.0]},
        materials={"a": {"base": "steel", "density": 1000.0}},
        sides={side: "rigid"},
    )
    cuts = solve(scene).cuts()
    rows = (np.arange(4) + 0.5)[::sign] * 30.0  # a row weighs 30 N
    np.testing.assert_allclose(cuts.force[:, 1], sign * rows, rtol=1e-9)
    np.testing.assert_allclose(cuts.needed[:, 1], sign * rows, rtol=1e-12)
    np.testing.assert_allclose(cuts.carried, rows)


@pytest.mark.parametrize(("side", "axis"), [("bottom", 1), ("top", 1), ("left", 0), ("right", 0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_handed_on_counts_above_nothing_whichever_way_it_goes(side, axis, sign):
    opposite = {"bottom": "top", "top": "bottom", "left": "right", "right": "left"}[side]
    load = {"side": opposite, "force": [sign * 3.0 * (axis == 0), sign * 3.0 * (axis == 1)]}
    cuts = solve(plate(sides={side: "rigid"}, loads=[load])).cuts()
    assert cuts.axis == "xy"[axis]
    np.testing.assert_allclose(cuts.carried, 3.0, rtol=1e-9)
    np.testing.assert_allclose(cuts.missing, 0.0, atol=1e-9)


def test_where_supports_hold_both_parts_nothing_is_called_missing():
    cuts = LoadModel(plate(sides={"bottom": "rigid", "left": "rigid"})).run().cuts()
    assert np.isnan(cuts.missing).all()
    rollers = solve(plate(sides={"bottom": "rigid", "left": "roller", "right": "roller"})).cuts()
    np.testing.assert_allclose(rollers.missing, 0.0, atol=2e-10)  # they let slide along
    assert np.isnan(rollers.needed[:, 0]).all()


def test_cubes_are_cut_across_every_axis():
    load = {"side": "top", "force": [0.0, 0.0, -5.0]}
    result = solve(pressed([3, 4, 5], None, cell_size=0.1, loads=[load]))
    np.testing.assert_allclose(result.cuts().carried, 5.0, rtol=1e-9)
    np.testing.assert_allclose(result.cuts("x").force, 0.0, atol=5.0)
    assert [len(result.cuts(axis).at) for axis in "xyz"] == [3, 4, 5]


def test_rows_of_hexagons_are_cut():
    result = LoadModel(HEXAGONS).run()
    upright, row = result.stress[:, 1, 1], result.last.cells[:, 1]
    squeeze = -np.bincount(row, upright, minlength=4) * 0.01 * HEXAGONS.thickness
    np.testing.assert_allclose(result.cuts().carried, squeeze)


@pytest.mark.parametrize(
    ("scene", "axis"), [(plate(), "z"), (plate(), "xy"), (plate(), 1), (HEXAGONS, "x")]
)
def test_cuts_that_are_none_are_refused(scene, axis):
    with pytest.raises(ParameterError, match="axis"):
        LoadModel(scene).run().cuts(axis)


def test_a_table_of_cuts_names_its_units():
    table = LoadModel(plate()).run().cuts().to_dataframe()
    assert list(table) == ["y (m)", "carried (N)", "balance (N)", "missing (N)"]
    assert table["carried (N)"].max() == pytest.approx(1.8862, abs=5e-5)
