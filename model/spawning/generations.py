"""From the first agents to the last: solve, look for unbalanced load, spawn, and again."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from kaju.model.elasticity.krylov import Iteration, dot
from kaju.model.elasticity.problem import ACTIVE, STIFF_PRESSURE

from .aims import Aim, Aimed, EnergyAim
from .balance import Balance
from .composite import Composite, Floats
from .ground import Ground
from .held import beside_rigid_cells, check_held, loose_part, slender
from .indicator import Indicator, indicate
from .leaves import Flags, Index, Leaves
from .nested import DIRECT, FACTORISED, NestedMultigrid

ALGEBRAIC_SHARE = 0.05
"""Every generation is solved to this share of its estimated error, the last one further."""
LAST = 1e-10
MOST_GENERATIONS = 60
FIRST_GUESS = 0.3
"""Of the first generation's error."""


class Generation(NamedTuple):
    """One step of spawning.

    Attributes
    ----------
    agents : int
    error : float
        Estimated error in the energy norm, relative.
    energy : float
    iterations : int
    aimed_error : float
        Estimated error that the tolerance is about, relative.
    code, size : int array, shape (agents,)
        Morton code of the lower corner and edge (units) of every agent.
    load : array, shape (agents,)
        Load that every agent left unbalanced.
    chosen : bool array, shape (agents,)
        Who of them spawns children for that load in the next step.
    """

    agents: int
    error: float
    energy: float
    iterations: int
    aimed_error: float
    code: Index
    size: Index
    load: Floats
    chosen: Flags


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
    aimed : Aimed
        The error that the tolerance is about, and who contributes to it.
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
    aimed: Aimed
    generations: list[Generation]
    residuals: list[float]
    levels: int
    reached: bool
    stopped: str
    notes: list[str] = field(default_factory=list)


