"""What a result says along a line."""

import numpy as np
import pytest
from plates import plate as pressed

from kaju import LoadModel, solve
from kaju.errors import ResultError

HOLE = {"material": "air", "box": [[0.02, 0.02], [0.06, 0.06]]}


def plate(**body):
    load = {"side": "top", "force": [0.0, -2.0]}
    return pressed([8, 8], None, thickness=0.002, loads=[load], **body)


@pytest.mark.parametrize(
    "answer",
    [
        lambda scene: solve(scene, resolution=2),
        lambda scene: solve(scene, tolerance=0.2),
        lambda scene: LoadModel(scene).run(),
    ],
)
def test_every_answer_has_profiles(answer):
    result = answer(plate())
    table = result.profile([0.0, 0.04], [0.08, 0.04], count=9)
    np.testing.assert_allclose(table["distance (m)"], np.linspace(0.0, 0.08, 9))
    points = table[["x (m)", "y (m)"]].to_numpy()
    np.testing.assert_allclose(points[:, 1], 0.04)
    moved = table[["displacement_x (m)", "displacement_y (m)"]].to_numpy()
    np.testing.assert_array_equal(moved, result.displacement_at(points))
    stress = result.stress_at(points)
    for name, a, b in (("xx", 0, 0), ("xy", 0, 1), ("yy", 1, 1)):
        np.testing.assert_array_equal(table[f"stress_{name} (Pa)"], stress[:, a, b])


@pytest.mark.parametrize("how", [{}, {"tolerance": 0.3}])
def test_points_outside_of_the_body_are_left_out(how):
    table = solve(plate(regions=[HOLE]), **how).profile([0.0, 0.04], [0.08, 0.04], count=17)
    np.testing.assert_allclose(
        table["distance (m)"], [*np.arange(5) * 0.005, *np.arange(12, 17) * 0.005]
    )


def test_lines_that_are_none_are_refused():
    result = solve(plate())
    for start, end in (([0.0, 0.0], [0.0, 0.0]), ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])):
        with pytest.raises(ResultError, match="profile: two different points of 2 numbers"):
            result.profile(start, end)
    with pytest.raises(ResultError, match="lies in the body"):
        result.profile([1.0, 0.0], [1.0, 1.0])
