"""Coefficients that bring the prescribed rule closest to a reference."""

from dataclasses import replace

import numpy as np
import pytest
from plates import plate as pressed

from kaju import (
    Coefficients,
    ElasticRule,
    LoadModel,
    PrescribedRule,
    Reference,
    compare,
    fit_rule,
    solve,
)
from kaju.errors import ParameterError

OWN = PrescribedRule(alpha=(0.5, 0.5, 0.25), beta=0.5, threshold=0.02)


def plate(rule=OWN, steps=1):
    return pressed([10, 10], [5, 9], steps=steps, size=[0.1, 0.1], thickness=0.002, rule=rule)


def as_reference(result):
    points = result.scene.lattice.centres(np.argwhere(result.scene.rasterise() >= 0))
    return Reference(points, result.displacement_at(points), result.stress_at(points))


@pytest.fixture(scope="module")
def fit():
    return fit_rule(plate(), solve(plate(), resolution=8), evaluations=120)


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
    assert 90 <= fit.evaluations <= 126


def test_the_same_question_has_the_same_answer():
    one, again = (fit_rule(plate(), solve(plate()), evaluations=20) for _ in range(2))
    assert again.rule == one.rule
    np.testing.assert_array_equal(again.history, one.history)


def test_loads_are_not_multiplied_unless_allowed(fit):
    _, forward, friction = fit.rule.alpha
    assert forward + 2.0 * friction <= 1.0 + 1e-12
    assert LoadModel(plate(fit.rule)).certificate.stable
    reference = solve(plate(), resolution=8)
    free = fit_rule(plate(), reference, most_passed_on=1.4, evaluations=80)
    assert LoadModel(plate(free.rule)).certificate.stable
    assert free.misfit[1] < fit.misfit[1]


def test_coefficients_that_made_the_reference_are_found_again():
    """The reference was made by the rule itself, so the misfit must all but vanish."""
    made = replace(OWN, alpha=(0.3, 0.6, 0.15), beta=0.9)
    fit = fit_rule(plate(), as_reference(LoadModel(plate(made)).run()), evaluations=200)
    assert fit.misfit[0] > 0.3
    assert fit.misfit[1] < 0.1


def test_stress_can_be_fitted_instead():
    reference = solve(plate(), resolution=8)
    fit = fit_rule(plate(), reference, quantity="stress", evaluations=40)
    assert fit.misfit[1] == fit.after.stress.misfit < fit.misfit[0]


def test_adding_up_stays_stable():
    adding = PrescribedRule(alpha=(0.5, 0.3, 0.15), beta=1.0, threshold=0.02, accumulate=True)
    fit = fit_rule(plate(adding), solve(plate(), resolution=4), evaluations=40)
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


def test_the_elastic_rule_has_nothing_to_fit():
    with pytest.raises(ParameterError, match="its rule is 'elastic'"):
        fit_rule(plate(ElasticRule()), solve(plate()))


def test_stress_needs_a_reference_that_knows_it():
    result = solve(plate())
    points = np.array([[0.055, 0.095], [0.055, 0.055]])
    reference = Reference(points, result.displacement_at(points))
    with pytest.raises(ParameterError, match="knows no stress"):
        fit_rule(plate(), reference, quantity="stress")


def test_a_fit_of_one_quantity_says_what_it_costs_the_other(fit):
    by_name = {row.quantity: row for row in fit.misfits}
    assert by_name["displacement"].after < by_name["displacement"].before
    assert by_name["stress"].after > by_name["stress"].before
    assert by_name["stress"].weight == 0.0
    assert "stress" in fit.trade_off.partition("but")[2]
    assert fit.trade_off in str(fit)


def test_several_quantities_are_weighed():
    reference = solve(plate(), resolution=4)

    def both_after(**weights):
        fit = fit_rule(plate(), reference, quantity=weights, evaluations=30)
        return np.hypot(*(row.after for row in fit.misfits))

    both = both_after(displacement=1.0, stress=1.0)
    assert both < both_after(displacement=1.0)
    assert both < both_after(displacement=1.0, stress=0.0)
    assert both == pytest.approx(both_after(displacement=3.0, stress=3.0), rel=1e-9)


def test_several_scenes_are_fitted_together():
    """Two bodies whose references were made by one rule: it is found on both at once."""
    made = replace(OWN, alpha=(0.3, 0.6, 0.15), beta=0.9)
    load = {"side": "top", "force": [0.0, -2.0]}
    bar = pressed([4, 10], None, thickness=0.002, material="rubber", loads=[load], rule=OWN)
    scenes = [plate(), bar]
    references = [as_reference(LoadModel(scene.replace(rule=made)).run()) for scene in scenes]
    fit = fit_rule(scenes, references, evaluations=150)
    both = [(n, quantity) for n in (0, 1) for quantity in ("displacement", "stress")]
    assert [(row.scene, row.quantity) for row in fit.misfits] == both
    assert all(row.after < 0.5 * row.before for row in fit.misfits if row.weight)
    alone = fit_rule(scenes, references, weights=[1.0, 0.0], evaluations=40)
    first = fit_rule(plate(), references[0], evaluations=40)
    assert alone.misfit == pytest.approx(first.misfit, rel=1e-12)


def test_without_a_reference_elasticity_is_believed():
    fit = fit_rule(plate(), evaluations=20)
    assert fit.misfit[0] == pytest.approx(0.79, abs=0.1)
    assert fit.before.reference.resolution == 8


def test_it_ends_in_time_with_the_best_until_then():
    fit = fit_rule(plate(), solve(plate()), evaluations=100_000, seconds=0.5)
    assert fit.evaluations < 100_000
    assert fit.notes[0].startswith("ended after 0.5 s")
    assert fit.misfit[1] == pytest.approx(fit.history[-1], rel=1e-12)


@pytest.mark.parametrize(
    ("scenes", "arguments", "message"),
    [
        (1, {"quantity": "strain"}, "quantity: 'displacement' or 'stress', got 'strain'"),
        (1, {"evaluations": 3}, "evaluations: 10 or more"),
        (1, {"most_passed_on": 3.0}, "most_passed_on: must lie above 0 and up to 2"),
        (2, {"weights": [1.0]}, "weights: one for each of the 2 scenes"),
        (1, {"weights": [0.0]}, "weights: weights from 0 upwards, not all 0"),
        (1, {"quantity": {"displacement": -1.0}}, "quantity: weights from 0 upwards"),
        (1, {"quantity": {"displacment": 1.0}}, "did you mean 'displacement'"),
        (1, {"seconds": 0.0}, "seconds: a time above 0 s"),
        (2, {"reference": []}, "reference: one for each of the 2 scenes"),
    ],
)
def test_wrong_arguments_are_named(scenes, arguments, message):
    with pytest.raises(ParameterError, match=message):
        fit_rule([plate()] * scenes, **arguments)


def test_plane_and_space_are_fitted_apart():
    cube = pressed([2, 2, 2], [0, 0, 1], [0.0, 0.0, -1.0])
    with pytest.raises(ParameterError, match="all must be in the plane, or all in space"):
        fit_rule([plate(), cube])
