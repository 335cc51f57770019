"""Known answers: represented to rounding, or approached by the power that theory gives."""

import numpy as np
import pytest

import exact
from exact import ConfinedCompression, RigidRotation, UniformCompression, convergence

STEP = 1e-5
PROBLEMS = [kind() for kind in exact.CONVERGING_PROBLEMS]


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda problem: type(problem).__name__)
def test_exact_solutions_obey_hooke_and_equilibrium(problem):
    points = problem.points() * (1 - 1e-3) + 5e-4
    d = points.shape[1]
    gradient, unbalanced = np.empty((len(points), d, d)), np.zeros((len(points), d))
    for axis, step in enumerate(STEP * np.eye(d)):
        ahead, behind = points + step, points - step
        change = problem.exact_displacement(ahead) - problem.exact_displacement(behind)
        gradient[:, :, axis] = change / (2 * STEP)
        change = problem.exact_stress(ahead) - problem.exact_stress(behind)
        unbalanced += change[:, :, axis] / (2 * STEP)
    stress = problem.exact_stress(points)
    scale = np.abs(stress).max()
    derived = problem.hooke(0.5 * (gradient + gradient.transpose(0, 2, 1)))
    np.testing.assert_allclose(derived, stress, atol=1e-7 * scale)
    np.testing.assert_allclose(unbalanced, 0, atol=1e-6 * scale)


def coarse(problem):
    return problem.resolutions[:-1] if len(problem.resolutions) > 3 else problem.resolutions


@pytest.mark.parametrize(("problem", "resolutions"), [
    *(pytest.param(each, coarse(each), id=type(each).__name__) for each in PROBLEMS),
    pytest.param(exact.LCorner(), (64, 128, 256), marks=pytest.mark.slow),
])  # fmt: skip
def test_observed_order(problem, resolutions):
    for quantity, study in convergence(problem, resolutions).items():
        low, high = problem.orders[quantity]
        assert low < study.order < high, (quantity, study)


@pytest.mark.parametrize("ratio", [-0.3, 0.0, 0.49])
def test_the_cantilever_converges_for_any_ratio_and_plane(ratio):
    for plane in ("stress", "strain"):
        problem = exact.TimoshenkoCantilever(poissons_ratio=ratio, plane=plane)
        study = convergence(problem, (8, 16))["displacement"]
        assert 1.7 < study.order < 2.4
        assert study.errors[-1] < 0.01


CLOSE = 1e-10
VARIANTS = [
    UniformCompression(plane="stress"),
    UniformCompression(poissons_ratio=-0.6),
    UniformCompression(dimension=3),
    ConfinedCompression(plane="stress"),
    ConfinedCompression(poissons_ratio=0.499),
    ConfinedCompression(dimension=3),
    ConfinedCompression(dimension=3, poissons_ratio=0.49),
]
REPRESENTED = [
    pytest.param(problem, id=f"{type(problem).__name__}-{number}")
    for number, problem in enumerate([*(kind() for kind in exact.EXACT_PROBLEMS), *VARIANTS])
]


@pytest.mark.parametrize("problem", REPRESENTED)
def test_the_grid_represents_the_answer(problem):
    for resolution in problem.resolutions:
        result = problem.solve(resolution, tolerance=1e-13)
        for quantity in problem.orders:
            assert problem.error(result, quantity) < CLOSE


@pytest.mark.parametrize("problem", [
    ConfinedCompression(poissons_ratio=0.4999),
    ConfinedCompression(dimension=3, poissons_ratio=0.4999),
])  # fmt: skip
def test_extreme_materials_cost_the_digits_of_their_contrast(problem):
    result = problem.solve(6, tolerance=1e-13)
    assert max(problem.error(result, of) for of in ("displacement", "stress")) < 1e-8


def test_a_rotation_stores_no_energy():
    result = RigidRotation().solve(6)
    strained = RigidRotation(finite=True, angle=0.1).solve(6)
    assert abs(result.strain_energy) < 1e-12 * strained.strain_energy
