"""Sweeps that are kept: resumed, killed, protected, and no larger than their table."""

import json
import resource
import sys

import pandas
import pytest
import sweep_work

import kaju
from kaju import sweep
from kaju.model.study.parts import load_sweep

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def kept(out, count=50, **options):
    options = {"workers": 1, "progress": False} | options
    return sweep(sweep_work.square, {"x": list(range(count))}, out=out, **options)


def test_the_folder_holds_the_table(tmp_path):
    table = kept(tmp_path / "new" / "sweep")
    assert sorted(path.name for path in (tmp_path / "new" / "sweep").iterdir()) == [
        "sweep.json",
        "table.parquet",
    ]
    stored = load_sweep(tmp_path / "new" / "sweep")
    pandas.testing.assert_frame_equal(stored, table)
    assert stored.attrs["sweep"] == table.attrs["sweep"]
    assert pandas.read_parquet(tmp_path / "new" / "sweep" / "table.parquet").equals(table)


def test_only_what_is_missing_is_computed(tmp_path):
    whole = kept(tmp_path)
    part = whole[whole["run"] % 3 > 0].assign(square=-1)
    part.attrs = {}
    part.to_parquet(tmp_path / "part-000007.parquet")
    (tmp_path / "table.parquet").unlink()
    again = kept(tmp_path)
    assert again["run"].tolist() == list(range(50))
    assert again["square"].tolist() == [-1 if x % 3 else x * x for x in range(50)]
    assert not list(tmp_path.glob("part-*"))


def test_parts_beside_the_whole_table_count_once(tmp_path):
    whole = kept(tmp_path)
    (tmp_path / "part-000000.parquet").write_bytes((tmp_path / "table.parquet").read_bytes())
    assert load_sweep(tmp_path).equals(whole)
    assert kept(tmp_path).equals(whole)
    assert not list(tmp_path.glob("part-*"))


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


def test_torn_parts_are_named(tmp_path):
    kept(tmp_path)
    (tmp_path / "part-000003.parquet").write_bytes(b"PAR1 and nothing else")
    with pytest.raises(kaju.KajuError, match=r"part-000003.parquet: cannot be read .*; delete it"):
        kept(tmp_path)
    (tmp_path / "sweep.json").write_text("{")
    with pytest.raises(kaju.KajuError, match="cannot be read"):
        load_sweep(tmp_path)


@linux
def test_two_sweeps_do_not_share_a_folder(tmp_path, monkeypatch):
    from kaju.model.study import parts

    monkeypatch.setattr(parts, "_PATIENCE", 0.1)
    busy = sweep_work.start(str(tmp_path))
    try:
        while not (tmp_path / "sweep.json").exists():
            pass
        with pytest.raises(kaju.KajuError, match="another sweep is writing"):
            sweep_work.run_slow(str(tmp_path))
    finally:
        busy.kill()
        busy.wait()
        busy.stdout.close()


@linux
def test_killed_at_any_moment_it_goes_on(tmp_path):
    found = sweep_work.kill_often(6, tmp_path)
    assert found["kills"] == 6
    assert found["orphans"] == 0


@linux
@pytest.mark.slow
def test_killed_often_it_still_goes_on(tmp_path):
    assert sweep_work.kill_often(30, tmp_path, seed=1)["orphans"] == 0


@linux
def test_ten_thousand_runs_need_no_more_memory_than_a_thousand(tmp_path):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    table = sweep(
        sweep_work.heavy,
        {"x": range(10_000)},
        sweep_work.memory,
        workers=2,
        out=tmp_path,
        progress=False,
    )
    assert table["sum"].sum() == pytest.approx(200_000 * sum(range(10_000)))
    early = table["memory"][:1000].max()
    assert table["memory"].max() < early + 20_000  # kB; the results themselves are 16 GB
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 100_000


def test_interrupted_the_rows_are_kept(tmp_path, monkeypatch):
    from kaju.model.study import sweeping

    def interrupted(*arguments):
        rows = original(*arguments)
        yield next(rows)
        raise KeyboardInterrupt

    original = sweeping.rows_of
    monkeypatch.setattr(sweeping, "rows_of", interrupted)
    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path)
    monkeypatch.undo()
    assert 0 < len(load_sweep(tmp_path)) < 50
    assert kept(tmp_path)["square"].tolist() == [x * x for x in range(50)]


def test_the_sweep_says_what_it_was(tmp_path):
    kept(tmp_path)
    about = json.loads((tmp_path / "sweep.json").read_text())
    assert about["varied"] == ["x"]
    assert about["points"] == 50
    assert about["subject"] == "sweep_work.square"
