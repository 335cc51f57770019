"""Ctrl-C ends a computation between two of its steps, so that what was computed is whole.

The first Ctrl-C is only noted. Loops ask `interrupt_requested` between cycles, generations and
time steps and end there; the caller gets what there is, as `Interrupted.best`. A second Ctrl-C
ends at once, as it does everywhere else in Python.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from threading import current_thread, main_thread
from types import FrameType
from typing import TypeVar

from kaju.errors import ConvergenceError

Answer = TypeVar("Answer")

NOTE = "interrupted: what was computed until then, and not the whole answer"  # marks results
_requested: bool | None = None  # None while nothing runs that could keep its answer


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
