"""From the first agents to the last: solve, look for unbalanced load, spawn, and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.model.elastic.bracket import MOST_PROVED, PROVED_AT, Bracket, worth_proving
from kaju.model.elastic.krylov import Iteration
from kaju.model.elastic.problem import ACTIVE
from kaju.model.elastic.solver import lost_digits, rounding_notes

from .agent_fields import AgentFields
from .aims import Aim, Aimed, EnergyAim, choose, unproved
from .balance import Balance
from .composite import Composite, Floats
from .curvature import Indicator, indicate
from .goals import GoalAim
from .ground import Ground
from .held import first_agents
from .leaves import Flags, Index, Leaves
from .nested import LAST, NestedMultigrid, energy_of, relative_error, settle
from .previous import Heirs, Standing
from .tree_boxes import bracket_of_agents

if TYPE_CHECKING:
    from .block_spawner import BlockSpawner

ALGEBRAIC_SHARE = 0.05
"""Every generation is solved to this share of its estimated error, the last one further."""
ROUGH = 0.05
"""One cycle of previous agents is enough to tell within a per cent what they will leave."""
MOST_GENERATIONS = 60
TELLING, FAR = 500, 100.0
"""From so many agents on they tell how many more it takes; so many times too many are not tried."""
TOLD = 1e-5
"""Share of the applied forces that may be left on agents without a word."""
FIRST_GUESS = 0.3
"""Of the first generation's error."""
TINY = 1e-300


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
        Why it ended, if it is not: "depth" (the smallest agents allowed), "agents",
        "iteration", or "blind" (bounds say that agents do not see their errors).
    notes : list of str
    retired : int
        Agents of the previous answer for which a parent has come back.
    bracket : Bracket or str, optional
        What is certain of the answer, if that has been looked for; in words why nothing is.
    """

    balance: Balance
    displacement: Floats
    indicator: Indicator
    energy: float
    error: float
    aimed: Aimed
    generations: Sequence[Generation]
    residuals: list[float]
    levels: int
    reached: bool
    stopped: str
    notes: list[str] = field(default_factory=list)
    retired: int = 0
    bracket: Bracket | str | None = field(default=None, repr=False)

    @property
    def leaves(self) -> Leaves:
        """The agents."""
        return self.balance.grid.leaves

    @property
    def ground(self) -> Ground:
        """What they stand on."""
        return self.balance.grid.ground

    @cached_property
    def fields(self) -> AgentFields:
        """Strains, stresses and displacements of all agents."""
        return AgentFields(self.balance, self.displacement)

    def near(self, agent: Index) -> tuple[AgentFields, Index]:
        """Return the fields of agents and of those about them, and which of these they are."""
        return self.fields, agent

    @property
    def moved(self) -> Floats:
        """Displacement of the agents' middles, shape (agents, dimension)."""
        return self.fields.displacement

    @property
    def stress(self) -> Floats:
        """Stress tensors of the agents, shape (agents, dimension, dimension)."""
        return self.fields.stress

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        return self.balance.reactions(self.displacement)


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
    previous : Spawning, optional
        Agents on the same cells to begin with, instead of the first ones.

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
    retired : int
        Agents of the previous answer for which a parent has come back.
    """

    aimed: Aimed

    def __init__(
        self,
        ground: Ground,
        tolerance: float,
        most_agents: int,
        aim: Aim | None = None,
        previous: Spawning | None = None,
    ) -> None:
        self.ground, self.tolerance, self.most_agents = ground, tolerance, most_agents
        self.aim = aim or EnergyAim()
        self._heirs = None
        if previous is None:
            self._stand(_first(ground))
        else:
            self._heirs = Heirs(ground, previous.balance.grid.leaves)
            self._stand(self._heirs.take_up(previous))
        self.generations: list[Generation] = []
        self.error = FIRST_GUESS if previous is None else previous.error
        self.finished = False
        self.retired = 0
        self.bracket: Bracket | str | None = None
        self._estimated = 0
        self._share = PROVED_AT[ground.dimension] if isinstance(self.aim, EnergyAim) else 1.0
        self._chosen: Flags | None = None
        self._stopped = ""

    @property
    def leaves(self) -> Leaves:
        """The agents of this generation."""
        return self.balance.grid.leaves

    @property
    def target(self) -> float:
        """The estimated error at which bounds, if there can be any, may keep the tolerance."""
        few = len(self.leaves) <= MOST_PROVED[self.ground.dimension]
        return self.tolerance / self._share if few else self.tolerance

    @property
    def _proved(self) -> bool:
        return isinstance(self.bracket, Bracket) and self.bracket.error <= self.tolerance

    def _stand(self, standing: Standing) -> None:
        self.balance, self.hierarchy, self.displacement, self.notes = standing

    def step(self) -> None:
        """Spawn, but for the first time, and settle."""
        if self._chosen is not None:
            self._spawn(self._chosen)
        if self._heirs is not None and not self.generations:
            runs = self._take_stock(self._heirs)
        else:
            runs = [self._settle(ALGEBRAIC_SHARE * self.error)]
            self._look(runs[-1].errors[-1])
        if self._ends():
            runs.append(self._finish())
            self._ends()
            self._note_rest(runs[-1])
            self._prove()
        # A few large agents may turn about a hinge that their children stiffen.
        if self.finished or len(self.leaves) >= TELLING:
            said = self._rounding()
            self.notes += said if self.finished else []
        self._residuals = runs[-1].residuals
        self._chosen = None if self.finished else self.aimed.chosen
        self._remember(sum(run.iterations for run in runs))

    def _take_stock(self, heirs: Heirs) -> list[Iteration]:
        """Let agents of the previous answer settle roughly, retire, and spawn at once."""
        runs = [self._settle(ROUGH)]
        self._look(None)
        within = self.aimed.error <= self.tolerance
        # Only an error that adds up can be shared out; another is mended from the start.
        standing = _first(self.ground) if not (within or self.aim.adds_up) else self._regroup(heirs)
        while standing is not None:
            self._stand(standing)
            runs.append(self._settle(ALGEBRAIC_SHARE * self.error))
            self._look(runs[-1].errors[-1])
            standing = self._regroup(heirs) if within else None
            within = self.aimed.error <= self.tolerance
        self.retired = heirs.retired(self.balance.grid.leaves)
        return runs

    def _regroup(self, heirs: Heirs) -> Standing | None:
        return heirs.regroup(self.balance, self.displacement, self.aimed)

    def _finish(self) -> Iteration:
        """Settle for good."""
        run = self._settle(LAST)
        self._look(run.errors[-1])
        return run

    def _ends(self) -> bool:
        """Tell whether no step is left."""
        self._stopped = self._reason_to_stop(self.aimed.chosen)
        self.finished = self.aimed.error <= self.target or bool(self._stopped)
        return self.finished

    def outcome(self) -> Spawning:
        """Return the agents as they are."""
        kept = self.aimed.error <= self.tolerance or self._proved
        reached = kept and self._stopped != "iteration"
        return Spawning(
            self.balance, self.displacement, self.indicator, self.energy, self.error,
            self.aimed, list(self.generations), self._residuals, self.hierarchy.depth, reached,
            "" if reached else self._stopped, list(self.notes), self.retired, self.bracket,
        )  # fmt: skip

    def _spawn(self, chosen: Flags) -> None:
        self.bracket = None  # of those that were there before
        number, leaves = len(self.generations), self.balance.grid.leaves
        cause = self.indicator.load * self.ground.scales.force
        leaves = leaves.split(chosen, number, cause)
        leaves = leaves.balanced(number, young=leaves.step == number)
        finer = Balance(Composite(self.ground, leaves))
        grown = self.hierarchy.grow(finer) @ self.displacement
        self.displacement = np.where(finer.grid.state == ACTIVE, grown, finer.grid.value)
        self.balance = finer

    def _settle(self, share: float) -> Iteration:
        """Balance the forces to a relative algebraic error."""
        return settle(self.balance, self.hierarchy, self.displacement, share)

    def _look(self, algebraic: float | None) -> None:
        """See what is left unbalanced, besides an algebraic error."""
        self.indicator = indicate(self.balance, self.displacement)
        self.energy = energy_of(self.balance, self.displacement)
        error = relative_error(self.indicator, self.energy)
        # An error that is still to be settled will be a share of this one.
        algebraic = ALGEBRAIC_SHARE * error if algebraic is None else algebraic
        self.error = float(np.hypot(error, algebraic))
        self.aimed = self.aim.look(self)

    def _reason_to_stop(self, chosen: Flags) -> str:
        agents = len(chosen) + ((1 << self.ground.dimension) - 1) * np.count_nonzero(chosen)
        if agents > self.most_agents or len(self.generations) + 1 == MOST_GENERATIONS:
            return "agents"
        if isinstance(self.aim, EnergyAim) and out_of_reach(self, len(chosen)):
            return "agents"
        return "" if chosen.any() else "depth"

    def _note_rest(self, run: Iteration) -> None:
        if run.errors[-1] > 0.1 * max(self.error, self.tolerance):
            self._stopped, self.finished = "iteration", True
        left = run.residuals[-1] if not run.converged else self._left_of_loads()
        if self.finished and (not run.converged or left > TOLD):
            self.notes.append(f"the forces on the agents balance to {left:.1g} of the loads only")

    def _left_of_loads(self) -> float:
        """Return what is left beside the applied forces; those of moved sides may be far larger."""
        rest = (self.balance.force(self.displacement) - self.balance.load)[self.balance.free]
        applied = float(np.abs(self.balance.load).sum())
        return float(np.abs(rest).sum()) / applied if applied > 0.0 else 0.0

    def _rounding(self) -> list[str]:
        """Say what rounding leaves unbalanced; refuse what it hides before more agents spawn."""
        free, right = self.balance.free, self.balance.load - self.balance.pull
        stiffness = self.hierarchy.matrix.diagonal()
        return rounding_notes(lost_digits(self.displacement[free] * stiffness, right[free]))

    def _prove(self) -> None:
        """Go on where the mean stress may be further off than the tolerance."""
        leaves = self.balance.grid.leaves
        few = len(leaves) <= MOST_PROVED[self.ground.dimension]
        if not few or self._stopped == "iteration":
            return
        ratio = max(self.aimed.error / self.tolerance, 1.0) ** self.ground.dimension
        self._estimated = self._estimated or round(ratio * len(leaves))
        if isinstance(self.aim, GoalAim):
            self._bound(self.aim)
        if not isinstance(self.aim, EnergyAim) or self.aimed.error > self.target:
            return
        self.bracket = bracket_of_agents(self.balance, self.displacement)
        if self._proved:
            return
        if isinstance(self.bracket, Bracket):
            self._share = min(self.bracket.error / max(self.aimed.error, TINY), 1.0)
            chosen = choose(self.balance.grid, *unproved(self.bracket, self.tolerance))
            if self._worth(chosen):
                self.aimed, self.finished = self.aimed._replace(chosen=chosen), False
                return
        # Without a proof the estimate has to do.
        self._share = 1.0
        if self.aimed.error > self.tolerance:
            self.aimed = self.aim.look(self)
            self._ends()

    def _bound(self, aim: GoalAim) -> None:
        """Hold goals between bounds, and go on where these say that estimates are blind."""
        estimated, self.aimed = self.aimed, aim.bounded(self)
        if self.aimed.error > self.tolerance >= estimated.error:
            self.finished = not self._worth(self.aimed.chosen)
            self._stopped = "blind" if self.finished else ""
        if self.finished and not isfinite(self.aimed.error):
            self.aimed = estimated

    def _worth(self, chosen: Flags) -> bool:
        """Tell whether to go on for a proof if these spawn."""
        agents = len(chosen) + ((1 << self.ground.dimension) - 1) * int(np.count_nonzero(chosen))
        worth = worth_proving(agents, self._estimated) and agents <= self.most_agents
        return bool(chosen.any()) and worth and len(self.generations) + 2 < MOST_GENERATIONS

    def _remember(self, iterations: int) -> None:
        leaves, load = self.balance.grid.leaves, self.indicator.load
        nobody = np.zeros(len(leaves), dtype=np.bool_)
        chosen = nobody if self._chosen is None else self._chosen
        cost = (len(leaves), self.error, self.energy, iterations, self.aimed.error)
        self.generations.append(Generation(*cost, leaves.code, leaves.size, load, chosen))


def out_of_reach(spawner: Spawner | BlockSpawner, agents: int) -> bool:
    """Tell whether a tolerance takes far more agents than allowed.

    Their number grows at least with the error's fall to the power of the dimension, unless a
    resolution does not let them be smaller.
    """
    if spawner.ground.smallest > 1:
        return False
    ratio = spawner.error / spawner.tolerance
    expected = agents * ratio**spawner.ground.dimension
    return agents >= TELLING and expected > FAR * spawner.most_agents


def _first(ground: Ground) -> Standing:
    balance, notes = first_agents(ground)
    return Standing(balance, NestedMultigrid(balance), balance.grid.value.copy(), notes)
