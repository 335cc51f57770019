"""What models that step have in common: which agents act, how steps end, and what is shown of them.

Ctrl-C ends a computation between two of its steps, so that what was computed is whole. The first
one is only noted. Loops ask `interrupt_requested` between cycles, generations and time steps and
end there; the caller gets what there is, as `Interrupted.best`. A second one ends at once, as it
does everywhere else in Python.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import count, islice
from numbers import Integral
from threading import current_thread, main_thread
from time import monotonic
from types import FrameType
from typing import Any, TypeVar

from kaju.errors import ConvergenceError, ParameterError, brief, require, takes

A = TypeVar("A")
Answer = TypeVar("Answer")

Order = Callable[[list[A]], Iterable[A]]
"""Of the agents for which loads wait, those that act in this step, one after another."""
Until = Callable[[Any], bool] | int
"""A question about the model, asked before every step: whether to stop. Or a number of steps."""

NOTE = "interrupted: what was computed until then, and not the whole answer"  # marks results
_requested: bool | None = None  # None while nothing runs that could keep its answer
_one_of_many = ContextVar("_one_of_many", default=False)


def chosen(order: Order[A], waiting: list[A]) -> list[A]:
    """Return the agents that an order of your own lets act; it may name some without end."""
    mixed = "to shuffle them, return waiting[0].random.sample(waiting, len(waiting))"
    try:
        answer: Any = order(list(waiting))
    except AttributeError as error:  # as of waiting.shuffle()
        error.add_note(f"order gets a list of agents; {mixed}")
        raise
    acting = list(islice(answer, len(waiting) + 1)) if hasattr(answer, "__iter__") else []
    if not 0 < len(acting) == len({*map(id, acting)} & {*map(id, waiting)}):
        told = f"must return at least one of the {len(waiting)} agents that it gets, each once, and"
        told += f" no others; it returned {len(acting)} ({brief(answer)})"
        raise ParameterError(f"order: {told}{f'; {mixed}' * (answer is None)}")
    return acting


def takes_objects(engine: str, agent: type, usual: type, small: bool) -> bool:
    """Tell whether agents are to be objects: asked for, of your own class, or few ("auto")."""
    own_class = agent is not usual
    if engine not in ("auto", "agents", "arrays"):
        cure = "; a class goes into material_agent= or face_agent=" * isinstance(engine, type)
        raise ParameterError(f"engine: 'auto', 'agents' or 'arrays', got {engine!r}{cure}")
    told = f"engine: 'arrays' knows no {getattr(agent, '__name__', agent)}; agents of your own are"
    require(engine != "arrays" or not own_class, f"{told} objects, so take 'auto' or 'agents'")
    return engine == "agents" or (engine == "auto" and (small or own_class))


def step_to_end(
    model: Any,
    until: Until | None,
    result: Callable[[], Answer],
    line: Callable[[], str] | None = None,
    shown: bool | None = None,
) -> Answer:
    """Step until the end, so many times, or until a yes; return what there is.

    `line` returns a line of progress, which is `shown` as `progress_line` says.
    """
    whole = isinstance(until, Integral) and not isinstance(until, bool) and until > 0
    asked = "until: a function of the model (until=lambda model: ...), or a number of steps above 0"
    fits = until is None or whole or (callable(until) and takes(until, model))
    require(fits, f"{asked}, is needed, got {until!r}")

    def steps() -> Answer:
        with progress_line(shown) as report:
            for _ in range(int(until)) if isinstance(until, Integral) else count():
                if not model.running or (callable(until) and until(model)):
                    break
                model.step()
                if line is not None:
                    report(line)
                if interrupt_requested():
                    break
        return result()

    return interruptible(steps)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C has ended a computation; `best` is the result as far as it came, marked as such."""

    def __init__(self, best: object) -> None:
        super().__init__(f"{NOTE}; it is this error's `best`")
        self.best = best


def interrupt_requested() -> bool:
    """Tell whether Ctrl-C was pressed: a loop that steps then takes no further step."""
    return bool(_requested)


def interruptible(compute: Callable[[], Answer]) -> Answer:
    """Return what is computed in steps, or raise `Interrupted` if it ended after Ctrl-C."""
    global _requested
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if _requested is not None or not usual or current_thread() is not main_thread():
        return compute()
    _requested = False
    signal.signal(signal.SIGINT, _note)
    try:
        answer: object = compute()
        if not _requested:
            return answer  # type: ignore[return-value]
    except ConvergenceError as error:
        if not _requested:
            raise
        answer = error.best
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _requested = None
    raise Interrupted(answer)


def _note(number: int, frame: FrameType | None) -> None:
    """Note the first signal; end at the second."""
    global _requested
    if _requested:
        signal.default_int_handler(number, frame)
    _requested = True
    # Nothing else is safe while a stream may be half-written.
    os.write(2, b"stopping after this step; Ctrl-C once more ends at once\n")


@contextmanager
def progress_line(shown: bool | None = None) -> Iterator[Callable[[str | Callable[[], str]], None]]:
    """Yield what shows a line, or what returns one, on the terminal after two seconds.

    None: only if it is a terminal.
    """
    began = monotonic()
    status = None

    def report(line: str | Callable[[], str]) -> None:
        nonlocal status
        if not visible or monotonic() - began < 2.0:
            return
        text = line() if callable(line) else line
        if status is None:
            from rich.console import Console

            status = Console(stderr=True).status(text)
            status.start()
        status.update(text)

    visible = sys.stderr.isatty() and not _one_of_many.get() if shown is None else shown
    try:
        yield report
    finally:
        if status is not None:
            status.stop()


@contextmanager
def without_progress() -> Iterator[None]:
    """Let runs inside the block show no line by default: they are part of a larger computation."""
    before = _one_of_many.set(True)
    try:
        yield
    finally:
        _one_of_many.reset(before)
