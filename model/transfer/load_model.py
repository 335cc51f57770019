"""The Mesa model of load transfer by a prescribed rule."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any, Literal

import numpy as np

from kaju.agents.awake_cells import AwakeBoundary, AwakeCell
from kaju.agents.boundary_agent import BoundaryAgent
from kaju.agents.material_agent import MaterialAgent
from kaju.agents.rules import Emission, ShareRule, Shares
from kaju.agents.shares import Load, Sense
from kaju.errors import StabilityError
from kaju.mesa_model import Order, SteppedModel, Until, takes_objects
from kaju.model.scene import Scene
from kaju.model.scene.lattice import Lattice
from kaju.progress import progress_line

from .agent_engine import AgentEngine, boundary_classes
from .array_engine import ArrayEngine
from .stability import Certificate, certify, not_known
from .stage import News, Stage, Totals
from .transfer import BOUNDARY_NAMES, Transfer, states_of
from .transfer_result import TransferResult

EngineName = Literal["auto", "agents", "arrays"]

MOST_CELLS_FOR_AGENTS = 10_000
"""Up to this many cells every agent is an object when the engine is chosen by itself."""

MOST_REMEMBERED = 10_000
"""So many sets of emissions are kept, so that they need not be worked out for every load."""

MOST_GROWTH = 1e12
"""A run whose waiting loads exceed the applied ones by this factor is stopped."""

MOST_GROWTH_UNKNOWN = 1e3
"""The same for agents of one's own, of which no certificate says that their loads end."""


