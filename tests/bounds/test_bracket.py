"""The true energy lies between two that can be computed, whatever the body and its loads."""

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from goal_bodies import on_top, plate
from spawning_bodies import drawn

from kaju import Deflection, Scene, solve

PRECISE = 2e-6
"""Share of its energy that a truth by graded elements may be off."""


def pressed(n):
    return plate(cells=[n, n], loads=[on_top(0.08, 0.12, [0.0, -2.0])])


def test_bounds_of_equal_cells_close_in_as_their_estimate_does():
    truth = graded_elements(pressed(10), order=4, levels=14).strain_energy
    gaps = []
    for n in (10, 40, 160):
        result = solve(pressed(n))
        lower, upper = result.energy_bounds
        assert lower * (1 - PRECISE) <= truth <= upper * (1 + PRECISE), (lower, truth, upper)
        assert result.error_bound is None  # which is of a stress that balances
        assert result.no_bound
        gaps.append((upper - lower) / upper)
        assert gaps[-1] < 4.5 * result.error_estimate**2
    assert gaps == sorted(gaps, reverse=True)


def test_a_row_of_cells_between_two_moved_sides_is_solved():
    # One cell across, held along both long sides: the strain is that of the sides.
    moved = {"displacement": [0.0, -2e-6]}
    body = {"cell_size": 0.01, "cells": [6, 1], "thickness": 0.01, "material": "a"}
    sides = {"bottom": "rigid", "top": moved, "left": "roller", "right": "roller"}
    result = solve(Scene(body=body, materials={"a": ELASTIC}, sides=sides))
    exact = 0.5 * 1e9 / (1 - 0.3**2) * (2e-4) ** 2 * 0.06 * 0.01 * 0.01
    assert result.strain_energy == pytest.approx(exact)
    assert result.energy_bounds == pytest.approx((exact, exact))


ELASTIC = {"youngs_modulus": 1e9, "poissons_ratio": 0.3}
STIFF = {"youngs_modulus": 1e10, "poissons_ratio": 0.2}


def held(sides, loads, codes=((1,) * 4,) * 6):
    return drawn(codes, [ELASTIC, STIFF], loads, sides=sides)


BED, SOFT, HARD = ({"stiffness": k} for k in (1e11, 1e8, 1e13))


@pytest.mark.parametrize("bed", [SOFT, BED, HARD], ids=["soft", "bed", "hard"])
@pytest.mark.parametrize("load", [
    {"side": "bottom", "force": [-1e3, 0.0]},
    {"side": "bottom", "force": [0.0, -1e3]},
    {"cell": [2, 0], "side": "right", "force": [0.0, -1e3]},
    {"cell": [0, 0], "force": [-1e3, -0.9e3]},
], ids=["along", "onto", "beside", "within"])  # fmt: skip
def test_whatever_loads_a_bed_is_proved(bed, load):
    body = held({"bottom": bed} | ({"left": "roller"} if load["force"][0] else {}), [load])
    result, finer = solve(body, tolerance=0.2), solve(body, tolerance=0.1)
    assert result.tolerance_kept == "proved"
    lower, upper = result.energy_bounds[0] * (1 - 1e-9), result.energy_bounds[1] * (1 + 1e-9)
    assert lower <= finer.energy_bounds[1]
    assert finer.energy_bounds[0] <= upper


def test_goals_of_a_slender_bar_are_proved():
    law, load = {"youngs_modulus": 1e9, "poissons_ratio": 0.0}, {"side": "right", "force": [0, -1]}
    scene = drawn(np.ones((100, 1)), [law], [load], cell_size=1.0, sides={"left": "rigid"})
    goal = solve(scene, tolerance=0.2, goal=Deflection("right", "y")).goals[0]
    timoshenko = -(4.0 * 100.0**3 + 1.2 * 100.0 * 2.0) / 1e9
    assert abs(goal.value - timoshenko) <= goal.error_bound
    assert goal.relative_error <= 0.2


def moved(loads=()):
    codes = np.ones((8, 6), dtype=int)
    codes[3:5, 2:4] = 0
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, -1e-5]}}
    return held(sides, list(loads), codes)


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
