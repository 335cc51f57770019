"""Bodies from files as other programs write them."""

import io
import sys

import numpy as np
import pytest
from PIL import Image
from plates import loaded
from plates import plate as pressed

import kaju
from kaju.errors import SceneError

tifffile = pytest.importorskip("tifffile")
pytest.importorskip("svgpathtools")
pytest.importorskip("trimesh")

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
FACES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)
NESTED = [((x, x, x), edge, False) for x, edge in ((0.1, 2.2), (0.2, 2.0), (0.7, 1.0))]


def plate(region, cells=(64, 64), size=0.01, **body):
    return loaded(
        cells,
        cell_size=size,
        regions=[{"material": "air", **region}],
        sides={},
        allow_floating=True,
        **body,
    )


def air(scene):
    return int((scene.rasterise() < 0).sum())


# Grey images.

MIDDLE = np.hypot(*np.meshgrid(np.arange(64) - 31.5, np.arange(64) - 31.5))
DARK = np.clip(0.5 - (20 - MIDDLE) * 0.03, 0, 1)  # a dark disk of radius 20


@pytest.mark.parametrize(("name", "pixels"), [
    ("8.png", (255 * DARK).round().astype(np.uint8)),
    ("16.png", (65535 * DARK).round().astype(np.uint16)),
    ("16 bits in 32.tif", (65535 * DARK).astype(np.int32)),
    ("32.tif", ((2**31 - 1) * DARK).astype(np.int32)),
    ("float.tif", DARK.astype(np.float32)),
])  # fmt: skip
def test_grey_images_of_all_depths_are_the_same_disk(tmp_path, name, pixels):
    Image.fromarray(pixels).save(tmp_path / name)
    scenes = [
        plate({"image": {"file": str(tmp_path / name), **level}}) for level in ({"level": 0.5}, {})
    ]
    assert [air(scene) for scene in scenes] == [1264, 1264]
    again = kaju.Scene.from_archive(*scenes[0].to_archive())
    assert np.array_equal(again.rasterise(), scenes[0].rasterise())


def test_a_photo_is_turned_as_viewers_show_it(tmp_path):
    pixels = np.full((20, 30, 3), 255, np.uint8)
    pixels[0, 0] = 0
    photo = Image.fromarray(pixels)
    exif = photo.getexif()
    exif[0x0112] = 6  # a quarter turn clockwise: the first pixel comes to the upper right
    path = tmp_path / "turned.png"
    photo.save(path, exif=exif)
    body = {"image": str(path), "cell_size": 0.01, "thickness": 0.01, "allow_floating": True}
    force = {"region": {"box": [[0, 0], [1, 1]]}, "force": [0, -1.0]}
    scene = kaju.Scene(body=body, legend={"black": "steel", "white": "air"}, loads=[force])
    assert np.argwhere(scene.rasterise() >= 0).tolist() == [[19, 29]]


def test_pages_are_layers_in_space_and_refused_in_the_plane(tmp_path):
    layers = np.full((3, 4, 5), 65535, np.uint16)  # pages, rows, columns
    layers[0, 3, 1] = layers[2, 0, 4] = 0
    tifffile.imwrite(tmp_path / "pages.tif", layers, photometric="minisblack")
    tifffile.imwrite(tmp_path / "colours.tif", layers, photometric="rgb")
    with pytest.raises(SceneError, match=r"has 3 pages"):
        plate({"image": {"file": str(tmp_path / "pages.tif")}})
    solid = plate({"image": {"file": str(tmp_path / "pages.tif")}}, cells=(5, 4, 3))
    assert np.argwhere(solid.rasterise() < 0).tolist() == [[1, 0, 0], [4, 3, 2]]
    with pytest.raises(SceneError, match="grey layers of one size"):
        plate({"image": {"file": str(tmp_path / "colours.tif")}}, cells=(5, 4, 3))


# Surfaces.


def stl(path, *boxes):
    """Write boxes, each a lower corner, an edge, and whether it looks inwards."""
    lines = ["solid some"]
    for low, edge, inwards in boxes:
        for face in FACES[:, ::-1] if inwards else FACES:
            corners = np.array(low) + edge * CORNERS[face]
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += ["vertex {:g} {:g} {:g}".format(*corner) for corner in corners]
            lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid some"]))
    return str(path)