class LoadModel(SteppedModel):
    """Load transfer, one generation a step.

    In each step every agent takes the loads that reached it in the step before and passes
    its shares on. A scene with staged loading is run once per stage, each time from the
    start and with a larger part of the loads.

    Parameters
    ----------
    scene : Scene
        Body, supports, loads and a prescribed rule.
    engine : {"auto", "agents", "arrays"}
        "agents": every agent is an object on Mesa's cell space. "arrays": agents are rows of
        arrays, for any size of body. Both give the same loads. "auto" takes objects for
        bodies of up to 10,000 cells and for agents of your own.
    material_agent : type of MaterialAgent
        Your own subclass, if you have one.
    allow_unstable : bool
        Run even if the stability certificate says that loads will grow; the run then stops
        before they overflow.
    max_generations : int
        A stage is stopped after this many generations.
    rng : int, optional
        Seed of the model's random numbers; the rule itself draws none.
    boundary_agents : mapping of str to type of BoundaryAgent, optional
        Your own classes for "free", "rigid" or "roller" boundaries.
    order : callable, optional
        Your own order of work: from the agents for which loads wait, it chooses those that
        act in this step, one after another. The others wait. None: all act at once.
    rule : object, optional
        Your own rule, instead of the scene's: see `kaju.agents.rules.ShareRule`.
    seed : int, optional
        Another word for `rng`.

    Attributes
    ----------
    generation : int
        Steps taken in the current stage.
    stage : int
        Current stage of loading, counted from 1.
    running : bool
        False when the last stage has come to rest or was stopped.
    certificate : Certificate
        What is known about the stability before the run; of agents of your own, nothing.
    agents : mesa AgentSet
        The agents that are awake. Where they are rows of arrays, objects that show the rows
        are made when this is read.
    space : mesa.discrete_space grid or None
        Where the agents live; None where they are rows of arrays.
    datacollector : mesa.DataCollector
        After every step: stage, generation, number of material agents, loads taken so far
        in the stage, given back by boundaries, and waiting (N).

    Raises
    ------
    StabilityError
        If the certificate finds the run unstable and `allow_unstable` is False.
    SceneError
        If the scene asks for something that only the elastic rule can do.
    ParameterError
        If a boundary or engine does not exist, or a class is none for its task.
    """

    def __init__(
        self,
        scene: Scene,
        engine: EngineName = "auto",
        material_agent: type[MaterialAgent] = MaterialAgent,
        allow_unstable: bool = False,
        max_generations: int = 10_000,
        rng: Any = None,
        *,
        boundary_agents: Mapping[str, type[BoundaryAgent]] | None = None,
        order: Order[MaterialAgent] | None = None,
        rule: ShareRule | None = None,
        seed: int | None = None,
    ) -> None:
        super().__init__(rng, seed)
        self.scene = scene
        self.transfer = Transfer(scene, rule)
        self.certificate: Certificate = certify(scene, self.transfer)
        self._own: dict[str, Any] = {
            "material_agent": material_agent,
            "boundary_agents": boundary_agents,
            "order": order,
            "rule": rule,
        }
        own = {"material": material_agent} if material_agent is not MaterialAgent else {}
        own |= dict(boundary_agents or {})
        self.allow_unstable = allow_unstable
        if own:
            self.certificate = not_known([agent.__name__ for agent in own.values()])
        elif not (self.certificate.stable or allow_unstable):
            raise StabilityError(
                f"{self.certificate.verdict}; to watch it grow all the same, "
                "set allow_unstable=True"
            )
        self.max_generations = max_generations
        self._axis_of: list[int] = scene.lattice.axis_of.tolist()
        self._sent: dict[tuple[Shares, int, Sense, int], tuple[Emission, ...]] = {}
        self._rows: list[AwakeCell | AwakeBoundary] = []
        self._cells: list[AwakeCell] = []
        self.engine = self._choose_engine(engine, material_agent, boundary_agents or {}, order)
        self.reset()

    def _choose_engine(
        self,
        engine: str,
        material_agent: type[MaterialAgent],
        boundary_agents: Mapping[str, type[BoundaryAgent]],
        order: Order[MaterialAgent] | None,
    ) -> AgentEngine | ArrayEngine:
        small = self.scene.lattice.size <= MOST_CELLS_FOR_AGENTS
        own: Any = next(iter(boundary_agents.values()), order) or MaterialAgent
        if material_agent is not MaterialAgent:
            own = material_agent
        classes = boundary_classes(boundary_agents)
        if takes_objects(engine, own, MaterialAgent, small):
            return AgentEngine(self, self.scene, self.transfer, material_agent, classes, order)
        return ArrayEngine(self.scene, self.transfer)

    def reset(self) -> None:
        """Go back to the first stage, before any load was taken, and to the first seed."""
        self._start_again()
        self.finished: list[Stage] = []
        self.seconds = 0.0
        self._begin_stage(1)

    def checkpoint_options(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and those that no file can hold."""
        objects = isinstance(self.engine, AgentEngine)
        options = {
            "engine": "agents" if objects else "arrays",
            "allow_unstable": self.allow_unstable,
            "max_generations": self.max_generations,
        }
        usual = self._own["material_agent"] is MaterialAgent
        return options, self._own | ({"material_agent": None} if usual else {})

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step; loads (N) are those of the current stage."""
        engine = self.engine
        return {
            "stage": self.stage,
            "generation": engine.generation,
            "material_agents": engine.awake,
            "load_taken": engine.taken,
            "load_returned": engine.returned,
            "load_waiting": self.pending,
        }

    def _begin_stage(self, stage: int) -> None:
        self.stage = stage
        self._stage_is_over = False
        for agent in self._rows:
            agent.remove()
        self._rows, self._cells = [], []
        self._looked: tuple[int, Stage] | None = None
        self.engine.start(*states_of(self.scene, stage, self.transfer.rule.sense))
        self.pending = self.engine.pending

    @property
    def space(self) -> Any:
        """Mesa's grid, one cell wider than the scene's on every side; None with arrays."""
        return self.engine.space if isinstance(self.engine, AgentEngine) else None

    @property
    def agents(self) -> Any:
        """The agents that are awake, as a Mesa AgentSet in the order in which they woke."""
        self._show_rows()
        return super().agents

    @property
    def agents_by_type(self) -> Any:
        """The agents that are awake, a Mesa AgentSet for each class."""
        self._show_rows()
        return super().agents_by_type

    def agent_at(self, index: tuple[int, ...]) -> MaterialAgent | None:
        """Return the material agent of a cell of the scene, None if it sleeps."""
        cell = np.array([index], dtype=np.int64)
        if not self.lattice.contains(cell)[0]:
            return None
        if isinstance(self.engine, AgentEngine):
            place = self.engine.space[tuple(count + 1 for count in index)]
            return self.engine.agents.get(place)
        table, key = self.engine.agents, self.lattice.key(cell)
        if table.missing(key)[0]:
            return None
        self._show_rows()
        return self._cells[int(table.find(key)[0])]

    @property
    def looked_at(self) -> Stage:
        """The current stage as it is now; worked out once a step."""
        if self._looked is None or self._looked[0] != self.generation:
            self._looked = (self.generation, self.engine.stage(self._factor, ""))
        return self._looked[1]

    def _show_rows(self) -> None:
        """Make objects for the rows of arrays that have none yet."""
        if isinstance(self.engine, AgentEngine):
            return
        stage = self.looked_at
        edges = len(self._rows) - len(self._cells)
        new_cells = [AwakeCell(self, row) for row in range(len(self._cells), len(stage.cells))]
        new_edges = [AwakeBoundary(self, row) for row in range(edges, len(stage.boundary_cells))]
        self._cells += new_cells
        self._rows += [*new_cells, *new_edges]

    def wakers(self, row: int) -> list[tuple[int, ...]]:
        """Return the cells whose loads woke the agent of a row."""
        stage = self.looked_at
        cell, bits = stage.cells[row : row + 1], int(stage.woken_by[row])
        arms = [arm for arm in range(self.lattice.directions) if bits >> arm & 1]
        return [tuple(self.lattice.neighbours(cell, arm)[0].tolist()) for arm in arms]

    @staticmethod
    def boundary_name(kind: int) -> str:
        """Return the name of a kind of boundary."""
        return BOUNDARY_NAMES[kind]

    @property
    def lattice(self) -> Lattice:
        """The scene's lattice."""
        return self.scene.lattice

    @property
    def generation(self) -> int:
        """Steps taken in the current stage."""
        return self.engine.generation

    @property
    def threshold(self) -> float:
        """γ (N)."""
        return self.transfer.rule.threshold

    @property
    def accumulate(self) -> bool:
        """Whether loads that meet are added before they are judged."""
        return self.transfer.rule.accumulate

    @property
    def cross_section(self) -> float:
        """A (m²), over which an own share is spread."""
        return self.transfer.cross_section

    def form(self, index: tuple[int, ...]) -> int:
        """Return the form of the cell with that index."""
        several = self.lattice.forms > 1
        return int(self.lattice.form(np.array([index]))[0]) if several else 0

    def axis_of(self, direction: int) -> int:
        """Return the number of the axis that a direction lies on."""
        return self._axis_of[direction]

    def heading(self, load: Load) -> int:
        """Return where a load travels: a push along its force, a pull against it."""
        return self.transfer.heading(load.direction, load.sense)

    def emissions(self, agent: MaterialAgent, load: Load) -> tuple[Emission, ...]:
        """Return what a load sends out of an agent for each newton, by its shares."""
        key = (agent.shares, load.direction, load.sense, agent.form)
        sent = self._sent.get(key)
        if sent is None:
            if len(self._sent) > MOST_REMEMBERED:
                self._sent.clear()
            sent = self._sent[key] = self.transfer.emissions(*key)
        return sent

    def hand_over(self, sender: MaterialAgent, arm: int, load: Load) -> None:
        """Bring a load to the neighbour over an arm, where it is taken in the next step."""
        assert isinstance(self.engine, AgentEngine)
        self.engine.hand_over(sender, arm, load)

    def step(self) -> None:
        """Let one generation of loads be taken; a new stage begins when one is at rest."""
        began = perf_counter()
        if self._stage_is_over:
            self.finished.append(self.engine.stage(self._factor, self.outcome))
            self._begin_stage(self.stage + 1)
        if not self.at_rest:
            self.engine.step()
        self.pending = self.engine.pending
        self._stage_is_over = self.outcome != ""
        more = self.pending == 0.0 and self.stage < self.scene.stages
        self.running = more or not self._stage_is_over
        self.seconds += perf_counter() - began

    @property
    def _factor(self) -> float:
        return self.stage / self.scene.stages

    @property
    def at_rest(self) -> bool:
        """Whether no load waits to be taken in the current stage."""
        return self.engine.pending == 0.0

    @property
    def outcome(self) -> str:
        """How the current stage ended, in words; empty while loads travel."""
        generation, pending = self.engine.generation, self.pending
        if pending == 0.0:
            if generation == 0:
                return f"no load exceeds the threshold of {self.threshold:g} N: nothing happens"
            return f"at rest after {generation} generations"
        watched = not (self.certificate.known or self.allow_unstable)
        if pending > (MOST_GROWTH_UNKNOWN if watched else MOST_GROWTH) * self.engine.applied:
            return (
                f"stopped after {generation} generations: the loads have grown to "
                f"{pending / self.engine.applied:.0e} times the applied ones"
            ) + ("; to watch them grow further, set allow_unstable=True" if watched else "")
        if generation >= self.max_generations:
            return f"stopped after max_generations = {generation} with loads on their way"
        return ""

    def since(self, generation: int, agents: int = 0) -> News:
        """Return what has happened in the current stage after a generation.

        Parameters
        ----------
        generation : int
            0 for all of it.
        agents : int
            How many agents are known already; those that spawned later are told.
        """
        return self.engine.since(generation, agents)

    @property
    def totals(self) -> Totals:
        """What each agent of the current stage has done by now, in the order of `Stage`."""
        return self.engine.totals()

    def watch(self, port: int = 8000, *, browser: bool = True) -> None:
        """Show agents like these at work in a browser; see `kaju.watch`."""
        import kaju

        kaju.watch(self, port, browser=browser)

    def run(self, progress: bool | None = None, until: Until | None = None) -> TransferResult:
        """Step until the last stage is at rest, and return the result.

        Parameters
        ----------
        until : callable, optional
            A function of the model; the run pauses as soon as it is true, and can go on.
        progress : bool, optional
            Show a progress line; None: on a terminal, when the run takes over two seconds.
        """
        with progress_line(progress) as report:
            return self._run(
                until,
                self.result,
                lambda: report(
                    f"stage {self.stage} of {self.scene.stages}, generation {self.generation}, "
                    f"{self.pending:.3g} N on the way"
                ),
            )

    def result(self) -> TransferResult:
        """Return what has been computed so far."""
        outcome = self.outcome or f"interrupted after {self.generation} generations"
        stages = (*self.finished, self.engine.stage(self._factor, outcome))
        return TransferResult(
            scene=self.scene, stages=stages, certificate=self.certificate, seconds=self.seconds
        )
