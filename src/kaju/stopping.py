"""Ctrl-C ends a computation between two of its steps, so that what was computed is whole.

The first Ctrl-C is only noted. Loops ask `stopped` between cycles, generations and time steps
and end there; whoever called gets what there is, as `Interrupted.best`. A second Ctrl-C ends at
once, as it does everywhere else in Python.
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

NOTE = "interrupted: what was computed until then, and not the whole answer"
"""How results are marked."""
_WORDS = b"stopping after this step; Ctrl-C once more ends at once\n"
_asked: bool | None = None
"""Whether to stop; None while nobody computes what could be kept."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C has ended a computation; `best` is the result as far as it came, marked as such."""

    def __init__(self, best: object) -> None:
        super().__init__(f"{NOTE}; it is this error's `best`")
        self.best = best


def stopped() -> bool:
    """Tell whether Ctrl-C was pressed: whoever steps then takes no further step."""
    return bool(_asked)


def keeping(compute: Callable[[], Answer]) -> Answer:
    """Return what is computed, by steps between which it may be stopped."""
    global _asked
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if _asked is not None or not usual or current_thread() is not main_thread():
        return compute()
    _asked = False
    signal.signal(signal.SIGINT, _note)
    try:
        answer: object = compute()
        if not stopped():
            return answer  # type: ignore[return-value]
    except ConvergenceError as error:
        if not stopped():
            raise
        answer = error.best
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _asked = None
    raise Interrupted(answer)


def _note(number: int, frame: FrameType | None) -> None:
    global _asked
    if _asked:
        signal.default_int_handler(number, frame)
    _asked = True
    os.write(2, _WORDS)  # nothing else is safe while a stream may be half-written
