"""What kaju's Mesa models have in common: seeds, steps that end, and data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from itertools import chain
from numbers import Integral
from traceback import walk_tb
from types import SimpleNamespace
from typing import Any, Self

from numpy.random import default_rng

from kaju._mesa import DataCollector, Model, number_agents_of, track_figures
from kaju.agents.face_agent import FaceAgent
from kaju.agents.material_agent import PlacedAgent
from kaju.agents.own_agents import HOOKS, check_methods
from kaju.agents.parameter import Declaration, declared
from kaju.errors import AgentError, ParameterError, brief, require, takes
from kaju.result_kinds import html_in_notebook


class SteppedModel(Model):
    """A Mesa model that can be run to its end, stopped on the way, and started again.

    `rng`, `seed`: seed of `rng` and `random`; give one of them. `running` is False at the end, and
    `step` then does nothing. `steps` are those since the start or the last `reset`. The figures
    after every step are in `datacollector`, and from Mesa 3.5 on the data set "figures", too.

    Raises
    ------
    ParameterError
        If both seeds are given.
    """

    step: Callable[[], None]
    running: bool
    _collector: DataCollector | None
    _noted: list[Any]  # figures that the collector has not yet, each as a model has them
    _own_collector = False

    def __init__(
        self, rng: Any = None, seed: int | None = None, order: Any = None, **of_mesa: Any
    ) -> None:
        base = next(one for one in type(self).__mro__ if one.__module__.startswith("kaju."))
        check_methods(type(self).__name__, type(self), base)
        for name, one in declared([type(self)], Declaration).items():
            told = f"{name}: a {type(one).__name__} stands on the class of the agents, and not on"
            raise ParameterError(f"{told} {type(self).__name__}; declare it there")
        told = "order: a function of the agents for which loads wait is needed"
        fits = order is None or (callable(order) and takes(order, []))
        require(fits, f"{told}, got {brief(order)}")
        self.order = order
        require(rng is None or seed is None, "seed: is another word for rng; give one of them")
        self._own_step = self.step  # of this class, or of a subclass
        self.step = self._one_step  # Mesa wraps this one: it counts and tells the time
        self.steps_taken, self._stepping = 0, False
        number_agents_of(self)
        given = rng if seed is None else seed
        if given is None:  # one that can be told, so that the run can be had again
            drawn = int(default_rng().integers(2**32))
            given = getattr(of_mesa.get("scenario"), "rng", drawn)
        if isinstance(given, str) and given.isdecimal():  # as the fields of SolaraViz give it
            given = int(given)
        try:
            default_rng(given)
        except (TypeError, ValueError):
            told = "rng: its seed must be a whole number, not below 0"
            raise ParameterError(f"{told}, got {brief(given)}") from None
        scenario = of_mesa.get("scenario")
        if getattr(scenario, "rng", given) is not given:  # the keyword's counts, as of all numbers
            of_mesa["scenario"] = scenario = copy(scenario)
            vars(scenario)["rng"] = given
        super().__init__(rng=given, **of_mesa)
        self.seed = int(given) if isinstance(given, Integral) else None
        """Seed of the random numbers, also if none was given; None if `rng` was no whole number."""
        track_figures(self)
        self.first_states = self.rng.bit_generator.state, self.random.getstate()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Go on with the numbers of agents in a copy."""
        self.__dict__.update(state)
        number_agents_of(self, 1 + len(state.get("_agents", ())))

    def _one_step(self) -> None:
        """Take one step, unless the model is at its end: then there is nothing to count."""
        told = "step: the model is in the middle of a step; its agents cannot start another"
        require(not self._stepping, told)
        if self.running:
            self.steps_taken += 1
            self.steps = self.steps_taken  # as Mesa 3 counts them, and Mesa 4 does not
            self._stepping = True
            rows = _rows_of(self._collector) if self._own_collector else 0
            try:
                with noting_agents():
                    self.act_once(self._let_act)
            finally:
                self._stepping = False
            if self._own_collector:
                require(_rows_of(self._collector) == rows, COLLECTS)
                _collect(self.datacollector, self)
            else:  # Mesa copies every figure deeply, which would cost as much as a small step
                clock = {"steps": self.steps, "time": float(self.steps)}
                self._noted.append(SimpleNamespace(**clock, **self.figures()))
        self.steps = self.steps_taken

    def _let_act(self) -> None:
        """Call `step`; refuse one of a subclass in which no agent acts, at once."""
        self._own_step()
        if self.steps_taken > 1 or self._acted or self._own_step.__module__.startswith("kaju."):
            return  # agents of one's own may wait
        code = getattr(self._own_step, "__code__", None)
        if code is not None and "step" not in (*code.co_names, *code.co_consts):
            name = type(self).__name__
            raise AgentError(f"step: {name}.step lets no agent act; call super().step() in it")

    _acted = property(lambda model: model.generation > 0, doc="Whether agents have acted.")

    def act_once(self, step: Callable[[], None]) -> None:
        """Take one `step`, of this class or a subclass, with what comes before and after it."""
        step()

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step."""
        raise NotImplementedError

    @property
    def datacollector(self) -> DataCollector:
        """The figures after every step, as Mesa keeps them."""
        if self._collector is None:
            self._collector = _Figures({name: name for name in self.figures()})
        noted, self._noted = self._noted, []
        for each in noted:
            self._collector.collect(each)
        return self._collector

    @datacollector.setter
    def datacollector(self, collector: DataCollector) -> None:
        told = "datacollector: set it after super().__init__(scene), which begins the data anew"
        require("steps_taken" in vars(self), told)
        self._collector, self._noted, self._own_collector = collector, [], True

    def _start_again(self) -> None:
        """Go back to no steps, the first random numbers and no data."""
        self.steps = self.steps_taken = 0
        self.running = True
        state, drawn = self.first_states
        self.rng.bit_generator.state = state
        self.random.setstate(drawn)
        self._collector, self._noted = _anew(self._collector) if self._own_collector else None, []

    def reset(self) -> None:
        """Go back to the start."""
        raise NotImplementedError

    def again(self, scene: Any, **changed: Any) -> Self:
        """Return a model of another scene with the same agents and seed; loads may grow in it."""
        options, own = self.arguments()
        options["rng"] = self.seed
        options |= {name: value for name, value in own.items() if value is not None}
        if "allow_unstable" in options:
            options["allow_unstable"] = True
        return type(self)(scene, **options | changed)

    _repr_html_ = html_in_notebook  # of what has happened so far

    def arguments(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and classes and functions of your own."""
        raise NotImplementedError


