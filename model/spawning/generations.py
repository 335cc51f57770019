"""From the first agents to the last: solve, look for unbalanced load, spawn, and again."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from kaju.model.elasticity.krylov import Iteration, dot
from kaju.model.elasticity.problem import ACTIVE, STIFF_PRESSURE

from .balance import Balance
from .composite import Composite, Floats
from .ground import Ground
from .held import check_held, slender
from .indicator import Indicator, indicate
from .leaves import Flags
from .nested import DIRECT, FACTORISED, NestedMultigrid

BULK = 0.75
"""The agents that spawn children stand for this share of the squared error (Dörfler 1996)."""
SPARE = 0.9
"""The last generation aims at this share of the tolerance."""
GAIN = 0.7
"""Share of its squared error that an agent's children are expected to take away."""
ALGEBRAIC_SHARE = 0.05
"""Every generation is solved to this share of its estimated error, the last one further."""
LAST = 1e-10
MOST_GENERATIONS = 60


class Generation(NamedTuple):
    """One step of spawning: agents, estimated error, energy (scaled) and iterations."""

    agents: int
    error: float
    energy: float
    iterations: int


@dataclass
class Spawning:
    """The agents and how they came to be; scaled.

    Attributes
    ----------
    balance : Balance
        The last generation's grid.
    displacement : array, shape (faces,)
    indicator : Indicator
        What each agent leaves unbalanced.
    energy : float
    error : float
        Estimated error in the energy norm, relative.
    generations : list of Generation
    residuals : list of float
        History of the last generation's iteration.
    levels : int
        Levels of the last multigrid cycle.
    reached : bool
        Whether the error is within the tolerance.
    stopped : str
        Why it ended, if it is not: "depth" (the smallest agents allowed), "agents" or
        "iteration".
    notes : list of str
    """

    balance: Balance
    displacement: Floats
    indicator: Indicator
    energy: float
    error: float
    generations: list[Generation]
    residuals: list[float]
    levels: int
    reached: bool
    stopped: str
    notes: list[str] = field(default_factory=list)


def spawn(ground: Ground, tolerance: float, most_agents: int) -> Spawning:
    """Solve with agents that are small only where the error asks for it.

    Parameters
    ----------
    ground : Ground
    tolerance : float
        Relative error in the energy norm.
    most_agents : int
        End, short of the tolerance, before there are more agents than this.
    """
    balance, notes = _first(ground)
    check_held(balance)
    hierarchy = NestedMultigrid(balance, _direct_limit(ground))
    u = balance.grid.value.copy()
    history: list[Generation] = []
    expected = 0.3
    for step in range(1, MOST_GENERATIONS + 1):
        run = _settle(balance, hierarchy, u, ALGEBRAIC_SHARE * expected)
        iterations = run.iterations
        indicator, energy, expected = _assess(balance, u, run)
        chosen = _chosen(balance.grid, indicator, energy, tolerance)
        agents = len(balance.grid.leaves)
        stopped = "" if chosen.any() else "depth"
        if agents + 3 * np.count_nonzero(chosen) > most_agents or step == MOST_GENERATIONS:
            stopped = "agents"
        if expected <= tolerance or stopped:
            run = _settle(balance, hierarchy, u, LAST)
            indicator, energy, expected = _assess(balance, u, run)
            iterations += run.iterations
            if run.errors[-1] > 0.1 * max(expected, tolerance):
                stopped = "iteration"
        history.append(Generation(agents, expected, energy, iterations))
        if expected <= tolerance or stopped:
            break
        cause = indicator.load * ground.scales.force
        leaves = balance.grid.leaves.split(chosen, step, cause).balanced(step)
        finer = Balance(Composite(ground, leaves))
        u = np.where(finer.grid.state == ACTIVE, hierarchy.grow(finer) @ u, finer.grid.value)
        balance = finer
    if not run.converged:
        notes.append(
            f"the forces on the agents balance to {run.residuals[-1]:.1g} of the loads only"
        )
    reached = expected <= tolerance and stopped != "iteration"
    return Spawning(
        balance, u, indicator, energy, expected, history, run.residuals, hierarchy.depth,
        reached, "" if reached else stopped, notes,
    )  # fmt: skip


