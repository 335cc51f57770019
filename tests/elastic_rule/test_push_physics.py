"""Where the agents come to rest is linear elasticity."""

from dataclasses import replace

import numpy as np
import pytest
from elastic_scenes import (
    block,
    direct_solution,
    displacement,
    drawn,
    energy_norm,
    plate,
    ragged,
    run,
    run_random,
    scenes,
)
from hypothesis import given, settings

from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, FOUNDATION, RIGID, ROLLER

ORDERS = ["wave", "largest first", "multilevel"]


def relative_error(model):
    truth = direct_solution(model)
    return energy_norm(model, displacement(model) - truth) / energy_norm(model, truth)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [plate, ragged, block])
def test_every_order_comes_to_rest_at_the_direct_solution(make, order):
    scene = make(order=order, tolerance=1e-5)
    if order == "largest first":
        model, result = run(scene, pushes_per_step=10_000)
    else:
        model, result = run(scene)
    assert result.outcome.startswith("at rest")
    # One level's meter is a lower bound of the error, by the number of cells at most.
    assert relative_error(model) < (1.5e-5 if order == "multilevel" else 1e-4)


@settings(max_examples=30)
@given(scene=scenes())
def test_at_rest_the_error_keeps_the_bound_that_the_threshold_implies(scene):
    model, result = run_random(scene)
    assert result.outcome.startswith(("at rest", "no load"))
    finest = model.table.levels[0]
    n = finest.size
    assert model.state.measured(0).max() <= model.threshold
    root = np.sqrt(finest.stiffness)
    scaled = root[:, None] * (np.eye(n) - finest.shares[:, :n].toarray()) / root
    smallest = np.linalg.eigvalsh(scaled)[0]
    error = energy_norm(model, displacement(model) - direct_solution(model))
    bound = model.threshold * np.sqrt(n / model.table.reference / smallest)
    assert error <= bound * (1 + 1e-9)


@settings(max_examples=30)
@given(scene=scenes())
def test_every_newton_is_accounted_for(scene):
    _, result = run_random(scene, max_steps=200)
    assert result.ledger.imbalance < 1e-12
    assert [check.allowed for check in result.checks()] == [1e-6]
    left = result.ledger.applied - result.ledger.resting + result.reaction
    assert np.abs(left).max() <= 1e-12 * result.ledger.turnover
    supports = result.boundary.kind != AIR
    total = result.boundary.reaction[supports].sum(axis=0)
    np.testing.assert_allclose(total, result.reaction, atol=1e-12 * result.ledger.turnover)


def test_the_ground_carries_the_load():
    _, result = run(plate(force=(0.7, -2.0), tolerance=1e-8))
    np.testing.assert_allclose(result.reaction, (-0.7, 2.0), atol=1e-7)
    assert set(result.boundary.kind.tolist()) == {RIGID, AIR}
    assert result.ledger.applied == pytest.approx((0.7, -2.0))


def test_above_a_large_threshold_the_load_rests_before_it_reaches_the_ground():
    # Prescribed or elastic: below γ nothing more happens, and the books say so.
    _, result = run(plate(order="wave", threshold=0.2))
    assert not result.reaction.any()
    np.testing.assert_allclose(result.ledger.resting, (0.0, -2.0), atol=1e-12)
    _, parents = run(plate(order="multilevel", threshold=0.2))
    assert parents.reaction[1] == pytest.approx(2.0, abs=0.3)


def test_displacements_add_up_as_loads_do():
    solved = {}
    for name, force in {"both": (1.0, -2.0), "x": (1.0, 0.0), "y": (0.0, -2.0)}.items():
        model, _ = run(plate(force=force, tolerance=1e-8))
        solved[name] = displacement(model)
    error = np.abs(solved["x"] + solved["y"] - solved["both"]).max()
    assert error < 1e-7 * np.abs(solved["both"]).max()