COLLECTS = "datacollector: a model collects after every step itself; leave collect() out of step"


class _Figures(DataCollector):
    """What notes the figures that a model hands it, and is not to be asked to note a model."""

    def collect(self, model: Any) -> None:
        require(not isinstance(model, Model), COLLECTS)
        super().collect(model)


def _anew(collector: Any) -> Any:
    """Return a collector of Mesa's with its reporters and no data; of another kind the same."""
    if isinstance(collector, DataCollector):
        old, collector = collector, copy(collector)  # of a subclass, too
        asks = (getattr(old, f"{kind}_reporters") for kind in ("model", "agent", "agenttype"))
        DataCollector.__init__(collector, *asks, {name: [*old.tables[name]] for name in old.tables})
    return collector


def _rows_of(collector: Any) -> int:
    """Return how much Mesa's collector has noted."""
    notes = getattr(collector, "model_vars", {}).values()
    return sum(map(len, notes)) + len(getattr(collector, "_agent_records", ()))


def _collect(collector: Any, model: SteppedModel) -> None:
    """Let a collector of your own note a step, its agents where `mesa.batch_run` looks for them.

    Until Mesa 3.4 that is the place of the row that the model has then, counted from 0; the
    collector files them by steps, which are one more unless the start was collected, too.
    """
    collector.collect(model)
    filed, step = getattr(collector, "_agent_records", {}), model.steps
    if step in filed and not hasattr(collector, "_collection_steps"):
        rows = max(map(len, collector.model_vars.values()), default=step)
        filed[rows - 1] = filed.pop(step)


ROW = "[*super().emissions(load), row] adds a row"
HANDED = "write self.model.hand_over(self, arm, load)"
SLEEPS = "agent_at of a cell that sleeps is None"
BOX = "self.inbox has (direction, magnitude, sense): copies; self.waiting() lists the loads"
HINTS = {"'NoneType' object has": SLEEPS, "te tuple": ROW, "'append'": ROW, "'hand_over'": HANDED}
HINTS |= {"'tuple' object has": BOX}
"""What to do about errors that agents of one's own often make, by a part of what they say."""


@contextmanager
def noting_agents() -> Iterator[None]:
    """Add to an error from within an agent's hook a note of whose, where and when."""
    try:
        yield
    except Exception as error:
        called = ""
        for frame, _ in walk_tb(error.__traceback__):
            agent, hook = frame.f_locals.get("self"), frame.f_code.co_name
            if hook in chain(*HOOKS.values()) and isinstance(agent, PlacedAgent | FaceAgent):
                called, within = agent.model.engine.guard.called(agent), hook
        if called and called not in str(error):
            hints = [f"; {hint}" for part, hint in HINTS.items() if part in str(error)]
            error.add_note(f"in {within} of {called}{''.join(hints)}")
        raise
