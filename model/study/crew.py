"""Who computes the runs: processes of our own, or any executor of `concurrent.futures`.

Sent one by one, runs cost several milliseconds each to hand over. So they go out in batches of
about half a second, sized by what runs have taken so far, smaller towards the end so that
nobody waits for the last. No more batches are on their way than keep everybody busy.

A process of our own that dies takes the whole pool with it. The runs that were on their way are
then computed one at a time, so that a run that kills its process is known by it.

Short runs of many agents leave garbage, which Python looks for in all that a process has loaded:
a fifth of a run of 7 ms. So workers set aside ("freeze") what they have before the first run.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import multiprocessing
import os
import pickle
import signal
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from functools import lru_cache
from math import ceil
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Protocol

from kaju.arrays import Ints
from kaju.errors import ParameterError, WorkerError

from .job import ERROR, Job, Row, begun, run_batch
from .points import Points

Batch = list[tuple[int, Mapping[str, Any]]]
Answer = tuple[float, list[Row]]

_BATCH = 0.5  # s that a batch should take
_LEAST = 0.05  # s below which handing over would be noticed
_DEATHS = 3
"""So often a run may kill the process that computes nothing else, before it is given up."""
_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of Linux


class Crew(Protocol):
    """Who computes batches."""

    workers: int

    def submit(self, batch: Batch) -> Future[Answer]:
        """Hand over a batch."""

    def mend(self, reason: Exception) -> None:
        """Replace what has died, or raise WorkerError."""


class Borrowed:
    """An executor that somebody else made and will close.

    Parameters
    ----------
    executor : concurrent.futures.Executor
        Also Dask's, loky's or mpi4py's.
    job : Job
        Sent with every batch; each worker unpacks it once.
    workers : int
        How many runs it computes at a time.

    Raises
    ------
    ParameterError
        If the job cannot be sent.
    """

    def __init__(self, executor: Executor, job: Job, workers: int) -> None:
        self.workers = workers
        self._executor = executor
        self._job = packed(job)

    def submit(self, batch: Batch) -> Future[Answer]:
        """Hand over a batch."""
        return self._executor.submit(_unpack_and_run, self._job, os.getpid(), batch)

    def mend(self, reason: Exception) -> None:
        """Raise WorkerError: the executor is not ours to replace."""
        raise WorkerError(
            f"executor: failed with {type(reason).__name__}: {reason}; the rows that were "
            "finished are kept in out=, and the same sweep goes on from there"
        ) from reason


class Own:
    """Processes that live no longer than the sweep.

    On Linux they are forked, elsewhere spawned, whatever start method the process has as its
    default: importing Mesa changes that.
    """

    def __init__(self, job: Job, workers: int) -> None:
        self.workers = workers
        self._forks = sys.platform == "linux"
        self._job: Job | bytes = job if self._forks else packed(job)
        self._came_back = False
        if self._forks:
            job.prepare()
        self._open()

    def _open(self) -> None:
        context = multiprocessing.get_context("fork" if self._forks else "spawn")
        self._leash, held = context.Pipe(duplex=False)
        self._held = held
        self._pool = ProcessPoolExecutor(
            self.workers,
            mp_context=context,
            initializer=_begin_work,
            initargs=(self._job, self._leash, held, os.getpid()),
        )

    def submit(self, batch: Batch) -> Future[Answer]:
        """Hand over a batch."""
        future = self._pool.submit(_run_held, batch)
        future.add_done_callback(self._note)
        return future

    def _note(self, future: Future[Answer]) -> None:
        self._came_back |= not future.cancelled() and future.exception() is None

    def mend(self, reason: Exception) -> None:
        """Open a new pool in place of a broken one.

        Raises
        ------
        WorkerError
            If processes cannot even start.
        """
        self.close()
        if not isinstance(reason, BrokenExecutor):
            raise WorkerError(f"executor: failed with {reason!r}") from reason
        if not (self._came_back or self._forks):
            raise WorkerError(
                "executor: the processes end as soon as they start; a script that sweeps must "
                "do so below `if __name__ == '__main__':`, for they read it too"
            ) from reason
        self._open()

    def close(self) -> None:
        """End the processes, also those that compute."""
        self._held.close()
        self._leash.close()
        self._pool.shutdown(cancel_futures=True)


def packed(job: Job) -> bytes:
    """Return a job as bytes.

    Raises
    ------
    ParameterError
        If one of its functions is known to this process only.
    """
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ParameterError(
            f"run, measure: cannot be sent to other processes ({error}); "
            "define functions at the top of a module"
        ) from error


def rows_of(crew: Crew, points: Points, runs: Ints) -> Iterator[list[Row]]:
    """Yield the rows of runs as they are finished; an empty list when a second has passed.

    Parameters
    ----------
    crew : Crew
    points : Points
    runs : array of int
        Numbers of the points to run.

    Raises
    ------
    WorkerError
        If nobody is left to compute.
    """
    order = _Order(points, runs, crew.workers)
    waiting: dict[Future[Answer], Batch] = {}
    finished: SimpleQueue[Future[Answer]] = SimpleQueue()
    broken: Exception | None = None
    try:
        while waiting or order.left:
            if broken and not waiting:
                crew.mend(broken)
                broken = None
            while not broken and order.left and len(waiting) < order.room:
                batch = order.next()
                try:
                    future = crew.submit(batch)
                except RuntimeError as error:  # a broken or closed pool
                    order.put_back(batch)
                    broken = error
                else:
                    waiting[future] = batch
                    future.add_done_callback(finished.put)
            if not waiting:
                continue
            try:
                future = finished.get(timeout=1.0)
            except Empty:
                yield []
                continue
            batch = waiting.pop(future)
            try:
                seconds, rows = future.result()
            except Exception as error:  # not of a run: those are caught where they happen
                broken = error
                yield order.suspect(batch)
            else:
                order.learn(seconds, len(batch))
                yield rows
    finally:
        for future in waiting:
            future.cancel()


class _Order:
    """In which batches runs go out."""

    def __init__(self, points: Points, runs: Ints, workers: int) -> None:
        self._points = points
        self._runs = runs
        self._begun = 0
        self._workers = workers
        self._each: float | None = None
        self._suspects: deque[int] = deque()
        self._deaths: dict[int, int] = {}
        self._alone = False

    @property
    def left(self) -> bool:
        """Whether anything has still to go out."""
        return bool(self._suspects) or self._begun < len(self._runs)

    @property
    def room(self) -> int:
        """How many batches may be on their way: one at work and one at hand for each."""
        return 1 if self._suspects or self._alone else 2 * self._workers

    def next(self) -> Batch:
        """Return the next batch."""
        self._alone = bool(self._suspects)
        if self._suspects:
            return self._batch([self._suspects.popleft()])
        size = self._size(len(self._runs) - self._begun)
        taken = self._runs[self._begun : self._begun + size]
        self._begun += size
        return self._batch(taken.tolist())

    def _size(self, left: int) -> int:
        if self._each is None:
            return 1
        share = left * self._each / (3 * self._workers)  # s: smaller towards the end
        return min(left, ceil(min(max(share, _LEAST), _BATCH) / max(self._each, 1e-6)))

    def _batch(self, runs: Sequence[int]) -> Batch:
        return [(run, self._points[run]) for run in runs]

    def learn(self, seconds: float, runs: int) -> None:
        """Take note of how long runs take."""
        each = seconds / runs
        self._each = each if self._each is None else 0.7 * self._each + 0.3 * each
        self._alone = False

    def put_back(self, batch: Batch) -> None:
        """Take back what nobody has begun."""
        self._suspects.extend(run for run, _ in batch)
        self._alone = False

    def suspect(self, batch: Batch) -> list[Row]:
        """Set runs aside whose process died; return the row of one that has died alone, often."""
        if self._alone:
            ((run, point),) = batch
            self._deaths[run] = self._deaths.get(run, 0) + 1
            if self._deaths[run] == _DEATHS:
                self._alone = False
                why = f"WorkerError: the process that computed it died, {_DEATHS} times"
                return [begun(run, point) | {ERROR: why}]
        self.put_back(batch)
        return []


_held_job: Job | None = None


def _begin_work(job: Job | bytes, leash: Connection, held: Connection, parent: int) -> None:
    """Let a process of our own end with the sweep, however that ends."""
    global _held_job
    held.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    if sys.platform == "linux":
        # At once, also while compiled code runs that keeps the thread below from its turn.
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
    Thread(target=_end_with, args=(leash,), daemon=True).start()
    _held_job = job if isinstance(job, Job) else pickle.loads(job)  # noqa: S301 (our own)
    _held_job.prepare()
    gc.freeze()


def _end_with(leash: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        leash.recv_bytes()
    os._exit(1)


def _run_held(batch: Batch) -> Answer:
    assert _held_job is not None
    return run_batch(_held_job, batch)


def _unpack_and_run(job: bytes, home: int, batch: Batch) -> Answer:
    return run_batch(_unpacked(job, home), batch)


@lru_cache(maxsize=2)
def _unpacked(job: bytes, home: int) -> Job:
    unpacked = pickle.loads(job)  # noqa: S301 (made by `packed`, sent by the user's own executor)
    assert isinstance(unpacked, Job)
    if os.getpid() != home:  # a worker's process, not a thread of the caller's
        unpacked.prepare()
        gc.unfreeze()
        gc.collect()
        gc.freeze()
    return unpacked
