"""`kaju compare` on the command line."""

import json
from pathlib import Path

import pytest
from plates import plate

from kaju import LoadModel, compare, solve
from kaju.errors import ParameterError, ResultError, ResultFileError

ELEMENTS = Path(__file__).parents[1] / "data" / "plate_finite_elements.npz"


@pytest.fixture
def stored(tmp_path):
    scene = plate([8, 8], [4, 7], size=[0.08, 0.08], thickness=0.002)
    results = {"run": LoadModel(scene).run(), "elastic": solve(scene, resolution=2)}
    for name, result in results.items():
        (tmp_path / name).mkdir()
        result.save(tmp_path / name / "result.npz")
    return tmp_path, results


def test_folders_of_runs_are_compared_and_nothing_is_replaced_unasked(stored, typed):
    folder, results = stored
    words = ("compare", folder / "run", folder / "elastic", "--out", folder / "errors")
    done = typed(*words)
    assert done.exit_code == 0
    assert "prescribed rule against elasticity, 64 points" in done.output
    found = json.loads((folder / "errors" / "comparison.json").read_text())
    assert found == compare(results["run"], results["elastic"]).summary()
    for name in ("error_displacement.png", "error_stress.png"):
        assert (folder / "errors" / name).stat().st_size > 5_000

    with pytest.raises(ResultFileError, match="--force"):
        typed(*words)
    assert typed(*words, "--force").exit_code == 0


def test_scenes_and_references_in_the_wrong_place_are_refused(stored, typed):
    folder, _ = stored
    with pytest.raises(ParameterError, match=r"run it first \(kaju run plate.toml\)"):
        typed("compare", folder / "run", "plate.toml")
    with pytest.raises(ResultError, match="the other way round"):
        typed("compare", ELEMENTS, folder / "run")
