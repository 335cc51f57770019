"""Problems whose answer the grid represents: right to rounding, at any resolution."""

import numpy as np
import pytest

from exact import (
    EXACT_PROBLEMS,
    BimaterialBar,
    ConfinedCompression,
    RigidRotation,
    UniformCompression,
)

CLOSE = 1e-10
VARIANTS = [
    UniformCompression(plane="stress"),
    UniformCompression(poissons_ratio=-0.6),
    UniformCompression(dimension=3),
    ConfinedCompression(plane="stress"),
    ConfinedCompression(poissons_ratio=0.499),
    ConfinedCompression(dimension=3),
    ConfinedCompression(dimension=3, poissons_ratio=0.49),
    BimaterialBar(contrast=1e-3, plane="stress"),
]
PROBLEMS = [
    pytest.param(problem, id=f"{type(problem).__name__}-{number}")
    for number, problem in enumerate([*(kind() for kind in EXACT_PROBLEMS), *VARIANTS])
]


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_grid_represents_the_answer(problem):
    for resolution in problem.resolutions:
        result = problem.solve(resolution, tolerance=1e-13)
        for quantity in problem.orders:
            assert problem.error(result, quantity) < CLOSE


@pytest.mark.parametrize(
    "problem",
    [
        BimaterialBar(contrast=1e6),
        BimaterialBar(contrast=1e-6),
        ConfinedCompression(poissons_ratio=0.4999),
        ConfinedCompression(dimension=3, poissons_ratio=0.4999),
    ],
)
def test_extreme_materials_cost_the_digits_of_their_contrast(problem):
    result = problem.solve(6, tolerance=1e-13)
    assert max(problem.error(result, of) for of in ("displacement", "stress")) < 1e-8


def test_a_rotation_stores_no_energy():
    result = RigidRotation().solve(6)
    strained = RigidRotation(finite=True, angle=0.1).solve(6)
    assert abs(result.strain_energy) < 1e-12 * strained.strain_energy


@pytest.mark.parametrize("angle", [1e-3, 0.3, np.pi / 2])
def test_a_finite_rotation_looks_like_a_uniform_shortening(angle):
    problem = RigidRotation(finite=True, angle=angle)
    result = problem.solve(6, tolerance=1e-13)
    assert problem.error(result, "stress") < CLOSE / min(angle, 1.0)
    expected = problem.hooke((np.cos(angle) - 1) * np.eye(2)[None])[0]
    close = 1e-9 * problem.youngs_modulus
    np.testing.assert_allclose(result.cells().stress[1, 1], expected, atol=close)
