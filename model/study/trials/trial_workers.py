"""Many trials, side by side, each in a process that may hang or die without stopping the rest."""

from __future__ import annotations

import csv
import signal
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import astuple, dataclass, fields
from math import ceil, isfinite
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic, process_time
from typing import TYPE_CHECKING, Any

from kaju.errors import ParameterError

from .trial import FAILED, TRUTH, Outcome, attempt, put_to

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

COLUMNS = tuple(field.name for field in fields(Outcome))
MOST_MEMORY = 6 * 2**30
"""Address space of a worker (bytes): a scene that wants more is a finding."""
PATIENCE = 10
"""Times its processor time that a trial may take by the clock: the machine may be busy."""
OUT_OF_TIME = getattr(signal, "SIGXCPU", 0)


def trials(
    numbers: Iterable[int], workers: int = 2, limit: float = 30.0, beyond: float = 10.0
) -> Iterator[Outcome]:
    """Yield the outcome of every trial as it ends, in no particular order.

    Parameters
    ----------
    numbers : iterable of int
        Which trials.
    workers : int
        Processes side by side.
    limit : float
        A trial that takes more seconds of processor time than this has hung: its process is
        killed. One that only waits is, after ten times as many.
    beyond : float
        Seconds more for a process's first trial, in which much is compiled.

    Raises
    ------
    ParameterError
        If there are no workers, or the limit is not above 0.
    """
    if workers < 1:
        raise ParameterError(f"workers: must be 1 or more, got {workers}")
    if not limit > 0.0:
        raise ParameterError(f"limit: must be above 0 s, got {limit}")
    left = iter(numbers)
    crew = [_Worker(limit, beyond) for _ in range(workers)]
    try:
        for worker in crew:
            worker.give(next(left, None))
        while any(worker.busy for worker in crew):
            busy = [worker for worker in crew if worker.busy]
            wait([worker.pipe for worker in busy], timeout=0.2)
            for worker in busy:
                outcome = worker.ended()
                if outcome is not None:
                    yield outcome
                    worker.give(next(left, None))
    finally:
        for worker in crew:
            worker.dismiss()


class _Worker:
    """A process that makes one trial after the other, and is replaced when it hangs or dies."""

    def __init__(self, limit: float, beyond: float) -> None:
        self._limit, self._beyond = limit, beyond
        self._number: int | None = None
        self._hire()

    def _hire(self) -> None:
        # Mesa's batch runner changes the process-wide way to start; this one does not care.
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self._allowance = self._limit + self._beyond

    @property
    def busy(self) -> bool:
        return self._number is not None

    def give(self, number: int | None) -> None:
        self._number, self._since = number, monotonic()
        if number is not None:
            self.pipe.send((number, self._allowance))

    def ended(self) -> Outcome | None:
        """Return the trial's outcome if it has ended, or must end."""
        assert self._number is not None
        if self.pipe.poll():
            try:
                outcome: Outcome = self.pipe.recv()
            except EOFError:
                self._process.join()
                hung = self._process.exitcode == -OUT_OF_TIME
                return self._lost(self._hung() if hung else "the process died")
            self._allowance = self._limit
            return outcome
        spent = monotonic() - self._since
        return self._lost(self._hung()) if spent > PATIENCE * self._allowance else None

    def _hung(self) -> str:
        return f"hung: killed after {monotonic() - self._since:.0f} s"

    def _lost(self, what: str) -> Outcome:
        number, spent = self._number, monotonic() - self._since
        self.dismiss()
        self._hire()
        assert number is not None
        return Outcome(number, *put_to(number), FAILED, what, seconds=spent)

    def dismiss(self) -> None:
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _serve(pipe: Connection) -> None:
    with suppress(ImportError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    with suppress(EOFError, KeyboardInterrupt):
        while True:
            number, seconds = pipe.recv()
            _end_after(seconds)
            pipe.send(attempt(number))


def _end_after(seconds: float) -> None:
    """Let the system end this process after so many more seconds of its own work, if it can."""
    with suppress(ImportError, ValueError):
        import resource

        whole = ceil(process_time() + seconds)
        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (whole, hard))


@dataclass(frozen=True)
class Tally:
    """How many trials of an engine were answered, refused by name, and failed."""

    engine: str
    answered: int
    refused: int
    failed: int


def record(outcomes: Iterable[Outcome], path: Path) -> Iterator[Outcome]:
    """Write every outcome to a table as it comes, and hand it on."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        for outcome in outcomes:
            rows.writerow(_cells(outcome))
            file.flush()
            yield outcome


def _cells(outcome: Outcome) -> list[Any]:
    return [f"{v:.6g}" if isinstance(v, float) else v for v in astuple(outcome)]


def bounded(outcomes: Iterable[Outcome]) -> tuple[int, int, int]:
    """Count answers whose truth is known, those with bounds, and truths within these."""
    known = [o for o in outcomes if o.truth > 0.0]
    proven = [o for o in known if isfinite(o.upper)]
    low, high = 1.0 - TRUTH, 1.0 + TRUTH
    inside = [o for o in proven if o.lower * low <= o.truth <= o.upper * high]
    return len(known), len(proven), len(inside)


def tally(outcomes: Iterable[Outcome]) -> list[Tally]:
    """Count verdicts, engine by engine."""
    counts: dict[str, dict[str, int]] = {}
    for outcome in outcomes:
        engine = counts.setdefault(outcome.engine, {})
        engine[outcome.verdict] = engine.get(outcome.verdict, 0) + 1
    return [
        Tally(name, *(n.get(v, 0) for v in ("answered", "refused", "failed")))
        for name, n in sorted(counts.items())
    ]
