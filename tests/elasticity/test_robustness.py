"""Iterations to 1e-8 on holes, contrasts and nearly incompressible bodies."""

import numpy as np
import pytest
from elastic_cases import cube, pixel_body, plate
from scipy.sparse.linalg import spsolve

from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.elastic.equal.staggered import Numbering, stiffness_matrix


@pytest.fixture(autouse=True)
def iterated(monkeypatch):
    """Few cells are iterated here as many are."""
    monkeypatch.setattr("kaju.model.elastic.equal.solver.FEW", {2: 0, 3: 0})


def assert_exact(solution, problem, share):
    """Not further off than a share of the answer of a sparse direct solver, on the active faces."""
    numbering = Numbering(problem.face_states)
    matrix = stiffness_matrix(problem, numbering).tocsc()
    exact = spsolve(matrix, numbering.gather(problem.force))
    mine = numbering.gather(solution.displacement)
    assert np.abs(mine - exact).max() <= share * np.abs(exact).max()


def solved(problem, most):
    solution = solve_problem(problem, 1e-8)
    assert solution.converged
    assert solution.iterations <= most
    assert_exact(solution, problem, 1e-6)
    return solution


@pytest.mark.parametrize("n", [20, 80, 120])
def test_the_worked_plate_takes_at_most_twelve(n):
    assert solve_problem(plate(n), 1e-8).iterations <= 12


@pytest.mark.parametrize(
    "name",
    [
        *("hole", "square-hole", "top 1e3", "top 1e6", "top 1e-6", "bottom 1e6"),
        *("inclusion 1e-6", "inclusion 1e3", "inclusion 1e6"),
    ],
)
@pytest.mark.parametrize("n", [64, 75])
def test_voids_and_contrast_take_at_most_thirty(name, n):
    solution = solved(pixel_body(name, n), 30)
    assert solution.method == "Galerkin multigrid"
    assert not solution.notes


@pytest.mark.parametrize("ratio", [0.46, 0.49, 0.499, 0.4999, 0.499999])
def test_nearly_incompressible_in_plane_strain(ratio):
    counts = [solved(pixel_body(f"strain {ratio}", n), 60).iterations for n in (32, 64)]
    assert abs(counts[0] - counts[1]) <= 6


@pytest.mark.parametrize("ratio", [0.46, 0.4999])
def test_nearly_incompressible_in_space(ratio):
    solution = solved(cube(8, ratio), 60)
    assert solution.method == "mixed form"


@pytest.mark.parametrize("name", ["frame", "comb", "checkers 1e3", "checkers 1e6"])
def test_what_defeats_multigrid_is_solved_all_the_same(name):
    problem = pixel_body(name, 96)
    solution = solve_problem(problem, 1e-8)
    assert solution.converged
    assert solution.method in ("direct", "Galerkin multigrid")
    if solution.method == "direct":
        assert "slow" in solution.notes[0]
    assert_exact(solution, problem, 2e-5)


def test_where_factors_would_be_too_large_a_slow_iteration_goes_on(monkeypatch):
    monkeypatch.setattr("kaju.model.elastic.equal.iterative.DIRECT_LIMIT", {2: 0, 3: 0})
    problem = pixel_body("comb", 96)
    solution = solve_problem(problem, 1e-8)
    assert solution.method == "Galerkin multigrid"
    assert "slow" in solution.notes[0]
    assert_exact(solution, problem, 1e-4)


@pytest.mark.parametrize(
    "name", ["plain", "hole", "inclusion 1e3", "comb", "strain 0.4999", "ratio -0.9"]
)
def test_factors_of_few_cells_find_what_iterations_do(name, monkeypatch):
    problem = pixel_body(name, 64)
    iterated = solve_problem(problem, 1e-11)
    monkeypatch.setattr("kaju.model.elastic.equal.solver.FEW", {2: 64**2, 3: 0})
    solution = solve_problem(problem)
    assert (solution.method, solution.iterations <= 2) == ("direct", True)
    assert solution.energy == pytest.approx(iterated.energy, rel=1e-9)
    largest = max(np.abs(u).max() for u in iterated.displacement)
    for one, other in zip(solution.displacement, iterated.displacement, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-8 * largest)
    assert solution.discretisation == pytest.approx(iterated.discretisation, rel=0.35)
