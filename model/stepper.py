"""What models without agents have in common: steps, a run to the end, and a line of progress.

Their steps are not taken back: a result holds all records, so look back there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from time import perf_counter
from typing import Generic, TypeVar

from kaju.progress import progress_line
from kaju.stepping import Until, step_to_end

R = TypeVar("R")


class Stepper(ABC, Generic[R]):
    """Something that steps, plainly; `running` tells whether a step is left, `steps` counts."""

    running = True
    steps = 0
    seconds = 0.0  # that all steps took

    @abstractmethod
    def advance(self) -> None:
        """Take the next step; set `running` to False if it is the last."""

    @abstractmethod
    def result(self) -> R:
        """Return what has been computed so far."""

    @abstractmethod
    def progress(self) -> str:
        """Return the line of progress."""

    def step(self) -> None:
        """Take one step; at the end it does nothing."""
        if not self.running:
            return
        began = perf_counter()
        self.steps += 1
        try:
            self.advance()
        finally:
            self.seconds += perf_counter() - began

    def run(self, until: Until | None = None, progress: bool | None = None) -> R:
        """Step to the end, or until a question is answered with yes.

        `until`: a function of the model, asked before every step, or a number of steps;
        `progress`: whether to show a line of progress, None does so at a terminal.
        """
        with progress_line(progress) as report:
            return step_to_end(self, until, self.result, lambda: report(self.progress))
