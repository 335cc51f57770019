"""Two answers side by side: errors, where they are told apart, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from plates import plate as plate_of

from kaju import LoadModel, Reference, compare, load_scene, solve
from kaju.errors import ParameterError, ResultError, ResultFileError

ROOT = Path(__file__).parents[2]
ELEMENTS = ROOT / "tests" / "data" / "plate_finite_elements.npz"
SMALL_HOLE = {"disk": {"centre": [0.035, 0.035], "radius": 0.006}, "material": "air"}


def plate(cells=(8, 8), force=(0.0, -2.0), **changes):
    """A square plate of 80 mm pressed over the whole of its top."""
    usual = {"size": [0.08, 0.08], "thickness": 0.002, "loads": [{"side": "top", "force": force}]}
    return plate_of(list(cells), None, **usual | changes)


BLOCK = plate_of(
    [4, 4, 4], None, size=[0.1, 0.1, 0.1], loads=[{"side": "top", "force": [1.0, 0.0, -2.0]}]
)


def middles(result):
    return result.grid.lattice.centres(np.argwhere(result.cells().body))


@pytest.fixture(scope="module")
def elements():
    return Reference.load(ELEMENTS)


@pytest.fixture(scope="module")
def worked():
    return load_scene(ROOT / "examples" / "plate.toml").with_overrides({"loads.0.steps": 1})


def test_a_result_agrees_with_itself():
    left = {"box": [[0.0, 0.0], [0.02, 0.08]], "material": "air"}  # no body where cells begin
    result = solve(plate((10, 8), size=[0.1, 0.08], regions=[left]))
    found = compare(result, result)
    assert len(found.points) == 64
    displacement, stress = found.displacement, found.stress
    assert displacement.max_error == displacement.l2_error == displacement.misfit == 0.0
    assert stress.max_error == found.energy_error == 0.0
    assert "array([" not in repr(found) + repr(found.displacement) + repr(result.cuts())


def test_errors_are_shares_of_the_largest_value_of_the_reference():
    result = solve(plate())
    points = middles(result)
    true = result.displacement_at(points)
    shift = np.zeros_like(true)
    shift[5] = [3e-12, 4e-12]
    found = compare(result, Reference(points, true + shift, 2.0 * result.stress_at(points)))
    size = np.linalg.norm(true + shift, axis=1).max()
    assert found.displacement.scale == pytest.approx(size, rel=1e-14)
    assert found.displacement.max_error == pytest.approx(5e-12 / size)
    assert found.displacement.l2_error == pytest.approx(5e-12 / size / 8.0)
    assert np.argmax(found.displacement.error) == 5
    # Half of all stresses is missing, so half of the energy norm is.
    assert found.energy_error == pytest.approx(0.5, rel=1e-12)
    assert found.stress.misfit == pytest.approx(0.5, rel=1e-12)
    np.testing.assert_allclose(found.stress.component("yy").ratio, 0.5)
    beside = points[:9] + 1e-3  # what a reference knows beside middles is compared there
    known = Reference(beside, result.displacement_at(beside))
    np.testing.assert_array_equal(compare(result, known).points, beside)


def test_the_worked_plate_against_finite_elements(worked, elements):
    """Known: E = 1.32302e-8 J; the elastic rule comes close, the prescribed rule does not."""
    assert elements.strain_energy == pytest.approx(1.32302e-8, rel=1e-5)
    prescribed = compare(LoadModel(worked).run(), elements)
    elastic = compare(solve(worked, resolution=8), elements)
    assert 0.5 < prescribed.displacement.max_error < 0.7
    assert prescribed.displacement.misfit == pytest.approx(0.9493, abs=2e-4)
    assert elastic.displacement.max_error < 2e-3
    assert elastic.stress.misfit < 0.01


def test_profiles_between_results_leave_holes_out():
    hole = {"box": [[0.02, 0.01], [0.04, 0.03]], "material": "air"}
    scene = plate([6, 4], size=[0.06, 0.04], regions=[hole])
    found = compare(solve(scene), solve(scene, resolution=2))
    profile = found.along((0.0, 0.025), (0.06, 0.025), 61)
    assert len(profile.points) == 42
    assert not ((profile.points[:, 0] > 0.0201) & (profile.points[:, 0] < 0.0399)).any()


@pytest.mark.parametrize(("other", "message"), [
    (plate([8, 6], size=[0.08, 0.06]), "by what is at"),
    (plate(thickness=0.003), "in thickness: 0.002 and 0.003 m"),
    (plate(plane="strain"), "in plane: stress and strain"),
    (plate(material="aluminium"), "by what is at"),
    (plate(regions=[SMALL_HOLE]), "by what is at"),
    (plate(force=[0.0, -1.0]), "loads differ: .*-2.* and .*-1"),
    (BLOCK, "2 dimensions and one in 3"),
])  # fmt: skip
def test_different_bodies_and_loads_are_told_apart(other, message):
    with pytest.raises(ResultError, match=message):
        compare(solve(plate()), solve(other))


def test_a_reference_never_guesses():
    reference = Reference([[0.0, 0.0], [1.0, 0.0]], [[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(reference.displacement_at(np.array([[1.0, 0.0]])), [[3.0, 4.0]])
    with pytest.raises(ResultError, match=r"knows nothing at \(0.5, 0\) m"):
        reference.displacement_at(np.array([[1.0, 0.0], [0.5, 0.0]]))
    with pytest.raises(ResultError, match="stress: the reference has none"):
        reference.stress_at(np.array([[1.0, 0.0]]))
    with pytest.raises(ParameterError, match="shape"):
        Reference([[0.0, 0.0]], [[1.0, 2.0], [3.0, 4.0]])
    with pytest.raises(ParameterError, match=r"stress.*shape"):
        Reference([[0.0, 0.0]], [[1.0, 2.0]], [[1.0, 2.0]])
    with pytest.raises(ParameterError, match="finite"):
        Reference([[0.0, 0.0]], [[1.0, np.nan]])


@pytest.fixture
def stored(tmp_path):
    scene = plate_of([8, 8], [4, 7], size=[0.08, 0.08], thickness=0.002)
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
    with pytest.raises(ResultFileError, match=r"is a scene; run it first: kaju run .*plate\.toml"):
        typed("compare", folder / "run", ROOT / "examples" / "plate.toml")
    with pytest.raises(ResultError, match="the other way round"):
        typed("compare", ELEMENTS, folder / "run")
