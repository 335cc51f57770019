"""Bodies: plates, drawings, images, arrays; what is where, and beyond the sides."""

import numpy as np
import pytest
from PIL import Image
from plates import PLATE_TEXT, loaded, plate

from kaju import PrescribedRule, Scene

AIR, RIGID = -1, -2

PLATE = f"""
{PLATE_TEXT.replace("[sides]", "thickness = 0.002" + chr(10) + "[sides]")}
steps = 20
[materials.steel]
youngs_modulus = 206e9
poissons_ratio = 0.3
[rule]
kind = "prescribed"
alpha = [0.5, 0.5, 0.25]
beta = 0.5
threshold = 0.01
"""
DRAWN = """
[body]
cell_size = 0.01
thickness = 0.005
drawing = '''
..##.
.###.
=====
'''
[legend]
"." = "air"
"#" = "rubber"
"=" = "rigid"
"""


def test_the_worked_plate():
    scene = Scene.from_toml(PLATE)
    assert scene.lattice.kind == "square"
    assert scene.lattice.shape == (20, 20)
    assert scene.lattice.cell_size == 0.01
    assert (scene.plane, scene.thickness, scene.stages) == ("stress", 0.002, 20)
    assert scene.rule == PrescribedRule((0.5, 0.5, 0.25), 0.5, 0.01)
    (steel,) = scene.cell_materials
    assert (steel.name, steel.youngs_modulus, steel.poissons_ratio) == ("steel", 206e9, 0.3)
    assert str(scene) == "20 x 20 squares of 0.01 m (steel), 1 load in 20 stages, prescribed rule"
    # It is material inside, and its sides outside.
    around = [[0, 0], [19, 19], [5, -1], [5, 20], [-1, 5], [20, 5]]
    assert scene.kinds(around).tolist() == [0, 0, RIGID, AIR, AIR, AIR]
    lower, upper = scene.bounds()
    assert (lower.tolist(), upper.tolist()) == ([0, 0], [20, 20])
    assert np.all(scene.rasterise() == 0)


def test_the_first_line_of_a_drawing_is_the_top():
    scene = Scene.from_toml(DRAWN)
    a, r = AIR, RIGID
    assert scene.rasterise().T[::-1].tolist() == [[a, a, 0, 0, a], [a, 0, 0, 0, a], [r] * 5]
    assert scene.kinds([[2, 2], [0, 0], [0, 2], [1, 1]]).tolist() == [0, RIGID, AIR, 0]
    lower, upper = scene.bounds()
    assert (lower.tolist(), upper.tolist()) == ([1, 1], [4, 3])


def test_cubes_from_a_file_of_codes(tmp_path):
    codes = np.zeros((2, 3, 4), dtype=np.uint8)
    codes[0] = 1
    np.save(tmp_path / "body.npy", codes)
    scene = Scene.from_array(tmp_path / "body.npy", legend={1: "steel", 0: "rigid"}, cell_size=0.1)
    assert scene.lattice.kind == "cube"
    assert (scene.plane, scene.thickness) == (None, 1.0)
    assert scene.rasterise()[0].tolist() == [[0] * 4] * 3
    assert scene.rasterise()[1].tolist() == [[RIGID] * 4] * 3


def test_an_image_is_read_by_its_colours(tmp_path):
    clear, red, blue = [0, 0, 0, 0], [255, 0, 0, 255], [18, 52, 86, 255]
    pixels = np.array([[clear, red, clear], [red, red, blue]], dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "body.png")
    legend = {"transparent": "air", "red": "rubber", "#123456": "rigid"}
    scene = Scene.from_image(tmp_path / "body.png", legend=legend, cell_size=0.01)
    assert scene.rasterise().T[::-1].tolist() == [[AIR, 0, AIR], [0, 0, RIGID]]


def test_a_giant_plate_costs_nothing_until_it_is_asked():
    hole = {"disk": {"centre": [5.0, 5.0], "radius": 1.0}, "material": "air"}
    scene = plate([10**6] * 2, [500_000, 10**6 - 1], cell_size=1e-5, regions=[hole])
    assert scene.kinds([[500_000, 500_000], [0, 0], [500_000, 10**6 - 1]]).tolist() == [AIR, 0, 0]
    assert scene.applied().cells.tolist() == [[500_000, 10**6 - 1]]
    with pytest.raises(ValueError, match=r"1000000 x 1000000 cells are more than the 2e"):
        scene.rasterise()


def test_equality_is_by_value():
    one = Scene.from_toml(PLATE)
    assert one == Scene.from_toml(PLATE)
    assert one == Scene.from_toml(PLATE.replace("size = [0.2, 0.2]", "cell_size = 0.01"))
    for was, is_now in (("-2.0", "-2.1"), ("206e9", "205e9"), ('"rigid"', '"roller"')):
        assert one != Scene.from_toml(PLATE.replace(was, is_now))
    assert one != 5
    drawn = Scene.from_toml(DRAWN)
    assert drawn == Scene.from_toml(DRAWN.replace("#", "o"))
    assert drawn != Scene.from_toml(DRAWN.replace("..##.", "..#.."))


@pytest.mark.parametrize("medium", ["air", "water", "gas", "vacuum"])
def test_all_media_beside_a_body_are_alike(medium):
    load = {"cell": [0, 1], "force": [0.0, -1.0]}
    scene = loaded("#~\n##", load, legend={"#": "steel", "~": medium})
    assert scene.rasterise().tolist() == [[0, 0], [0, AIR]]
    assert Scene.from_toml(scene.to_toml()) == scene
