"""Sweeps on everybody's back ends: all end with the same table."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager

import joblib
import pytest
import sweep_work
from plates import plate

import kaju
from kaju import sweep
from kaju.model.study.sweep_store import load_sweep


def own(**options):
    points = {"x": [0.5 * k for k in range(200)]}
    return sweep(sweep_work.square, points, **{"workers": 2, "progress": False} | options)


def test_threads():
    with joblib.parallel_config(backend="threading"):
        assert own().equals(own(workers=1))


@contextmanager
def dask(folder):
    """A scheduler and two workers, each a process, over TCP on 127.0.0.1."""
    distributed = pytest.importorskip("distributed")
    file = folder / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    path = os.pathsep.join([sweep_work.HERE, os.environ.get("PYTHONPATH", "")])
    common = {"env": os.environ | {"PYTHONPATH": path}, "cwd": folder, **quiet}

    def run(what, *options):
        module = f"distributed.cli.dask_{what}"
        command = [sys.executable, "-m", module, "--scheduler-file", str(file), "--no-dashboard"]
        return subprocess.Popen([*command, *options], **common)

    started = [run("scheduler", "--host", "127.0.0.1", "--port", "0")]
    try:
        started += [run("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        with distributed.Client(scheduler_file=str(file)) as client:
            assert client.scheduler.address.startswith("tcp://127.0.0.1:")
            client.wait_for_workers(2, timeout=60)
            yield client
    finally:
        for process in reversed(started):
            process.kill()  # asked to end, they wait for one another
        for process in started:
            process.wait(30)


@pytest.mark.slow
def test_dask_over_tcp(tmp_path):
    here = own()
    with dask(tmp_path), joblib.parallel_config(backend="dask"):
        assert own().equals(here)
        scene = plate([20, 20], [10, 19], size=[0.2, 0.2])
        vary = {"rule.threshold": [0.01, 0.001]}
        there = sweep(scene, vary, workers=2, progress=False)
        assert there.equals(sweep(scene, vary, workers=1, progress=False))


def test_a_run_that_kills_its_process_ends_the_sweep_and_the_rows_are_kept(tmp_path):
    points = {"x": list(range(40))}
    with pytest.raises(kaju.KajuError, match="TerminatedWorkerError"):
        sweep(sweep_work.deadly, points, workers=2, out=tmp_path, progress=False)
    rows = load_sweep(tmp_path)
    assert rows["square"].tolist() == [x * x for x in rows["x"]]
