"""Scene to text or file and back: the same scene."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from plates import loaded

import kaju
from kaju import Coefficients, ElasticRule, Material, PrescribedRule, Scene, load_scene
from kaju.errors import SceneError

share = st.floats(0.0, 0.6)
rules = st.one_of(
    st.builds(
        PrescribedRule,
        alpha=st.none() | st.tuples(share, share, share),
        beta=st.floats(0.0, 1.0),
        threshold=st.floats(1e-9, 1.0),
        accumulate=st.booleans(),
        materials=st.dictionaries(
            st.just("a b"), st.builds(Coefficients, alpha=st.none(), beta=st.floats(0.0, 1.0))
        ),
    ),
    st.builds(
        ElasticRule,
        threshold=st.none() | st.floats(1e-9, 1.0),
        order=st.sampled_from(["largest first", "multilevel"]),
        tolerance=st.floats(1e-12, 0.5),
    ),
)
sides = st.dictionaries(
    st.sampled_from(["left", "right", "top"]),
    st.sampled_from(["rigid", "free", "roller", {"stiffness": 1e7}, {"displacement": [1e-5, 0.0]}]),
)
elements = st.builds(
    kaju.ThreeElement, K_f=st.floats(1.0, 1e9), D_f=st.just(0.0) | st.floats(1e-9, 1e9)
)
materials = st.builds(
    Material,
    name=st.just("a b"),
    youngs_modulus=st.floats(1e-3, 1e12),
    poissons_ratio=st.floats(-0.9, 0.5),
    density=st.none() | st.floats(1.0, 1e4),
    source=st.text(max_size=12),
    rheology=st.none() | elements,
)
component = st.floats(-1e6, 1e6).filter(lambda x: x != 0.0)
LETTERS = {"#": "a b", ".": "air", "=": "rigid", "o": "cork"}


@st.composite
def scenes(draw):
    columns, rows = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    body = {
        "cell_size": draw(st.floats(1e-6, 10.0)),
        "thickness": draw(st.floats(1e-6, 10.0)),
        "plane": draw(st.sampled_from(["stress", "strain"])),
        "lattice": draw(st.sampled_from(["square", "hexagon"])),
        "allow_floating": True,
    }
    parts = {"body": body}
    kind = draw(st.sampled_from(["plain", "drawing", "array"]))
    if kind == "plain":
        body |= {"cells": [columns, rows], "material": "a b"}
        middle = [columns * body["cell_size"] / 2, rows * body["cell_size"] / 3]
        if draw(st.booleans()):
            disk = {"centre": middle, "radius": body["cell_size"] * 2}
            body["regions"] = [{"disk": disk, "material": draw(st.sampled_from(["cork", "a b"]))}]
    elif kind == "drawing":
        row = st.text("##.=o", min_size=columns, max_size=columns)
        drawing = ["#" * columns, *draw(st.lists(row, min_size=rows, max_size=rows))]
        body["drawing"] = "\n".join(drawing)
        parts["legend"] = LETTERS
    else:
        codes = draw(st.lists(st.sampled_from([0, 1, -3]), min_size=columns, max_size=columns))
        body["array"] = np.array([[1, *codes]] * rows)
        parts["legend"] = {0: "air", 1: "a b", -3: "rigid"}
    load = {"side": "top" if kind != "array" else "bottom", "force": [draw(component), 1.0]}
    parts["sides"] = {**draw(sides), "top": "free"}
    parts["loads"] = [{**load, "steps": draw(st.integers(1, 9))}] if draw(st.booleans()) else []
    parts["materials"] = {"a b": draw(materials)}
    return Scene(**parts, rule=draw(rules))


@settings(max_examples=30)
@given(scenes())
def test_a_text_and_an_archive_give_the_same_scene(scene):
    assert Scene.from_archive(*scene.to_archive()) == scene
    again = Scene.from_toml(scene.to_toml())
    assert again == scene
    assert np.array_equal(again.rasterise(), scene.rasterise())
    assert np.array_equal(again.applied().force, scene.applied().force)
    assert again.to_toml() == scene.to_toml()


def test_a_text_is_made_to_be_read():
    scene = Scene(
        body={"cells": [4, 2], "cell_size": 0.1, "material": "my oak"},
        materials={"my oak": {"base": "oak", "source": "measured"}},
        sides={"bottom": "rigid", "left": {"stiffness": 1e9}},
        loads=[{"region": {"box": [[0.0, 0.2], [0.2, 0.2]]}, "force": [0.0, -1.0]}],
        rule={"materials": {"my oak": {"beta": 0.2}}},
        regions=[{"disk": {"centre": [0.3, 0.1], "radius": 0.08}, "material": "cork"}],
    )
    text = scene.to_toml()
    for part in (
        '[[body.regions]]\nmaterial = "cork"\ndisk = {centre = [0.3, 0.1], radius = 0.08}\n',
        '[materials."my oak"]\nyoungs_modulus = 12300000000.0\npoissons_ratio = 0.369\n',
        '[sides]\nbottom = "rigid"\nleft = {stiffness = 1000000000.0}\n',
        "[[loads]]\nregion = {box = [[0.0, 0.2], [0.2, 0.2]]}\nforce = [0.0, -1.0]\n",
        '[rule.materials."my oak"]\nbeta = 0.2\n',
    ):
        assert part in text


def painted(folder):
    pixels = np.zeros((3, 4, 3), dtype=np.uint8)
    pixels[2] = 255
    Image.fromarray(pixels).save(folder / "body.png")
    legend = {"black": "ice", "white": "rigid"}
    return Scene.from_image(folder / "body.png", legend=legend, cell_size=0.1)


def test_a_small_image_is_saved_as_a_drawing(tmp_path):
    scene = painted(tmp_path).replace(loading="continue")
    scene.save(tmp_path / "scene.toml")
    (tmp_path / "body.png").unlink()
    assert 'drawing = """\n####\n####\n====\n"""' in (tmp_path / "scene.toml").read_text()
    assert load_scene(tmp_path / "scene.toml") == scene


