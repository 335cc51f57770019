"""What sweeps cost: the worked plate 2000 times, in a loop and on two processes.

`python benchmarks/sweeps.py prices [--runs RUNS]`, on a machine with nothing else to do. Every kind
of run is timed three times in turn, and the least time counts; the first sweep of a process, which
waits until its workers have imported kaju, has a row of its own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from time import perf_counter

from shared import ROOT, by_name, in_turn, timed

import kaju


def scene() -> kaju.Scene:
    return kaju.load_scene(ROOT / "examples" / "plate.toml").with_overrides({"loads.0.steps": 1})


def forces(runs: int) -> list[float]:
    return [-1.5 - k / runs for k in range(runs)]


def loop(runs: int) -> None:
    plate = scene()
    for force in forces(runs):
        kaju.LoadModel(plate.with_overrides({"loads.0.force.1": force})).run().summary()


def sweep(runs: int, workers: int, folder: bool = False) -> None:
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "out" if folder else None
        varied = {"loads[0].force[1]": forces(runs)}
        table = kaju.sweep(scene(), varied, workers=workers, out=out, progress=False)
    assert (table["error"] == "").all()


def prices(runs: int = 2000) -> Iterator[str]:
    """Yield the seconds that each kind of run takes."""
    loop(20)
    jobs = {
        "a loop": partial(loop, runs),
        "1 process": partial(sweep, runs, 1),
        "2 processes": partial(sweep, runs, 2),
        "2 processes, into a folder": partial(sweep, runs, 2, folder=True),
    }
    first = timed(jobs["2 processes"], perf_counter)[1]
    spent = [seconds for _, seconds in in_turn(3, *jobs.values(), clock=perf_counter)]
    found = {"2 processes, for the first time": first} | dict(zip(jobs, spent, strict=True))
    yield "| run | s | times as fast |\n|---|---|---|"
    for name, seconds in sorted(found.items(), key=lambda item: -item[1]):
        yield f"| {name} | {seconds:.1f} | {found['a loop'] / seconds:.2f} |"


if __name__ == "__main__":
    by_name(__doc__, prices)
