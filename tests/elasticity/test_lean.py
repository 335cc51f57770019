"""A small answer compiles nothing: numba is not even imported."""

import subprocess
import sys

import pytest

PLATE = """
import sys
import kaju
scene = kaju.Scene(
    body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
    sides={"bottom": "rigid"},
    loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
)
"""


@pytest.mark.parametrize("how", ["", "resolution=5", "tolerance=0.05"])
def test_a_small_answer_and_its_bounds_take_no_compiled_loop(how):
    script = PLATE + (
        f"result = kaju.solve(scene, {how})\n"
        "low, high = result.energy_bounds\n"
        "assert 0.0 < low < high < 1.1 * low\n"
        "assert low <= result.strain_energy < (1.0 + result.error_estimate**2) * high\n"
        "assert result.error_estimate > 0.0\n"
        "assert result.stress_at([[0.1, 0.1]]).shape == (1, 2, 2)\n"
        "print('numba' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("False\n", "")
