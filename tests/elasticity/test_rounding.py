"""What rounding eats is said or refused; small answers compile nothing, and compiling is said."""

import os
import subprocess
import sys

import pytest
from plates import PLATE, loaded

import kaju


def block(side, material=None, plane="stress", **sides):
    a = material or {"youngs_modulus": 1e9, "poissons_ratio": 0.3}
    of = {"size": [1.0, 1.0], "plane": plane, "material": "a", "materials": {"a": a}}
    load = {"side": "top", "force": [0.0, -1.0]}
    return loaded([8, 8], load, sides={"bottom": side, **sides}, **of)


@pytest.mark.parametrize(("ratio", "said"), [(0.499999999, False), (0.49999999999, True)])
def test_a_pressure_that_eats_digits_is_noted(ratio, said):
    gum = {"youngs_modulus": 1e9, "poissons_ratio": ratio}
    result = kaju.solve(block("rigid", gum, "strain"))
    assert result.reactions["bottom"][1] == pytest.approx(1.0, abs=1e-5)
    assert any("rounding leaves" in note for note in result.summary()["notes"]) == said


@pytest.mark.slow  # it compiles
def test_compiling_is_said_once(tmp_path):
    script = (
        "import numpy as np; from kaju.model.elastic.equal import row_kernels as k;"
        "from kaju import Scene, solve; solve(Scene(body={'size': [1, 1, 1], 'cells': [4] * 3,"
        " 'material': 'steel'}, sides={'bottom': 'rigid'}, loads=[{'side': 'top', 'pressure': 1}]),"
        " resolution=16); print(2.0)"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    for expected in (1, 0):
        run = subprocess.run(
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True
        )
        assert run.stdout == "2.0\n"
        assert run.stderr.count("kaju compiles its loops") == expected


@pytest.mark.parametrize("how", ["", "resolution=5", "tolerance=0.05"])
def test_a_small_answer_and_its_bounds_import_little_and_no_compiled_loop(how):
    script = (
        "import sys, kaju\n"
        f"result = kaju.solve(kaju.Scene(**{PLATE}), {how})\n"
        "low, high = result.energy_bounds\n"
        "assert 0.0 < low < high < 1.1 * low\n"
        "assert low <= result.strain_energy < (1.0 + result.error_estimate**2) * high\n"
        "assert result.error_estimate > 0.0\n"
        "assert result.stress_at([[0.1, 0.1]]).shape == (1, 2, 2)\n"
        "print({'numba', 'scipy.spatial', 'scipy.ndimage', 'PIL'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("set()\n", "")
