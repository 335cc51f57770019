"""Problems whose error must fall with the cell size, by the power that theory gives."""

import numpy as np
import pytest

from exact import (
    CONVERGING_PROBLEMS,
    Cerruti,
    LCorner,
    TimoshenkoCantilever,
    convergence,
)

STEP = 1e-5
PROBLEMS = [kind() for kind in CONVERGING_PROBLEMS]


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


@pytest.mark.parametrize(
    ("problem", "resolutions"),
    [
        *(pytest.param(each, coarse(each), id=type(each).__name__) for each in PROBLEMS),
        pytest.param(LCorner(), (64, 128, 256), marks=pytest.mark.slow),
        pytest.param(Cerruti(), (8, 16, 32), marks=pytest.mark.slow),
    ],
)
def test_observed_order(problem, resolutions):
    for quantity, study in convergence(problem, resolutions).items():
        low, high = problem.orders[quantity]
        assert low < study.order < high, (quantity, study)


@pytest.mark.parametrize("ratio", [-0.3, 0.0, 0.49])
def test_the_cantilever_converges_for_any_ratio_and_plane(ratio):
    for plane in ("stress", "strain"):
        problem = TimoshenkoCantilever(poissons_ratio=ratio, plane=plane)
        study = convergence(problem, (8, 16))["displacement"]
        assert 1.7 < study.order < 2.4
        assert study.errors[-1] < 0.01
