"""Conjugate gradients and minimal residuals, with the history that a result reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from kaju.arrays import Floats
from kaju.stopping import interrupt_requested

Operator = Callable[[Floats], Floats]


def dot(a: Floats, b: Floats) -> float:
    """Return a·b, summed in the same order on any number of processors."""
    # Not BLAS: its threads would wait for each other for longer than these sums take.
    return float(np.einsum("i,i->", a, b))


@dataclass
class Iteration:
    """How an iteration went."""

    solution: Floats  # The last iterate
    residuals: list[float] = field(default_factory=list)
    """Norm of the residual, relative to the right-hand side, before every iteration."""
    errors: list[float] = field(default_factory=list)
    """Estimated energy norm of the error that is left, relative to the solution's."""
    converged: bool = False
    held_back: float = 0.0
    """Work that the residual at the start would do on the start."""
    residual: Floats = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def iterations(self) -> int:
        """Number of preconditioner applications after the start."""
        return max(len(self.residuals) - 1, 0)

    @property
    def rate(self) -> float:
        """Mean factor per iteration over the last five."""
        recent = self.residuals[-6:]
        if len(recent) < 2 or recent[0] <= 0:
            return 0.0
        return float((recent[-1] / recent[0]) ** (1 / (len(recent) - 1)))

    def at_rounding(self, error: float = 1e-8) -> bool:
        """Tell whether the residual has stopped falling, below an error, as no digits are left."""
        recent = self.residuals
        stalled = len(recent) > 8 and min(recent[-4:]) > 0.5 * min(recent[:-4])
        return stalled and self.errors[-1] < error


def conjugate_gradients(
    apply: Operator,
    precondition: Operator,
    load: Floats,
    start: Floats | None,
    done: Callable[[Iteration], bool],
    most: int = 200,
    energy: Callable[[Floats], float] | None = None,
) -> Iteration:
    """Solve a symmetric positive definite system (Hestenes & Stiefel 1952)."""
    # `done` sees the history after every step and decides. The error estimate is √(r·Br) for a
    # preconditioner B that is spectrally close to the inverse, over √(energy(solution)), by default
    # √(load·solution). What `apply` returns is overwritten.
    x = np.zeros_like(load) if start is None else start
    r = load.copy() if start is None else load - apply(x)
    scale = float(np.sqrt(dot(load, load))) or 1.0
    run = Iteration(x, held_back=dot(x, r), residual=r)
    p: Floats | None = None
    square, previous = dot(r, r), 1.0
    for step in range(most + 1):
        run.residuals.append(float(np.sqrt(square)) / scale)
        if run.residuals[-1] == 0.0 or not np.isfinite(run.residuals[-1]):
            run.errors.append(0.0)
            run.converged = run.residuals[-1] == 0.0
            return run
        z = precondition(r)
        product = dot(r, z)
        whole = abs(dot(load, x) if energy is None else energy(x))
        positive = product > 0.0 and whole > 0.0
        run.errors.append(float(np.sqrt(product / whole)) if positive else np.inf)
        if done(run):
            # The last correction is at hand; its own error is smaller by the cycle's rate.
            run.converged = True
            x += z
            return run
        if step == most or product <= 0.0 or interrupt_requested():
            return run
        if p is None:
            p = np.array(z, dtype=np.float64)
        else:
            p *= product / previous
            p += z
        previous = product
        q = apply(p)
        resisted = dot(p, q)
        if not resisted > 0.0:  # Rounding has eaten what the body resists with.
            return run
        length = product / resisted
        q *= length
        r -= q
        x += np.multiply(p, length, out=q)
        square = dot(r, r)
    return run


def minimal_residuals(
    apply: Operator, precondition: Operator, load: Floats, tolerance: float, most: int = 300
) -> Iteration:
    """Solve a symmetric indefinite system with a positive definite preconditioner."""
    # Preconditioned MINRES (Paige & Saunders 1975) in the form of Elman, Silvester & Wathen, Finite
    # Elements and Fast Iterative Solvers, algorithm 4.1. The residual is measured in the
    # preconditioner's norm.
    x = np.zeros_like(load)
    v_old, v = np.zeros_like(load), load.copy()
    w_old, w = np.zeros_like(load), np.zeros_like(load)
    z = precondition(v)
    gamma_old, gamma = 1.0, float(np.sqrt(v @ z))
    eta = start = gamma
    s_old = s = 0.0
    c_old = c = 1.0
    run = Iteration(x, [1.0], [1.0])
    if start == 0.0:
        run.converged = True
        return run
    for _ in range(most):
        z /= gamma
        az = apply(z)
        delta = float(az @ z)
        v_new = az - (delta / gamma) * v - (gamma / gamma_old) * v_old
        z_new = precondition(v_new)
        gamma_new = float(np.sqrt(max(float(v_new @ z_new), 0.0)))
        a0 = c * delta - c_old * s * gamma
        a1 = float(np.hypot(a0, gamma_new))
        a2 = s * delta + c_old * c * gamma
        a3 = s_old * gamma
        c_old, c, s_old, s = c, a0 / a1, s, gamma_new / a1
        w_old, w = w, (z - a3 * w_old - a2 * w) / a1
        x += c * eta * w
        eta = -s * eta
        run.residuals.append(abs(eta) / start)
        run.errors.append(run.residuals[-1])
        if run.residuals[-1] <= tolerance:
            run.converged = True
            return run
        if gamma_new == 0.0 or interrupt_requested():
            return run
        v_old, v, z = v, v_new, z_new
        gamma_old, gamma = gamma, gamma_new
    return run
