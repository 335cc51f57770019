"""What benchmarks share: parts that are run by their names, times taken in turn, best answers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import wraps
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any

import typer

from kaju import Scene, solve
from kaju.errors import ConvergenceError

ROOT = Path(__file__).parents[1]
TESTS = ROOT / "tests"

Part = Callable[..., Iterator[object]]
"""Yields lines to be printed; its arguments are options of the command."""


def by_name(about: str | None, *parts: Part, usual: tuple[Part, ...] = ()) -> None:
    """Run the part that the command line names; without a name the usual ones, or all, in turn."""
    app = typer.Typer(help=about, add_completion=False, pretty_exceptions_enable=False)

    @app.callback(invoke_without_command=True)
    def every(context: typer.Context) -> None:
        for part in (usual or parts) if context.invoked_subcommand is None else ():
            _printed(part)()

    for part in parts:
        app.command(part.__name__)(_printed(part))
    app()


def _printed(part: Part) -> Callable[..., None]:
    @wraps(part)
    def show(**options: Any) -> None:
        for line in part(**options):
            print(line, flush=True)

    return show


def timed(job: Callable[[], Any], clock: Callable[[], float] = process_time) -> tuple[Any, float]:
    """Return what a job answers, and the seconds that it took."""
    began = clock()
    answer = job()
    return answer, clock() - began


def in_turn(
    runs: int, *jobs: Callable[[], Any], clock: Callable[[], float] = process_time
) -> list[tuple[Any, float]]:
    """Return the last answer of every job, and the least of its times (s).

    The jobs take turns, so that a busy machine slows all alike.
    """
    rounds = [[timed(job, clock) for job in jobs] for _ in range(runs)]
    return [(own[-1][0], min(seconds for _, seconds in own)) for own in zip(*rounds, strict=True)]


def of_tests(name: str) -> Any:
    """Return a module of helpers of the tests."""
    if (place := str(TESTS / "support")) not in sys.path:
        sys.path.append(place)
    return import_module(name)


def nearest(scene: Scene, **how: Any) -> Any:
    """Return the answer of `kaju.solve`, or the best one if it misses its tolerance."""
    try:
        return solve(scene, **how)
    except ConvergenceError as error:
        return error.best
