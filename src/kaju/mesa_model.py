"""What all of kaju's Mesa models have in common: seeds, steps that end, data, and checkpoints.

Steps are deterministic: from the same scene, seed and classes they lead to the same numbers, bit
for bit. So a checkpoint holds no inboxes and no multigrid cycle half done; loading it takes the
steps again and compares the figures noted at the end. Nothing in the file is code: classes of
one's own are given again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any, Self

from kaju._mesa import DataCollector, Model
from kaju.errors import ParameterError, ResultFileError
from kaju.model.results.archive import Archive, open_archive, reading, write_archive
from kaju.model.results.subjects import subject_archive, subject_from
from kaju.result_kinds import NOTEBOOK, fetch
from kaju.stepping import Until, step_to_end
from kaju.stopping import Answer

_SUBJECT = "subject."
RandomStates = tuple[dict[str, Any], tuple[int, tuple[int, ...], float | None]]
"""Of a model's two generators of random numbers, before anything was drawn."""


def _names_of(own: Mapping[str, Any]) -> dict[str, str]:
    """Return by which names classes and objects of one's own are recognised."""

    def name_of(value: Any) -> str:
        if isinstance(value, Mapping):
            return ", ".join(f"{key}: {name_of(part)}" for key, part in sorted(value.items()))
        return str(getattr(value, "__name__", None) or type(value).__name__)

    return {name: name_of(value) for name, value in own.items() if value is not None}


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

    def _forget(self, count: int) -> None:
        """Take the data of the last steps back."""
        collected = self.datacollector  # with what was noted since it was last read
        for values in collected.model_vars.values():
            del values[-count:]
        if hasattr(collected, "_collection_steps"):  # Mesa from 3.4 on
            del collected._collection_steps[-count:]

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
        options, own = self.checkpoint_options()
        options |= {name: value for name, value in own.items() if value is not None}
        if "allow_unstable" in options:
            options["allow_unstable"] = True
        return type(self)(scene, **options | changed)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the page, with what has happened so far."""
        html: str = fetch(NOTEBOOK)(self)
        return html

    def checkpoint_options(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and those that no file can hold."""
        raise NotImplementedError

    def checkpoint_parts(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return what the model is of, such as its scene, as arrays and plain values."""
        names = ("subject", "network", "scene")
        return subject_archive(next(getattr(self, name) for name in names if hasattr(self, name)))

    def save_checkpoint(self, path: str | Path) -> Path:
        """Write what it takes to go on from here later: continuing is as never having stopped.

        The file holds what was asked, the seed and the number of steps.

        Raises
        ------
        ResultFileError
            If the file cannot be written.
        """
        arrays, about = self.checkpoint_parts()
        options, own = self.checkpoint_options()
        text = {
            "model": type(self).__name__,
            "subject": about,
            "options": options,
            "own": _names_of(own),
            "rng": list(self.first_states),
            "steps": self.steps,
            "figures": self.figures(),
        }
        packed = {_SUBJECT + name: array for name, array in arrays.items()}
        return write_archive(path, "checkpoint", packed, text)

    @classmethod
    def load_checkpoint(cls, path: str | Path, **own: Any) -> Self:
        """Return the model of a checkpoint, as it was; its steps are taken again.

        Parameters
        ----------
        path : path
            What `save_checkpoint` wrote.
        **own
            Classes, orders and rules of your own that the model was made with.

        Raises
        ------
        ResultFileError
            If the file is none of this model, or its steps now lead elsewhere.
        ParameterError
            If something of your own is missing or another.
        """
        target = Path(path)
        if not target.exists() and target.suffix != ".npz":
            target = target.with_name(target.name + ".npz")
        archive = open_archive(target, "checkpoint")
        with reading(target):
            model_name = archive.value("model", str)
            if model_name != cls.__name__:
                raise ResultFileError(
                    f"{target}: holds a {model_name}; load it with {model_name}.load_checkpoint"
                )
            about = archive.value("subject", dict[str, Any])
            subject = subject_from(Archive(target, archive.part(_SUBJECT), about))
            wanted = archive.value("own", dict[str, str])
            steps, figures = archive.value("steps", int), archive.about["figures"]
        found = _names_of(own)
        for name in wanted.keys() | found.keys():
            if wanted.get(name) != found.get(name):
                raise ParameterError(
                    f"{name}: {target} was made with {wanted.get(name, 'none of your own')}, got "
                    f"{found.get(name, 'none')}; give load_checkpoint(path, {name}=...) what the "
                    "model was made with"
                )
        # What goes wrong with classes of one's own is not the file's fault.
        with nullcontext() if own else reading(target):
            model = cls(subject, **archive.value("options", dict[str, Any]), **own)
            model.first_states = archive.value("rng", RandomStates)
            model.reset()
            while model.running and model.steps < steps:
                model.step()
        again = json.loads(json.dumps(model.figures()))
        if model.steps != steps or repr(again) != repr(figures):
            raise ResultFileError(
                f"{target}: its {steps} steps led elsewhere this time ({again} instead of "
                f"{figures}); agents were changed by hand between steps, draw random numbers that "
                "are not the model's, or are other classes now"
            )
        return model

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
