"""A file of materials for several scenes, and errors that name the line of a key."""

import pytest
from plates import loaded

from kaju import Scene, load_scene
from kaju.errors import SceneError, SceneFileError

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


def test_scenes_share_a_file_of_materials(folder):
    scene = load_scene(folder / "scene.toml")
    agar, steel = scene.cell_materials
    assert (agar.name, agar.youngs_modulus, agar.poissons_ratio) == ("agar", 30e3, 0.49)
    assert (steel.name, steel.youngs_modulus, steel.density) == ("stiff steel", 210e9, 7850.0)
    assert Scene.from_toml(SCENE, folder) == scene
    again = Scene.from_toml(scene.to_toml())
    assert again == scene, "written whole, it needs no other file"


def test_python_takes_the_file_too(folder):
    other_scene = folder / "other.toml"
    other_scene.write_text("[materials.agar]\nyoungs_modulus = 1e3\npoissons_ratio = 0.3\n[body]\n")
    lab = folder / "lab.toml"
    for path, modulus in ((lab, 30e3), (str(lab), 30e3), (other_scene, 1e3)):
        scene = loaded([2, 2], material="agar", materials=path)
        assert scene.cell_materials[0].youngs_modulus == modulus


def test_single_values_of_shared_materials_can_be_changed(folder):
    scene = load_scene(folder / "scene.toml", {"materials.agar.youngs_modulus": 5e3})
    assert [m.youngs_modulus for m in scene.cell_materials] == [5e3, 210e9]


@pytest.mark.parametrize(
    ("lab", "told"),
    [
        (LAB.replace("0.49", "0.9"), r"lab.toml: line 4: agar.poissons_ratio: must lie"),
        (LAB.replace("30e3", "'soft'"), r"lab.toml: line 3: agar.youngs_modulus: must be a number"),
        (LAB.replace("base", "bass"), r"line 7: stiff steel.bass: .*did you mean 'base'"),
        ("x = 1\n", "must hold a table for each material"),
        ("[agar\n", "not valid TOML.*line 1"),
        (None, "lab.toml: cannot be read: No such file"),
    ],
)
def test_wrong_files_of_materials_are_named(folder, lab, told):
    if lab is None:
        (folder / "lab.toml").unlink()
    else:
        (folder / "lab.toml").write_text(lab)
    with pytest.raises(SceneFileError if lab is None else SceneError, match=told):
        load_scene(folder / "scene.toml")


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("cell = [0, 1]", "cel = [0, 1]", "scene.toml: line 17: loads.0.cel: unknown key"),
        ("force = [0.0, -1.0]", "force = [0.0]", "line 18: loads.0.force"),
        ("cell_size = 0.01", "cell_size = -1.0", "line 4: body.cell_size: must be above 0"),
        ('bottom = "rigid"', 'bottm = "rigid"', "line 14: sides.bottm"),
        ('bottom = "rigid"', '"bottom" = "stuck"', "line 14: sides.bottom"),
    ],
)
def test_errors_of_a_file_name_the_line(folder, right, wrong, told):
    (folder / "scene.toml").write_text(SCENE.replace(right, wrong))
    with pytest.raises(SceneError, match=told):
        load_scene(folder / "scene.toml")


def test_what_was_not_read_from_the_file_has_no_line(folder):
    with pytest.raises(SceneError, match=r"scene.toml: (line 3: )?body.cell_size: must be above 0"):
        load_scene(folder / "scene.toml", {"body.cell_size": -1.0})


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("threshold", "did you mean rule.threshold"),
        ("treshold", "did you mean rule.threshold"),
        ("cel_size", "did you mean body.cell_size"),
        ("force", "did you mean loads.0.force"),
        ("bdy.cells", "did you mean 'body'"),
        ("qqqqqq", "known are body, legend, materials"),
    ],
)
def test_keys_that_belong_elsewhere_are_told_where(folder, key, told):
    scene = load_scene(folder / "scene.toml")
    with pytest.raises(SceneError, match=f"{key.partition('.')[0]}: .*{told}"):
        scene.with_overrides({key: 1})