@pytest.mark.parametrize(("boxes", "volume", "guessed"), [
    ([((0.3, 0.7, 0.7), 1.0, False), ((0.8, 0.7, 0.7), 1.0, False)], 1.5, False),  # they cross
    ([((0.3, 0.7, 0.7), 1.0, True), ((0.8, 0.7, 0.7), 1.0, False)], 1.5, False),
    ([((0.2, 0.2, 0.2), 2.0, False), ((0.7, 0.7, 0.7), 1.0, True)], 7.0, False),  # a cavity
    ([((0.2, 0.2, 0.2), 2.0, False), ((0.7, 0.7, 0.7), 1.0, False)], 7.0, True),
    ([((0.2, 0.2, 0.2), 0.5, False), ((1.2, 1.2, 1.2), 1.0, False)], 1.125, False),  # apart
    ([((0.2, 0.2, 0.2), 1.0, False), ((1.2, 0.2, 0.2), 1.0, False)], 2.0, False),  # a face
    ([((0.2, 0.2, 0.2), 1.0, False), ((1.2, 1.2, 0.2), 1.0, False)], 2.0, False),  # an edge
    ([((0.2, 0.2, 0.2), 1.0, False)] * 2, 1.0, False),  # twice the same
    (NESTED, 2.2**3 - 8.0 + 1.0, True),  # a body in a cavity
])  # fmt: skip
def test_shells_of_an_stl_are_one_body(tmp_path, boxes, volume, guessed):
    surface = {"file": stl(tmp_path / "some.stl", *boxes)}
    scene = plate({"surface": surface}, cells=(24, 24, 24), size=0.1)
    assert air(scene) * 1e-3 == pytest.approx(volume)
    assert any("cavity" in note for note in scene.notes) == guessed
    again = kaju.Scene.from_archive(*scene.to_archive())
    assert np.array_equal(again.rasterise(), scene.rasterise())
    rough = str(plate({"surface": surface}, cells=(5, 5, 5), size=0.5).notes)
    assert all(f"x = {low[0]:g} m" in rough for low, _, _ in boxes)  # between cells of 0.5 m
    assert "between cells" not in str(scene.notes)


@pytest.mark.parametrize(("edge", "told"), [(4.0, "scale = 0.001"), (0.03, "is cut off")])
def test_a_part_larger_than_the_array_is_told(tmp_path, edge, told):
    surface = {"file": stl(tmp_path / "part.stl", ((0.0, 0.0, 0.0), edge, False))}
    moved = {"surface": surface | {"offset": [0.011, 0.0, 0.0]}, "material": "steel"}
    moved = plate(moved, cells=(4, 4, 4), size=5e-3)
    for one in (moved, kaju.Scene.from_archive(*moved.to_archive())):
        assert all(part in one.notes[-1] for part in ("reaches from (0.011, 0, 0)", told))
    if edge == 4.0:
        with pytest.raises(kaju.KajuError, match="holds the whole array"):
            plate({"surface": surface, "material": "steel"}, cells=(4, 4, 4), size=5e-3)


# Drawings.

SVG = '<svg xmlns="http://www.w3.org/2000/svg" {} >{}</svg>'
PAGE = 'width="80mm" height="40mm" viewBox="0 0 80 40"'
RECT = '<rect id="part" x="10" y="5" width="20" height="10"/>'
POINT = {"point": [0.005, 0.008], "force": [0.0, -1.0]}
HOLE = '<rect id="hole" x="15" y="7" width="10" height="6"/>'


def drawn(tmp_path, inner, page=PAGE, **others):
    (tmp_path / "drawing.svg").write_text(SVG.format(page, inner))
    region = {"path": {"file": str(tmp_path / "drawing.svg")} | others.pop("of", {})}
    return plate(region, (80, 40), 0.001, **others)


def centres(scene):
    """Return the middle of what is drawn (mm), and its area (mm²)."""
    found = np.argwhere(scene.rasterise() < 0)
    return [*(found.mean(axis=0) + 0.5).tolist(), len(found)]


