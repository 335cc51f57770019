"""A run's folder appears whole or not at all, whenever the process ends."""

import json
import os
import shutil
import signal
import sys
import zlib
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from plates import plate as pressed

from kaju import LoadModel, load_result
from kaju.cli.output import Folder
from kaju.errors import ResultFileError
from kaju.model.results.archive import write_archive

EVENTS = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "shutil.rmtree")


def run(force):
    return LoadModel(pressed([4, 4], [1, 3], [0.0, force], size=[0.04, 0.04])).run()


@pytest.fixture(scope="module")
def old():
    return run(-1.0)


@pytest.fixture(scope="module")
def new():
    return run(-2.0)


def write(result, force=False):
    return Folder(Path("here"), force).write(result, pictures="none")


def names_here():
    return [path.name for path in Path().iterdir()]


@pytest.fixture(autouse=True)
def _standing_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def taken(folder):
    """The load taken in a whole folder, by both of its files; None if there is no folder."""
    if not folder.exists():
        return None
    by_file = load_result(folder).summary()["load_taken"]
    assert json.loads((folder / "summary.json").read_text())["load_taken"] == by_file
    return by_file


def killed_at(event, write):
    """Write in a process that is killed before its nth file event; tell whether it was."""
    child = os.fork()
    if child == 0:
        seen = 0

        def count(name, _):
            nonlocal seen
            if name in EVENTS:
                seen += 1
                if seen == event:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        try:
            write()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.mark.parametrize("force", [False, True])
def test_a_killed_run_leaves_the_old_folder_or_the_new_one(old, new, force):
    folder = Path("here")
    states = set()
    for event in range(1, 1000):
        if force and not folder.exists():
            write(old)
            (folder / "notes.txt").write_text("mine")
        before = taken(folder)
        killed = killed_at(event, lambda: write(new, force))
        after = taken(folder)
        states.add(after)
        assert after in (before, new.summary()["load_taken"])
        if not killed:
            break
        if force:
            assert (folder / "notes.txt").read_text() == "mine"
        if after != before:
            shutil.rmtree(folder)
    assert event > 15
    assert new.summary()["load_taken"] in states
    assert (old.summary()["load_taken"] if force else None) in states
    assert names_here() == ["here"], "the last run swept the dead ones"


def test_a_stored_file_is_the_old_one_or_the_new_one(old, new):
    place = Path("result.npz")
    old.save(place)
    for event in range(1, 100):
        killed = killed_at(event, lambda: new.save(place))
        found = load_result(place).summary()["load_taken"]
        assert found in (old.summary()["load_taken"], new.summary()["load_taken"])
        if not killed:
            break
    assert event > 3
    assert names_here() == ["result.npz"]


@pytest.mark.parametrize("force", [False, True])
def test_who_comes_second_keeps_the_results_beside_and_says_so(old, new, force):
    if force:
        write(old)
    slow, quick = Folder(Path("here"), force), Folder(Path("here"), force)
    quick.write(old, pictures="none")
    with pytest.raises(ResultFileError, match=r"another run .* this one's are in here-2"):
        slow.write(new, pictures="none")
    assert taken(Path("here")) == old.summary()["load_taken"]
    assert taken(Path("here-2")) == new.summary()["load_taken"]


def test_an_empty_folder_may_be_filled(new):
    Path("here").mkdir()
    assert [path.name for path in write(new)] == ["result.npz", "summary.json"]


def test_folders_of_ones_own_inside_a_replaced_run_stay(old, new):
    write(old)
    Path("here/films/of mine").mkdir(parents=True)
    Path("here/films/of mine/one.txt").write_text("kept")
    write(new, force=True)
    assert Path("here/films/of mine/one.txt").read_text() == "kept"
    assert taken(Path("here")) == new.summary()["load_taken"]


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (".", "is a folder that you stand in"),
        ("..", "is a folder that you stand in"),
        ("/proc/kaju/here", "cannot be written"),
        ("a file/here", "cannot be written"),
        ("a file", "is a file"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_computed(place, message):
    Path("a file").write_text("")
    with pytest.raises(ResultFileError, match=message):
        Folder(Path(place))


def test_without_an_exchange_in_one_step_names_are_exchanged_all_the_same(old, new, monkeypatch):
    monkeypatch.setattr("ctypes.CDLL", lambda _: object())
    write(old)
    write(new, force=True)
    assert taken(Path("here")) == new.summary()["load_taken"]
    assert names_here() == ["here"]


def test_large_results_are_packed_quickly(tmp_path):
    """A run of a million agents is stored in seconds, also when Ctrl-C has ended it."""
    rng = np.random.default_rng(1)
    many = {"load": rng.normal(size=200_000), "agent": rng.integers(0, 90_000, 200_000)}
    began = process_time()
    path = write_archive(tmp_path / "many", "trial", many, {})
    spent = process_time() - began
    began = process_time()
    for array in many.values():
        zlib.compress(array.tobytes())
    assert spent < 0.75 * (process_time() - began)
    with np.load(path) as stored:
        np.testing.assert_array_equal(stored["agent"], many["agent"])