@pytest.mark.parametrize("order", ["wave", "multilevel"])
def test_a_mirrored_scene_has_the_mirrored_answer(order):
    pressed = {"cell": [0, 3], "side": "top", "force": [0.5, -2.0]}
    one = drawn("aabba\naaaaa\naa.bb\n=====", [pressed])
    other = drawn("abbaa\naaaaa\nbb.aa\n=====", [pressed | {"cell": [4, 3], "force": [-0.5, -2.0]}])
    rule = replace(one.rule, order=order, threshold=1e-4)
    left, right = (run(scene.model_copy(update={"rule": rule}))[1] for scene in (one, other))
    scale = np.nanmax(np.abs(left.displacement[1]))
    tolerance = 1e-12 if order == "wave" else 1e-3  # a wave has no first and last agent
    for axis, sign in ((0, -1.0), (1, 1.0)):
        mirrored = sign * right.displacement[axis][::-1]
        np.testing.assert_allclose(left.displacement[axis], mirrored, atol=tolerance * scale)


def test_uniform_compression_between_smooth_walls_is_exact():
    # σ = F/A, ε_y = -σ/E, ε_x = +νσ/E; rollers below and left let the rest slide.
    cells, size, force = 4, 0.2, -8e5
    scene = Scene(
        body={"size": [size] * 2, "cells": [cells] * 2, "thickness": 0.01, "material": "steel"},
        sides={"bottom": "roller", "left": "roller"},
        loads=[{"side": "top", "force": [0.0, force]}],
        rule={"kind": "elastic", "tolerance": 1e-12},
    )
    _, result = run(scene)
    strain = force / (size * 0.01 * 206e9)
    line = np.linspace(0.0, size, cells + 1)
    u_x, u_y = result.displacement
    np.testing.assert_allclose(u_y, np.tile(strain * line, (cells, 1)), atol=1e-11 * size)
    np.testing.assert_allclose(u_x, np.tile(-0.3 * strain * line[:, None], (1, cells)), atol=1e-15)
    assert set(result.boundary.kind.tolist()) == {ROLLER}
    assert result.agents.level.min() > 0  # no single cell has anything to add


def test_confined_cubes_on_an_elastic_bed_are_springs_in_a_row():
    # Walls all round: stiffness C₁₁ A/L in series with the bed's s A.
    bed = 4e13
    scene = Scene(
        body={"cell_size": 0.01, "cells": [2, 2, 3], "material": "steel"},
        sides=dict.fromkeys(("left", "right", "front", "back"), "roller")
        | {"bottom": {"stiffness": bed}},
        loads=[{"side": "top", "pressure": 1e6}],
        rule={"kind": "elastic", "tolerance": 1e-12},
    )
    _, result = run(scene)
    stretch = 206e9 * 0.7 / (1.3 * 0.4)
    u_z = result.displacement[2][0, 0]
    expected = -1e6 / bed - 1e6 / stretch * 0.01 * np.arange(4)
    np.testing.assert_allclose(u_z, expected, rtol=1e-10)
    bedded = result.boundary.kind == FOUNDATION
    np.testing.assert_allclose(result.boundary.reaction[bedded, 2], 1e6 * 1e-4, rtol=1e-10)


def test_a_pushed_wall_strains_the_body_without_any_load():
    scene = Scene(
        body={"cell_size": 0.01, "cells": [4, 3], "material": "steel"},
        sides={"left": {"displacement": [1e-6, 0.0]}, "right": "roller", "bottom": "roller"},
        rule={"kind": "elastic", "tolerance": 1e-10},
    )
    model, result = run(scene)
    np.testing.assert_allclose(result.displacement[0][0], 1e-6, rtol=1e-12)
    assert relative_error(model) < 1e-9
    np.testing.assert_allclose(result.reaction, 0.0, atol=1e-6 * result.ledger.turnover)
    assert result.boundary.reaction[:, 0].max() > 1e3


def test_faces_without_body_beside_them_have_no_displacement():
    _, result = run(ragged())
    u_x, u_y = result.displacement
    assert result.result.cells().origin == (0, 1)  # the ground is no part of the body
    assert u_x.shape == (9, 6)
    assert u_y.shape == (8, 7)
    assert np.isnan(u_x[0, 5])  # beside the air at the upper left
    assert u_y[0, 0] == 0.0  # on the ground
    assert u_y[3, 0] != 0.0  # over the gap
