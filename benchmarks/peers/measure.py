"""One job, one process: time, memory and error of a method on a problem."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from .methods import METHODS, Sized
from .problems import PROBLEMS

REPEATS = 3
LONG = 10.0  # A job that takes longer than this (s) is run once
PATIENCE = 200.0  # A job that takes longer than this (s) is given up
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
ALONE = {
    **os.environ,
    **dict.fromkeys(THREADS, "1"),
    "PYTHONPATH": os.pathsep.join(
        filter(None, [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")])
    ),
}
"""One thread for all: the small dense steps of elements and multigrid are quicker on one."""


@dataclass(frozen=True)
class Measurement:
    """What an answer cost, and how good it is."""

    problem: str
    method: str
    division: int  # Parts into which every edge of the picture's cells was split
    cells: int  # Cells, agents or elements of the body
    seconds: float | None = None  # Median processor time (s); None if there is no answer
    memory: float | None = None  # Peak above what was in use before (MB)
    max_error: float | None = None  # As a share of the largest true displacement
    l2_error: float | None = None  # The same, root mean square
    runs: int = 0  # How many runs the median is of
    failure: str = ""  # Why there is no answer


def jobs(quick: bool) -> Iterator[tuple[str, str, int]]:
    """Yield problem, method and division of all jobs."""
    for problem in PROBLEMS:
        for method in METHODS.values():
            for division in method.divisions[problem]:
                if not quick or cells_of(problem, division) <= method.quick:
                    yield problem, method.name, division


def in_a_fresh_process(problem: str, method: str, division: int) -> Measurement:
    """Measure a job in a process of its own; whatever goes wrong there is its `failure`."""
    nothing = Measurement(problem, method, division, cells_of(problem, division))
    if missing := [package for package in METHODS[method].needs if find_spec(package) is None]:
        return replace(nothing, failure=f"{' and '.join(missing)} not installed")
    command = [sys.executable, "-m", "peers.measure", problem, method, str(division)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=PATIENCE, check=True, env=ALONE
        )
    except subprocess.TimeoutExpired:
        return replace(nothing, failure=f"given up after {PATIENCE:g} s")
    except subprocess.CalledProcessError as error:
        last = error.stderr.strip().splitlines()[-1:] or [f"exit code {error.returncode}"]
        return replace(nothing, failure=last[0])
    return Measurement(**json.loads(done.stdout))


def cells_of(problem: str, division: int) -> int:
    """Return the number of cells of a problem's body."""
    body = PROBLEMS[problem]
    return int(body.picture.sum() * division**body.dimension)


def measure(problem: str, method: str, division: int) -> Measurement:
    """Measure a job in this process: warm up, run, compare with the truth."""
    body, compared = PROBLEMS[problem], METHODS[method]
    compared.answer(body, min(compared.divisions[problem]))()  # compiles and imports
    before = _peak()
    times: list[float] = []
    while len(times) < (1 if times and times[0] > LONG else REPEATS):
        began = time.process_time()
        answer = compared.answer(body, division)
        times.append(time.process_time() - began)
    memory = _peak() - before
    max_error, l2_error = body.error(answer())
    cells = answer.parts if isinstance(answer, Sized) else cells_of(problem, division)
    seconds = statistics.median(times)
    return Measurement(
        problem, method, division, cells, seconds, memory, max_error, l2_error, len(times)
    )


def _peak() -> float:
    """Return the largest memory this process has used (MB)."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / 1e6 if sys.platform == "darwin" else used / 1e3


if __name__ == "__main__":
    found = measure(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    sys.stdout.write(json.dumps(asdict(found)))
