"""What a result says along a line."""

import numpy as np
import pytest

from kaju import LoadModel, Scene, solve
from kaju.errors import ResultError

HOLE = {"material": "air", "box": [[0.02, 0.02], [0.06, 0.06]]}


def plate(**body):
    described = {"size": [0.08, 0.08], "cells": [8, 8], "thickness": 0.002, "material": "steel"}
    load = {"side": "top", "force": [0.0, -2.0]}
    return Scene(body=described | body, sides={"bottom": "rigid"}, loads=[load])


def answers():
    scene = plate()
    return [
        solve(scene, resolution=2),
        solve(scene, strategy="spawning", tolerance=0.2),
        LoadModel(scene).run(),
    ]


@pytest.mark.parametrize("number", range(3))
def test_every_answer_has_profiles(number):
    result = answers()[number]
    table = result.profile([0.0, 0.04], [0.08, 0.04], count=9)
    np.testing.assert_allclose(table["distance (m)"], np.linspace(0.0, 0.08, 9))
    points = table[["x (m)", "y (m)"]].to_numpy()
    np.testing.assert_allclose(points[:, 1], 0.04)
    moved = table[["displacement_x (m)", "displacement_y (m)"]].to_numpy()
    np.testing.assert_array_equal(moved, result.displacement_at(points))
    stress = result.stress_at(points)
    for name, a, b in (("xx", 0, 0), ("xy", 0, 1), ("yy", 1, 1)):
        np.testing.assert_array_equal(table[f"stress_{name} (Pa)"], stress[:, a, b])


@pytest.mark.parametrize("how", [{}, {"strategy": "spawning", "tolerance": 0.3}])
def test_points_outside_of_the_body_are_left_out(how):
    table = solve(plate(regions=[HOLE]), **how).profile([0.0, 0.04], [0.08, 0.04], count=17)
    np.testing.assert_allclose(
        table["distance (m)"], [*np.arange(5) * 0.005, *np.arange(12, 17) * 0.005]
    )


def test_lines_that_are_none_are_refused():
    result = answers()[0]
    with pytest.raises(ResultError, match="profile: two different points of 2 numbers"):
        result.profile([0.0, 0.0], [0.0, 0.0])
    with pytest.raises(ResultError, match="two different points of 2 numbers"):
        result.profile([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    with pytest.raises(ResultError, match="lies in the body"):
        result.profile([1.0, 0.0], [1.0, 1.0])
