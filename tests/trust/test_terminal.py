"""The command on a terminal that knows only ASCII."""

import os
import subprocess
import sys


def test_materials_are_listed_on_an_ascii_terminal():
    run = subprocess.run(
        [sys.executable, "-m", "kaju", "materials"],
        env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"},
        capture_output=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert b"steel" in run.stdout
