"""Each wrong description is one clear error: key path, rule, value, remedy."""

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import kaju
from kaju import KajuError, Scene
from kaju.errors import SceneError, SceneFileError
from kaju.model.scene import Body, LoadTable

BODY = {"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"}
GIVEN = {"sides": {"bottom": "rigid"}, "loads": [{"cell": [10, 19], "force": [0, -2]}]}


def scene(body=None, **parts):
    return Scene(**{"body": BODY | (body or {}), **GIVEN, **parts})


BODIES = [
    ({"size": [0.2, -0.2]}, "body.size.1: must be above 0, got -0.2; size is the edges"),
    ({"size": [float("nan"), 0.2]}, "body.size.0: must be finite, got nan"),
    ({"size": [True, 0.2]}, "body.size.0: must be a number, got True"),
    ({"size": [0.2, 0.1]}, "cells must be as high as wide, .* 0.01 x 0.005 m; change size or"),
    ({"size": [1e-11, 1e-11]}, "body.size: cells would be 5e-13 m wide"),
    ({"cell_size": 0.01}, "body.size: give either size or cell_size"),
    ({"cells": [20]}, r"body.cells: two or three numbers are needed, got \[20\]"),
    ({"cells": [20.0, 20]}, "body.cells.0: must be a whole number, got 20.0"),
    ({"cells": None}, "body.cells: is needed"),
    ({"cells": [10**10, 10**10]}, r"cells are more than can be counted \(2\^62\)"),
    ({"material": None}, 'body.material: is needed, such as "steel"'),
    ({"regions": [{"box": [[0, 0], [0.1, 0.1]], "material": "pinned"}]}, "can be pinned; g"),
    ({"regions": [{"box": [[0, 0], [0.1, 0.1]], "material": "bolt"}]}, "did you mean 'pinned'"),
    ({"material": "stele"}, r"body.material: there is no material 'stele' \(did you mean 'steel'"),
    ({"material": "Steel S235"}, r'describe it under \[materials."Steel S235"\]'),
    ({"plane": "strian"}, r"body.plane: .* got 'strian' \(did you mean 'strain'\?\)"),
    ({"lattice": "hexagon"}, "body.size: rows of hexagons overlap; give cell_size"),
    ({"lattice": "cube"}, r"body.cells: 'cube' has 3 axes, but \(20, 20\) names 2"),
    ({"cells": [2, 2, 2], "size": [1, 1, 1]}, "body.thickness: belongs to two dimensions"),
    ({"sise": [1, 1]}, r"body.sise: unknown key \(did you mean 'size'\?\)"),
    ({"drawing": "##"}, "body.cells: the drawing has its own"),
]


PARTS = [
    ({"bodi": 1}, r"bodi: unknown key \(did you mean 'body'\?\)"),
    ({"body": BODY | {"regions": []}, "regions": []}, "regions: are given twice"),
    ({"legend": {"#": "steel"}}, "legend: explains a drawing, an image or an array; the body has"),
    ({"materials": {"m": {"youngs_modulus": 1}}}, "m.poissons_ratio: is needed, or a base"),
    ({"materials": {"m": {"base": "ice", "density": 0}}}, "materials.m.density: must be above 0"),
    ({"materials": {"m": "soft"}}, "materials.m: must be a table of youngs_modulus, .* got 'soft'"),
    ({"materials": {"air": {"base": "ice"}}}, "materials.air: cannot name a material"),
    ({"sides": {"botom": "rigid"}}, r"sides.botom: .* \(did you mean 'bottom'\?\); there is left"),
    ({"sides": {"bottom": "rigd"}}, r"sides.bottom: there is no 'rigd' \(did you mean 'rigid'\?\)"),
    ({"sides": {"bottom": {"displacement": [0]}}}, "displacement: .* should have 2 numbers"),
    ({"loads": {"cell": [0, 0]}}, r"loads: must be a list.* write \[\[loads\]\], with two bra"),
    ({"body": BODY | {"regions": {"material": "air"}}}, r"regions: .* \[\[body.regions\]\], w"),
    ({"materials": {"a": {"E": 1e9}}}, r"a.E: unknown key \(did you mean 'youngs_modulus'\?\)"),
    ({"supports": {"bottom": "rigid"}}, r"unknown key \(did you mean 'sides'\?\)"),
    ({"sides": {"bottom": "fixed"}}, r"no 'fixed' \(did you mean 'rigid'\?\)"),
    ({"history": {"steps": [{"hold": 1.0, "duration": 2.0}]}}, "history.steps.0.duration"),
    ({"history": {"steps": [{"ramp": 1.0, "period": 2.0}]}}, "history.steps.0.period"),
    ({"history": {"steps": [{"ramp": 1.0, "hold": 2.0}]}}, "history.steps.0.ramp"),
    ({"rule": {"kind": "elastik"}}, r"rule.kind: .* 'elastik' \(did you mean 'elastic'\?\)"),
    ({"rule": {"threshold": 0.0}}, "rule.threshold: must be a load above 0 N, got 0.0"),
    ({"rule": {"alpha": [0.5, 0.5, -1]}}, "rule.alpha: α₃ must be a number, 0 or more"),
    ({"rule": {"materials": {"steel": {"beta": 3.0}}}}, "rule.materials.steel.beta: must lie betw"),
    ({"rule": {"materials": {"stel": {}}}}, r"rule.materials.stel: .* \(did you mean 'steel'\?\)"),
]


