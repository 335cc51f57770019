"""The uniform plate and the unit cube, to the digits of two independent programs."""

import numpy as np
import pytest
from elastic_cases import cube, plate

from kaju.model.elastic.equal.solver import solve_problem


def plate_values(n):
    problem = plate(n)
    solution = solve_problem(problem, 1e-11)
    y = problem.scales.displacement * solution.displacement[1][1:-1, 1:-1]
    middle = y[n // 2 - 1 : n // 2 + 1].mean(axis=0)
    return middle[-1], middle[n // 2], solution


@pytest.mark.parametrize(
    ("n", "under_load", "centre"),
    [
        (80, -1.16878709e-8, -2.88729657e-9),
        pytest.param(320, -1.16719728e-8, -2.88620773e-9),
        pytest.param(1280, -1.16709893e-8, -2.88611051e-9, marks=pytest.mark.slow),
    ],
)
def test_plate(n, under_load, centre):
    top, middle, solution = plate_values(n)
    assert top == pytest.approx(under_load, rel=5e-9)
    assert middle == pytest.approx(centre, rel=5e-9)
    assert solution.method == ("direct" if n < 200 else "full multigrid")
    # Converged finite elements give -1.16709e-8 and -2.8861e-9 m.
    assert top == pytest.approx(-1.16709e-8, rel=100 / n**2 + 1e-5)


@pytest.mark.parametrize(
    ("n", "energy", "under_load", "centre"),
    [
        (8, 2.17789, -4.35579, -0.733370),
        (16, 1.85313, -4.07069, -0.700344),
        pytest.param(32, 1.73755, -4.01520, -0.691329, marks=pytest.mark.slow),
    ],
)
def test_cube(n, energy, under_load, centre):
    problem = cube(n)
    solution = solve_problem(problem, 1e-10)
    unit = problem.scales.displacement
    z = unit * solution.displacement[2][1:-1, 1:-1, 1:-1]
    axis = z[n // 2 - 1 : n // 2 + 1, n // 2 - 1 : n // 2 + 1].mean(axis=(0, 1))
    assert solution.energy * problem.scales.force * unit == pytest.approx(energy, rel=5e-6)
    assert axis[-1] == pytest.approx(under_load, rel=2e-6)
    assert axis[n // 2] == pytest.approx(centre, rel=2e-6)


def test_error_estimate_follows_the_energy_error():
    # The limit is that of the tables' own sequence, extrapolated.
    limit = 1.10770e-8
    for n in (80, 160):
        problem = plate(n)
        solution = solve_problem(problem)
        energy = solution.energy * problem.scales.force * problem.scales.displacement
        true = np.sqrt(energy / limit - 1)
        assert 0.5 < solution.error / true < 3
