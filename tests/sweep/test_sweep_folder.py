"""Sweeps that are kept: resumed, killed, protected, on any back end, and typed."""

import json
import os
import re
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, nullcontext
from types import ModuleType

import joblib
import pandas
import pytest
import sweep_work
from plates import PLATE

import kaju
from kaju import Scene, sweep
from kaju.errors import KajuError
from kaju.model.study.sweep import load_sweep

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def kept(out, count=50, run=sweep_work.square, **options):
    options = {"workers": 1, "progress": False} | options
    return sweep(run, {"x": range(count)}, out=out, **options)


def test_the_folder_holds_the_table_and_says_what_it_was(tmp_path):
    out = tmp_path / "new" / "sweep"
    table = kept(out)
    assert sorted(path.name for path in out.iterdir()) == ["sweep.sqlite", "table.csv"]
    stored = load_sweep(out)
    pandas.testing.assert_frame_equal(stored, table)
    about = stored.attrs["sweep"]
    assert about == table.attrs["sweep"]
    told = {"varied": ["x"], "points": 50, "subject": "sweep_work.square"}
    assert {name: about[name] for name in told} == told
    assert table_of(out).equals(table)


def test_only_what_is_missing_is_computed(tmp_path, monkeypatch):
    kept(tmp_path)
    with closing(sqlite3.connect(tmp_path / "sweep.sqlite")) as store, store:
        assert store.execute("PRAGMA journal_mode").fetchone() == ("wal",)  # readers need not wait
        store.execute("DELETE FROM rows WHERE run % 3 = 0")
        text = json.dumps({"run": 1, "x": 1, "square": -1, "error": ""})
        store.execute("UPDATE rows SET text = ? WHERE run = 1", (text,))
    assert load_sweep(tmp_path)["run"].tolist() == [run for run in range(50) if run % 3]
    said = []
    monkeypatch.setattr(
        sys.modules[sweep.__module__], "progress_line", lambda _: nullcontext(said.append)
    )
    again = kept(tmp_path)
    assert (said[0], said[-1]) == ("34 of 50 runs", "50 of 50 runs")
    assert again["run"].tolist() == list(range(50))
    assert again["square"].tolist() == [-1 if x == 1 else x * x for x in range(50)]


def test_another_sweep_is_not_mixed_in(tmp_path):
    kept(tmp_path)
    for change in ({"count": 51}, {"seed": 1}, {"measure": "square"}):
        with pytest.raises(kaju.KajuError, match="holds another sweep"):
            kept(tmp_path, **change)
    other = tmp_path / "full"
    other.mkdir()
    (other / "thesis.tex").write_text("")
    with pytest.raises(OSError, match="not empty"):
        kept(other)
    with pytest.raises(OSError, match="cannot be written"):
        kept(other / "thesis.tex" / "sweep")


EDITED = """
import functools, sys
import numpy as np
import kaju
KEEP, STEPS, RUNS = 0.5, np.arange(3.0), 0
WORDS = np.array(["up", "down"], object)
class Base(kaju.MaterialAgent):
    \"\"\"Words, and no rule.\"\"\"
    part = kaju.Parameter(0.25, 0.0, 1.0)
    def emissions(self, load):
        return [row._replace(share=KEEP * row.share) for row in super().emissions(load)]
class Mine(Base):
    left = property(lambda agent: 3.0)
def doubled(x):
    return 2 * x
@functools.cache
def counted(result):
    global RUNS
    RUNS += 1
    return doubled(len(result.last.cells)) + len(WORDS) * STEPS.sum() * ("up" in {"up", "down"})
class Rule(kaju.PrescribedRule):
    def shares(self, material, dimension):
        return super().shares(material, dimension)._replace(own=0.5)
def order(waiting):
    return waiting
def scaled(factor):
    return lambda result: {"own": factor * counted(result)}
def rows(out):
    plate = kaju.Scene(body={"size": [0.1, 0.1], "cells": [4, 4], "material": "steel"},
        sides={"bottom": "rigid"}, loads=[{"cell": [1, 3], "force": [0.0, -2.0]}])
    run = functools.partial(kaju.LoadModel, material_agent=Mine, order=order, rule=Rule())
    told = {"workers": 1, "progress": False, "measure": scaled(1), "run": run}
    return kaju.sweep(plate, {"rule.threshold": [0.1, 0.2]}, out=out, **told)["own"].tolist()
"""
EDITS = [
    ("KEEP, STEPS, RUNS = 0.5", "KEEP, STEPS, RUNS = 0.25", "KEEP"),
    ("KEEP * row", "KEEP**2 * row", "Base.emissions"),
    ("Mine(Base)", "Mine(kaju.MaterialAgent)", "Base, Base.emissions, KEEP, Mine"),
    ("Parameter(0.25", "Parameter(0.75", "Base"),
    ("agent: 3.0", "agent: 4.0", "Mine.<lambda>"),
    ("own=0.5", "own=0.4", "Rule.shares"),
    ("2 * x", "3 * x", "doubled"),
    ('"down"], obj', '"town"], obj', "WORDS"),
    ("arange(3.0)", "arange(4.0)", "STEPS"),
    ("    return waiting", "    return waiting[:1]", "order"),
    ("scaled(1)", "scaled(2)", "scaled.<locals>.<lambda>"),
]


