"""Files of every kind, damaged in every way: refused by name, or read; nothing else."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from stored_files import rewritten

import kaju
from kaju.model.network import solve as solve_network
from kaju.model.network import triangular

PLATE = Path(__file__).parents[2] / "examples" / "plate.toml"


@pytest.mark.parametrize(
    ("seed", "counts"), [(13, (20, 30)), pytest.param(2026, (1000, 800), marks=pytest.mark.slow)]
)
def test_damaged_files_are_refused_by_name(tmp_path, seed, counts):
    program = Path(__file__).parents[1] / "support" / "damage.py"
    run = subprocess.run(
        [sys.executable, program, tmp_path, str(seed), *map(str, counts)],
        capture_output=True,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    *before, last = run.stdout.splitlines() or [""]
    assert run.returncode == 0, f"after {before[-1:]} {last}: {run.stderr[-500:]}"
    ends = json.loads(last)
    assert ends["raw"] == []
    assert ends["different"] == []
    assert ends["refused"] + ends["read"] == sum(counts)
    assert ends["refused"] > 0.5 * sum(counts)
    assert ends["MB"] < 250


@pytest.mark.parametrize(
    "change", [lambda s: s[::-1], lambda s: 0 * s, lambda s: -s, lambda s: s[:0]]
)
def test_stages_out_of_order_are_refused_by_name(tmp_path, change):
    path = solve_network(triangular(3, force=0.1)).save(tmp_path / "n.npz")
    rewritten(path, lambda arrays, about: arrays.update(stage=change(arrays["stage"])))
    with pytest.raises(kaju.KajuError, match="'stage' must"):
        kaju.load_result(path)


@pytest.mark.parametrize(("change", "named"), [
    (lambda arrays, about: about["stages"][0].update(generations=10**9), "generations"),
    (lambda arrays, about: about["stages"][0].update(generations=10**30), "generations"),
    (lambda arrays, about: about["stages"][0].pop("factor"), "'stages.0.factor' is missing"),
    (lambda arrays, about: about["stages"].append({}), "stages"),
    (lambda arrays, about: arrays.pop("stages.0.kept"), "'stages.0.kept' is missing"),
    (lambda arrays, about: arrays["stages.0.cells"].fill(99), "'stages.0.cells' must be"),
    (lambda arrays, about: arrays["stages.0.cells"].fill(9), "two agents"),
    (lambda arrays, about: arrays["stages.0.history.generation"].fill(99), "last generation"),
    (lambda arrays, about: arrays["stages.0.taken"].fill(np.nan), "finite"),
])  # fmt: skip
def test_a_tampered_file_is_refused_by_name(tmp_path, change, named):
    path = kaju.LoadModel(kaju.load_scene(PLATE)).run().save(tmp_path / "t.npz")
    rewritten(path, change)
    with pytest.raises(kaju.KajuError, match=named):
        kaju.load_result(path)
