"""The same scene on finer cells, or with single values changed by their key path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plates import PLATE_TEXT, loaded

from kaju import KajuError, Scene, load_scene
from kaju.errors import ParameterError, SceneError


def plate(*loads, cells=(4, 3), **body):
    return loaded(cells, *loads, cell_size=0.1, **body)


def resultant(scene):
    """Total force and its moment about the origin, forces at their faces' middles."""
    lattice, applied = scene.lattice, scene.applied()
    faces = np.vstack([lattice.normals, np.zeros(lattice.dimension)])[applied.direction]
    place = lattice.centres(applied.cells) + 0.5 * lattice.cell_size * faces
    moments = place[:, :, None] * applied.force[:, None, :]
    return applied.force.sum(axis=0), (moments - moments.transpose(0, 2, 1)).sum(axis=0)


def test_pictures_repeat_their_cells():
    scene = loaded("#.\n##")
    expected = np.kron(scene.rasterise(), np.ones((3, 3), dtype=int))
    assert np.array_equal(scene.refine(3).rasterise(), expected)
    assert scene.refine(2).refine(3) == scene.refine(6)


def test_a_load_on_a_surface_cell_becomes_a_load_on_that_surface():
    fine = plate({"cell": [1, 2], "force": [0, -2], "steps": 5}).refine(2)
    (load,) = fine.loads
    assert load.region is not None
    assert fine.stages == 5
    applied = fine.applied()
    assert applied.cells.tolist() == [[2, 5], [3, 5]]
    assert applied.direction.tolist() == [3, 3]
    assert applied.force.tolist() == [[0, -1], [0, -1]]


def test_a_load_where_the_finer_body_has_no_cell_any_more():
    hole = [[0.0, 0.27], [0.1, 0.27], [0.1, 0.2], [0.2, 0.2], [0.2, 0.3], [0.0, 0.3]]
    region = {"polygon": hole, "material": "air"}
    scene = plate({"cell": [0, 2], "force": [0, -4]}, regions=[region])
    assert scene.kinds([[0, 2], [1, 2]]).tolist() == [0, -1]
    total, _ = resultant(scene.refine(10))
    assert np.allclose(total, [0, -4])


sides = st.sampled_from(["left", "right", "bottom", "top"])
forces = st.tuples(st.sampled_from([-2.0, -1.0, 0.0, 3.0]), st.sampled_from([-1.0, 2.0]))
cells = st.tuples(st.integers(0, 3), st.integers(0, 2))
boxes = st.tuples(st.floats(0.0, 0.15), st.floats(0.2, 0.4)).map(
    lambda x: {"region": {"box": [[x[0], 0.3], [x[1], 0.3]]}}
)
places = st.one_of(
    cells.map(lambda cell: {"cell": cell}),
    st.tuples(cells, sides).map(lambda c: {"cell": c[0], "side": c[1]}),
    st.tuples(st.floats(0.0, 0.4), st.floats(0.0, 0.3)).map(lambda p: {"point": p}),
    boxes,
    st.just({"side": "top"}),
)


@given(places, forces, st.integers(1, 5))
def test_total_force_is_kept_and_moment_for_loads_on_faces(place, force, k):
    scene = plate({**place, "force": force})
    total, moment = resultant(scene)
    fine_total, fine_moment = resultant(scene.refine(k))
    assert np.allclose(fine_total, total, rtol=1e-12, atol=1e-12)
    if "point" not in place and "region" not in place:
        assert np.allclose(fine_moment, moment, rtol=1e-12, atol=1e-12)


