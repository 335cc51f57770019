"""Many trials side by side, each in a process that may hang or die without stopping the rest."""

from __future__ import annotations

import csv
import signal
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import astuple, fields
from math import ceil, inf, isfinite
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic, process_time
from typing import TYPE_CHECKING

from kaju.errors import ParameterError

from .trial import FAILED, UNFINISHED, VERDICTS, Outcome, attempt, family_of, put_to
from .trial_kinds import TRUTH

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

COLUMNS = tuple(field.name for field in fields(Outcome))
MOST_MEMORY = 6 * 2**30  # address space of a worker (bytes): a scene that wants more is a finding
PATIENCE = 20  # times its processor time that a trial may take by the clock, on a busy machine
OUT_OF_TIME = getattr(signal, "SIGXCPU", 0)
WARM = (0, 1, 2, 5, 12, 19, 38)  # trials by which a worker compiles before any time counts

Case = tuple[int, str]  # a trial's number, and what it is put to; "" is the kind whose turn it is


def trials(
    numbers: Iterable[int | Case], workers: int = 2, limit: float = 60.0, *, warm: bool = True
) -> Iterator[Outcome]:
    """Yield the outcome of every trial as it ends, in no particular order.

    `numbers`: which trials; with a name, put to that kind; `workers`: processes side by side;
    `limit`: a trial that takes more seconds of processor time than this has failed: its process is
    killed. One that does not come to that in twenty times as long by the clock is not finished, for
    which the machine may be too busy; `warm`: whether workers warm up before the clock starts.
    """
    if workers < 1:
        raise ParameterError(f"workers: must be 1 or more, got {workers}")
    if not limit > 0.0:
        raise ParameterError(f"limit: must be above 0 s, got {limit}")
    left = ((case, "") if isinstance(case, int) else case for case in numbers)
    processes = [_TrialProcess(limit, warm) for _ in range(workers)]
    try:
        for worker in processes:
            worker.give(next(left, None))
        while busy := [worker for worker in processes if worker.case]:
            wait([worker.pipe for worker in busy], timeout=0.2)
            for worker in busy:
                outcome = worker.ended()
                if outcome is not None:
                    yield outcome
                    worker.give(next(left, None))
    finally:
        for worker in processes:
            worker.end()


class _TrialProcess:
    """A process that makes one trial after the other, and is replaced when it is killed or dies."""

    def __init__(self, limit: float, warm: bool) -> None:
        self._limit, self._warm = limit, warm
        self.case: Case | None = None
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        serving = (theirs, self._limit, self._warm)
        self._process: BaseProcess = context.Process(target=_serve, args=serving, daemon=True)
        self._process.start()
        theirs.close()
        self._since = inf  # it warms up

    def give(self, case: Case | None) -> None:
        """Send the next trial, if there is one."""
        self.case = case
        if self._since < inf:
            self._since = monotonic()
        if case is not None:
            self.pipe.send(case)

    def ended(self) -> Outcome | None:
        """Return the trial's outcome if it has ended, or must end."""
        while self.pipe.poll():
            try:
                outcome: Outcome | None = self.pipe.recv()
            except (EOFError, ConnectionResetError):
                self._process.join()
                late = self._process.exitcode == -OUT_OF_TIME
                why = f"took more than {self._limit:g} s of processor time"
                return self._lost(FAILED, why if late else "the process died")
            self._since = monotonic()
            if outcome is not None:
                return outcome
        spent = monotonic() - self._since
        if spent > PATIENCE * self._limit:
            return self._lost(UNFINISHED, f"waited for {spent:.0f} s, by the clock")
        return None

    def _lost(self, verdict: str, what: str) -> Outcome:
        assert self.case is not None
        number, engine = self.case
        self.end()
        self._start()
        return Outcome(number, family_of(number), engine or put_to(number), verdict, what)

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _serve(pipe: Connection, limit: float, warm: bool) -> None:
    for number in WARM if warm else ():
        attempt(number)
    _limited("RLIMIT_AS", MOST_MEMORY)
    pipe.send(None)
    with suppress(EOFError, KeyboardInterrupt):
        while True:
            case = pipe.recv()
            _limited("RLIMIT_CPU", ceil(process_time() + limit))
            pipe.send(attempt(*case))


def _limited(what: str, most: int) -> None:
    """Let the system refuse this process more of something, if it can."""
    with suppress(ImportError, ValueError):
        import resource

        kind = getattr(resource, what)
        resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))


def record(outcomes: Iterable[Outcome], path: Path) -> Iterator[Outcome]:
    """Write every outcome to a table as it comes, and hand it on."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        for outcome in outcomes:
            rows.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in astuple(outcome)])
            file.flush()
            yield outcome


def bounded(outcomes: Iterable[Outcome]) -> tuple[int, int, int]:
    """Count answers whose truth is known, those with bounds, and truths within these."""
    known = [o for o in outcomes if o.truth > 0.0]
    proven = [o for o in known if isfinite(o.upper)]
    low, high = 1.0 - TRUTH, 1.0 + TRUTH
    inside = [o for o in proven if o.lower * low <= o.truth <= o.upper * high]
    return len(known), len(proven), len(inside)


def tally(outcomes: Iterable[Outcome]) -> dict[str, list[int]]:
    """Count the `VERDICTS` of every engine."""
    counts = Counter((outcome.engine, outcome.verdict) for outcome in outcomes)
    engines = sorted({engine for engine, _ in counts})
    return {name: [counts[name, verdict] for verdict in VERDICTS] for name in engines}
