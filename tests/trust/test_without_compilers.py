"""kaju in a browser's Python (Pyodide): no numba, joblib, typer and rich; and without PETSc."""

import subprocess
import sys

import pytest
from plates import PLATE

import kaju

TAKEN_AWAY = (
    f"PLATE = {PLATE}"
    + """
import sys
for name in ("numba", "llvmlite", "joblib", "typer", "rich", "resource"):
    sys.modules[name] = None
import tempfile
from pathlib import Path

import kaju

plate = kaju.Scene(**PLATE)
elastic = plate.replace(rule=kaju.ElasticRule())
folder = Path(tempfile.mkdtemp())
run = kaju.LoadModel(plate).run()
assert len(run.last.cells) == 34
kaju.solve(elastic, tolerance=0.1)
kaju.plot(run)
kaju.animate(run, folder / "film.gif")
kaju.export_page(plate, folder / "page.html")
large = elastic.replace(body={"cell_size": 0.01, "cells": [230, 230], "material": "steel"})
for refused in (
    lambda: kaju.GrowthModel(elastic, volume=0.5).run(),
    lambda: kaju.solve(large.replace(loads=[{"cell": [9, 229], "force": [0.0, -2.0]}])),
    lambda: kaju.sweep(plate, {"rule.threshold": [0.01, 0.02]}),
):
    try:
        refused()
    except kaju.KajuError as refusal:
        print(refusal)
"""
)


@pytest.mark.slow
def test_agents_answers_pictures_and_pages_need_no_compiler():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", TAKEN_AWAY], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    growth, large, sweep = done.stdout.splitlines()
    assert "growth and bodies of more than 10,000 cells" in growth
    assert growth == large
    assert sweep.startswith("sweep: joblib")


def test_without_petsc_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    with pytest.raises(ImportError, match="apt-get install python3-petsc4py-real") as raised:
        kaju.solve_petsc(kaju.Scene(**PLATE))
    assert isinstance(raised.value, kaju.KajuError)