def rows_of(text, out):
    edited = sys.modules["edited"] = ModuleType("edited")
    exec(text, vars(edited))
    return edited.rows(out)


def test_rows_of_other_code_are_not_mixed_in(tmp_path):
    out = tmp_path / "sweep"
    first = rows_of(EDITED, out)
    assert rows_of(EDITED.replace("no rule", "none"), out) == first
    (tmp_path / "edited.py").write_text(f"# told\n{EDITED}")
    code = f"from edited import rows; of = {str(out)!r}; print({first} == rows(of) == rows(of))"
    for seed in "12":  # by which sets are in another order
        env = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(tmp_path)}
        assert subprocess.check_output([sys.executable, "-c", code], env=env) == b"True\n"
    for old, new, named in EDITS:
        assert EDITED.count(old) == 1, old
        with pytest.raises(KajuError, match=rf"sweep: .* other code \({re.escape(named)} changed"):
            rows_of(EDITED.replace(old, new), out)


@linux
@pytest.mark.slow
def test_killed_it_goes_on_and_leaves_nobody_at_work(tmp_path):
    session = sweep_work.killed(str(tmp_path / "out"))
    deadline = time.monotonic() + 60.0  # a worker that starts has to import first
    while sweep_work.members(session) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert sweep_work.members(session) == []
    table = sweep_work.run_slow(tmp_path / "out", workers=1)
    assert table["square"].tolist() == [x * x for x in range(sweep_work.RUNS)]


def test_interrupted_the_rows_are_kept(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path, run=interrupted)
    assert load_sweep(tmp_path)["square"].tolist() == [x * x for x in range(20)]
    sweep_work.patience = True
    assert kept(tmp_path, run=interrupted)["square"].tolist() == [x * x for x in range(50)]


def interrupted(x):
    if x == 20 and not getattr(sweep_work, "patience", False):
        raise KeyboardInterrupt
    return sweep_work.square(x)


def own(**options):
    points = {"x": [0.5 * k for k in range(200)]}
    return sweep(sweep_work.square, points, **{"workers": 2, "progress": False} | options)


def test_threads():
    with joblib.parallel_config(backend="threading"):
        assert own().equals(own(workers=1))


def test_a_run_that_kills_its_process_ends_the_sweep_and_the_rows_are_kept(tmp_path):
    points = {"x": list(range(40))}
    with pytest.raises(kaju.KajuError, match="TerminatedWorkerError"):
        sweep(sweep_work.deadly, points, workers=2, out=tmp_path, progress=False)
    rows = load_sweep(tmp_path)
    assert rows["square"].tolist() == [x * x for x in rows["x"]]


@pytest.fixture
def swept(tmp_path, typed):
    """Sweep the worked plate into a folder; return the folder and what was told."""
    file, out = tmp_path / "plate.toml", tmp_path / "sweep"
    Scene(**PLATE).save(file)

    def run(*words):
        return out, typed("sweep", file, *words, "--out", out, "--workers", 1)

    return run


def table_of(out):
    return pandas.read_csv(out / "table.csv", keep_default_na=False)


def test_a_sweep_from_the_command(swept):
    words = ("--vary", "rule.threshold=0.01,0.001", "--workers", 2)
    out, done = swept(*words)
    assert (done.exit_code, done.output[:16]) == (0, "2 runs, 0 failed"), done.output
    assert {"load_taken", "load_absorbed"} & {*done.output.split()} == {"load_taken"}  # 0 in both
    assert table_of(out)["load_taken"].round(6).tolist() == [12.879375, 21.104766]
    assert sorted(path.name for path in out.iterdir()) == ["sweep.sqlite", "table.csv"]
    assert swept(*words)[1].output == done.output  # nothing is computed again


@pytest.mark.parametrize(("options", "message"), [
    (["--vary", "rule.beta"], "KEY=VALUE,VALUE or KEY=LOW:HIGH"),
    (["--vary", "rule.beta=2:1"], "LOW below HIGH"),
    (["--vary", "rule.beta=0:1:log"], "above 0"),
    (["--vary", "rule.beta=0:1"], "method='sobol' or 'lhs'"),
    (["--vary", "rule.beta=0,1", "--run", "fem"], "--run: auto, agents, solve, stability"),
])  # fmt: skip
def test_what_is_misspelt_is_refused(swept, tmp_path, options, message):
    with pytest.raises(KajuError, match=message):
        swept(*options)
    assert not (tmp_path / "sweep").exists()
