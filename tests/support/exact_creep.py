"""Exact answers of a three-element material to a history: those to its jumps and bends, added."""

import numpy as np
from scipy.special import exprel

from kaju import History


def added(history, times, to_jump, to_ramp):
    history = history if isinstance(history, History) else History.step(history)
    at, jumps, bends = history.corners()
    since = np.maximum(np.asarray(times) - at[:, None], 0.0)
    return jumps @ to_jump(since) + bends @ to_ramp(since)


def exactly_crept(element, force, times):
    """Displacement: of a held force t/D_d + (1 - exp(-t K_f/D_f))/K_f, of a ramp the integral."""
    spring, beside, behind = element.K_f, element.D_f, element.D_d

    def held(t):
        given = t / beside * exprel(-t * spring / beside) if beside else (t > 0.0) / spring
        return given + t / behind

    def ramp(t):
        x = t * spring / (beside or 1.0)
        far = (x + np.expm1(-x)) / np.maximum(x, 1e-3) ** 2
        mean = np.where(x < 1e-3, 0.5 - x / 6.0 + x**2 / 24.0, far)
        return (t**2 / beside * mean if beside else t / spring) + 0.5 * t**2 / behind

    return added(force, times, held, ramp)


def exactly_relaxed(element, displacement, times):
    """Force: a held displacement fades, a ramp stretches the spring and then flows."""
    share, pace = 1.0 / (1.0 + element.D_f / element.D_d), element.K_f / (element.D_d + element.D_f)

    def held(t):
        return (t > 0.0) * share**2 * element.K_f * np.exp(-t * pace)

    def ramp(t):
        flows = element.D_f * np.exp(-t * pace)
        return (t > 0.0) * share * (element.K_f * t * exprel(-t * pace) + flows)

    return added(displacement, times, held, ramp)