def _assess(balance: Balance, u: Floats, run: Iteration) -> tuple[Indicator, float, float]:
    """Return what is left unbalanced, the energy, and the relative error."""
    indicator, energy = indicate(balance, u), _energy(balance, u)
    return indicator, energy, float(np.hypot(_relative(indicator, energy), run.errors[-1]))


def _first(ground: Ground) -> tuple[Balance, list[str]]:
    """Return the first agents; members one agent wide get smaller ones."""
    leaves = ground.start()
    notes: list[str] = []
    grid = Composite(ground, leaves)
    while True:
        thin = slender(grid)
        if not thin.any():
            return Balance(grid), notes
        if not notes and (leaves.size[thin] <= ground.cell).any():
            cell = leaves.lower[thin & (leaves.size <= ground.cell)][0] // ground.cell
            place = ", ".join(str(int(i)) for i in cell)
            notes.append(f"a member is one cell wide at ({place}): its cells were halved")
        leaves = leaves.split(thin, 0, np.zeros(len(leaves))).balanced(0)
        grid = Composite(ground, leaves)


def _direct_limit(ground: Ground) -> int:
    """Return up to how many faces a generation is factorised: all, if nearly incompressible."""
    moduli = ground.moduli
    d = ground.dimension
    rubber = np.any(moduli.lateral > STIFF_PRESSURE * moduli.shear)
    return FACTORISED[d] if rubber and ground.scene.plane != "stress" else DIRECT[d]


def _settle(balance: Balance, hierarchy: NestedMultigrid, u: Floats, share: float) -> Iteration:
    """Solve for the free faces of `u`, in place, to a relative algebraic error."""
    free = balance.free
    right = (balance.load - balance.pull)[free]
    load, given = balance.load[free], balance.given_energy

    def twice_energy(x: Floats) -> float:
        return 2 * float(dot(x, load)) - float(dot(x, right)) + given

    def done(run: Iteration) -> bool:
        return run.errors[-1] <= share or _at_rounding(run)

    run = hierarchy.solve(right, u[free], done, twice_energy)
    u[free] = run.solution
    return run


def _at_rounding(run: Iteration) -> bool:
    recent = run.residuals
    return len(recent) > 8 and min(recent[-4:]) > 0.5 * min(recent[:-4]) and run.errors[-1] < 1e-8


def _energy(balance: Balance, u: Floats) -> float:
    """Return the energy, of second order in what the iteration left."""
    free = balance.free
    rest = balance.force(u)[free] - balance.load[free]
    return balance.energy(u) - float(rest @ u[free])


def _relative(indicator: Indicator, energy: float) -> float:
    total = float(indicator.square.sum())
    if energy <= 0.0:
        return 0.0 if total == 0.0 else inf
    return sqrt(total / (2 * energy))


def _chosen(grid: Composite, indicator: Indicator, energy: float, tolerance: float) -> Flags:
    """Choose the agents that spawn children: those that leave most unbalanced.

    What the smallest agents leave cannot be helped and does not count.
    """
    square = np.where(grid.leaves.size > grid.ground.smallest, indicator.square, 0.0)
    total = float(square.sum())
    excess = total - 2 * energy * (SPARE * tolerance) ** 2
    goal = max(min(BULK * total, excess / GAIN), 0.0)
    order = np.argsort(-square, kind="stable")
    count = int(np.searchsorted(np.cumsum(square[order]), goal)) + 1
    chosen = np.zeros(len(square), dtype=np.bool_)
    chosen[order[:count]] = True
    return chosen & (square > 0.0) & (excess > 0.0)
