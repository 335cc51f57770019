"""Bodies on PETSc: comparison with `solve`, scaling over processes, memory a cell.

`python benchmarks/scale.py` says what is missing, or runs 1, 2 and 4 processes and compares them
with `solve`; with `--tables` it measures iterations, strong and weak scaling and memory as well.
Run it with a Python that has petsc4py and mpi4py (docs/scale.md).
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
from importlib.util import find_spec
from time import perf_counter, process_time

RUN = "--run"


def missing() -> list[str]:
    found = [name for name in ("petsc4py", "mpi4py") if find_spec(name) is None]
    return found + ([] if shutil.which("mpirun") else ["mpirun"])


def scene(cells: tuple[int, ...], hole: bool):  # type: ignore[no-untyped-def]
    import kaju

    size, d = 1.0 / max(cells), len(cells)
    extent = [n * size for n in cells]
    low = [0.375 * x for x in extent[:-1]] + [extent[-1]]
    high = [0.625 * x for x in extent[:-1]] + [extent[-1]]
    centre = [0.5 * x for x in extent]
    shape = {"ball" if d == 3 else "disk": {"centre": centre, "radius": 0.2 * min(extent)}}
    return kaju.Scene(
        body={
            "cells": list(cells),
            "cell_size": size,
            "material": "steel",
            "regions": [{**shape, "material": "air"}] if hole else [],
        },
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [low, high]}, "force": [0.0] * (d - 1) + [-1.0]}],
        rule={"kind": "elastic"},
    )


def on_this_process(cells: tuple[int, ...], hole: bool) -> None:
    """Solve and let the first process print what it took."""
    import kaju
    from kaju.model.scale.solve import communicator

    comm = communicator()
    asked = scene(cells, hole)
    kaju.solve(scene((16,) * len(cells), hole), engine="petsc")  # compiles, loads libraries
    before, spent = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, process_time()
    comm.barrier()
    began = perf_counter()
    result = kaju.solve(asked, tolerance=1e-10, engine="petsc")
    comm.barrier()
    seconds = perf_counter() - began
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    spent = comm.allreduce(process_time() - spent)
    figures = result.summary()
    if comm.Get_rank() == 0:
        report = {name: figures[name] for name in ("strain_energy", "iterations", "agents")}
        report |= {"seconds": seconds, "memory": 1024 * memory, "processor": spent}
        print(json.dumps(report), flush=True)


def measured(processes: int, cells: tuple[int, ...], hole: bool = False) -> dict[str, float]:
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = ["mpirun", "-n", str(processes), sys.executable, __file__, RUN, str(int(hole))]
    command += [str(n) for n in cells]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def own(cells: tuple[int, ...], hole: bool) -> tuple[int, float, float]:
    """Return iterations, energy and time of kaju's own solver at the same tolerance."""
    from kaju.model.elastic.solve import solve

    solve(scene((16,) * len(cells), hole))
    began = process_time()
    result = solve(scene(cells, hole), tolerance=1e-10)
    return result.iterations, result.strain_energy, process_time() - began


def compare() -> None:
    print("| cells | processes | iterations | kaju's own | energy beside `solve` |")
    print("|---|---|---|---|---|")
    for cells, hole in (((128, 128), False), ((130, 75), True), ((24, 24, 24), True)):
        iterations, energy, _ = own(cells, hole)
        for processes in (1, 2, 4):
            found = measured(processes, cells, hole)
            apart = abs(found["strain_energy"] / energy - 1.0)
            name = " x ".join(map(str, cells)) + (", hole" if hole else "")
            print(f"| {name} | {processes} | {found['iterations']} | {iterations} | {apart:.1e} |")
            if apart > 1e-8:
                sys.exit("they differ")


def tables(sizes: list[tuple[int, ...]]) -> None:
    print(
        "\n| cells | processes | s | processor time, all (s) | µs a cell | B a cell | iterations "
    )
    print("| kaju's own: iterations, processor time (s) |\n|---|---|---|---|---|---|---|---|")
    for cells in sizes:
        for hole in (False, True):
            iterations, _, seconds = own(cells, hole)
            for processes in (1, 2):
                found = measured(processes, cells, hole)
                count = found["agents"]
                name = " x ".join(map(str, cells)) + (", hole" if hole else "")
                print(
                    f"| {name} | {processes} | {found['seconds']:.2f} | {found['processor']:.2f} "
                    f"| {found['processor'] / count * 1e6:.1f} | {found['memory'] / count:.0f} "
                    f"| {found['iterations']} | {iterations}, {seconds:.2f} |",
                    flush=True,
                )
    print("\n| weak: cells a process | processes | s | processor time, all (s) | iterations |")
    print("|---|---|---|---|---|")
    for processes, cells in ((1, (256, 256)), (2, (512, 256)), (4, (512, 512))):
        found = measured(processes, cells)
        print(
            f"| 65536 | {processes} | {found['seconds']:.2f} | {found['processor']:.2f} "
            f"| {found['iterations']} |"
        )


if __name__ == "__main__":
    if RUN in sys.argv:
        hole, *cells = (int(text) for text in sys.argv[sys.argv.index(RUN) + 1 :])
        on_this_process(tuple(cells), bool(hole))
    elif missing():
        print(f"missing: {', '.join(missing())}; docs/scale.md says how to get it")
        sys.exit(1)
    else:
        compare()
        if "--tables" in sys.argv:
            tables(
                [(256, 256), (512, 512), (1024, 1024), (32, 32, 32), (64, 64, 64), (128, 128, 128)]
            )
