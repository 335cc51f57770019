"""The two schemes: the exact discrete formula, order, monotony, energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kaju.model.rheology import schemes as steps
from kaju.model.rheology.element import ThreeElement, laws_of
from kaju.model.rheology.load_history import History

ELEMENT = ThreeElement(K_f=2.0, D_f=3.0, D_d=5.0)
FORCE = 7.0
PACES = 10.0 ** np.arange(-6, 13)


@pytest.mark.parametrize("pace", PACES)
def test_backward_euler_is_the_discrete_creep_formula(pace):
    step, n = pace * ELEMENT.retardation_time, np.arange(1, 1001)
    formula = FORCE * (n * step / 5.0 - np.expm1(-n * np.log1p(step * 2.0 / 3.0)) / 2.0)
    closed = ELEMENT.creep(force=FORCE, times=step * n)
    stepped = ELEMENT.creep(force=History.step(FORCE), times=step * n)
    np.testing.assert_allclose(closed, formula, rtol=1e-12)
    np.testing.assert_allclose(stepped, formula, rtol=1e-12)


def test_a_million_steps_keep_the_discrete_formula():
    n = np.arange(1, 10**6 + 1)
    step = 1e-6 * ELEMENT.retardation_time
    formula = FORCE * (n * step / 5.0 - np.expm1(-n * np.log1p(1e-6)) / 2.0)
    crept = ELEMENT.creep(force=FORCE, times=step * n)
    np.testing.assert_allclose(crept, formula, rtol=1e-12)


@pytest.mark.parametrize("scheme", ["backward_euler", "sdirk2"])
@pytest.mark.parametrize("pace", PACES)
def test_creep_relaxation_and_recovery_never_turn_back(scheme, pace):
    step = pace * ELEMENT.retardation_time
    n = np.arange(1, 301)
    given_way = ELEMENT.creep(force=FORCE, times=step * n, scheme=scheme)
    assert np.all(np.diff(given_way, prepend=0.0) > 0.0)

    unloading = History.step(FORCE).hold(100 * step).release()
    voigt = ThreeElement.kelvin_voigt(2.0, 3.0)
    recovering = voigt.creep(force=unloading, times=step * n, scheme=scheme)
    rounding = 1e-15 * recovering.max()
    assert np.all(np.diff(recovering[100:]) <= rounding)
    assert np.all(recovering >= -rounding)

    stretched = History().ramp(1.0, 100 * step)
    force = ELEMENT.relaxation(displacement=stretched, times=step * n, scheme=scheme)
    rounding = 1e-13 * force.max()
    assert np.all(np.diff(force[:100]) >= -rounding)
    assert np.all(np.diff(force[100:]) <= rounding)
    assert np.all(force >= -rounding)


@given(st.floats(1e-6, 1e12), st.floats(0.0, 1e6), st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_any_element_gives_steadily_and_stays_below_its_limit(pace, spring, damper, flow):
    element = ThreeElement(spring, damper, flow)
    step = pace * damper / max(spring, 1e-6)
    times = step * np.arange(1, 41)
    for scheme in ("backward_euler", "sdirk2"):
        given_way = element.creep(force=1.0, times=times, scheme=scheme)
        assert np.all(np.isfinite(given_way))
        assert np.all(np.diff(given_way, prepend=0.0) >= 0.0)
        # The Voigt part neither passes 1/K_f nor outruns its own damper.
        voigt = given_way - times / flow
        slack = 1e-12 * given_way
        assert np.all(voigt * spring <= 1.0 + slack * spring)
        assert np.all(voigt <= times / damper + slack)


@pytest.mark.parametrize(("scheme", "order"), [("backward_euler", 1.0), ("sdirk2", 2.0)])
@pytest.mark.parametrize("driven", ["force", "displacement"])
def test_measured_order(scheme, order, driven):
    history = History().ramp(1.0, 1.0).hold(2.0).release(1.0).hold(4.0)
    answer = ELEMENT.creep if driven == "force" else ELEMENT.relaxation
    errors = []
    for count in (64, 128, 256):
        times = np.linspace(0.0, 8.0, count + 1)[1:]
        numbers = {driven: history, "times": times}
        errors.append(
            np.abs(answer(**numbers, scheme=scheme) - answer(**numbers, scheme="exact")).max()
        )
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(slopes, order, atol=0.06)


def test_sdirk2_is_second_order_stiffly_accurate_and_lands_on_its_stages():
    method = steps.SDIRK2
    assert method.ends[-1] == 1.0
    assert sum(method.weights) == pytest.approx(1.0, abs=1e-15)
    middle = sum(w * c for w, c in zip(method.weights, method.ends, strict=True))
    assert middle == pytest.approx(0.5, abs=1e-15)
    # the third inner step ends where the whole step ends
    assert method.gamma + 2 * method.spacing == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("name", sorted(steps.SCHEMES))
def test_decay_factors_lie_between_zero_and_one_and_vanish_for_long_steps(name):
    method = steps.scheme(name)
    x = np.concatenate([[0.0], np.logspace(-12, 15, 5001)])
    factor = np.exp(method.log_factor(x))
    assert factor[0] == 1.0
    assert np.all((factor[1:] >= 0.0) & (factor[1:] < 1.0 + 1e-16))
    assert factor[-1] < 1e-14
    short = x[1:200]
    assert np.all(
        np.abs(factor[1:200] - np.exp(-short)) <= 0.6 * short ** (method.order + 1) + 3e-16
    )


def test_uneven_times_are_the_schemes_own_uneven_steps():
    times = np.array([0.3, 0.5, 2.0])
    left = 1.0
    for step in (0.3, 0.2, 1.5):
        left /= 1.0 + step * 2.0 / 3.0
    expected = FORCE * (2.0 / 5.0 + (1.0 - left) / 2.0)
    assert ELEMENT.creep(force=FORCE, times=times)[-1] == pytest.approx(expected, rel=1e-14)


laws = st.tuples(
    st.floats(0.01, 100.0), st.floats(0.0, 100.0), st.sampled_from([0.1, 3.0, 1e4, np.inf])
)


@settings(max_examples=60)
@given(laws, st.floats(-6.0, 12.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_an_element_in_a_step_is_a_spring_with_another_rest_length(numbers, log_step, q, force):
    law, step = ThreeElement(*numbers), 10.0**log_step
    state = steps.Stretch(np.array([q]), np.array([0.25]))
    stiffness, rest = steps.as_spring(law, step, state)
    rate = steps.rates(law, step, state, np.array([force]))
    elongation = state.q + state.d + step * (rate.q + rate.d)
    scale = stiffness * (np.abs(elongation) + np.abs(rest)) + abs(force)
    assert np.all(np.abs(stiffness * (elongation - rest) - force) <= 1e-11 * scale)
    rate = (elongation - state.q - state.d) / step
    assert steps.force_at_rate(law, step, state, rate) == pytest.approx(
        force, abs=1e-11 * float(scale[0])
    )
    # The published form: C = 1/D_d + 1/(K_f h + D_f).
    damper = 1.0 / law.D_d + 1.0 / (law.K_f * step + law.D_f)
    assert stiffness == pytest.approx(1.0 / (damper * step), rel=1e-12)


def test_arrays_of_elements_move_like_single_ones():
    elements = [ThreeElement(2.0, 3.0, 5.0), ThreeElement.spring(4.0), ThreeElement.dashpot(1.0)]
    many = laws_of(elements)
    state = steps.Stretch(np.zeros(3), np.zeros(3))
    for weight in steps.SDIRK2.weights:
        rate = steps.rates(many, steps.SDIRK2.gamma * 0.5, state, np.ones(3))
        state = steps.Stretch(state.q + weight * 0.5 * rate.q, state.d + weight * 0.5 * rate.d)
    single = [float(e.creep(force=1.0, times=[0.5], scheme="sdirk2")[0]) for e in elements]
    np.testing.assert_allclose(state.q + state.d, single, rtol=1e-14)
