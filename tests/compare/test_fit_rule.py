"""Coefficients that bring the prescribed rule closest to a reference."""

from dataclasses import replace

import numpy as np
import pytest

from kaju import LoadModel, Reference, Scene, compare, fit_rule, solve
from kaju.agents.rules import Coefficients, ElasticRule, PrescribedRule
from kaju.errors import ParameterError

OWN = PrescribedRule(alpha=(0.5, 0.5, 0.25), beta=0.5, threshold=0.02)


def plate(rule=OWN, steps=1):
    return Scene(
        body={"size": [0.1, 0.1], "cells": [10, 10], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [5, 9], "force": [0.0, -2.0], "steps": steps}],
        rule=rule,
    )


def as_reference(result):
    points = result.scene.lattice.centres(np.argwhere(result.scene.rasterise() >= 0))
    return Reference(points, result.displacement_at(points), result.stress_at(points))


@pytest.fixture(scope="module")
def fit():
    return fit_rule(plate(), solve(plate(), resolution=8), evaluations=200)


def test_the_fitted_rule_is_closer_and_ready_to_use(fit):
    before, after = fit.misfit
    assert after < 0.9 * before
    result = LoadModel(plate(fit.rule)).run()
    again = compare(result, solve(plate(), resolution=8))
    assert again.displacement.misfit == pytest.approx(after, rel=1e-12)
    assert fit.before.displacement.misfit == pytest.approx(before, rel=1e-12)


def test_history_only_falls_and_counts_the_runs(fit):
    assert (np.diff(fit.history) <= 0.0).all()
    assert fit.history[0] == fit.misfit[0]
    assert fit.history[-1] == pytest.approx(fit.misfit[1], rel=1e-12)
    assert 150 <= fit.evaluations <= 210


def test_the_same_question_has_the_same_answer(fit):
    again = fit_rule(plate(), solve(plate(), resolution=8), evaluations=200)
    assert again.rule == fit.rule
    np.testing.assert_array_equal(again.history, fit.history)


def test_loads_are_not_multiplied_unless_allowed(fit):
    _, forward, friction = fit.rule.alpha
    assert forward + 2.0 * friction <= 1.0 + 1e-12
    assert LoadModel(plate(fit.rule)).certificate.stable
    reference = solve(plate(), resolution=8)
    free = fit_rule(plate(), reference, most_passed_on=1.4, evaluations=200)
    assert LoadModel(plate(free.rule)).certificate.stable
    assert free.misfit[1] < fit.misfit[1]


def test_coefficients_that_made_the_reference_are_found_again():
    """The reference was made by the rule itself, so the misfit must all but vanish."""
    made = replace(OWN, alpha=(0.3, 0.6, 0.15), beta=0.9)
    fit = fit_rule(plate(), as_reference(LoadModel(plate(made)).run()), evaluations=500)
    assert fit.misfit[0] > 0.3
    assert fit.misfit[1] < 0.1


def test_stress_can_be_fitted_instead():
    reference = solve(plate(), resolution=8)
    fit = fit_rule(plate(), reference, quantity="stress", evaluations=100)
    assert fit.misfit[1] == fit.after.stress.misfit < fit.misfit[0]


def test_adding_up_stays_stable():
    adding = PrescribedRule(alpha=(0.5, 0.3, 0.15), beta=1.0, threshold=0.02, accumulate=True)
    fit = fit_rule(plate(adding), solve(plate(), resolution=4), evaluations=100)
    assert fit.rule.accumulate
    assert LoadModel(plate(fit.rule)).certificate.stable
    assert fit.misfit[1] < fit.misfit[0]


def test_the_last_stage_alone_is_fitted_and_materials_lose_their_own_coefficients():
    rule = replace(OWN, materials={"steel": Coefficients(alpha=(0.4, 0.4, 0.3))})
    fit = fit_rule(plate(rule, steps=3), solve(plate()), evaluations=20)
    assert fit.rule.materials == {}
    assert fit.rule.threshold == rule.threshold
    single = LoadModel(plate(rule)).run()
    assert fit.misfit[0] == pytest.approx(compare(single, solve(plate())).displacement.misfit)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"quantity": "strain"}, "quantity: 'displacement' or 'stress', got 'strain'"),
        ({"evaluations": 3}, "evaluations: 10 or more"),
        ({"most_passed_on": 3.0}, "most_passed_on: must lie above 0 and up to 2"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ParameterError, match=message):
        fit_rule(plate(), solve(plate()), **arguments)


def test_the_elastic_rule_has_nothing_to_fit():
    with pytest.raises(ParameterError, match="its rule is 'elastic'"):
        fit_rule(plate(ElasticRule()), solve(plate()))


def test_stress_needs_a_reference_that_knows_it():
    result = solve(plate())
    points = np.array([[0.055, 0.095], [0.055, 0.055]])
    reference = Reference(points, result.displacement_at(points))
    with pytest.raises(ParameterError, match="knows no stress"):
        fit_rule(plate(), reference, quantity="stress")
