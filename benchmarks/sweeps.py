"""What sweeps cost: the worked plate 2000 times, in a loop and on two processes.

`python benchmarks/sweeps.py [RUNS]`, on a machine with nothing else to do. Every way is timed three
times in turn, and the least time counts; the first sweep of a process, which waits until its
workers have imported kaju, is told apart.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import kaju

SCENE = Path(__file__).parent.parent / "examples" / "plate.toml"


def scene() -> kaju.Scene:
    return kaju.load_scene(SCENE).with_overrides({"loads.0.steps": 1})


def forces(runs: int) -> list[float]:
    return [-1.5 - k / runs for k in range(runs)]


def loop(runs: int) -> None:
    plate = scene()
    for force in forces(runs):
        kaju.LoadModel(plate.with_overrides({"loads.0.force.1": force})).run().summary()


def sweep(workers: int, folder: bool = False) -> Callable[[int], None]:
    def on(runs: int) -> None:
        with tempfile.TemporaryDirectory() as place:
            out = Path(place) / "out" if folder else None
            varied = {"loads[0].force[1]": forces(runs)}
            table = kaju.sweep(scene(), varied, workers=workers, out=out, progress=False)
        assert (table["error"] == "").all()

    return on


def timed(way: Callable[[int], None], runs: int) -> float:
    began = perf_counter()
    way(runs)
    return perf_counter() - began


def measure(runs: int = 2000) -> dict[str, float]:
    """Return the seconds that each way takes."""
    loop(20)
    ways = {
        "a loop": loop,
        "1 process": sweep(1),
        "2 processes": sweep(2),
        "2 processes, into a folder": sweep(2, folder=True),
    }
    found = {"2 processes, for the first time": timed(ways["2 processes"], runs)}
    for _ in range(3):
        for name, way in ways.items():
            found[name] = min(found.get(name, float("inf")), timed(way, runs))
    return found


def main() -> None:
    found = measure(*(int(word) for word in sys.argv[1:2]))
    print("| way | s | times as fast |\n|---|---|---|")
    for name, seconds in sorted(found.items(), key=lambda item: -item[1]):
        print(f"| {name} | {seconds:.1f} | {found['a loop'] / seconds:.2f} |")


if __name__ == "__main__":
    main()