def test_images_and_arrays_are_found_beside_the_scene(tmp_path):
    scene = painted(tmp_path)
    (tmp_path / "scene.toml").write_text(
        '[body]\nimage = "body.png"\ncell_size = 0.1\n[legend]\nblack = "ice"\nwhite = "rigid"\n'
    )
    assert load_scene(tmp_path / "scene.toml") == scene
    np.save(tmp_path / "body.npy", np.array([[2, 1, 1]] * 4))
    text = '[body]\narray = "body.npy"\ncell_size = 0.1\n[legend]\n1 = "ice"\n2 = "rigid"\n'
    (tmp_path / "scene.toml").write_text(text)
    assert load_scene(tmp_path / "scene.toml") == scene
    assert Scene.from_toml(text, folder=tmp_path) == scene


@pytest.mark.parametrize("shape", [(200, 150), (2, 3, 4)])
def test_a_large_array_is_saved_beside_the_scene(tmp_path, shape):
    codes = np.arange(np.prod(shape)).reshape(shape) % 2
    scene = Scene.from_array(codes, legend={0: "ice", 1: "rigid"}, cell_size=0.1)
    with pytest.raises(SceneError, match=r"body.array: is too large, or has too many axes"):
        scene.to_toml()
    scene.save(tmp_path / "scene.toml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scene.cells.npy", "scene.toml"]
    assert load_scene(tmp_path / "scene.toml") == scene
    assert Scene.from_archive(*scene.to_archive()) == scene


def test_a_region_image_is_found_from_the_new_place(tmp_path):
    painted(tmp_path)
    scene = loaded([4, 3], regions=[{"image": {"file": tmp_path / "body.png"}, "material": "cork"}])
    (tmp_path / "inner").mkdir()
    scene.save(tmp_path / "inner" / "scene.toml")
    assert '"../body.png"' in (tmp_path / "inner" / "scene.toml").read_text()
    again = load_scene(tmp_path / "inner" / "scene.toml")
    assert np.array_equal(again.rasterise(), scene.rasterise())
