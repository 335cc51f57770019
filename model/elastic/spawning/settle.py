"""Agents settle: they move until their forces balance, to a share of their error."""

from __future__ import annotations

from math import inf, sqrt

from kaju.model.elastic.krylov import Iteration, dot

from .balance import Balance
from .composite import Floats
from .indicator import Indicator
from .nested import NestedMultigrid

WORST = 0.05
"""Displacements that are off by more than this share do not tell who has to spawn."""


def settle(balance: Balance, hierarchy: NestedMultigrid, u: Floats, share: float) -> Iteration:
    """Solve for the free faces of `u`, in place, to a relative algebraic error."""
    free = balance.free
    right = (balance.load - balance.pull)[free]
    load, given = balance.load[free], balance.given_energy

    def twice_energy(x: Floats) -> float:
        return 2 * float(dot(x, load)) - float(dot(x, right)) + given

    def done(run: Iteration) -> bool:
        return run.errors[-1] <= min(share, WORST) or _at_rounding(run)

    run = hierarchy.solve(right, u[free], done, twice_energy)
    u[free] = run.solution
    return run


def _at_rounding(run: Iteration) -> bool:
    recent = run.residuals
    return len(recent) > 8 and min(recent[-4:]) > 0.5 * min(recent[:-4]) and run.errors[-1] < 1e-8


def energy_of(balance: Balance, u: Floats) -> float:
    """Return the energy, of second order in what the iteration left."""
    free = balance.free
    rest = balance.force(u)[free] - balance.load[free]
    return balance.energy(u) - float(dot(rest, u[free]))


def relative_error(indicator: Indicator, energy: float) -> float:
    """Return the estimated error in the energy norm, relative to a solution of some energy."""
    total = float(indicator.square.sum())
    if energy <= 0.0:
        return 0.0 if total == 0.0 else inf
    return sqrt(total / (2 * energy))
