"""Regions: shapes over a background, evaluated at the cells' centres."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from plates import loaded

from kaju import Scene
from kaju.errors import SceneError

AIR, RIGID, MIXED = -1, -2, -99


def plate(*regions, cells=(8, 8), **body):
    free = {"sides": {}, "allow_floating": True}
    return loaded(cells, cell_size=1.0, regions=list(regions), **free, **body)


def test_the_edge_belongs_to_the_region():
    scene = plate({"box": [[0.5, 0.5], [2.5, 0.5 + 1.0]], "material": "air"}, cells=(4, 3))
    assert np.argwhere(scene.rasterise() == AIR).tolist() == [
        [0, 0], [0, 1], [1, 0], [1, 1], [2, 0], [2, 1],
    ]  # fmt: skip


def test_later_regions_cover_earlier_ones():
    scene = plate(
        {"box": [[0, 0], [3, 3]], "material": "rubber"},
        {"box": [[1, 1], [2, 2]], "material": "rigid"},
        cells=(3, 3),
    )
    assert [material.name for material in scene.cell_materials] == ["steel", "rubber"]
    assert scene.rasterise().tolist() == [[1, 1, 1], [1, RIGID, 1], [1, 1, 1]]


def test_a_triangle_includes_the_centres_on_its_long_side():
    scene = plate({"polygon": [[0, 0], [4, 0], [0, 4]], "material": "air"}, cells=(4, 4))
    i, j = np.indices((4, 4))
    assert np.array_equal(scene.rasterise() == AIR, i + j <= 3)


def test_the_dark_pixels_of_an_image(tmp_path):
    pixels = np.array([[255, 0], [0, 0]], dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "hole.png")
    hole = {"file": tmp_path / "hole.png", "box": [[1, 1], [5, 5]]}
    scene = plate({"image": hole, "material": "air"}, cells=(6, 6))
    expected = np.zeros((6, 6), dtype=bool)
    expected[1:5, 1:3] = expected[3:5, 3:5] = True
    assert np.array_equal(scene.rasterise() == AIR, expected)


numbers = st.floats(-1.0, 9.0).map(lambda x: round(x, 2))
points = st.tuples(numbers, numbers)
boxes = st.tuples(points, points).map(
    lambda p: {"box": [np.minimum(*p).tolist(), (np.maximum(*p) + 1.0).tolist()]}
)
disks = st.builds(
    lambda centre, radius: {"disk": {"centre": centre, "radius": radius}},
    points,
    st.floats(1.0, 4.0),
)
polygons = st.lists(points, min_size=3, max_size=6, unique=True).map(lambda p: {"polygon": p})
shapes = st.one_of(boxes, disks, polygons)


@given(st.lists(st.tuples(shapes, st.sampled_from(["air", "rigid", "rubber"])), max_size=4))
def test_asking_cell_by_cell_is_rasterising(described):
    regions = [{**shape, "material": material} for shape, material in described]
    try:
        scene = plate(*regions)
    except SceneError:
        refused = r"no extent|outside|no cell's centre|of the body|is body"
        with pytest.raises(SceneError, match=refused):
            plate(*regions)
        return
    i, j = np.indices((8, 8))
    cells = np.stack([i.ravel(), j.ravel()], axis=1)
    raster = scene.rasterise()
    assert np.array_equal(scene.kinds(cells), raster.ravel())
    lower, upper = scene.bounds()
    outside = np.any((cells < lower) | (cells >= upper), axis=1)
    assert np.all(raster.ravel()[outside] < 0)
    check_boxes(scene, sure=False)


def check_boxes(scene, sure):
    """A box of 2^k cells is of one kind only if all of its cells are; if `sure`, and just then."""
    raster = scene.rasterise()
    for edge in (2, 4, 8):
        corners = edge * np.argwhere(np.ones([n // edge for n in raster.shape]))
        for at, kind in zip(corners, scene.box_kinds(corners, edge.bit_length() - 1), strict=True):
            held = raster[tuple(slice(low, low + edge) for low in at)]
            assert kind == MIXED or (held == kind).all()
            assert not sure or (kind == MIXED) == (np.ptp(held) > 0)


@given(st.lists(st.sampled_from([0, 0, 0, 1]), min_size=24, max_size=24))
def test_boxes_of_a_drawn_body_are_of_one_kind_just_if_their_cells_are(codes):
    codes = np.kron(np.reshape(codes, (4, 6)), np.ones((2, 2), int))
    codes[0, 0] = 0
    legend = {0: "steel", 1: "air"} if codes.any() else {0: "steel"}
    free = {"allow_floating": True, "sides": {}}
    check_boxes(Scene.from_array(codes, legend=legend, cell_size=1.0, **free), sure=True)


@given(shapes)
def test_a_mirrored_region_fills_the_mirrored_cells(shape):
    def mirrored(point):
        return [8.0 - point[0], point[1]]

    if "box" in shape:
        (x0, y0), (x1, y1) = shape["box"]
        other = {"box": [[8.0 - x1, y0], [8.0 - x0, y1]]}
    elif "disk" in shape:
        other = {"disk": {**shape["disk"], "centre": mirrored(shape["disk"]["centre"])}}
    else:
        other = {"polygon": [mirrored(corner) for corner in shape["polygon"]]}
    corners = [{"box": [[x, 0], [x + 1, 1]], "material": "ice"} for x in (0, 7)]
    try:
        one = plate({**shape, "material": "rigid"}, *corners)
    except ValueError:
        with pytest.raises(ValueError, match=r"no extent|outside|no cell's centre"):
            plate({**other, "material": "rigid"})
        return
    two = plate({**other, "material": "rigid"}, *corners)
    assert np.array_equal(one.rasterise(), two.rasterise()[::-1])
