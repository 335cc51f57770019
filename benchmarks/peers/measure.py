"""One job, one process: time, memory and error of a method on a problem."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from .finite_elements import RESIDUAL
from .methods import METHODS, Spawned
from .problems import PROBLEMS

REPEATS = 3
LONG = 10.0
"""A job that takes longer than this (s) is run once."""
PATIENCE = 200.0
"""A job that takes longer than this (s) is given up."""
ALONE = {
    **os.environ,
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join(
        filter(None, [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")])
    ),
}
"""The small dense steps of finite elements and algebraic multigrid are quicker on one thread."""


@dataclass(frozen=True)
class Measurement:
    """What an answer cost, and how good it is.

    Attributes
    ----------
    problem, method : str
    division : int
        Parts into which every edge of the picture's cells was split.
    cells : int
        Cells or elements of the body.
    seconds : float or None
        Median time (s); None if there is no answer.
    memory : float or None
        Peak above what was in use before (MB).
    max_error, l2_error : float or None
        As shares of the largest true displacement.
    runs : int
        How many runs the median is of.
    failure : str
        Why there is no answer.
    """

    problem: str
    method: str
    division: int
    cells: int
    seconds: float | None = None
    memory: float | None = None
    max_error: float | None = None
    l2_error: float | None = None
    runs: int = 0
    failure: str = ""


def jobs(quick: bool, problems: tuple[str, ...] = ()) -> Iterator[tuple[str, str, int]]:
    """Yield problem, method and division of all jobs; of all problems unless some are named."""
    for problem in problems or tuple(PROBLEMS):
        for method in METHODS.values():
            for division in (method.quick if quick else method.divisions)[problem]:
                yield problem, method.name, division


def in_a_fresh_process(problem: str, method: str, division: int) -> Measurement:
    """Measure a job in a process of its own; whatever goes wrong there is told."""
    nothing = Measurement(problem, method, division, cells_of(problem, division))
    missing = METHODS[method].missing
    if missing:
        return _failed(nothing, f"{' and '.join(missing)} not installed")
    try:
        if method == "dolfinx":
            return by_dolfinx(nothing)
        command = [sys.executable, "-m", "peers.measure", problem, method, str(division)]
        return Measurement(**json.loads(_output_of(command)))
    except subprocess.TimeoutExpired:
        return _failed(nothing, f"given up after {PATIENCE:g} s")
    except subprocess.CalledProcessError as error:
        last = error.stderr.strip().splitlines()[-1:] or [f"exit code {error.returncode}"]
        return _failed(nothing, last[0])


def _output_of(command: list[str]) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE, check=True, env=ALONE
    )
    return done.stdout


@cache
def python_with_dolfinx() -> str | None:
    """Return a Python that has dolfinx: this one, or the system's; None if there is none."""
    for python in (sys.executable, "/usr/bin/python3"):
        try:
            _output_of([python, "-c", "import dolfinx, petsc4py"])
        except (OSError, subprocess.SubprocessError):
            continue
        return python
    return None


def by_dolfinx(nothing: Measurement) -> Measurement:
    """Let dolfinx answer, in whichever Python has it."""
    python = python_with_dolfinx()
    if python is None:
        return _failed(nothing, "dolfinx not installed")
    described = PROBLEMS[nothing.problem]
    question = {k: v for k, v in vars(described).items() if k not in ("name", "title")}
    question |= {"points": described.points, "division": nothing.division}
    question |= {"residual": RESIDUAL, "long": LONG}
    with tempfile.TemporaryDirectory() as folder:
        asked, told = Path(folder) / "question.npz", Path(folder) / "answer.npz"
        np.savez(asked, **question)
        _output_of(
            [python, str(Path(__file__).with_name("dolfinx_peer.py")), str(asked), str(told)]
        )
        with np.load(told) as file:
            answer = dict(file)
    max_error, l2_error = described.error(answer["displacement"])
    return replace(
        nothing,
        seconds=float(np.median(answer["times"])),
        memory=float(answer["memory"]),
        max_error=max_error,
        l2_error=l2_error,
        runs=len(answer["times"]),
    )


def cells_of(problem: str, division: int) -> int:
    """Return the number of cells of a problem's body."""
    described = PROBLEMS[problem]
    return int(described.picture.sum() * division**described.dimension)


def measure(problem: str, method: str, division: int) -> Measurement:
    """Measure a job in this process: warm up, run, compare with the truth."""
    described, way = PROBLEMS[problem], METHODS[method]
    way.prepare(described, min(way.divisions[problem]))()()
    job = way.prepare(described, division)
    before = _peak()
    times: list[float] = []
    while len(times) < (1 if times and times[0] > LONG else REPEATS):
        began = time.perf_counter()
        answer = job()
        times.append(time.perf_counter() - began)
    memory = _peak() - before
    max_error, l2_error = described.error(answer())
    return Measurement(
        problem,
        method,
        division,
        answer.agents if isinstance(answer, Spawned) else cells_of(problem, division),
        statistics.median(times),
        memory,
        max_error,
        l2_error,
        len(times),
    )


def _peak() -> float:
    """Return the largest memory this process has used (MB)."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / 1e6 if sys.platform == "darwin" else used / 1e3


def _failed(nothing: Measurement, reason: str) -> Measurement:
    return replace(nothing, failure=reason)


if __name__ == "__main__":
    found = measure(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    sys.stdout.write(json.dumps(asdict(found)))