class Spawner:
    """Agents that settle, look for what they leave unbalanced, and spawn, step by step.

    Parameters
    ----------
    ground : Ground
    tolerance : float
        Relative error.
    most_agents : int
        End, short of the tolerance, before there are more agents than this.
    aim : Aim, optional
        What the tolerance is about; by default the error in the energy norm.

    Attributes
    ----------
    balance : Balance
        This generation's grid.
    displacement : array, shape (faces,)
    indicator : Indicator
    generations : list of Generation
    energy : float
    error : float
        Estimated error of this generation in the energy norm; its target before it settles.
    aimed : Aimed
        The error that the tolerance is about, and who has to spawn for it.
    finished : bool
        Whether no step is left.
    """

    def __init__(
        self, ground: Ground, tolerance: float, most_agents: int, aim: Aim | None = None
    ) -> None:
        self.ground, self.tolerance, self.most_agents = ground, tolerance, most_agents
        self.aim = aim or EnergyAim()
        self.balance, self.notes = _first(ground)
        self.hierarchy = NestedMultigrid(self.balance, _direct_limit(ground))
        self.displacement = self.balance.grid.value.copy()
        self.generations: list[Generation] = []
        self.error = FIRST_GUESS
        self.finished = False
        self._chosen: Flags | None = None
        self._stopped = ""

    def step(self) -> None:
        """Spawn, but for the first time, and settle."""
        if self._chosen is not None:
            self._spawn(self._chosen)
        run = self._settle(ALGEBRAIC_SHARE * self.error)
        iterations = run.iterations
        if self._ends():
            run = self._settle(LAST)
            iterations += run.iterations
            self._ends()
            self._note_rest(run)
        self._residuals = run.residuals
        self._chosen = None if self.finished else self.aimed.chosen
        self._remember(iterations)

    def _ends(self) -> bool:
        """Look how far off the agents are; tell whether no step is left."""
        self.aimed = self.aim.look(self)
        self._stopped = self._reason_to_stop(self.aimed.chosen)
        self.finished = self.aimed.error <= self.tolerance or bool(self._stopped)
        return self.finished

    def outcome(self) -> Spawning:
        """Return the agents as they are."""
        reached = self.aimed.error <= self.tolerance and self._stopped != "iteration"
        return Spawning(
            self.balance, self.displacement, self.indicator, self.energy, self.error,
            self.aimed, list(self.generations), self._residuals, self.hierarchy.depth, reached,
            "" if reached else self._stopped, list(self.notes),
        )  # fmt: skip

    def _spawn(self, chosen: Flags) -> None:
        number, leaves = len(self.generations), self.balance.grid.leaves
        cause = self.indicator.load * self.ground.scales.force
        leaves = leaves.split(chosen, number, cause)
        leaves = leaves.balanced(number, young=leaves.step == number)
        finer = Balance(Composite(self.ground, leaves))
        grown = self.hierarchy.grow(finer) @ self.displacement
        self.displacement = np.where(finer.grid.state == ACTIVE, grown, finer.grid.value)
        self.balance = finer

    def _settle(self, share: float) -> Iteration:
        """Balance the forces to a relative algebraic error; see what is left unbalanced."""
        run = _settle(self.balance, self.hierarchy, self.displacement, share)
        self.indicator = indicate(self.balance, self.displacement)
        self.energy = _energy(self.balance, self.displacement)
        self.error = float(np.hypot(_relative(self.indicator, self.energy), run.errors[-1]))
        return run

    def _reason_to_stop(self, chosen: Flags) -> str:
        agents = len(chosen) + ((1 << self.ground.dimension) - 1) * np.count_nonzero(chosen)
        if agents > self.most_agents or len(self.generations) + 1 == MOST_GENERATIONS:
            return "agents"
        return "" if chosen.any() else "depth"

    def _note_rest(self, run: Iteration) -> None:
        if run.errors[-1] > 0.1 * max(self.error, self.tolerance):
            self._stopped, self.finished = "iteration", True
        if not run.converged and self.finished:
            self.notes.append(
                f"the forces on the agents balance to {run.residuals[-1]:.1g} of the loads only"
            )

    def _remember(self, iterations: int) -> None:
        leaves, load = self.balance.grid.leaves, self.indicator.load
        nobody = np.zeros(len(leaves), dtype=np.bool_)
        chosen = nobody if self._chosen is None else self._chosen
        cost = (len(leaves), self.error, self.energy, iterations, self.aimed.error)
        self.generations.append(Generation(*cost, leaves.code, leaves.size, load, chosen))


def spawn(ground: Ground, tolerance: float, most_agents: int, aim: Aim | None = None) -> Spawning:
    """Solve with agents that are small only where the error asks for it; see `Spawner`."""
    spawner = Spawner(ground, tolerance, most_agents, aim)
    while not spawner.finished:
        spawner.step()
    return spawner.outcome()


def _first(ground: Ground) -> tuple[Balance, list[str]]:
    """Return the first agents; members one agent wide and pins get smaller ones."""
    leaves, notes = ground.start(), list[str]()
    balance = Balance(_stiff(ground, leaves, notes))
    if loose_part(balance) is not None:
        pinned = beside_rigid_cells(balance.grid)
        leaves = balance.grid.leaves.split(pinned, 0, np.zeros(len(pinned))).balanced(0)
        balance = Balance(_stiff(ground, leaves, notes))
        notes.append("a single rigid cell holds no turn: the cells beside were halved")
        check_held(balance)
    return balance, notes


def _stiff(ground: Ground, leaves: Leaves, notes: list[str]) -> Composite:
    """Lay leaves so small that every one is held by its neighbours against sliding."""
    grid = Composite(ground, leaves)
    while True:
        thin = slender(grid)
        if not thin.any():
            return grid
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
    return balance.energy(u) - float(dot(rest, u[free]))


def _relative(indicator: Indicator, energy: float) -> float:
    total = float(indicator.square.sum())
    if energy <= 0.0:
        return 0.0 if total == 0.0 else inf
    return sqrt(total / (2 * energy))
