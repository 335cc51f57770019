"""Coefficients that bring the prescribed rule closest to a reference."""

from dataclasses import replace

import numpy as np
import pytest
from plates import plate as pressed

from kaju import LoadModel, PrescribedRule, Reference, compare, fit_rule, solve
from kaju.errors import ParameterError

OWN = PrescribedRule(alpha=(0.5, 0.5, 0.25), beta=0.5, threshold=0.02)


def plate(rule=OWN, steps=1):
    return pressed([10, 10], [5, 9], steps=steps, size=[0.1, 0.1], thickness=0.002, rule=rule)


@pytest.fixture(scope="module")
def fit():
    return fit_rule(plate(), solve(plate(), resolution=8), evaluations=120)


def test_the_fitted_rule_is_closer_and_ready_to_use(fit):
    before, after = fit.misfit
    assert after < 0.9 * before
    again = compare(LoadModel(plate(fit.rule)).run(), solve(plate(), resolution=8))
    assert again.displacement.misfit == pytest.approx(after, rel=1e-12)
    assert fit.before.displacement.misfit == pytest.approx(before, rel=1e-12)


@pytest.mark.slow
def test_coefficients_that_made_the_reference_are_found_again():
    """The reference was made by the rule itself, so the misfit must all but vanish."""
    run = LoadModel(plate(replace(OWN, alpha=(0.3, 0.6, 0.15), beta=0.9))).run()
    points = run.scene.lattice.centres(np.argwhere(run.scene.rasterise() >= 0))
    known = Reference(points, run.displacement_at(points), run.stress_at(points))
    fit = fit_rule(plate(), known, evaluations=200)
    assert fit.misfit[1] < 0.1 < 0.3 < fit.misfit[0]
    steps = plate(steps=3).replace(loading="continue")  # all at once
    again = fit_rule(steps, fit.after.reference, evaluations=10)
    assert again.misfit[0] == fit.misfit[0]


@pytest.mark.parametrize(("arguments", "message"), [
    ({"quantity": "strain"}, "quantity: must be 'displacement' or 'stress', got 'strain'"),
    ({"evaluations": 3}, "evaluations: must be 10 or more"),
    ({"quantity": "displacment"}, "did you mean 'displacement'"),
])  # fmt: skip
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ParameterError, match=message):
        fit_rule(plate(), **arguments)
