"""Things to sweep that other processes can import."""

import os
import signal
import subprocess
import sys
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


def slow(x):
    time.sleep(0.02)
    return {"square": x * x}


def run_slow(out, workers=2):
    import kaju

    return kaju.sweep(slow, {"x": list(range(RUNS))}, workers=workers, out=out, progress=False)


def killed(out):
    """Begin the slow sweep in a session of its own, and kill it; return its session."""
    code = f"import sys; sys.path.insert(0, {HERE!r}); import sweep_work as w; w.run_slow({out!r})"
    process = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
    while not (Path(out) / "sweep.sqlite").exists():
        time.sleep(0.05)
    time.sleep(1.0)
    process.kill()
    process.wait(60)
    return process.pid


def members(session):
    """Return the living processes of a session (Linux)."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            found += [entry.name] * (int(fields[3]) == session and fields[0] != "Z")
    return found