REGIONS = [
    ({"box": [[0, 0], [0.1, 0.1]]}, "body.regions.0.material: is needed"),
    ({"material": "air"}, "body.regions.0.box: a region has exactly one shape .* got none"),
    ({"box": [[1, 1], [2, 2]], "material": "air"}, "body.regions.0.box: lies outside the array"),
    ({"box": [[0, 0], [0, 1]], "material": "air"}, "body.regions.0.box: .*must be the lower one"),
    ({"ball": {"centre": [0, 0], "radius": 1}, "material": "air"}, "three dimensions; use disk"),
    ({"disk": {"centre": [0.1, 0.1], "radius": 1e-3}, "material": "air"}, "holds no cell's centre"),
    ({"disk": {"centre": [0, 0], "diameter": 1}}, r"key \(did you mean 'radius', half of it\?\)"),
    ({"circle": {}}, r"unknown key \(did you mean 'disk'\?\)"),
    ({"disk": {"centre": [0, 0], "radius": 20}, "material": "air"}, "0: leaves nothing.* metres?"),
    ({"polygon": [[0, 0], [0, 1], [0, 2]], "material": "air"}, "corners lie on one line"),
    ({"disk": {"centre": [0, 0], "radius": 20}, "material": "ice"}, "holds the whole .* metres?"),
    ({"path": "M 0 0 H 200 V 200 H 0 Z", "material": "ice"}, "regions.0.path: holds the whole"),
    ({"path": "M 9 0 H 200 V 200 H 0 V 9 Z", "material": "ice"}, "no cell's centre; it .* metres?"),
    ({"box": [[0, 0], [1, 1]], "material": "air", "name": "left"}, "0.name: 'left' is what a s"),
    ({"image": {"file": "no.png"}, "material": "air"}, "file: no.png: cannot be read: No such"),
]


WRONG = [
    *[({"body": body}, told) for body, told in BODIES],
    *PARTS,
    *[({"body": {"regions": [region]}}, told) for region, told in REGIONS],
]


@pytest.mark.parametrize(("parts", "told"), WRONG)
def test_what_is_wrong_is_named(parts, told):
    with pytest.raises(SceneError, match=told):
        scene(**parts)


def test_several_problems_are_told_together():
    with pytest.raises(SceneError, match=r"2 problems:\n  body.thickness: .*\n  loads.0.steps: "):
        scene({"thickness": -1}, loads=[{"cell": [0, 0], "force": [0, -1], "steps": 0}])


@pytest.mark.parametrize(("cells", "legend", "told"), [
    ("##\n#", {"#": "ice"}, "line 2 has 1 letters, line 1 has 2; all rows must be equally"),
    ("##\n#x", {"#": "ice"}, r"line 2, letter 2 is 'x', which \[legend\] does not explain"),
    ("##", {}, "legend: is needed to explain the drawing"),
    (np.zeros((3, 3)), {0: "ice"}, "must hold whole numbers, got float64"),
    (np.zeros((3, 3), int), {1: "ice"}, r"9 cells have a code.* first 0 in cell \[0, 0\]"),
    (np.zeros(3, int), {0: "ice"}, r"two or three axes, got shape \(3,\)"),
    ("no.npy", {0: "ice"}, "body.array: no.npy: cannot be read: No such file"),
])  # fmt: skip
def test_drawings_and_arrays(cells, legend, told):
    kind = "drawing" if isinstance(cells, str) and cells != "no.npy" else "array"
    with pytest.raises(SceneError, match=told):
        Scene(body={"cell_size": 0.1, kind: cells}, legend=legend, **GIVEN)