@given(st.tuples(st.integers(0, 1), st.integers(0, 1), st.integers(0, 1)), st.integers(2, 3))
def test_cubes(cell, k):
    scene = plate({"cell": cell, "force": [0, 0, -1]}, cells=(2, 2, 2))
    fine = scene.refine(k)
    assert len(fine.applied().cells) == k * k
    for ours, theirs in zip(resultant(scene), resultant(fine), strict=True):
        assert np.allclose(ours, theirs, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("k", [0, -1, 1.5, True, "2"])
def test_by_what_is_no_whole_number(k):
    with pytest.raises(ParameterError, match=r"k: must be a whole number"):
        plate().refine(k)


def test_too_fine():
    scene = Scene.from_array(np.ones((9, 9), int), legend={1: "ice"}, cell_size=1.0,
                             sides={"top": "rigid"})  # fmt: skip
    with pytest.raises(SceneError, match=r"body: 18000 x 18000 cells are more than the 2e"):
        scene.refine(2000)
    with pytest.raises(KajuError, match=r"can be counted"):
        plate().refine(10**9)


PLATE = PLATE_TEXT + "steps = 20\n"


def changed(**changes):
    return Scene.from_toml(PLATE).with_overrides(
        {key.replace("__", "."): value for key, value in changes.items()}
    )


def test_values_are_read_as_toml_writes_them_in_lists_and_new_tables_too():
    rule = {"rule__threshold": "0.001", "rule__accumulate": "true"}
    scene = changed(loads__0__steps="1", loads__0__force="[1, 0]", **rule)
    assert (scene.stages, scene.loads[0].force) == (1, (1.0, 0.0))
    assert (scene.rule.threshold, scene.rule.accumulate) == (0.001, True)
    scene = changed(loads__0__force__1="-3", materials__steel__base="steel",
                    sides__left="{stiffness = 1e6}", body__cells=[40, 40])  # fmt: skip
    assert Scene.from_toml(PLATE).loads[0].force == (0.0, -2.0)
    assert scene.loads[0].force == (0.0, -3.0)
    assert scene.side_condition("left").stiffness == 1e6
    assert scene.lattice.shape == (40, 40)


@pytest.mark.parametrize(("key", "value", "told"), [
    ("rule.treshold", "1", r"rule.treshold: unknown key \(did you mean 'threshold'\?\)"),
    ("loads.1.steps", "1", "loads.1: loads is a list; its items are 0 to 0, .* no item '1'"),
    ("loads.0.steps.0", "1", "loads.0.steps.0: loads.0.steps is 20, which has no parts"),
    ("body..cells", "1", "is not a key path"),
    ("loads.0.steps", "many", "loads.0.steps: must be a whole number, got 'many'"),
    # one value cannot smuggle in another
    ("loads.0.steps", "1\nother = 2", "loads.0.steps: must be a whole number"),
])  # fmt: skip
def test_paths_and_values_that_cannot_be(key, value, told):
    with pytest.raises(SceneError, match=told):
        Scene.from_toml(PLATE).with_overrides({key: value})


def test_a_file_may_be_mended_while_it_is_read(tmp_path):
    path = tmp_path / "plate.toml"
    path.write_text(PLATE.replace("steps = 20", "steps = 0"))
    with pytest.raises(SceneError, match=r"plate.toml: line 11: loads.0.steps: must be above 0"):
        load_scene(path)
    for spelling in ("loads.0.steps", "loads[0].steps"):
        assert load_scene(path, {spelling: "2"}).stages == 2
        assert load_scene(path, {spelling: 3}).with_overrides({spelling: "4"}).stages == 4
    with pytest.raises(SceneError, match=r"toml: line 8: loads.0.steps: must be above 0, got -1"):
        load_scene(path, {"loads[0].steps": "-1"})  # the load's line: the value is not the file's


def test_a_new_kind_of_rule_starts_a_new_rule():
    scene = Scene.from_toml(PLATE)
    elastic = scene.with_overrides({"rule.threshold": "0.5", "rule.kind": "elastic"})
    assert (elastic.rule.kind, elastic.rule.threshold) == ("elastic", 0.5)
    assert scene.with_overrides({"rule.kind": "prescribed"}).rule == scene.rule
