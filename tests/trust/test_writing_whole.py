"""A run's folder appears whole or not at all, whenever the process ends."""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from plates import plate as pressed

from kaju import LoadModel, load_result
from kaju.cli.console import Folder
from kaju.errors import ResultFileError

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


def test_a_killed_run_leaves_no_folder_or_the_whole_one(new):
    folder, states = Path("here"), set()
    for event in range(1, 1000):
        killed = killed_at(event, lambda: write(new))
        states.add(taken(folder))
        if folder.exists():
            shutil.rmtree(folder)
        if not killed:
            break
    assert event > 5
    assert states == {None, new.summary()["load_taken"]}


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


def test_nothing_is_removed_that_this_process_did_not_make(new):
    Path(".kaju-backup/years").mkdir(parents=True)
    Path(".kaju-backup/years/thesis.csv").write_text("mine")
    Path(".kaju-notes").write_text("mine")
    Path(".kaju-loop").symlink_to(".kaju-loop")
    os.mkfifo(".kaju-pipe")
    new.save("a.npz")
    new.scene.save("s.toml")
    write(new)
    write(new, force=True)
    assert {".kaju-backup", ".kaju-notes", ".kaju-loop", ".kaju-pipe"} | {
        *("a.npz", "s.toml", "here")
    } == set(names_here())
    assert Path(".kaju-backup/years/thesis.csv").read_text() == "mine"


def test_links_stay_and_what_they_lead_to_is_written(old, new):
    for name in ("empty", "full"):
        Path(name).mkdir()
        Path(f"to {name}").symlink_to(name)
    Path("full/notes.txt").write_text("mine")
    Path("to file.npz").symlink_to("full/file.npz")
    Folder(Path("to empty")).write(new, pictures="none")
    Folder(Path("to full"), force=True).write(new, pictures="none")
    old.save("to file.npz")
    assert taken(Path("empty")) == taken(Path("full")) == new.summary()["load_taken"]
    assert load_result("full/file.npz").summary() == old.summary()
    assert Path("full/notes.txt").read_text() == "mine"
    assert all(Path(f"to {name}").is_symlink() for name in ("empty", "full", "file.npz"))


def test_who_comes_second_is_refused_and_changes_nothing(old, new):
    slow, quick = Folder(Path("here")), Folder(Path("here"))
    quick.write(old, pictures="none")
    with pytest.raises(ResultFileError, match=r"here: cannot be written: "):
        slow.write(new, pictures="none")
    assert taken(Path("here")) == old.summary()["load_taken"]
    assert names_here() == ["here"]


@pytest.mark.parametrize(("place", "message"), [
    (".", "is the working folder"),
    ("..", "is the working folder"),
    ("/proc/kaju/here", "cannot be written"),
    ("a file/here", "cannot be written"),
    ("a file", "is a file"),
])  # fmt: skip
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_computed(place, message):
    Path("a file").write_text("")
    with pytest.raises(ResultFileError, match=message):
        Folder(Path(place))