def test_pickles_are_not_opened(tmp_path):
    np.save(tmp_path / "body.npy", np.array([[{}]]), allow_pickle=True)
    with pytest.raises(SceneFileError, match=r"cannot be read as an array of numbers"):
        Scene.from_array(tmp_path / "body.npy", legend={1: "steel"}, cell_size=0.1)
    np.savez(tmp_path / "two.npz", np.zeros((2, 2)))
    with pytest.raises(SceneFileError, match=r"holds several arrays"):
        Scene.from_array(tmp_path / "two.npz", legend={1: "steel"}, cell_size=0.1)


def test_an_unknown_colour_is_named_with_its_place(tmp_path):
    pixels = np.zeros((4, 5, 3), dtype=np.uint8)
    pixels[1, 3] = [1, 2, 3]
    Image.fromarray(pixels).save(tmp_path / "body.png")
    told = r"1 pixels .* first #010203 in row 2 from the top, column 4,.* explains 'black' \(ice\)"
    with pytest.raises(SceneError, match=told):
        Scene.from_image(tmp_path / "body.png", legend={"black": "ice"}, cell_size=0.1)
    with pytest.raises(SceneError, match=r"legend: 'blakc' is not a colour"):
        Scene.from_image(tmp_path / "body.png", legend={"blakc": "ice"}, cell_size=0.1)


def png_of(width, height):
    """The head of a PNG that claims to be of some size, with hardly any data."""

    def chunk(kind, data):
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = chunk(b"IDAT", zlib.compress(b"\x00"))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + data + chunk(b"IEND", b"")


@pytest.mark.parametrize(("content", "told"), [
    (b"no picture", "cannot be read as an image .*save it as PNG"),
    (png_of(10_000, 10_000), "has 10000 x 10000 pixels, more than 5e"),
    (png_of(100_000, 100_000), "unpacks to an enormous image"),
])  # fmt: skip
def test_images_that_cannot_be_read(tmp_path, content, told):
    path = tmp_path / "body.png"
    path.write_bytes(content)
    with pytest.raises(SceneFileError, match=told):
        Scene.from_image(path, legend={"black": "ice"}, cell_size=0.1)


anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats()
    | st.text(max_size=4)
    | st.sampled_from(["air", "rigid", "steel", "top", 0.1, 3]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2)
    ),
    max_leaves=5,
)
PLACES = [
    *[f"body.{key}" for key in Body.model_fields if key not in ("image", "array")],
    *[f"loads.0.{key}" for key in LoadTable.model_fields],
    "body", "legend", "materials", "materials.steel", "materials.m.youngs_modulus", "sides",
    "sides.bottom", "sides.left", "loads", "loads.0", "rule", "rule.kind", "rule.alpha",
    "rule.beta", "rule.threshold", "rule.materials", "regions", "nothing",
]  # fmt: skip


@given(st.sampled_from(PLACES), anything)
def test_whatever_is_given_ends_in_a_scene_or_in_a_named_error(place, value):
    table = {
        "body": dict(BODY),
        "sides": {"bottom": "rigid"},
        "materials": {"steel": {"base": "ice"}},
        "loads": [{"cell": [10, 19], "force": [0.0, -2.0]}],
        "rule": {},
    }
    *path, last = place.split(".")
    inner = table
    for key in path:
        inner = inner[int(key)] if isinstance(inner, list) else inner.setdefault(key, {})
    inner[int(last) if isinstance(inner, list) else last] = value
    try:
        made = Scene(**table)
    except KajuError:
        with pytest.raises(SceneError, match=r"(?s)^.+: .{5}"):
            Scene(**table)
    else:
        assert np.all(np.isfinite(made.applied().force))


BROKEN = [
    (
        "size = [1, 2\n\nb = 1",
        r"^line 1 is not valid TOML: a list lacks its \].*; got size = \[1, 2$",
    ),
    ("disk = {radius = 1\n", "line 1 .* a table lacks its }"),
    ('material = "steel\n[sides]', "line 1 .* a text lacks the quotes"),
    ("[[loads]\n", "line 1 .* as many brackets"),
    ("a = 8 mm  # of a\n", "line 1 .* numbers have no units"),
    ("a = 1\na = 2", "line 2 .* given twice"),
    ('file = "C:\\parts"', "line 1 .* in a path as /"),
]


@pytest.mark.parametrize(("text", "told"), BROKEN)
def test_what_is_no_toml_is_said_in_plain_words(text, told):
    with pytest.raises(SceneError, match=told):
        Scene.from_toml(text)


