"""What models that step have in common, with agents or without: steps, and how they end.

Steps of a `Stepper` are not taken back: a result holds all records, so look back there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from time import perf_counter
from typing import Generic, TypeVar

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
        """Step to the end, a number of times, or until a function returns True.

        `until`: a function of the model, asked before every step, or a number of steps;
        `progress`: whether to show a line of progress, None does so at a terminal.
        """
        return step_to_end(self, until, self.result, self.progress, progress)


def counted(number: int, thing: str, written: Callable[[int], str] = str) -> str:
    """Return a number of things: "1 generation", "12 generations", "12 pushes"."""
    many = "es" if thing.endswith("sh") else "s"
    return f"{written(number)} {thing}{many * (number != 1)}"


def not_balanced(after: str, off: float) -> str:
    """Return how agents ended that lost or made loads: a share of all loads."""
    return (
        f"ended after {after} with a ledger that does not balance: {100.0 * off:.3g} % of all "
        "loads are not accounted for; let a take or pass_on of your own call super(), or book all "
        "that it does"
    )
