"""The Mesa model of load transfer by a prescribed rule."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, Literal

import mesa
import numpy as np

from kaju.agents.material_agent import MaterialAgent
from kaju.errors import StabilityError
from kaju.model.engine_choice import takes_objects
from kaju.model.progress import progress_line

from .agent_engine import AgentEngine
from .array_engine import ArrayEngine
from .stability import Certificate, certify
from .stage import News, Stage
from .transfer import Transfer, states_of
from .transfer_result import TransferResult

if TYPE_CHECKING:
    from kaju.agents.load import Load, Sense
    from kaju.agents.rules import Emission, Shares
    from kaju.model.scene import Scene
    from kaju.model.scene.lattice import Lattice

EngineName = Literal["auto", "agents", "arrays"]

MOST_CELLS_FOR_AGENTS = 10_000
"""Up to this many cells every agent is an object when the engine is chosen by itself."""

MOST_REMEMBERED = 10_000
"""So many sets of emissions are kept, so that they need not be worked out for every load."""

MOST_GROWTH = 1e12
"""A run whose waiting loads exceed the applied ones by this factor is stopped."""


class LoadModel(mesa.Model):
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
        Seed for Mesa; the rule itself draws no random numbers.

    Attributes
    ----------
    generation : int
        Steps taken in the current stage.
    stage : int
        Current stage of loading, counted from 1.
    running : bool
        False when the last stage has come to rest or was stopped.
    certificate : Certificate
        What is known about the stability before the run.

    Raises
    ------
    StabilityError
        If the certificate finds the run unstable and `allow_unstable` is False.
    SceneError
        If the scene asks for something that only the elastic rule can do.
    """

    def __init__(
        self,
        scene: Scene,
        engine: EngineName = "auto",
        material_agent: type[MaterialAgent] = MaterialAgent,
        allow_unstable: bool = False,
        max_generations: int = 10_000,
        rng: int | None = None,
    ) -> None:
        super().__init__(rng=rng)
        self.scene = scene
        self.transfer = Transfer(scene)
        self.certificate: Certificate = certify(scene, self.transfer)
        if not (self.certificate.stable or allow_unstable):
            raise StabilityError(
                f"{self.certificate.verdict}; to watch it grow all the same, "
                "set allow_unstable=True"
            )
        self.max_generations = max_generations
        self._axis_of: list[int] = scene.lattice.axis_of.tolist()
        self._sent: dict[tuple[Shares, int, Sense, int], tuple[Emission, ...]] = {}
        self.engine = self._choose_engine(engine, material_agent)
        self.reset()

    def _choose_engine(
        self, engine: str, material_agent: type[MaterialAgent]
    ) -> AgentEngine | ArrayEngine:
        small = self.scene.lattice.size <= MOST_CELLS_FOR_AGENTS
        if takes_objects(engine, material_agent, MaterialAgent, small):
            return AgentEngine(self, self.scene, self.transfer, material_agent)
        return ArrayEngine(self.scene, self.transfer)

    def reset(self) -> None:
        """Go back to the first stage, before any load was taken."""
        self.finished: list[Stage] = []
        self.seconds = 0.0
        self.running = True
        self._begin_stage(1)

    def _begin_stage(self, stage: int) -> None:
        self.stage = stage
        self._stage_is_over = False
        self.engine.start(*states_of(self.scene, stage))

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

    def parity(self, index: tuple[int, ...]) -> int:
        """Return the form of the cell with that index, 0 or 1."""
        return int(self.lattice.parity(np.array([index]))[0])

    def axis_of(self, direction: int) -> int:
        """Return the number of the axis that a direction lies on."""
        return self._axis_of[direction]

    def heading(self, load: Load) -> int:
        """Return where a load travels: a push along its force, a pull against it."""
        return self.transfer.heading(load.direction, load.sense)

    def emissions(self, agent: MaterialAgent, load: Load) -> tuple[Emission, ...]:
        """Return what a load sends out of an agent for each newton, by its shares."""
        key = (agent.shares, load.direction, load.sense, agent.parity)
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
        if not self.running:
            return
        began = perf_counter()
        if self._stage_is_over:
            self.finished.append(self.engine.stage(self._factor, self.outcome))
            self._begin_stage(self.stage + 1)
        if not self.at_rest:
            self.engine.step()
        self._stage_is_over = self.outcome != ""
        more = self.at_rest and self.stage < self.scene.stages
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
        generation, pending = self.engine.generation, self.engine.pending
        if pending == 0.0:
            if generation == 0:
                return f"no load exceeds the threshold of {self.threshold:g} N: nothing happens"
            return f"at rest after {generation} generations"
        if pending > MOST_GROWTH * self.engine.applied:
            return (
                f"stopped after {generation} generations: the loads have grown to "
                f"{pending / self.engine.applied:.0e} times the applied ones"
            )
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

    def again(self, scene: Scene) -> LoadModel:
        """Return a new model of another scene with the same kind of agents.

        It runs loads that grow, too, until they threaten to overflow.
        """
        engine = self.engine
        agent = engine.material_agent if isinstance(engine, AgentEngine) else None
        return type(self)(
            scene,
            engine="agents" if agent else "arrays",
            material_agent=agent or MaterialAgent,
            allow_unstable=True,
            max_generations=self.max_generations,
        )

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the page, with what has happened so far."""
        from kaju.view.page.notebook import shown

        return shown(self)

    def watch(self, port: int = 8000, *, browser: bool = True) -> None:
        """Show agents like these at work in a browser; see `kaju.watch`."""
        import kaju

        kaju.watch(self, port, browser=browser)

    def run(self, progress: bool | None = None) -> TransferResult:
        """Step until the last stage is at rest, and return the result.

        Parameters
        ----------
        progress : bool, optional
            Show a progress line; None: on a terminal, when the run takes over two seconds.
        """
        with progress_line(progress) as report:
            while self.running:
                self.step()
                report(
                    f"stage {self.stage} of {self.scene.stages}, generation {self.generation}, "
                    f"{self.engine.pending:.3g} N on the way"
                )
        return self.result()

    def result(self) -> TransferResult:
        """Return what has been computed so far."""
        outcome = self.outcome or f"interrupted after {self.generation} generations"
        stages = (*self.finished, self.engine.stage(self._factor, outcome))
        return TransferResult(
            scene=self.scene,
            stages=stages,
            certificate=self.certificate,
            seconds=self.seconds,
        )
