"""What kaju's Mesa models have in common: seeds, steps that end, and data."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import partial
from typing import Any, Self

from kaju._mesa import DataCollector, Model
from kaju.errors import ParameterError
from kaju.result_kinds import NOTEBOOK, fetch
from kaju.stepping import Until, step_to_end
from kaju.stopping import Answer


class SteppedModel(Model):
    """A Mesa model that can be run to its end, stopped on the way, and started again.

    Parameters
    ----------
    rng, seed : int, optional
        Seed of `rng` and `random`; give one of them. kaju's own agents draw no random numbers.

    Attributes
    ----------
    running : bool
        False at the end; `step` then does nothing and counts nothing.
    steps : int
        Steps taken since the start or the last `reset`.
    datacollector : mesa.DataCollector
        The model's `figures` after every step. Set another one to collect what you like.

    Raises
    ------
    ParameterError
        If both seeds are given.
    """

    step: Callable[[], None]
    running: bool
    _collector: DataCollector | None
    _noted: list[tuple[int, dict[str, float]]]
    _own_collector: bool

    def __init__(self, rng: Any = None, seed: int | None = None, **of_mesa: Any) -> None:
        if rng is not None and seed is not None:
            raise ParameterError("seed: is another word for rng; give one of them")
        # Mesa counts the steps of whatever `step` is now: the model's own, or a subclass's.
        self._own_step = self.step
        self.step = self._one_step
        self.steps_taken, self._stepping = 0, False
        super().__init__(rng=rng if seed is None else seed, **of_mesa)
        self.first_states = deepcopy(self.rng.bit_generator.state), self.random.getstate()

    def begin_step(self) -> None:
        """Do what has to be done before anybody acts, whatever `step` a subclass has."""

    def end_step(self) -> None:
        """Do what has to be done when everybody has acted."""

    def _one_step(self) -> None:
        """Take one step, unless the model is at its end: then there is nothing to count."""
        if self._stepping:
            raise ParameterError(
                "step: the model is in the middle of a step; its agents act in it, and cannot take "
                "another"
            )
        if self.running:
            self.steps_taken += 1
            self.steps = self.steps_taken  # as Mesa 3 counts them, and Mesa 4 does not
            self._stepping = True
            try:
                self.begin_step()
                self._own_step()
                self.end_step()
            finally:
                self._stepping = False
            self._note()
        self.steps = self.steps_taken

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step."""
        raise NotImplementedError

    @property
    def datacollector(self) -> DataCollector:
        """The figures after every step, as Mesa keeps them."""
        if self._collector is None:
            reporters = {name: partial(_figure, name) for name in self.figures()}
            self._collector = DataCollector(reporters)
        noted, self._noted = self._noted, []
        for step, figures in noted:
            for name, value in figures.items():
                self._collector.model_vars[name].append(value)
            if hasattr(self._collector, "_collection_steps"):  # Mesa from 3.4 on
                self._collector._collection_steps.append(step)
        return self._collector

    @datacollector.setter
    def datacollector(self, collector: DataCollector) -> None:
        self._collector, self._noted, self._own_collector = collector, [], True

    def _note(self) -> None:
        if self._own_collector:
            self.datacollector.collect(self)
        else:
            # Mesa copies every figure deeply, which would cost as much as a small step.
            self._noted.append((self.steps, self.figures()))

    def _start_again(self) -> None:
        """Go back to no steps, the first random numbers and no data."""
        self.steps = self.steps_taken = 0
        self.running = True
        state, drawn = self.first_states
        self.rng.bit_generator.state = deepcopy(state)
        self.random.setstate(drawn)
        self._collector, self._noted, self._own_collector = None, [], False

    def reset(self) -> None:
        """Go back to the start."""
        raise NotImplementedError

    def again(self, scene: Any, **changed: Any) -> Self:
        """Return a model of another scene with the same agents; it runs loads that grow, too."""
        options, own = self.arguments()
        options |= {name: value for name, value in own.items() if value is not None}
        if "allow_unstable" in options:
            options["allow_unstable"] = True
        return type(self)(scene, **options | changed)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the page, with what has happened so far."""
        html: str = fetch(NOTEBOOK)(self)
        return html

    def arguments(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and classes and functions of one's own."""
        raise NotImplementedError

    def _run(
        self,
        until: Until | None,
        result: Callable[[], Answer],
        after: Callable[[], None] | None = None,
    ) -> Answer:
        return step_to_end(self, until, result, after)


def _figure(name: str, model: SteppedModel) -> float:
    """Return one of a model's figures, as Mesa asks for it."""
    return model.figures()[name]
