"""What benchmarks share: processor times of jobs that take turns in one process."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time
from typing import Any


def timed(job: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a job answers, and the processor time that it took (s)."""
    began = process_time()
    answer = job()
    return answer, process_time() - began


def in_turn(runs: int, *jobs: Callable[[], Any]) -> list[tuple[Any, float]]:
    """Return the last answer of every job, and the least of its times (s).

    The jobs take turns, so that a busy machine slows all alike.
    """
    rounds = [[timed(job) for job in jobs] for _ in range(runs)]
    return [(own[-1][0], min(seconds for _, seconds in own)) for own in zip(*rounds, strict=True)]
