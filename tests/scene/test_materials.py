"""A file of materials for several scenes, and errors that name the line of a key."""

from math import inf, nan

import pytest
from plates import loaded

from kaju import Material, Scene, load_scene, material
from kaju.errors import ParameterError, SceneError, SceneFileError

LAB = """\
# Measured here.
[agar]
youngs_modulus = 30e3
poissons_ratio = 0.49

["stiff steel"]
base = "steel"
youngs_modulus = 210e9
"""
SCENE = """\
materials = "lab.toml"

[body]
cell_size = 0.01
drawing = '''
aas
aas'''

[legend]
a = "agar"
s = "stiff steel"

[sides]
bottom = "rigid"

[[loads]]
cell = [0, 1]
force = [0.0, -1.0]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "lab.toml").write_text(LAB)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def test_scenes_share_a_file_of_materials(folder, typed):
    scene = load_scene(folder / "scene.toml")
    agar, steel = scene.cell_materials
    assert (agar.name, agar.youngs_modulus, agar.poissons_ratio) == ("agar", 30e3, 0.49)
    assert (steel.name, steel.youngs_modulus, steel.density) == ("stiff steel", 210e9, 7850.0)
    assert Scene.from_toml(SCENE, folder) == scene
    again = Scene.from_toml(scene.to_toml())
    assert again == scene, "written whole, it needs no other file"
    assert "steel" in typed("materials").output


def test_python_takes_the_file_too(folder):
    other_scene = folder / "other.toml"
    other_scene.write_text("[materials.agar]\nyoungs_modulus = 1e3\npoissons_ratio = 0.3\n[body]\n")
    lab = folder / "lab.toml"
    for path, modulus in ((lab, 30e3), (str(lab), 30e3), (other_scene, 1e3)):
        scene = loaded([2, 2], material="agar", materials=path)
        assert scene.cell_materials[0].youngs_modulus == modulus


@pytest.mark.parametrize(("lab", "told"), [
    (LAB.replace("0.49", "0.9"), r"lab.toml: line 4: agar.poissons_ratio: must lie"),
    (LAB.replace("base", "bass"), r"line 7: stiff steel.bass: .*did you mean 'base'"),
    ("x = 1\n", "must hold a table for each material"),
    ("[agar\n", "line 1 is not valid TOML"),
    (None, "lab.toml: cannot be read: No such file"),
])  # fmt: skip
def test_wrong_files_of_materials_are_named(folder, lab, told):
    if lab is None:
        (folder / "lab.toml").unlink()
    else:
        (folder / "lab.toml").write_text(lab)
    with pytest.raises(SceneFileError if lab is None else SceneError, match=told):
        load_scene(folder / "scene.toml")


@pytest.mark.parametrize(("right", "wrong", "told"), [
    ("cell = [0, 1]", "cel = [0, 1]", "scene.toml: line 17: loads.0.cel: unknown key"),
    ('bottom = "rigid"', '"bottom" = "stuck"', "line 14: sides.bottom"),
])  # fmt: skip
def test_errors_of_a_file_name_the_line(folder, right, wrong, told):
    (folder / "scene.toml").write_text(SCENE.replace(right, wrong))
    with pytest.raises(SceneError, match=told):
        load_scene(folder / "scene.toml")


@pytest.mark.parametrize(("key", "told"), [
    ("threshold", "did you mean rule.threshold"),
    ("force", "did you mean loads.0.force"),
    ("qqqqqq", "known are body, legend, materials"),
])  # fmt: skip
def test_keys_that_belong_elsewhere_are_told_where(folder, key, told):
    scene = load_scene(folder / "scene.toml")
    with pytest.raises(SceneError, match=f"{key.partition('.')[0]}: .*{told}"):
        scene.with_overrides({key: 1})


NAMES = "steel aluminium copper glass concrete oak rubber ice granite cartilage noodle cork bone"


@pytest.mark.parametrize("name", [*NAMES.split(), "soft tissue"])
def test_the_usual_materials_have_name_density_and_source(name):
    entry = material(name)
    assert entry.name == name
    assert entry.density > 0.0
    assert len(entry.source) > 10


def test_a_near_spelling_is_suggested_and_none_for_what_is_far_from_all():
    with pytest.raises(ParameterError, match=r"no 'stele' \(did you mean 'steel'\?\); it has"):
        material("stele")
    with pytest.raises(ParameterError, match=r"the library has no 'xyz'; it has"):
        material("xyz")


@pytest.mark.parametrize(("name", "told", "values"), [
    ("youngs_modulus", "must be above 0 Pa, got", [0.0, -1.0, nan, inf]),
    ("poissons_ratio", "must lie above -1 and up to 0.5", [-1.0, 0.5000001, nan, -inf]),
    ("density", "must be above 0 kg/m³", [0.0, -1.0, nan, inf]),
])  # fmt: skip
def test_numbers_have_ranges(name, told, values):
    for value in values:
        with pytest.raises(ParameterError, match=f"{name}: {told}"):
            Material(**{"name": "m", "youngs_modulus": 1.0, "poissons_ratio": 0.3, name: value})