def test_millimetres_and_gigapascals_are_asked_about():
    body = {"size": [120, 120], "cells": [8, 8], "thickness": 8, "material": "steel"}
    steel = {"steel": {"youngs_modulus": 210, "poissons_ratio": 0.3}}
    load = {"side": "top", "force": [0.0, -50_000.0]}
    wrong = Scene(body=body, materials=steel, sides={"bottom": "rigid"}, loads=[load])
    notes = kaju.solve(wrong).notes
    assert sum("are these metres and pascals?" in note for note in notes) == 2
    assert kaju.LoadModel(wrong).run(progress=False).notes != ()
    softer = wrong.with_overrides({"materials.steel.youngs_modulus": 21e4})
    assert "1 MPa is 1e6 Pa" in softer.notes[0]
    assert "much for a body of steel" in wrong.with_overrides({"materials": {}}).notes[0]
    for share in (0.3, 0.2):  # up to the edge, and through it
        disk = {"radius": 0.3 * 120.0, "centre": [share * 120.0] * 2}
        assert "this hole meets the edge" in wrong.with_region(disk=disk).notes[-1]
    for shape, told in [
        ({"path": "M 0 0 H 130 V 60 H 0 Z"}, "what lies beyond is cut off"),
        ({"polygon": [[0, 0], [121, 0], [121, 60]]}, ""),
        ({"polygon": [[60, 0], [9e3, 0], [60, 9e3]]}, "are these metres?"),
        ({"disk": {"centre": [60, 60], "radius": 65.0}}, "is cut off"),
        ({"disk": {"centre": [0, 0], "radius": 65.0}}, ""),  # a quarter, by symmetry
        ({"box": [[-9, -9], [9, 9]]}, ""),  # all of a corner
        ({"rounded_box": {"box": [[60, 60], [9e3, 9e3]], "radius": 9.0}}, "are these metres?"),
    ]:
        notes = wrong.with_region("ice", **shape).notes
        assert [told in note for note in notes if "reaches from" in note] == [True] * bool(told)
    apart = disk | {"centre": [0.8 * wrong.lattice.extent[0]] * 2, "radius": 12.0}
    for at, idle in ((apart, True), (disk, False)):  # a part of steel where steel is, or in a hole
        notes = wrong.with_region(disk=disk).with_region(disk=at, material="steel").notes
        assert any("material below it" in note for note in notes) == idle
        assert any("1 covers this hole" in note for note in notes) != idle
    over = disk | {"radius": 20.0, "centre": [60, 24]}
    twice = wrong.with_region(disk=disk).with_region(disk=over)
    assert any("regions.0' and 'body.regions.1' overlap" in note for note in twice.notes)
    assert "nothing is applied" in wrong.replace(loads=()).notes[0]
    part = [{"box": [[0, 0], [100, 120]], "material": "steel"}]
    short = Scene(
        body=body | {"material": "air", "regions": part},
        sides=dict.fromkeys(["left", "right"], "rigid"),
        loads=[load],
    )
    assert "sides.right holds nothing: the body ends at x = 100 m" in str(short.notes)
    assert "sides.left" not in str(short.notes)
    for pressure, asked in ((10.0, True), (1e6, False)):  # 10 MPa were meant
        pressed = [{"side": "top", "pressure": pressure}]
        small = Scene(body=body | {"size": [0.1, 0.1]}, sides={"bottom": "rigid"}, loads=pressed)
        assert any("reaches only" in note for note in kaju.solve(small).notes) == asked
    fallen = {"materials": {}, "body.gravity": [0, -9810]}
    assert "the Earth's is 9.81" in str(wrong.with_overrides(fallen).notes)
    thick = [wrong.with_overrides({"body.thickness": t}).notes for t in (2400.0, 2401.0)]
    assert ["m are much for a plate of 120 m" in str(notes) for notes in thick] == [False, True]
    for wide, told in ((10.0, True), (9.9, False)):  # only small bodies are of foam
        foam = {"body.size": [wide, wide], "materials.steel.youngs_modulus": 4e5}
        assert any("is soft" in note for note in wrong.with_overrides(foam).notes) == told
    bare = Scene(body=body | {"thickness": None}, sides={"bottom": "rigid"}, loads=[load])
    assert "thickness is not given: 1 m" in bare.notes[-1]
    assert "thickness" not in str(bare.replace(loads=[{"side": "top", "pressure": 2.0}]).notes)
