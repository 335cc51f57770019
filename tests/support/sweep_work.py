"""Things to sweep that other processes can import, and a killer of sweeps.

`python tests/support/sweep_work.py KILLS` kills sweeps so many times and says what was found.
"""

import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

RUNS = 240
HERE = str(Path(__file__).parent)


def square(x, y=0.0):
    return {"square": x * x + y}


def drawn(x, rng):
    return float(np.random.default_rng(rng).random())


def deadly(x):
    """Kill the process at one point, always."""
    if x == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"square": x * x}


def heavy(x):
    """Return something large, of which only a figure is kept."""
    return np.full(200_000, float(x))


def memory(result):
    return {"sum": result.sum(), "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}


def slow(x):
    time.sleep(0.02)
    return {"square": x * x, "worker": "dead" if x < 0 else "alive"}


def run_slow(out, workers=2):
    import kaju

    print("go", flush=True)
    return kaju.sweep(slow, {"x": list(range(RUNS))}, workers=workers, out=out, progress=False)


def start(out):
    """Start the slow sweep in a session of its own; return when it begins to work."""
    code = f"import sys; sys.path.insert(0, {HERE!r}); import sweep_work as w; w.run_slow({out!r})"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    words = [sys.executable, "-c", code]
    process = subprocess.Popen(words, start_new_session=True, **pipes)
    assert process.stdout.readline() == b"go\n"
    return process


def members(session):
    """Return the living processes of a session and their parents (Linux)."""
    found = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == session and fields[0] != "Z":
                found[int(entry.name)] = int(fields[1])
    return found


def kill_once(out, after):
    """Kill the sweep; return the orphans that stay."""
    process = start(out)
    time.sleep(after)
    if process.poll() is None:
        process.kill()
    process.wait(60)
    process.stdout.close()
    deadline = time.monotonic() + 60.0  # a worker that starts has to import first
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    return list(members(process.pid))


def kill_often(kills, folder, seed=0):
    """Kill sweeps until that has happened so often; check every table that they end with."""
    random.seed(seed)
    orphans, tables, number = 0, 0, 0
    while number < kills:
        out = str(Path(folder) / f"sweep-{tables}")
        while number < kills and not (Path(out) / "table.parquet").exists():
            orphans += len(kill_once(out, random.uniform(0.0, 2.6)))
            number += 1
        table = run_slow(out, workers=1)
        tables += 1
        assert table["run"].tolist() == list(range(RUNS))  # nothing lost, nothing doubled
        assert table["square"].tolist() == [x * x for x in range(RUNS)]
        assert (table["error"] == "").all()
        left = sorted(path.name for path in Path(out).iterdir())
        assert left == ["sweep.sqlite", "table.parquet"], left
    return {"kills": number, "tables": tables, "orphans": orphans}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        import sweep_work  # by the name that the killed processes know it by

        print(sweep_work.kill_often(int(sys.argv[1]), folder))
