"""Memory, disk or a file's end fail at the nth time: one sentence, and nothing half-written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from plates import plate

import kaju
from kaju.errors import KajuError

COMPILER = shutil.which("cc")
LINUX = sys.platform == "linux"
pytestmark = pytest.mark.skipif(COMPILER is None or not LINUX, reason="needs cc on Linux")
SOURCE = Path(__file__).parents[1] / "support" / "refusing.c"
JELLY = {
    "youngs_modulus": 1e4,
    "poissons_ratio": 0.45,
    "rheology": {"K_f": 1e4, "D_f": 1e4, "D_d": 2e5},
}


def loaded(force):
    return [{"side": "top", "force": [0.0, force]}]


SCENES = {
    "s.toml": plate([12, 12], [6, 11]),
    "j.toml": plate(
        [4, 4],
        None,
        material="jelly",
        materials={"jelly": JELLY},
        loads=loaded(-0.1),
        history={"steps": [{"ramp": 1.0, "duration": 0.1}, {"hold": 1.0}]},
        rule={"kind": "elastic"},
    ),
    "h.toml": plate([5, 5], None, lattice="hexagon", material="oak", loads=loaded(2.0)),
}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    made = tmp_path_factory.mktemp("refusing") / "refusing.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", made, SOURCE, "-ldl"], check=True)
    return made


COMMANDS = {
    "run": "run s.toml --no-pictures --out out",
    "solve": "solve s.toml --no-pictures --out out",
    "picture": "run s.toml --out out",
    "new": "new out.toml",
    "page": "page s.toml --out out.html",
    "check": "check stored.npz",
    "check scene": "check s.toml",
    "page of a result": "page stored.npz --out out.html",
    "creep": "creep j.toml --no-pictures --out out",
    "break": "break h.toml --no-pictures --out out",
    "grow": "grow s.toml --steps 3 --no-pictures --out out",
    "compare": "compare s.toml --no-pictures --out out",
    "sweep": "sweep s.toml --vary loads[0].force[1]=-2,-3 --workers 1 --no-pictures --out out",
    "animate": "animate stored.npz --out out.gif",
}


def refused(library, folder, words, what, number):
    """Run a command to which the system refuses something; judge how it ends.

    Tell whether it gave up, and whether there was anything to refuse.
    """
    place = folder / f"{what} {number}"
    shutil.copytree(folder / "fresh", place)
    before = {path.name for path in place.iterdir()}
    done = subprocess.run(
        [sys.executable, "-m", "kaju", *words.split()],
        cwd=place,
        capture_output=True,
        text=True,
        timeout=300,
        env={
            **os.environ,
            "LD_PRELOAD": str(library),
            "KAJU_REFUSE": f"{what} {number}",
            "KAJU_BELOW": str(place),
            "KAJU_REFUSED": str(folder / f"{what} {number} was refused"),
            "OPENBLAS_NUM_THREADS": "1",
        },
    )
    told = f"{words} {what} {number}: {done.returncode} {done.stderr[-300:]}"
    # Rust, in which libraries below are written, ends the process itself, says why, and lets
    # nobody tidy up: what was being written stays under its hidden name, as after a kill.
    aborted = done.returncode == -6 and "memory allocation of" in done.stderr
    assert done.returncode in (0, 2) or aborted, told
    assert "Traceback" not in done.stderr, told
    written = {path.name for path in place.iterdir()} - before
    assert aborted or not any(name.startswith(".kaju") for name in written), told
    if done.returncode == 2:
        assert "error: " in done.stderr, told
    for path in place.rglob("*.npz"):
        try:
            kaju.load_result(path)
        except KajuError as error:
            raise AssertionError(told) from error
    for path in place.rglob("*.html"):
        assert path.read_text(encoding="utf-8").rstrip().endswith("</html>"), told
    if (place / "out.toml").exists():
        kaju.load_scene(place / "out.toml")
    return done.returncode == 2, (folder / f"{what} {number} was refused").exists()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("nth failures of ü🙂")
    (place / "fresh").mkdir()
    for file, scene in SCENES.items():
        scene.save(place / "fresh" / file)
    kaju.LoadModel(SCENES["s.toml"]).run().save(place / "fresh/stored.npz")
    return place


def each_failure(library, folder, name, what, numbers):
    """Let it fail at the first time, the second …; return how often that came through."""
    place = folder / f"{name}, {what}, {len(numbers)} times"
    shutil.copytree(folder / "fresh", place / "fresh")
    came = 0
    for number in numbers:
        gave_up, met = refused(library, place, COMMANDS[name], what, number)
        came += gave_up
        if not met:
            break  # it asks for no more than that
    return came


def test_the_first_failures_are_told_in_one_sentence(library, folder):
    assert each_failure(library, folder, "new", "write", (0, 1)) == 1
    assert each_failure(library, folder, "check", "read", (3, 4))  # the first are tried again


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("what", ["write", "read", "memory"])
def test_the_nth_failure_is_told_in_one_sentence(library, folder, name, what):
    numbers = range(12) if what != "memory" else (*range(8), *range(8, 120, 28))
    came = each_failure(library, folder, name, what, numbers)
    if (what, name) in {("write", "run"), ("read", "check"), ("memory", "solve")}:
        assert came
