"""The Mesa model of load transfer by a prescribed rule."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields, replace
from inspect import signature
from numbers import Integral
from operator import attrgetter
from time import perf_counter
from typing import Any, Literal

from kaju._mesa import AgentSet, Model
from kaju.agents.boundary_agent import BoundaryAgent
from kaju.agents.material_agent import MaterialAgent
from kaju.agents.own_agents import check_methods, every_name, own_classes
from kaju.agents.parameter import Parameter, State, declared
from kaju.agents.rules import PrescribedRule, ShareRule
from kaju.agents.shares import Load
from kaju.errors import ParameterError, brief, require, unknown
from kaju.model.scene import Scene, scene_needed
from kaju.model.scene.description import TABLES
from kaju.model.stepped_model import SteppedModel, noting_agents
from kaju.result_kinds import KINDS
from kaju.stepping import Order, Until, step_to_end, takes_objects

from .agent_engine import AgentEngine
from .array_engine import ArrayEngine
from .load_transfer import LoadTransfer
from .transfer import Transfer
from .transfer_result import TransferResult

EngineName = Literal["auto", "agents", "arrays"]
FIGURES = {
    "stage": "course.stage",
    "generation": "engine.generation",
    "material_agents": "engine.awake",
    "load_taken": "engine.taken",
    "load_returned": "engine.returned",
    "load_absorbed": "engine.absorbed",
    "load_dropped": "engine.ended",
    "load_waiting": "engine.pending",
}
"""What a model notes after every step, and where it has it."""
_NOTED = attrgetter(*FIGURES.values())


class LoadModel(SteppedModel):
    """Load transfer, one generation a step.

    In each step every agent takes the loads that reached it in the step before and passes its
    shares on. Loads in several stages run once per stage, each time from the start with more load,
    unless the scene's `loading` is "continue".

    Parameters
    ----------
    scene : Scene
        Body, supports, loads and a prescribed rule.
    engine : {"auto", "agents", "arrays"}
        Agents as objects on Mesa's cell space, or as rows of arrays, for any size of body; "auto":
        objects for up to 10,000 cells and for agents of your own.
    material_agent, boundary_agents : type of MaterialAgent, mapping of types of BoundaryAgent
        Your own classes; those of boundaries by "free", "rigid" or "roller".
    allow_unstable : bool
        Run even if `stability` says that loads will grow; it stops before they overflow.
    max_generations : int
        A stage is stopped after this many generations.
    rng, seed : int, optional
        Seed of the model's random numbers; the rule itself draws none.
    order : callable, optional
        A function of the agents for which loads wait; it returns those that act in this step, one
        after another. None: all act; what they hand over arrives in the next step.
    rule : object, optional
        Your own rule, instead of the scene's: see `kaju.agents.rules.ShareRule`.
    scenario : mesa Scenario, optional
        Its numbers (or a dict's) are read as if they were keywords; a keyword overrides it.
    **kwargs
        Numbers of the scene's rule to replace, such as ``threshold=0.001``, and values of the
        parameters that your agents declare; see `kaju.Parameter`.

    Raises
    ------
    StabilityError
        If `stability` says that loads will grow and `allow_unstable` is False.
    SceneError
        If the scene asks for something that only the elastic rule can do.
    ParameterError
        If a boundary or engine does not exist, or a class does not fit its task.

    Examples
    --------
    >>> import kaju
    >>> model = kaju.LoadModel(kaju.load_scene("plate.toml"))
    >>> model.step()
    >>> result = model.run()
    >>> result.last.generations, round(result.last.ledger.taken, 3)
    (8, 12.879)
    """

    _fixed: Collection[str] = ()  # names of what cannot be set, once it is

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
        scenario: Any = None,
        **kwargs: Any,
    ) -> None:
        of_mesa = hasattr(Model, "scenario") and hasattr(scenario, "to_dict")
        kept = {"scenario": scenario} if of_mesa else {}
        numbers = numbers_of(scenario)
        seeds = numbers.pop("rng", None), numbers.pop("seed", None)
        if rng is seed is None and not of_mesa:  # Mesa reads its own
            rng, seed = seeds
        SteppedModel.__init__(self, rng, seed, order, **kept)
        kwargs = numbers | kwargs
        scene_needed(scene)
        classes = own_classes(material_agent, boundary_agents)
        if isinstance(shares_by := rule or scene.rule, PrescribedRule):
            check_methods(f"rule: {type(shares_by).__name__}", type(shares_by), PrescribedRule)
        scene, self.parameters = keywords_into(scene, classes, kwargs, LoadModel, rule is not None)
        """Values of the parameters that your agents declare, by name."""
        usual = material_agent is MaterialAgent
        self._own: dict[str, Any] = {
            "material_agent": None if usual else material_agent,
            "boundary_agents": boundary_agents,
            "order": order,
            "rule": rule,
        }
        own_or_usual: Any = next(iter(classes), order) or MaterialAgent
        small = scene.lattice.size <= 10_000
        objects = takes_objects(engine, own_or_usual, MaterialAgent, small)

        def engine_of(transfer: Transfer) -> AgentEngine | ArrayEngine:
            if not objects:
                return ArrayEngine(transfer)
            return AgentEngine(self, transfer, material_agent, boundary_agents or {})

        self.course = LoadTransfer(
            scene, allow_unstable, max_generations,
            rule=rule, own=[agent.__name__ for agent in classes],
            ordered=order is not None, engine_of=engine_of,
        )  # fmt: skip
        self.scene, self.lattice = scene, scene.lattice
        self.allow_unstable, self.max_generations = allow_unstable, max_generations
        self.course.parameters, self.certificate = self.parameters, self.course.certificate
        """Whether loads will end, as far as is known before the run (not of agents of your own)."""
        self.engine: AgentEngine | ArrayEngine = self.course.engine
        self.transfer = transfer = self.course.transfer
        self.threshold, self.accumulate = transfer.rule.threshold, transfer.rule.accumulate
        self.cross_section = transfer.cross_section  # A (m²), over which an own share is spread
        self._fixed = {"threshold", "accumulate", *self.parameters}
        self.reset()

    def __getattr__(self, name: str) -> Any:
        """Return the value of a parameter that agents declare."""
        if name in vars(self).get("parameters", ()):
            return self.parameters[name]
        cure = "" if "course" in vars(self) else "; call super().__init__(scene) in its __init__"
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{cure}")

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to change what the engine was made with."""
        if name in self._fixed:
            told = f"a model keeps the {name} that it was made with; make another:"
            raise ParameterError(f"{name}: {told} {type(self).__name__}(scene, {name}={value!r})")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        cells = " x ".join(map(str, self.lattice.shape))
        awake = f"agents awake: {self.engine.awake}"
        return f"<{type(self).__name__} of {cells} cells: {self.course.progress()}, {awake}>"

    def reset(self) -> None:
        """Go back to the first stage, before any load was taken, and to the first seed."""
        self._start_again()
        self.course.reset()

    def act_once(self, step: Callable[[], None]) -> None:
        """Begin a generation, let agents act, and end it."""
        began, course = perf_counter(), self.course
        course.begin()
        step()
        course.end()
        self.running = self.running and course.running  # a step may have stopped the model
        course.seconds += perf_counter() - began

    def step(self) -> None:
        """Let agents take their loads; then boundaries give back, and loads arrive."""
        self.engine.act(self.order)

    def run(self, until: Until | None = None, progress: bool | None = None) -> TransferResult:
        """Step to the end, a number of times, or until a function returns True; return the result.

        `progress`: show a progress line; None: on a terminal, when the run takes over two seconds.
        """
        return step_to_end(self, until, self.result, self.course.progress, progress)

    def result(self) -> TransferResult:
        """Return what has been computed so far."""
        with noting_agents():
            walls = self._own["boundary_agents"] or {}
            names = {kind: wall.__name__ for kind, wall in walls.items()}
            drawn = (self.rng.bit_generator.state, self.random.getstate()) != self.first_states
            seed = self.seed if drawn else None
            return replace(self.course.result(), own_boundaries=names, seed=seed)

    _acted = property(attrgetter("engine.acted"), doc="Whether agents have acted in this step.")
    generation = property(attrgetter("engine.generation"), doc="Steps taken in the current stage.")
    stage = property(attrgetter("course.stage"), doc="Current stage of loading, counted from 1.")
    pending = property(attrgetter("engine.pending"), doc="Loads that wait to be taken (N), summed.")

    @property
    def outcome(self) -> str:
        """How the stage ended, or that a step has stopped it; empty till then."""
        return self.course.outcome if self.running else self.course.result().last.outcome

    def arguments(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and classes and functions of your own."""
        options = {
            "engine": "agents" if isinstance(self.engine, AgentEngine) else "arrays",
            "allow_unstable": self.allow_unstable,
            "max_generations": self.max_generations,
            **self.parameters,
        }
        return options, self._own

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step; loads (N) are those of the current stage."""
        return dict(zip(FIGURES, _NOTED(self), strict=True)) | self.parameters

    @staticmethod
    def sliders(*agents: type[MaterialAgent | BoundaryAgent]) -> dict[str, dict[str, Any]]:
        """Return a slider for each parameter that classes of agents declare, by name.

        Mesa's SolaraViz takes them among its `model_params`.
        """
        return {name: parameter.slider() for name, parameter in declared(agents, Parameter).items()}

    def _objects(self) -> AgentEngine:
        """Return the engine of agents as objects; say what to do if they are rows of arrays."""
        told = "engine: agents are rows of arrays here, not objects; take LoadModel(scene,"
        if not isinstance(self.engine, AgentEngine):
            raise ParameterError(f"{told} engine='agents'), or look at result().to_dataframe()")
        return self.engine

    @property
    def space(self) -> Any:
        """Mesa's space of the scene's cells, made when they are asked for; None with arrays."""
        return self.engine.space if isinstance(self.engine, AgentEngine) else None

    @property
    def agents(self) -> Any:
        """The agents that are awake, as a Mesa AgentSet in the order in which they woke."""
        self._objects()
        return super().agents

    @property
    def agents_by_type(self) -> Any:
        """The agents that are awake: a Mesa AgentSet for each class, empty if none is."""
        engine = self._objects()
        classes = engine.material_agent, *engine.boundary_agents.values()
        return {one: AgentSet([], random=self.random) for one in classes} | super().agents_by_type

    def agent_at(self, index: tuple[int, ...]) -> MaterialAgent | None:
        """Return the material agent of a cell of the scene, None if no load has woken it."""
        told = f"index: column and row of a cell are needed, such as (10, 19), got {brief(index)}"
        whole = hasattr(index, "__len__") and all(isinstance(at, Integral) for at in index)
        require(whole and len(index) == self.lattice.dimension, told)
        cells = " x ".join(map(str, self.lattice.shape))
        told = f"index: {brief(index)} is far outside of the {cells} cells"
        for at, count in zip(index, self.lattice.shape, strict=True):
            require(-1 <= at <= count, told)  # who asks for its neighbours meets -1 and the count
        return self._objects().agents.get(tuple(index))

    def axis_of(self, direction: int) -> int:
        """Return the number of the axis that a direction lies on."""
        return int(self.lattice.axis_of[direction])

    def heading(self, load: Load) -> int:
        """Return where a load travels: a push along its force, a pull against it."""
        return self.transfer.heading(load.direction, load.sense)

    def hand_over(self, sender: MaterialAgent, arm: int, load: Load) -> None:
        """Hand a load to the neighbour over an arm, which takes it in the next step.

        What is no load, or has no such arm, is an `AgentError`.
        """
        self._objects().hand_over(sender, arm, load)


def numbers_of(scenario: Any) -> dict[str, Any]:
    """Return numbers, seeds too, of a Scenario of Mesa's, of an object and its class, or a dict."""
    if scenario is None:
        return {}
    of_mesa = {"model", "scenario_id", "replication_id"}
    held = scenario
    if not isinstance(scenario, Mapping):
        told = "scenario: an object or a dict whose numbers have names is needed"
        require(type(scenario).__module__ != "builtins", f"{told}, got {brief(scenario)}")
        held = {n: getattr(scenario, n) for n in dir(scenario) if n not in of_mesa}
    own = {str(name): value for name, value in held.items() if not callable(value)}
    return {n: value for n, value in own.items() if n not in of_mesa and not n.startswith("_")}


def keywords_into(
    scene: Scene, classes: Iterable[type], given: Mapping[str, Any], model: type, own_rule: bool
) -> tuple[Scene, dict[str, Any]]:
    """Return the scene with numbers of its rule replaced, and the parameters of `classes`."""
    parameters = declared(classes, Parameter)
    for name in declared(classes, State):
        drawn = name in KINDS["load transfer"].pictures or name in KINDS["load transfer"].films
        column = re.fullmatch("(cell|displacement)_[xyz]|(strain|stress)_[xyz]{2}", name)
        told = f"{name}: a picture, a film or a column of results has this name; give the State"
        require(not (drawn or column), f"{told} another name")
    rule = {field.name for field in fields(scene.rule)}
    own = set(signature(model.__init__).parameters) | {"kind"}  # type: ignore[misc]
    for name in parameters.keys() & {
        *rule,
        *own,
        *FIGURES,
        "time",
        "steps",
        *every_name(model),
    }:  # Mesa 3.4
        whose = "the rule" if name in rule else f"every {model.__name__}"
        told = "has this name already; give the parameter another name"
        raise ParameterError(f"{name}: {whose} {told}")
    for name in given.keys() - parameters.keys() - rule:
        known = sorted({*parameters, *rule, *own} - {"self", "kind", "kwargs"})
        meant = "threshold" if name in ("gamma", "γ") else name
        raise unknown(name, model.__name__, known, meant)
    values = {name: one.checked(given.get(name, one.default)) for name, one in parameters.items()}
    changed = {name: value for name, value in given.items() if name in rule}
    told = "is a number of the scene's rule, but rule= gives another rule; give one of them"
    require(not (changed and own_rule), f"{next(iter(changed), '')}: {told}")
    if changed:
        # Checked as the numbers of a scene's file are; materials have no place there.
        numbers = {name: value for name, value in changed.items() if name != "materials"}
        table = TABLES[scene.rule.kind](**numbers)
        changed |= {name: getattr(table, name) for name in numbers}
        scene = scene.replace(rule=replace(scene.rule, **changed))
    return scene, values
