"""Files of every kind, damaged in every way: refused by name, or read; nothing else."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pyarrow")


@pytest.mark.parametrize(
    ("seed", "count"), [(13, 280), pytest.param(2026, 3000, marks=pytest.mark.slow)]
)
def test_damaged_files_are_refused_by_name(tmp_path, seed, count):
    program = Path(__file__).parents[1] / "damage.py"
    run = subprocess.run(
        [sys.executable, program, tmp_path, str(seed), str(count)],
        capture_output=True,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    *before, last = run.stdout.splitlines() or [""]
    assert run.returncode == 0, f"after {before[-1:]} {last}: {run.stderr[-500:]}"
    ends = json.loads(last)
    assert ends["raw"] == []
    assert ends["refused"] + ends["read"] == count
    assert ends["refused"] > 0.5 * count
    assert ends["MB"] < 1000
