"""The Mesa model of load transfer by the elastic rule, and its agents as objects."""

from __future__ import annotations

from functools import partial
from math import isfinite
from time import perf_counter
from typing import Any, Literal

import networkx
import numpy as np

from kaju._mesa import Cell, Network
from kaju.agents.face_agent import FaceAgent, Place
from kaju.agents.own_agents import OwnAgents, check_class
from kaju.agents.parameter import is_number
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError, StabilityError, brief, by_name
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.staggered import internal_force
from kaju.model.elastic.equal.system import Solution
from kaju.model.elastic.relaxation import elastic_run, push_state
from kaju.model.elastic.relaxation.elastic_run import ElasticRun, PushLedger, Recorder, StepRecord
from kaju.model.elastic.relaxation.push_state import PushEngine, PushState, Visit, multilevel
from kaju.model.elastic.relaxation.push_table import PushTable, WaveCertificate, certify_waves
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR
from kaju.model.stepped_model import SteppedModel
from kaju.model.stepper import counted, not_balanced
from kaju.stepping import Order, Until, chosen, step_to_end, takes_objects

EngineName = Literal["auto", "agents", "arrays"]

MOST_IDLE = 100  # Steps in which no agent takes a load; agents of your own may refuse by chance


class ElasticModel(SteppedModel):
    """Load transfer by shares that follow from the materials, step by step.

    An agent spawns on a face when the load left there exceeds the threshold γ. It yields, passes on
    all that it took to its neighbours, and rests until its load exceeds γ again. Supports keep the
    loads that reach them. When all agents rest, the faces stand where linear elasticity puts them,
    except for loads up to γ. The rule's order says which agents act in a step:

    - "wave": all agents above γ, by the share ω of P/k (damped Jacobi iteration);
    - "largest first": the one agent with the largest load (Southwell's relaxation);
    - "multilevel": the agents of one level, in turn (multigrid). Loads left on many cells are
      handed up as one load to *parent agents*, which stand for 2×2(×2) blocks; what these
      yield is handed down. The loads of the topmost parents, a handful, are solved at once, and
      after each cycle over all levels the faces go on in its direction, as far as that lowers
      the energy (conjugate gradients).

    Elasticity is linear, so loads are applied at once, whatever their number of steps. Where a
    member of the body is only one cell wide the cells are halved, so that it can carry shear.

    Parameters
    ----------
    scene : Scene
        Body of squares or cubes, supports, loads and an elastic rule.
    engine : {"auto", "agents", "arrays"}
        "agents": every agent is an object on a Mesa network. "arrays": agents are rows of
        arrays. Both give the same numbers. "auto" takes objects for up to 5,000 cells and
        for agents of your own.
    face_agent : type of FaceAgent
        Your own subclass, if you have one.
    allow_unstable : bool
        Run waves even if the certificate says that they will grow.
    pushes_per_step : int
        In the order "largest first": how many agents act in a step, one after another.
    max_steps : int
        The run is stopped after this many steps.
    stage : int, optional
        Stage of loading; the last one by default.
    rng, seed : int, optional
        Seed of the model's random numbers; the rule itself draws none.
    order : callable, optional
        Your own order of work, instead of the rule's: from the face agents whose load is above
        γ, it chooses those that act in this step, one after another. Parents take no part.

    Attributes
    ----------
    generation : int
        Steps taken.
    visit : Visit
        What the last step was: its level, and whether it led up or down.
    running : bool
        False when all agents rest, or the run was stopped.
    certificate : WaveCertificate or None
        By which share agents may yield at once; for the order "wave".
    history : list of StepRecord
        Energy, loads left and pushes after every step.

    Raises
    ------
    StabilityError
        If waves would grow and `allow_unstable` is False.
    SceneError
        If the cells are neither squares nor cubes, or the rule is another one.
    SupportError
        If a part of the body could move without straining.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml").replace(rule={"kind": "elastic"})
    >>> model = kaju.ElasticModel(scene)
    >>> model.step()
    >>> result = model.run().result
    >>> round(1e9 * result.max_displacement, 1)  # nm
    13.8
    """

    @by_name
    def __init__(
        self,
        scene: Scene,
        engine: EngineName = "auto",
        face_agent: type[FaceAgent] = FaceAgent,
        allow_unstable: bool = False,
        pushes_per_step: int = 1,
        max_steps: int = 1_000_000,
        stage: int | None = None,
        rng: Any = None,
        seed: int | None = None,
        *,
        order: Order[FaceAgent] | None = None,
    ) -> None:
        super().__init__(rng, seed, order)
        check_class("face_agent", face_agent, FaceAgent)
        if pushes_per_step < 1:
            raise ParameterError(f"pushes_per_step: must be 1 or more, got {pushes_per_step}")
        self.scene = scene
        self.stage = stage
        self.table = PushTable(scene, stage, "own" if order else None)
        self.certificate: WaveCertificate | None = None
        self.share = 1.0
        if self.table.order == "wave":
            self.certificate = certify_waves(self.table, self.table.rule.share)
            self.share = self.certificate.share
            if not (self.certificate.stable or allow_unstable):
                raise StabilityError(
                    f"{self.certificate.verdict}; to watch the loads grow, "
                    "set allow_unstable=True (`kaju run --allow-unstable`)"
                )
        self.allow_unstable = allow_unstable
        self.pushes_per_step, self.max_steps = pushes_per_step, max_steps
        small = scene.lattice.size <= 5_000  # Objects spawn and act within seconds.
        own: Any = order if face_agent is FaceAgent and order else face_agent
        self.engine: PushEngine
        self.face_agent = face_agent
        if takes_objects(engine, own, FaceAgent, small):
            self.engine = AgentPushEngine(self, self.table, face_agent)
        else:
            # Imported where it is needed, as it holds compiled loops.
            from kaju.model.elastic.relaxation.face_array_engine import ArrayPushEngine

            self.engine = ArrayPushEngine(self.table)
        self.reset()

    def reset(self) -> None:
        """Go back to the start, before any agent has yielded."""
        self._start_again()
        self.engine.reset()
        self.seconds = 0.0
        self.visit = Visit()
        self.history: list[StepRecord] = []
        self.recorder = Recorder(self.state)
        act = {
            "own": partial(self.engine.relax_chosen, self.order),
            "wave": partial(self.engine.relax_all, self.share),
            "largest first": partial(self.engine.relax_largest, self.pushes_per_step),
        }.get(self.table.order)
        self._order = multilevel(self.engine) if act is None else push_state.repeated(act)
        self._loudest, self._meter = self._loudest_at_start, _ = self.state.survey()
        self.running = not self.outcome

    @property
    def state(self) -> PushState:
        """What the faces of all levels carry."""
        return self.engine.state

    generation = property(lambda model: model.state.generation, doc="Steps taken.")
    threshold = property(lambda model: model.table.threshold, doc="γ (N).")
    space = property(lambda model: model.engine.space, doc="Where objects stand; None of arrays.")

    def hand_over(self, sender: FaceAgent, target: int, load: float) -> None:
        """Hand a load (N) to another face of the same level, or to a support."""
        engine, left = self.engine, self.state.levels[sender.level].left
        assert isinstance(engine, AgentPushEngine)
        if engine.own and not (is_number(load) and target in range(len(left))):
            over = f"hands over {brief(load)} N to {brief(target)}"
            what = f"{over}; its neighbours are `place.links`"
            raise engine.guard.wrong(sender, "hand_over", what)
        if engine.outbox is not None:  # until all agents of a wave have acted
            engine.outbox.append((target, load))
        else:
            left[target] += load

    def step(self) -> None:
        """Let one wave pass, one agent act, or the agents of one level take turns."""
        began = perf_counter()
        self.engine.idle += 1
        self.visit = next(self._order)
        self.state.generation += 1
        if self.visit.level == 0:
            # Between the levels the finest loads lack what their parents will yield.
            self._loudest, self._meter = self.state.survey()
        loads = self._loudest, self._meter
        self.history.append(StepRecord(*self.visit, self.state.energy, *loads, self.state.pushes))
        self.recorder.note()
        self.running = not self.outcome
        self.seconds += perf_counter() - began

    @property
    def at_rest(self) -> bool:
        """Whether the loads left, on all levels, are up to γ."""
        return self.visit.level == 0 and self._loudest <= self.threshold

    @property
    def error_estimate(self) -> float:
        """√(Σ P²/k) over all levels, over √(load · displacement): error in energy, as a share.

        With parents the error is close to it; where moduli jump by a million it may be some
        tens of times larger. Without parents it is a lower bound, and a smooth error may be
        larger by the number of cells along the body.
        """
        return self._meter

    @property
    def outcome(self) -> str:
        """How the run ended, or that a step has stopped it; empty while agents act."""
        unit = {"wave": "wave", "multilevel": "visit"}.get(self.table.order, "push")
        after = counted(self.state.pushes if unit == "push" else self.generation, unit)
        if self.at_rest:
            ledger = PushLedger.of(self.state)
            if not elastic_run.books(ledger, self.scene, self.generation).holds:
                return not_balanced(after, ledger.imbalance)
            if self.generation == 0:
                return f"no load exceeds the threshold of {self.threshold:g} N: nothing happens"
            return f"at rest after {after}"
        most = 1e12 if self.face_agent is FaceAgent else 1e3  # as for other agents of your own
        if not self._loudest <= most * self._loudest_at_start:  # or it is no number
            return (
                f"stopped after {after}: the largest load has grown to "
                f"{self._loudest / self._loudest_at_start:.0e} times that of the start"
            )
        if self.engine.idle >= MOST_IDLE:
            return (
                f"stopped after {after}: loads above the threshold wait, and no agent has "
                f"taken any for {MOST_IDLE} steps"
            )
        if self.generation >= self.max_steps:
            return f"stopped after max_steps = {self.max_steps} with loads above the threshold"
        return "" if self.running else self._stopped

    _stopped = property(lambda model: f"interrupted after {counted(model.generation, 'step')}")

    def arguments(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and classes and functions of your own."""
        own = None if self.face_agent is FaceAgent else self.face_agent
        options = {
            "engine": "agents" if isinstance(self.engine, AgentPushEngine) else "arrays",
            "allow_unstable": self.allow_unstable,
            "pushes_per_step": self.pushes_per_step,
            "max_steps": self.max_steps,
            "stage": self.stage,
        }
        return options, {"face_agent": own, "order": self.order}

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step: energies (J), loads (N)."""
        return {
            "level": self.visit.level,
            "energy": self.state.energy,
            "pushes": self.state.pushes,
            "largest_load": self._loudest,
            "error_estimate": self._meter,
        }

    def run(self, until: Until | None = None) -> ElasticRun:
        """Step until all agents rest, or `until` is true of the model; return what they did."""
        return step_to_end(self, until, self.result)

    def result(self) -> ElasticRun:
        """Return what has been computed so far."""
        state, agents = self.state, elastic_run.FaceAgents.of(self.state)
        outcome = self.outcome or self._stopped
        return ElasticRun(
            result=self._answer(outcome),
            outcome=outcome,
            threshold=self.threshold,
            agents=agents,
            history=tuple(self.history),
            ledger=PushLedger.of(state),
            certificate=self.certificate,
            moments=self.recorder.moments(agents),
            seconds=self.seconds,
            own_agents=() if self.face_agent is FaceAgent else (self.face_agent.__name__,),
        )

    def _answer(self, outcome: str) -> ElasticResult:
        """Return the faces' displacements as the answer of an elastic solver."""
        table, problem = self.table, self.table.problem
        fields = tuple(values.copy() for values in problem.fixed)
        moved = self.state.levels[0].displacement / problem.scales.displacement
        table.levels[0].numbering.scatter(moved, fields)
        notes = [
            outcome,
            "the error estimate is about the loads that are left, not about the size of the cells",
        ]
        moduli = [material.youngs_modulus for material in self.scene.cell_materials]
        contrast = max(moduli) / min(moduli)
        if contrast >= 1e4:
            notes.append(
                f"moduli differ by a factor of {contrast:.0e}: because of loads left on soft "
                "cells the error may be tens of times the estimate; check it by `kaju solve`"
            )
        forces = zip(internal_force(problem, fields), fields, strict=True)
        solution = Solution(
            displacement=fields,
            energy=0.5 * sum(float(np.vdot(f, u)) for f, u in forces),
            method=f"agents, {table.order}",
            discretisation=0.0,
            algebraic=self.error_estimate,
            residuals=[record.error_estimate for record in self.history],
            converged=self.at_rest,
            notes=notes,
        )
        found = CellAgents(
            self.scene, self.stage, table.posed.division, solution, known=table.posed
        )
        return ElasticResult(found, self.seconds)


class AgentPushEngine(PushEngine):
    """Lets agents act, with one object per agent.

    The space is a network that grows with the agents: each brings its cell, linked to those that it
    hands shares to.
    """

    def __init__(self, model: Any, table: PushTable, face_agent: type[FaceAgent]) -> None:
        self.model, self.face_agent = model, face_agent
        self.guard, self.own = OwnAgents(model), face_agent is not FaceAgent
        self.agents: list[dict[int, FaceAgent]] = []
        super().__init__(table)

    def reset(self) -> None:
        """Put the loads on the body, before any agent has yielded."""
        for agents in self.agents:
            for agent in agents.values():
                agent.remove()
        super().reset()
        self.space = Network(networkx.Graph(), random=self.model.random)
        self.agents = [{} for _ in self.table.levels]
        self.outbox: list[tuple[int, float]] | None = None

    def relax_together(self, level: int, acting: Ints, loads: Floats) -> None:
        """Let agents of a level take loads (N) at once, each its own: a Jacobi step."""
        state, faces = self.state, self.state.levels[level]
        agents = [self.agent(level, number) for number in acting.tolist()]
        left, moved = faces.left[acting], faces.displacement[acting]
        outbox = self.outbox = []
        for agent, load in zip(agents, loads.tolist(), strict=True):
            self._act(agent, load)
        self.outbox = None
        for target, load in outbox:
            faces.left[target] += load
        yielded = faces.displacement[acting] - moved
        state.energy -= 0.5 * float(yielded @ (left + faces.left[acting]))
        state.pushes += len(acting)

    def relax_in_turn(self, level: int) -> None:
        """Let the agents of a level above γ act in turn, and in turn backwards."""
        faces = self.state.levels[level]
        numbers = range(len(faces.weight))
        for number in (*numbers, *reversed(numbers)):
            if abs(faces.left[number]) * faces.weight[number] > self.state.threshold:
                self._push(level, number)

    def relax_largest(self, count: int) -> None:
        """Let the agent with the largest load act, `count` times or until none exceeds γ."""
        faces = self.state.levels[0]
        measured = faces.measured
        for _ in range(count):
            number = int(np.argmax(measured))
            if not measured[number] > self.state.threshold:
                return
            agent = self._push(0, number)
            for face in (number, *dict(agent.place.links)):
                if face < len(measured):
                    measured[face] = abs(faces.left[face]) * faces.weight[face]

    def relax_chosen(self, order: Order[FaceAgent]) -> None:
        """Let the agents act that an order chooses from those above γ, in turn."""
        waiting = np.flatnonzero(self.state.levels[0].measured > self.state.threshold)
        for agent in chosen(order, [self.agent(0, number) for number in waiting.tolist()]):
            self._push(0, agent.place.number)

    def _push(self, level: int, number: int) -> FaceAgent:
        """Let one agent act, and book the energy that it releases."""
        faces = self.state.levels[level]
        before, moved = faces.left[number], faces.displacement[number]
        agent = self.agent(level, number)
        self._act(agent, agent.left)
        yielded = faces.displacement[number] - moved
        self.state.energy -= 0.5 * float(yielded * (before + faces.left[number]))
        self.state.pushes += 1
        return agent

    def _act(self, agent: FaceAgent, load: float) -> None:
        """Let an agent act; what it leaves must be numbers."""
        before = agent.left, agent.displacement
        agent.act(load)
        if (agent.left, agent.displacement) != before:
            self.idle = 0
        if self.own and not (isfinite(agent.left) and isfinite(agent.displacement)):
            what = f"has left {agent.left} N and moved by {agent.displacement} m"
            raise self.guard.wrong(agent, "take", what)

    def agent(self, level: int, number: int) -> FaceAgent:
        """Return the agent of a face; it spawns if there is none yet."""
        agents = self.agents[level]
        if number not in agents:
            place, faces = self._place(level, number), self.state.levels[level]
            cell = Cell((level, place.axis, *place.index), random=self.model.random)
            self.space.add_cell(cell)
            agents[number] = self.face_agent(self.model, cell, place, faces)
            self.guard.check_begun(agents[number], place.index)
            faces.spawn_step[number] = agents[number].spawn_step
            for target, _ in place.links:
                if target in agents:
                    self.space.add_connection(cell, agents[target].cell)
        return agents[number]

    def _place(self, level: int, number: int) -> Place:
        table, agents = self.table, self.table.levels[level]
        axis, index = (values[number] for values in agents.place)
        shares = agents.shares
        row = slice(shares.indptr[number], shares.indptr[number + 1])
        materials = []
        if level == 0:
            # The cells below and above the face, along its normal.
            beside = index - (np.arange(len(index)) == axis), index
            kinds = [int(table.problem.kinds[tuple(cell)]) for cell in beside]
            materials = [table.grid.cell_materials[kind] for kind in kinds if kind > AIR]
        return Place(
            level,
            number,
            int(axis),
            tuple((index - 1 + (np.array(table.origin) if level == 0 else 0)).tolist()),
            table.positions(level)[number],
            tuple(materials),
            float(agents.stiffness[number]),
            tuple(zip(shares.indices[row].tolist(), shares.data[row].tolist(), strict=True)),
        )
