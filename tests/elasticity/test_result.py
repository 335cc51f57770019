"""One answer whatever its agents: the same names, the same meaning, and files that are safe."""

import zipfile
from io import BytesIO

import numpy as np
import pytest
from goal_bodies import plate
from plates import loaded
from spawning_bodies import under_a_patch
from stored_files import rewritten

import kaju
from kaju import ElasticResult, solve
from kaju.errors import ParameterError, ResultError, ResultFileError

HOWS = {"cells": {}, "finer cells": {"resolution": 3}, "agents": {"tolerance": 0.2}}


@pytest.fixture(scope="module", params=HOWS)
def answer(request):
    return solve(plate(), **HOWS[request.param])


def test_cells_and_agents_give_one_kind_of_answer(answer):
    assert isinstance(answer, ElasticResult)
    assert isinstance(answer, kaju.Result)
    n = answer.summary()["agents"]
    assert n == answer.agents == len(answer.lower) == len(answer.size) == len(answer.material)
    assert answer.displacement.shape == (n, 2)
    assert answer.stress.shape == answer.strain.shape == (n, 2, 2)
    assert answer.von_mises.shape == answer.level.shape == (n,)
    assert (answer.size**2).sum() == pytest.approx(0.04)
    assert answer.reactions["bottom"] == pytest.approx([0.0, 2.0], abs=1e-4)
    assert answer.tolerance_kept in (None, "proved")


def test_the_largest_displacement_is_looked_for_at_corners_however_fine_the_agents():
    load = {"region": {"box": [[0.12, 0.0], [0.12, 0.04]]}, "force": [0.0, -500.0]}
    cut = {"box": [[0.04, 0.04], [0.12, 0.12]], "material": "air"}
    size = {"size": [0.12, 0.12], "thickness": 0.008}
    bracket = loaded([24, 24], load, **size, regions=[cut], sides={"top": "rigid"})
    found = [solve(bracket), *(solve(bracket, tolerance=allowed) for allowed in (0.1, 0.02))]
    for one in found:
        (corner,) = np.linalg.norm(one.displacement_at([[0.12, 0.0]]), axis=1)
        assert one.max_displacement == one.summary()["max_displacement"] == pytest.approx(corner)
        assert corner == pytest.approx(found[-1].max_displacement, rel=0.02)


@pytest.mark.parametrize("cells", [[40, 2], [20, 1], [40, 2, 2]])
def test_the_largest_stress_of_a_beam_is_that_of_bending_by_its_clamp(cells):
    d = len(cells)
    down = {"side": "right", "force": [0.0, 0.0, -100.0][-d:]}
    beam = loaded(cells, down, size=[1.0, 0.05, 0.05][:d], sides={"left": "rigid"})
    wide = 0.05 if d == 3 else beam.thickness
    for tolerance in (0.05, 0.02):
        answer, bent = solve(beam, tolerance=tolerance), 100.0 * 0.025 / (wide * 0.05**3 / 12.0)
        found = answer.largest_stress
        assert found.value == pytest.approx(bent, rel=0.06)
        assert found.at[0] <= 0.05
        # and each agent on top tells the stress at its end towards the clamp
        x, upper = answer.lower[:, 0], answer.lower[:, d - 1] + answer.size
        top = (upper > 0.0499) & (x > 0.1) & (x < 0.7)
        assert top.any()
        np.testing.assert_allclose(answer.largest_von_mises[top], bent * (1.0 - x[top]), rtol=0.06)
        assert answer.to_dataframe()["largest_von_mises (Pa)"].max() < 1.7 * bent


@pytest.mark.parametrize("depth", [(), (1,)])
def test_the_largest_stress_of_a_short_beam_hardly_depends_on_its_cells(depth):
    d, wide = 2 + len(depth), [0.1] * len(depth)
    for k in (1, 2, 4, *[8] * (d == 2)):
        down = {"side": "right", "force": [0.0, 0.0, -5000.0][-d:]}
        cells, size = [2 * k, *k * np.array(depth), k], [0.2, *wide, 0.1]
        beam = loaded(cells, down, size=size, sides={"left": "rigid"})
        answer = solve(beam, tolerance=0.05)
        nominal = 5000.0 * 0.2 * 0.05 / ((wide or [beam.thickness])[0] * 0.1**3 / 12.0)
        assert answer.largest_stress.value == pytest.approx(0.95 * nominal, rel=0.06)
        assert answer.largest_stress.left_out == pytest.approx(0.01)
        told = "leaves out 0.01 m round them" + ", and lies there: nearer" * (d == 2)
        assert told in str(answer.notes)
        doubt = answer.summary()["largest_stress_Pa_doubt"]
        assert (doubt or "").startswith("may be off by about") == (d == 3)


