"""What sweeps cost: the worked plate 2000 times, in a loop, on processes of kaju's, and on Dask.

Run it on a machine with nothing else to do: `python benchmarks/sweeps.py [RUNS] [--memory]`.
Every way is timed three times in turn; the least time of each counts. Overhead is processor time
of parent and workers together beyond that of the loop, so it does not depend on what else the
machine does. With `--memory`, 10,000 runs are made instead and the workers' memory is printed.
"""

from __future__ import annotations

import gc
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

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


def on(executor: object, workers: int, folder: bool = False) -> Callable[[int], None]:
    def sweep(runs: int) -> None:
        with tempfile.TemporaryDirectory() as place:
            table = kaju.sweep(
                scene(),
                {"loads[0].force[1]": forces(runs)},
                executor=executor,
                workers=workers,
                out=Path(place) / "out" if folder else None,
                progress=False,
            )
        assert (table["error"] == "").all()

    return sweep


def processor_time() -> float:
    both = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(sum(resource.getrusage(who)[:2]) for who in both)


def start_dask(folder: Path) -> tuple[list[subprocess.Popen[bytes]], object]:
    from distributed import Client

    file = folder / "scheduler.json"
    quiet = subprocess.DEVNULL

    def run(what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard"]
        command += ["--scheduler-file", str(file), *options]
        return subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=quiet)

    started = [run("scheduler", "--host", "127.0.0.1", "--port", "0")]
    started += [run("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
    while not file.exists():
        time.sleep(0.05)
    client = Client(scheduler_file=str(file))
    client.wait_for_workers(2)
    return started, client


def times(runs: int) -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as folder:
        started, client = start_dask(Path(folder))
        ways = {
            "loop": loop,
            "1 process": on(None, 1),
            "2 processes": on(None, 2),
            "2 processes, in a folder": on(None, 2, folder=True),
            "dask, 2 workers": on(client.get_executor(), 2),  # type: ignore[attr-defined]
        }
        best: dict[str, tuple[float, float]] = {}
        loop(20)
        gc.freeze()  # as workers do: else the loop is slower than they are
        try:
            for _ in range(3):
                for name, way in ways.items():
                    began, spent = time.perf_counter(), processor_time()
                    way(runs)
                    found = time.perf_counter() - began, processor_time() - spent
                    one = best.get(name, found)
                    best[name] = (min(one[0], found[0]), min(one[1], found[1]))
        finally:
            client.close()  # type: ignore[attr-defined]
            for process in reversed(started):
                process.kill()
                process.wait()
    base = best["loop"]
    print(f"{runs} runs, {base[1] / runs * 1e3:.2f} ms of processor time each")
    print("| way | s | times as fast | processor time beyond the loop (ms a run) |")
    print("|---|---|---|---|")
    for name, (wall, spent) in best.items():
        beyond = "not seen from here" if "dask" in name else f"{(spent - base[1]) / runs * 1e3:.2f}"
        print(f"| {name} | {wall:.2f} | {base[0] / wall:.2f} | {beyond} |")


def peak(result: kaju.TransferResult) -> dict[str, float]:
    return {"memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def memory(runs: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        kaju.sweep(scene(), {"loads[0].force[1]": forces(100)}, peak, workers=2, out=folder)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with tempfile.TemporaryDirectory() as folder:
        varied = {"loads[0].force[1]": forces(runs)}
        table = kaju.sweep(scene(), varied, peak, workers=2, out=Path(folder) / "out")
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for until in (runs // 10, runs):
        print(f"largest worker after {until} runs: {table['memory'][:until].max():.1f} MB")
    print(f"parent after a first sweep of 100 runs: {before:.1f} MB, after this: {after:.1f} MB")


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:] if text.isdecimal()]
    if "--memory" in sys.argv:
        memory(numbers[0] if numbers else 10_000)
    else:
        times(numbers[0] if numbers else 2000)
