"""Conjugate gradients, with the history that a result reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from kaju.arrays import Floats
from kaju.stepping import interrupt_requested

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


def rate_of(values: list[float]) -> float:
    """Return the mean factor from each value to the next; 0 if there is none."""
    if len(values) < 2 or values[0] <= 0.0:
        return 0.0
    return float((values[-1] / values[0]) ** (1 / (len(values) - 1)))


def conjugate_gradients(
    apply: Operator,
    precondition: Operator,
    load: Floats,
    start: Floats,
    done: Callable[[Iteration], bool],
    most: int = 200,
    energy: Callable[[Floats], float] | None = None,
) -> Iteration:
    """Solve a symmetric positive definite system (Hestenes & Stiefel 1952)."""
    # `done` sees the history after every step and decides. The error estimate is √(r·Br) for a
    # preconditioner B that is spectrally close to the inverse, over √(energy(solution)), by default
    # √(load·solution). What `apply` returns is overwritten.
    x, r = start, load - apply(start)
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