def test_agents_say_what_points_in_their_middles_say(answer):
    every = slice(None, None, max(1, answer.agents // 50))
    middle, size_there = answer.middle[every], answer.size[every, None]
    # Values of agents that spawned are means: the fields that are proved vary within them.
    places = (np.arange(8) + 0.5) / 8 - 0.5 if answer.spawned else [0.0]
    within = [middle + size_there * [x, y] for x in places for y in places]
    near = 1e-2 if answer.spawned else 1e-9
    for at, known in ((answer.stress_at, answer.stress), (answer.strain_at, answer.strain)):
        mean = np.mean([at(points) for points in within], axis=0)
        np.testing.assert_allclose(mean, known[every], atol=near * np.abs(known).max())
    moved = answer.displacement_at(middle)
    inner = (middle[:, 1] > 0.02) & (middle[:, 1] < 0.17)
    np.testing.assert_allclose(
        moved[inner], answer.displacement[every][inner], atol=0.03 * answer.max_displacement
    )


def test_arrays_leave_out_what_is_no_body():
    holed = plate().with_region(disk={"centre": [0.1, 0.1], "radius": 0.05})
    for how in ({}, {"tolerance": 0.3}):
        cells = solve(holed, **how).cells(1)
        assert (cells.body[10, 10], cells.material[10, 10]) == (False, -1)
        assert np.isnan(cells.stress[10, 10]).all()
        assert np.isfinite(cells.stress[cells.body]).all()


def test_space_offers_the_same():
    cube = under_a_patch(3, 4, force=(1.0, 0.0, -2.0))
    found = [solve(cube), solve(cube, tolerance=0.5)]
    for answer in found:
        assert answer.cells(2).stress.shape == (8, 8, 8, 3, 3)
    assert len({tuple(answer.to_dataframe().columns) for answer in found}) == 1


@pytest.mark.parametrize(("how", "match"), [
    ({"tolerance": "a"}, "tolerance: must be a number"),
    ({"tolerance": 5.0}, "got 5.0; 5 % are 0.05"),
    ({"tolerance": "2%"}, "got '2%'; 2 % are 0.02"),
    ({"tol": 0.1}, "tol: solve has no such argument .did you mean 'tolerance'"),
    ({"tolerance": 1e-10}, "tolerance: must be a number from 1e-06"),
    ({"resolution": float("nan")}, "resolution: must be a whole number"),
    ({"resolution": 0}, "resolution"),
    ({"stage": 1.5}, "stage"),
    ({"previous": 3}, "previous"),
    ({"previous": 3, "tolerance": 0.1}, "an ElasticResult is needed to start from"),
])  # fmt: skip
def test_what_breaks_a_rule_is_named(how, match):
    with pytest.raises(ParameterError, match=match):
        solve(plate(), **how)


def test_arrays_of_no_resolution_or_too_many_cells_are_refused(answer):
    with pytest.raises(ParameterError, match="resolution"):
        answer.cells(0)
    with pytest.raises(ResultError, match="smaller resolution"):
        answer.cells(2000)


def test_stored_answers_are_read_as_they_were(answer, tmp_path, monkeypatch):
    again = kaju.load_result(answer.save(tmp_path / "answer"))
    assert again.summary() == answer.summary()
    monkeypatch.setattr("kaju.model.elastic.elastic_result.MOST_LOOKED_AT", 40)
    assert kaju.load_result(tmp_path / "answer.npz").largest_stress == answer.largest_stress
    np.testing.assert_array_equal(again.displacement, answer.displacement)
    np.testing.assert_array_equal(again.stress, answer.stress)


def told(path, value):
    def change(arrays, about):
        *inside, name = path.split(".")
        for part in inside:
            about = about[part]
        about[name] = value

    return change


LAST, MOVED = "found.generations.0", "found.solution.displacement.0"
TREE = {
    "index": (lambda arrays, _: arrays[f"{LAST}.code"].put(0, 1 << 40), "side by side"),
    "size": (lambda arrays, _: arrays[f"{LAST}.size"].put(0, 3), "side by side"),
    "nan": (lambda arrays, _: arrays[f"{LAST}.gap"].put(0, np.nan), "0.gap' must hold finite"),
    "missing": (lambda arrays, _: arrays.pop(f"{LAST}.chosen"), "chosen' is missing"),
    "none": (told("found.PairAgents.generations", []), "no generation"),
    "resolution": (told("found.PairAgents.ground.resolution", "two"), "resolution"),
    "later": (told("format", 99), "in version 99"),
}
for value in ({}, float("nan"), "a", [1.0]):
    TREE[f"tolerance {value}"] = (told("tolerance", value), "'tolerance' must")
CELLS = {
    "another version": (told("format", 3), "version 3 of the format"),
    "shape": (lambda arrays, _: arrays.update({MOVED: arrays[MOVED][:, :-1]}), "displacement"),
    "infinite": (lambda arrays, _: arrays[MOVED].put(0, np.inf), "finite"),
    "division": (told("found.CellAgents.division", -3), "division"),
    "storage": (told("found", {"Heap": {}}), "Heap"),
    "scene": (told("found.CellAgents.scene", "body = 3"), "damaged"),
}


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    tree = solve(plate(), tolerance=0.4).save(folder / "tree.npz")
    return {"tree": tree, "cells": solve(plate()).save(folder / "cells.npz")}


@pytest.mark.parametrize(
    ("which", "name"), [("tree", name) for name in TREE] + [("cells", name) for name in CELLS]
)
def test_what_is_wrong_in_a_file_is_found_before_it_is_used(stored, tmp_path, which, name):
    change, match = (TREE if which == "tree" else CELLS)[name]
    path = rewritten(stored[which], change, tmp_path / "wrong.npz")
    with pytest.raises(ResultFileError, match=match) as caught:
        kaju.load_result(path)
    assert "wrong.npz" in str(caught.value)


def test_what_unpacks_to_far_more_than_its_file_is_not_read(tmp_path):
    stream, path = BytesIO(), tmp_path / "bomb.npz"
    np.save(stream, np.zeros(20_000_000))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("json.npy", stream.getvalue())
    with pytest.raises(ResultFileError, match="more than results do"):
        kaju.load_result(path)


def test_others_make_up_for_agents_that_may_not_be_smaller():
    """All that the smallest leave counts, and the tolerance is kept all the same."""
    least = solve(plate(), tolerance=1e-3, resolution=4).error_estimate
    found = solve(plate(), tolerance=1.2 * least, resolution=4)
    assert found.error_bound <= 1.2 * least
    assert found.size.min() == pytest.approx(0.01 / 4)
