"""Problems with known answers, by every scheme and pace."""

import numpy as np
import pytest
from creep_problems import PROBLEMS, CreepUnderForce

from kaju.model.rheology.creeping import creep


def errors(given, steps, scheme):
    exact = given.exact(given.times)
    found = []
    for step in steps:
        result = creep(
            given.subject,
            given.history,
            given.times[-1],
            times=given.times,
            step=step,
            scheme=scheme,
            drive=given.drive,
        )
        found.append(np.abs(given.measured(result) - exact).max())
    return np.array(found)


@pytest.mark.parametrize("name", sorted(PROBLEMS))
@pytest.mark.parametrize(("scheme", "order"), [("backward_euler", 1.0), ("sdirk2", 2.0)])
def test_every_problem_is_met_with_the_scheme_s_order(name, scheme, order):
    found = errors(PROBLEMS[name](), (0.05, 0.025), scheme)
    np.testing.assert_allclose(np.log2(found[:-1] / found[1:]), order, atol=0.1)


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_every_problem_is_met_within_the_tolerance(name):
    given = PROBLEMS[name]()
    result = creep(
        given.subject, given.history, given.times[-1], times=given.times, tolerance=1e-3,
        drive=given.drive,
    )  # fmt: skip
    exact = given.exact(given.times)
    assert np.abs(given.measured(result) - exact).max() < 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_the_known_answers_agree_with_superposition(name):
    given = PROBLEMS[name]()
    answer = given.subject.creep if given.drive == "forces" else given.subject.relaxation
    driver = "force" if given.drive == "forces" else "displacement"
    superposed = answer(**{driver: given.history}, times=given.times, scheme="exact")
    np.testing.assert_allclose(superposed, given.exact(given.times), rtol=1e-12)


@pytest.mark.parametrize("pace", [1e-6, 1e-2, 1.0, 1e4, 1e12])
def test_the_discrete_formula_is_exact(pace):
    given = CreepUnderForce()
    step = pace * given.subject.retardation_time
    times = step * np.arange(1, 201)
    crept = given.subject.creep(force=given.force, times=times)
    expected = [given.after_steps(step, n) for n in range(1, 201)]
    np.testing.assert_allclose(crept, expected, rtol=1e-12)
