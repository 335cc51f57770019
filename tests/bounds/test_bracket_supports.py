"""Bounds of bodies on beds, under couples, and between sides that move."""

import numpy as np
import pytest
from spawning_bodies import drawn

from kaju import Deflection, Scene, Stress, solve

ELASTIC = {"youngs_modulus": 1e9, "poissons_ratio": 0.3}
STIFF = {"youngs_modulus": 1e10, "poissons_ratio": 0.2}


def plate(sides, loads, codes=((1,) * 4,) * 6):
    return drawn(codes, [ELASTIC, STIFF], loads, sides=sides)


BED, SOFT, HARD = ({"stiffness": k} for k in (1e11, 1e8, 1e13))


@pytest.mark.parametrize("bed", [SOFT, BED, HARD], ids=["soft", "bed", "hard"])
@pytest.mark.parametrize(
    "load",
    [
        {"side": "bottom", "force": [-1e3, 0.0]},
        {"side": "bottom", "force": [0.0, -1e3]},
        {"cell": [2, 0], "side": "right", "force": [0.0, -1e3]},
        {"cell": [0, 0], "force": [-1e3, -0.9e3]},
    ],
    ids=["along", "onto", "beside", "within"],
)
def test_whatever_loads_a_bed_is_proved(bed, load):
    result = solve(plate({"bottom": bed, "left": "roller"}, [load]), tolerance=0.2)
    assert result.tolerance_kept == "proved"
    finer = solve(plate({"bottom": bed, "left": "roller"}, [load]), tolerance=0.1)
    lower, upper = result.energy_bounds[0] * (1 - 1e-9), result.energy_bounds[1] * (1 + 1e-9)
    assert lower <= finer.energy_bounds[1]
    assert finer.energy_bounds[0] <= upper


def test_goals_of_a_slender_bar_are_proved():
    scene = Scene(
        body={"size": [100.0, 1.0], "cells": [100, 1], "material": "m"},
        materials={"m": {"youngs_modulus": 1e9, "poissons_ratio": 0.0}},
        sides={"left": "rigid"},
        loads=[{"side": "right", "force": [0.0, -1.0]}],
    )
    goal = solve(scene, tolerance=0.2, goal=Deflection("right", "y")).goals[0]
    timoshenko = -(4.0 * 100.0**3 + 1.2 * 100.0 * 2.0) / 1e9
    assert abs(goal.value - timoshenko) <= goal.error_bound
    assert goal.relative_error <= 0.2


def moved(loads=()):
    codes = np.ones((8, 6), dtype=int)
    codes[3:5, 2:4] = 0
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, -1e-5]}}
    return plate(sides, list(loads), codes)


@pytest.mark.parametrize("tolerance", [0.1, 0.05])
def test_sides_that_move_alone_have_bounds_of_second_order(tolerance):
    result = solve(moved(), tolerance=tolerance)
    lower, upper = result.energy_bounds
    assert result.tolerance_kept == "proved"
    assert upper / lower - 1.0 < 4.5 * result.error_bound**2
    finer = solve(moved(), tolerance=0.5 * tolerance).energy_bounds
    assert lower <= finer[1]
    assert finer[0] <= upper


def test_forces_beside_sides_that_move_have_wider_bounds_that_hold():
    force = {"cell": [1, 5], "side": "left", "force": [500.0, 0.0]}
    lower, upper = solve(moved([force]), tolerance=0.1).energy_bounds
    finer = solve(moved([force]), tolerance=0.03).energy_bounds
    assert lower <= finer[0] <= finer[1] <= upper


def test_a_load_onto_a_side_that_moves_is_the_wall_s_alone():
    loads = [{"cell": [2, 5], "side": "top", "force": [0.0, -700.0]}]
    plain, pressed = (solve(moved(on)) for on in ([], loads))
    assert pressed.found.solution.energy == pytest.approx(plain.found.solution.energy, rel=1e-9)
    (lower, upper), own = pressed.energy_bounds, plain.energy_bounds
    assert lower <= own[1]
    assert own[0] <= upper


def test_one_quantity_has_one_value():
    place = {"box": [[0.02, 0.01], [0.04, 0.02]]}
    asked = (Deflection("top", "y"), Stress(place, "yy"))
    loads = [{"side": "top", "force": [0.0, -1e3]}]
    result = solve(plate({"bottom": "rigid"}, loads), tolerance=0.2, goal=asked)
    for quantity, goal in zip(asked, result.goals, strict=True):
        assert result.value_of(quantity) == goal.value
    assert result.value_of(Deflection("top", "x")) != result.goals[0].value
