"""The asked tolerance is reached: checked against converged finite elements."""

from pathlib import Path

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from spawning_bodies import BODIES, PLANE, SOLID

from kaju import Reference, solve
from kaju.errors import ParameterError

DATA = Path(__file__).parents[1] / "data" / "spawning"
CASES = [(name, 0.05) for name in PLANE] + [("cube", 0.2), ("cube-inclusion", 0.2)]
CASES += [
    pytest.param(name, 0.1, marks=pytest.mark.slow)
    for name in (*PLANE, *SOLID)
    if name != "cube-rubber"
]


@pytest.mark.parametrize(("name", "tolerance"), CASES)
def test_true_error_is_what_was_asked_for(name, tolerance):
    """Ragged bodies, holes between two materials, rubber, contrasts of 10⁴, in both dimensions."""
    truth = Reference.load(DATA / f"{name}.npz")
    result = solve(BODIES[name](), tolerance=tolerance)
    error = np.sqrt(abs(result.generations[-1].energy / truth.strain_energy - 1))
    estimate = result.found.solution.error
    kept = "proved" if name in PLANE else result.tolerance_kept
    assert result.tolerance_kept == kept
    assert kept == "proved" or estimate <= tolerance
    # The estimate of few agents is less sure, above all where foam is beside steel; what the bounds
    # take in the plane does not depend on it.
    assert 0.5 < estimate / error < (10.0 if name == "blotched" else 4.0)
    assert error < 1.6 * max(tolerance, estimate)
    if kept == "proved":
        lower, upper = result.energy_bounds
        assert lower < truth.strain_energy < upper < (1.0 + 4.1 * tolerance**2) * lower
    largest = np.linalg.norm(truth.displacement, axis=1).max()
    away = np.linalg.norm(result.displacement_at(truth.points) - truth.displacement, axis=1).max()
    assert away < (10 if name in PLANE else 4) * tolerance**2 * largest


def test_tolerance_in_space_is_refused_for_rubber():
    """The estimate is too small there; equal cells answer for any ratio below one half."""
    with pytest.raises(ParameterError, match=r"0\.499 at most.*0\.4999"):
        solve(BODIES["cube-rubber"](), tolerance=0.1)


@pytest.mark.parametrize("name", ["rubber", "rubber-corner"])
def test_truth_is_what_finite_elements_say(name):
    pytest.importorskip("skfem")
    truth = Reference.load(DATA / f"{name}.npz")
    answer = graded_elements(BODIES[name](), order=4, levels=6)
    assert answer.strain_energy == pytest.approx(truth.strain_energy, rel=3e-5)
    away = answer.displacement_at(truth.points) - truth.displacement
    assert np.abs(away).max() < 1e-4 * np.abs(truth.displacement).max()
