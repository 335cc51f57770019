"""What all tests share."""

import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Jobs in the background of a shell ignore Ctrl-C, and so would all that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The tests start many processes: each would compile all over again what none may keep.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def compile_in_one_worker():
    """Let a worker that needs a loop which another one compiles wait, and load what that kept."""
    import fcntl

    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    usual, mine = Dispatcher.compile, set()

    def compile_or_load(loop, signature):
        source = loop.py_func.__code__.co_filename
        with global_compiler_lock:  # of this worker's threads
            if source in mine or not Path(source).exists():
                return usual(loop, signature)
            mine.add(source)
            try:
                with Path(source).open() as lock:
                    fcntl.flock(lock, fcntl.LOCK_EX)
                    return usual(loop, signature)
            finally:
                mine.remove(source)

    Dispatcher.compile = compile_or_load


if "PYTEST_XDIST_WORKER" in os.environ:  # others use the other processors
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if os.name == "posix":
        compile_in_one_worker()

# Machines differ in speed: a slow example is no failure.
settings.register_profile(
    "kaju", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)
settings.load_profile("kaju")

_WANTING = ("not installed", "could not import", "No module named")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """Fail what would be skipped for want of a program, where all programs must be there."""
    outcome = yield
    report = outcome.get_result()
    if report.skipped and os.environ.get("KAJU_TESTS_NEED_ALL"):
        reason = str(report.longrepr)
        if any(words in reason for words in _WANTING):
            report.outcome = "failed"
            report.longrepr = f"may not be skipped here: {reason}"


@pytest.fixture
def coarse(monkeypatch):
    """Let pictures and films be coarse, which is quick."""
    monkeypatch.setattr("kaju.view.style.RESOLUTION", 40)
    monkeypatch.setattr("kaju.view.films.RESOLUTION", 30)


@pytest.fixture
def kaju(coarse, monkeypatch, capsys, tmp_path):
    """Type a command in an empty folder; return exit code, output and error output."""
    from kaju.cli import main

    monkeypatch.chdir(tmp_path)

    def typed(*words):
        monkeypatch.setattr(sys, "argv", ["kaju", *words])
        with pytest.raises(SystemExit) as end:
            main()
        printed = capsys.readouterr()
        return end.value.code or 0, printed.out, printed.err

    return typed


@pytest.fixture
def typed(coarse):
    """Type a command; return what `typer` tells of it. Errors are raised as they are."""
    from typer.testing import CliRunner

    from kaju.cli import app

    def run(*words):
        return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)

    return run
