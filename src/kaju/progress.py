"""A progress line for runs that take long enough to wonder about."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import monotonic

_one_of_many = ContextVar("_one_of_many", default=False)


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
