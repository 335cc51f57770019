"""The Mesa model of agents that spawn where their two opinions differ: adaptive refinement."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.agents.spawning_agent import SpawningAgent
from kaju.errors import ResultError, by_name
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.goals.quantities import AskedFor
from kaju.model.elastic.pair.history import Family
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.solve import spawner_of
from kaju.model.scene import scene_needed
from kaju.model.stepped_model import SteppedModel
from kaju.model.stepper import counted
from kaju.stepping import Until, step_to_end

if TYPE_CHECKING:
    from kaju.model.scene import Scene


class SpawningModel(SteppedModel):
    """Agents that spawn where their two opinions differ, one generation in each step.

    The first agents are as large as the body, its materials, supports and loads let them be. In the
    plane each has two opinions about the load: a displacement that fits its neighbours without a
    gap, and a stress that balances the loads. In the first step all agents find theirs. In every
    later step those whose opinions differ most spawn 4 children of half their size and retire, and
    so do larger neighbours of these; then all find their opinions again. The sum of all differences
    proves the error, and the model ends when it is within the tolerance. In space agents have the
    first opinion only, 8 children, and an estimated error. Within true outlines agents that hold
    nothing of the body vanish. Objects that show agents are made when `agents` is read.

    Parameters
    ----------
    scene : Scene
        Of square or cubic cells.
    tolerance : float
        Relative error: in the energy norm, or in the `goal`.
    resolution, stage, most_agents, goal
        As of `kaju.solve`.
    rng : int, optional
        Seed for Mesa; the agents draw no random numbers.

    Attributes
    ----------
    family : Family
        All agents as a table, row by row in the order of spawning.
    generation : int
        Steps taken.
    error : float
        Relative error in the energy norm, or of the goal; the run ends when it is within the
        tolerance.
    running : bool
        False when the error is within the tolerance, or no more agents may spawn.

    Raises
    ------
    SupportError
        If a part of the body could move without straining.
    ParameterError, SceneError
        If an argument or the scene breaks a rule.

    Examples
    --------
    >>> import kaju
    >>> model = kaju.SpawningModel(kaju.load_scene("plate.toml"), tolerance=0.1)
    >>> result = model.run()
    >>> result.tolerance_kept, result.error_bound < 0.1
    ('proved', True)
    """

    @by_name
    def __init__(
        self,
        scene: Scene,
        tolerance: float = 1e-2,
        resolution: int | None = None,
        stage: int | None = None,
        most_agents: int | None = None,
        goal: AskedFor | None = None,
        rng: Any = None,
        seed: int | None = None,
    ) -> None:
        super().__init__(rng, seed)
        scene_needed(scene)
        self.scene, self.goal = scene, goal
        self.tolerance, self.resolution, self.stage = tolerance, resolution, stage
        self.most_agents: int | None = most_agents
        self._objects: list[SpawningAgent] = []
        self.reset()

    def reset(self) -> None:
        """Go back to the first agents, before the first step."""
        began = perf_counter()
        self._start_again()
        with self.scene.misplaced():
            self.spawner = spawner_of(self.scene, **self.arguments()[0], goal=self.goal)
        self.ground, self.most_agents = self.spawner.body, self.spawner.most_agents
        self._begin(self.spawner.leaves)
        self.seconds = perf_counter() - began

    def _begin(self, leaves: LeafCells) -> None:
        """Let these be the first agents."""
        for agent in self._objects:
            agent.remove()
        metre = self.ground.scene.lattice.cell_size / self.ground.cell
        self._objects, self.family = [], Family(self.ground.dimension, metre)
        self.family.grow(leaves.code, leaves.size)

    def step(self) -> None:
        """Let agents spawn (not in the first step), and let all find their opinions."""
        began = perf_counter()
        with self.scene.misplaced():
            self.spawner.step()
        last = self.spawner.generations[-1]
        if self.generation > 1:
            self.family.grow(last.code, last.size)
        elif self.scene.outlined:  # only now it is known what the first agents hold
            self._begin(self.spawner.last.leaves)
        self.family.settle(last.gap, last.chosen)
        self.running = not self.spawner.finished
        self.seconds += perf_counter() - began

    generation = property(lambda model: len(model.spawner.generations), doc="Steps taken.")

    @property
    def error(self) -> float:
        """Relative error, in the energy norm or of the goal; NaN before the first step."""
        return self.result().goal_error if self.generation else float("nan")

    @property
    def agents(self) -> Any:
        """All agents, retired ones too, as a Mesa AgentSet in the order of spawning."""
        self._made()
        return super().agents

    @property
    def working(self) -> Any:
        """The agents that have not retired, as a Mesa AgentSet along a space-filling curve."""
        objects = self._made()
        chosen = [objects[row] for row in self.family.working.tolist()]
        return type(super().agents)(chosen, random=self.random)

    def agent(self, row: int) -> SpawningAgent:
        """Return the agent of a row of the family."""
        return self._made()[row]

    def _made(self) -> list[SpawningAgent]:
        """Return the objects of all rows; make those that are not there yet."""
        family, materials = self.family, self.scene.cell_materials
        level, size, lower = family.level, family.size, family.lower
        # Of an agent that holds others its first one's, of one that holds nothing a neighbour's.
        leaves = self.spawner.last.leaves if self.generation else self.spawner.leaves
        at = np.searchsorted(leaves.code, family.rows["code"])
        kind = leaves.kind[np.minimum(at, len(leaves) - 1)].tolist()
        for row in range(len(self._objects), len(family)):
            own = family.rows[row]
            parent = self._objects[own["parent"]] if own["parent"] >= 0 else None
            agent = SpawningAgent(
                self,
                row=row,
                parent=parent,
                level=int(level[row]),
                lower=tuple(lower[row].tolist()),
                size=float(size[row]),
                material=materials[kind[row]],
                spawn_step=int(own["spawn_step"]),
                cause=float(own["cause"]),
            )
            self._objects.append(agent)
        return self._objects

    @property
    def outcome(self) -> str:
        """How the run ended, in words; empty while agents spawn."""
        if not self.spawner.finished:
            return ""
        result, after = self.result(), f"after {counted(self.generation, 'step')}"
        if result.tolerance_kept != "missed":
            return f"within the tolerance of {self.tolerance:g} {after}"
        return f"stopped {after}: {result.caveats[0].partition(': ')[2]}"

    def arguments(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and classes and functions of your own."""
        names = ("tolerance", "resolution", "stage", "most_agents")
        return {name: getattr(self, name) for name in names}, {"goal": self.goal}

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step."""
        agents = len(self.family.working)
        return {"generation": self.generation, "agents": agents, "error": self.error}

    def run(self, until: Until | None = None) -> ElasticResult:
        """Step until the error is within the tolerance, or the run was stopped."""
        return step_to_end(self, until, self.result, lambda: self.spawner.progress())

    def result(self) -> ElasticResult:
        """Return the agents as they are.

        Raises
        ------
        ResultError
            Before the first step, when none of them has an opinion.
        """
        if not self.generation:
            raise ResultError("result: nothing is computed yet; take a step first")
        return ElasticResult(self.spawner.outcome(), self.seconds, self.tolerance)
