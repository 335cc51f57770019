"""Sweeps on everybody's back ends: all end with the same table."""

import joblib
import pytest
import sweep_work

import kaju
from kaju import sweep
from kaju.model.study.sweep import load_sweep


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
