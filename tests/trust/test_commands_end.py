"""Whatever goes wrong, a command ends with one sentence and leaves nothing half-written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from plates import plate
from stored_files import rewritten

import kaju

COMMAND = [sys.executable, "-m", "kaju"]


@pytest.fixture
def folder(tmp_path):
    plate([3, 2], [1, 1]).save(tmp_path / "s.toml")
    return tmp_path


def run(folder, *words, **options):
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.run([*COMMAND, *words], cwd=folder, text=True, timeout=120, **options)


def is_one_sentence(done):
    told = done.stderr
    return done.returncode == 2 and told.startswith("error: ") and told.count("\n") == 1


@pytest.mark.parametrize("name", ["pipe.toml", "/dev/zero", "d" * 300 + ".toml"])
def test_what_is_no_file_is_named(folder, name):
    os.mkfifo(folder / "pipe.toml")
    done = run(folder, "check", name)
    assert is_one_sentence(done)
    assert "cannot be read" in done.stderr


def test_a_working_folder_that_is_gone_is_named(folder):
    gone = folder / "gone"
    gone.mkdir()
    done = run(gone, "check", str(folder / "s.toml"), preexec_fn=gone.rmdir)
    assert is_one_sentence(done)


def test_an_output_that_is_full_is_named(folder):
    with Path("/dev/full").open("w") as full:
        done = run(folder, "solve", "s.toml", "--no-pictures", "--json", "--out", "o", stdout=full)
    assert is_one_sentence(done)
    assert "the output: No space left" in done.stderr
    assert not (folder / "o").exists() or kaju.load_result(folder / "o").checks()[0].holds


def test_a_result_whose_books_do_not_balance_is_told(folder):
    path = kaju.LoadModel(kaju.load_scene(folder / "s.toml")).run().save(folder / "r.npz")

    def forged(arrays, about):
        about["stages"][-1]["ledger"]["taken"] *= 1.5

    (check,) = kaju.load_result(rewritten(path, forged)).checks()
    assert check.what == "every newton is accounted for"
    assert not check.holds
