"""Refinement: the same body, supports and loads on finer cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plates import loaded

from kaju import KajuError, Scene
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