@pytest.mark.parametrize(("inner", "page", "expected"), [
    (RECT, PAGE, [20, 30, 200]),
    ('<path d="M10 5h20v10h-20z"/>', PAGE, [20, 30, 200]),
    ('<g transform="translate(10 5)"><rect width="20" height="10"/></g>', PAGE, [20, 30, 200]),
    ('<rect width="37.795275590" height="37.795275590"/>', 'height="40mm"', [5, 35, 100]),
    ('<rect width="72" height="36"/>', 'width="2in" viewBox="0 0 144 72"', [12.5, 19, 325]),
    ('<path d="M10 5h20v10h-20zM12 7h5v5h-5z"/>', PAGE, [20, 30, 200]),  # nonzero: no hole
    ('<path fill-rule="evenodd" d="M10 5h20v10h-20zM15 7h10v6h-10z"/>', PAGE, [20, 30, 140]),
    ('<path d="M10 5h20v10h-20zM15 7v6h10v-6z"/>', PAGE, [20, 30, 140]),  # turned: a hole
    (RECT + HOLE, PAGE, [20, 30, 140]),
    ('<title>a plate</title><circle cx="40" cy="20" r="10"/>', PAGE, [40, 20, 316]),
    ('<ellipse cx="40" cy="20" rx="20" ry="5"/>', PAGE, [40, 20, 316]),
    ('<circle cx="10" cy="35" r="4"/>', 'width="160mm" viewBox="0 0 80 40"', [20, 10, 201]),
])  # fmt: skip
def test_drawings_are_metres_and_y_upwards(tmp_path, inner, page, expected):
    scene = drawn(tmp_path, inner, page)
    assert centres(scene)[:2] == pytest.approx(expected[:2], abs=0.6)
    assert centres(scene)[2] == pytest.approx(expected[2], rel=0.08)


def test_a_drawing_is_kept_with_its_scene(tmp_path):
    rest = '<text id="title">A</text><g clip-path="url(#a)"><line x2="1"/></g>'  # not asked for
    scene = drawn(tmp_path, f"{rest}{RECT}<g>{HOLE}</g>", of={"id": "hole"})
    assert centres(scene) == [20, 30, 60]
    with pytest.raises(SceneError, match=r"no shape has the id 'hol' .did you mean 'hole'.*part"):
        drawn(tmp_path, RECT + HOLE, of={"id": "hol"})
    scene.save(tmp_path / "beside.toml")
    assert kaju.load_scene(tmp_path / "beside.toml").rasterise().sum() == scene.rasterise().sum()
    again = kaju.Scene.from_archive(*scene.to_archive())
    assert np.array_equal(again.rasterise(), scene.rasterise())


@pytest.mark.parametrize(("inner", "words"), [
    ("<text>A</text>", "<text> is no outline"),
    ('<use href="#a"/>', "<use> is no outline"),
    ('<line x1="0" y1="0" x2="1" y2="1"/>', "<line> is no outline"),
    ('<rect width="5mm" height="1"/>', "<rect> is no outline"),
    ('<rect width="5" height="5" transform="turn(3)"/>', "transform is not read"),
    ('<rect width="5" height="5" clip-path="url(#a)"/>', "has a clip-path"),
    ('<circle cx="9" cy="9" r="5"/><circle cx="14" cy="9" r="5"/>', "cross or touch"),
    ("", "holds no outline"),
    ("<g>", "is not an SVG drawing"),
])  # fmt: skip
def test_what_is_no_outline_is_named(tmp_path, inner, words):
    with pytest.raises(SceneError, match=r"regions\.0\.path\.file: ") as error:
        drawn(tmp_path, inner)
    assert words in str(error.value)


def test_a_drawing_without_a_unit_is_told_to_be_in_pixels(tmp_path):
    pixels = 'viewBox="0 0 80 40"'
    told = [drawn(tmp_path, RECT, page).notes for page in (PAGE, pixels)]
    again = {"file": str(tmp_path / "drawing.svg")}  # which is told once for all regions
    told.append(drawn(tmp_path, RECT, pixels).with_region(path=again).notes)
    assert ["".join(notes).count("inch; give its") for notes in told] == [0, 1, 1]
    assert told[1][-1].endswith("?")  # so that check says that a note asks
    told = r"(lies outside|is air, not body).* 1/96 inch; give its <svg> a width"
    for inner, load in (('<rect x="900" width="9" height="9"/>', []), (RECT, [POINT])):
        with pytest.raises(SceneError, match=told):
            drawn(tmp_path, inner, pixels, loads=load)
    loose = drawn(tmp_path, RECT, pixels, loads=[POINT | {"point": [0.05, 0.04]}])
    for solve in (kaju.solve, lambda scene: kaju.SpawningModel(scene).run()):
        with pytest.raises(SceneError, match=r"could move anywhere.* 1/96 inch"):
            solve(loose)


# Texts.


def test_a_scene_comes_from_standard_input(monkeypatch):
    text = pressed([4, 4], [2, 3], [0.0, -2.0]).to_toml()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode("utf-8-sig"))))
    assert kaju.load_scene("-") == kaju.Scene.from_toml(text)
