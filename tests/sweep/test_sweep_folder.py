"""Sweeps that are kept: resumed, killed, protected, and no larger than their table."""

import json
import resource
import sqlite3
import sys
from contextlib import closing

import pandas
import pytest
import sweep_work

import kaju
from kaju import sweep
from kaju.model.study.sweep_store import load_sweep

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def kept(out, count=50, run=sweep_work.square, **options):
    options = {"workers": 1, "progress": False} | options
    return sweep(run, {"x": range(count)}, out=out, **options)


def test_the_folder_holds_the_table_and_says_what_it_was(tmp_path):
    out = tmp_path / "new" / "sweep"
    table = kept(out)
    names = sorted(path.name for path in out.iterdir())
    assert names == ["sweep.sqlite", "table.parquet"]
    stored = load_sweep(out)
    pandas.testing.assert_frame_equal(stored, table)
    about = stored.attrs["sweep"]
    assert about == table.attrs["sweep"]
    told = {"varied": ["x"], "points": 50, "subject": "sweep_work.square"}
    assert {name: about[name] for name in told} == told
    assert pandas.read_parquet(out / "table.parquet").equals(table)


def test_only_what_is_missing_is_computed(tmp_path):
    kept(tmp_path)
    with closing(sqlite3.connect(tmp_path / "sweep.sqlite")) as store, store:
        store.execute("DELETE FROM rows WHERE run % 3 = 0")
        text = json.dumps({"run": 1, "x": 1, "square": -1, "error": ""})
        store.execute("UPDATE rows SET text = ? WHERE run = 1", (text,))
    assert load_sweep(tmp_path)["run"].tolist() == [run for run in range(50) if run % 3]
    again = kept(tmp_path)
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


def test_a_damaged_store_is_named(tmp_path):
    kept(tmp_path)
    (tmp_path / "sweep.sqlite").write_bytes(b"SQLite format 3 and nothing else")
    with pytest.raises(kaju.KajuError, match="delete it, and its runs are computed again"):
        kept(tmp_path)


@linux
def test_killed_it_goes_on(tmp_path):
    found = sweep_work.kill_often(1, tmp_path)
    assert found == {"kills": 1, "tables": 1, "orphans": 0}


@linux
@pytest.mark.slow
def test_killed_at_any_moment_it_still_goes_on(tmp_path):
    assert sweep_work.kill_often(30, tmp_path, seed=1)["orphans"] == 0


@linux
def test_many_runs_need_no_more_memory_than_a_few(tmp_path):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    how = {"run": sweep_work.heavy, "measure": sweep_work.memory, "workers": 2}
    table = kept(tmp_path, 2_000, **how)
    assert table["sum"].sum() == pytest.approx(200_000 * sum(range(2_000)))
    early = table["memory"][:200].max()
    assert table["memory"].max() < early + 20_000  # kB; the results themselves are 3.2 GB
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 100_000


def test_interrupted_the_rows_are_kept(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path, run=interrupted)
    assert load_sweep(tmp_path)["square"].tolist() == [x * x for x in range(20)]
    sweep_work.patience = True
    again = kept(tmp_path, run=interrupted)
    assert again["square"].tolist() == [x * x for x in range(50)]


def interrupted(x):
    if x == 20 and not getattr(sweep_work, "patience", False):
        raise KeyboardInterrupt
    return sweep_work.square(x)
