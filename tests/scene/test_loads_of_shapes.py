"""Pressure on edges of any shape, pressure that varies, couples, and sides moved one way."""

import numpy as np
import pytest
from plates import loaded

from kaju import Scene, solve
from kaju.errors import SceneError

SIZE = 0.01
HOLE = {"material": "air", "disk": {"centre": [0.1, 0.1], "radius": 0.041}}


def plate(*loads, cells=(20, 20), **others):
    return loaded(list(cells), *loads, cell_size=SIZE, thickness=0.5, **others)


def middles(scene):
    applied = scene.applied()
    normal = scene.lattice.normals[applied.direction] * (applied.direction >= 0)[:, None]
    return scene.lattice.centres(applied.cells) + 0.5 * SIZE * normal


RING = {"centre": [0.1, 0.1], "inner": 0.03, "outer": 0.05}
SHAPES = {
    "disk": {"disk": {"centre": [0.1, 0.1], "radius": 0.05}},
    "ring": {"ring": RING},
    "polygon": {"polygon": [[0.05, 0.05], [0.15, 0.05], [0.15, 0.15], [0.05, 0.15]]},
}


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_pressure_on_the_edge_of_a_hole_pushes_outwards_everywhere(name):
    scene = plate({"region": SHAPES[name], "pressure": 3e4}, regions=[HOLE])
    applied, places = scene.applied(), middles(scene)
    edge = np.linalg.norm(places - 0.1, axis=1)
    assert np.all((edge > 0.03) & (edge < 0.05))
    outwards = np.einsum("ij,ij->i", applied.force, places - 0.1)
    assert np.all(outwards > 0.0)
    np.testing.assert_allclose(applied.force.sum(axis=0), 0.0, atol=1e-9)
    assert np.abs(applied.force).max() == pytest.approx(3e4 * SIZE * 0.5)
    # all of the edge: the faces towards the hole, counted on the grid
    body = scene.rasterise() >= 0
    hole = ~body[4:16, 4:16]
    faces = sum(np.abs(np.diff(hole.astype(int), axis=axis)).sum() for axis in (0, 1))
    assert len(applied.force) == faces
    assert Scene.from_toml(scene.to_toml()) == scene


def test_pressure_grows_with_the_depth():
    water = {"side": "right", "pressure": 9810.0 * 0.2, "pressure_slope": [0.0, -9810.0]}
    scene = plate(water)
    applied, places = scene.applied(), middles(scene)
    expected = -9810.0 * (0.2 - places[:, 1]) * SIZE * 0.5
    np.testing.assert_allclose(applied.force[:, 0], expected, rtol=1e-12)
    assert applied.force[:, 0].sum() == pytest.approx(-0.5 * 9810.0 * 0.2**2 * 0.5)
    assert Scene.from_toml(scene.to_toml()) == scene


TOP = {"box": [[0.05, 0.2], [0.12, 0.2]]}


@pytest.mark.parametrize("place", [{"side": "top"}, {"region": SHAPES["polygon"]}, {"region": TOP}])
def test_a_couple_has_a_moment_and_no_force(place):
    scene = plate({**place, "couple": 7.0}, regions=[HOLE])
    applied, places = scene.applied(), middles(scene)
    np.testing.assert_allclose(applied.force.sum(axis=0), 0.0, atol=1e-9)
    x, y = (places - places.mean(axis=0)).T
    assert (x * applied.force[:, 1] - y * applied.force[:, 0]).sum() == pytest.approx(7.0)
    assert Scene.from_toml(scene.to_toml()) == scene


def test_a_couple_bends_a_bar_as_a_beam():
    """A bar of 40 × 8 cells, clamped below, bent by a couple on its top: u = M L²/(2 E I)."""
    scene = plate({"side": "top", "couple": 100.0}, cells=(8, 40), rule={"kind": "elastic"})
    tip = solve(scene, resolution=4).displacement_at(np.array([[0.04, 0.4]]))[0, 0]
    inertia = scene.cell_materials[0].youngs_modulus * 0.5 * 0.08**3 / 12.0
    assert tip == pytest.approx(-100.0 * 0.4**2 / (2.0 * inertia), rel=0.03)
    hole = {"disk": {"centre": [0.04, 0.04], "radius": 1e-3}, "material": "air", "outline": "true"}
    couple = {"side": "right", "couple": 100.0}
    lying = plate(couple, cells=(40, 8), regions=[hole], sides={"left": "rigid"})
    goal = solve(lying, tolerance=0.05, goal="right").goals[0]
    assert abs(goal.value[1] + tip) < goal.error_bound < 0.05 * abs(tip)
    slope = -12.0 * 100.0 / (0.5 * 0.08**3)  # of the pressure that has this moment
    water = {"side": "top", "pressure": -0.04 * slope, "pressure_slope": [slope, 0.0]}
    again = solve(plate(water, cells=(8, 40), regions=[hole]), tolerance=0.05, goal="top").goals[0]
    assert abs(again.value[0] - tip) < again.error_bound


def test_a_couple_in_space_turns_about_its_axis():
    scene = loaded([4, 4, 6], {"side": "top", "couple": [1.0, -2.0, 5.0]}, cell_size=0.1)
    applied = scene.applied()
    arm = scene.lattice.centres(applied.cells)
    arm = arm - arm.mean(axis=0)
    np.testing.assert_allclose(np.cross(arm, applied.force).sum(axis=0), [1.0, -2.0, 5.0])
    np.testing.assert_allclose(applied.force.sum(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("tolerance", [None, 0.05])
def test_a_side_moved_across_itself_lets_the_body_slide(tolerance):
    """Squeezed between rollers: a state of uniform stress, whatever the width does."""
    sides = {"bottom": "roller", "left": "roller", "top": {"displacement": ["free", -1.2e-5]}}
    scene = plate(cells=(8, 12), rule={"kind": "elastic"}, sides=sides)
    moved = solve(scene, tolerance).displacement_at(np.array([[0.08, 0.12], [0.04, 0.06]]))
    np.testing.assert_allclose(moved[:, 1], [-1.2e-5, -0.6e-5], rtol=1e-9)
    np.testing.assert_allclose(moved[:, 0], [0.3 * 0.8e-5, 0.3 * 0.4e-5], rtol=1e-8)
    assert Scene.from_toml(scene.to_toml()) == scene


@pytest.mark.parametrize(("load", "told"), [
    ({"region": {}, "pressure": 1.0}, "exactly one shape of box, disk, ball, ring, polygon"),
    ({"region": {"ball": {"centre": [0.1] * 3, "radius": 0.1}}, "pressure": 1.0}, "three dim"),
    ({"region": SHAPES["disk"], "pressure": 1.0}, "no free face"),
    ({"side": "top", "force": [0.0, 1.0], "couple": 1.0}, "got force, couple"),
    ({"side": "top", "couple": [1.0, 2.0, 3.0]}, "one number"),
    ({"cell": [3, 19], "couple": 1.0}, "a single cell has no lever"),
])  # fmt: skip
def test_what_cannot_act_is_refused(load, told):
    with pytest.raises(SceneError, match=told):
        plate(load)


@pytest.mark.parametrize("moved", [["free", "free"], [1e-5, "free"]])
def test_a_side_is_moved_across_itself_or_wholly(moved):
    with pytest.raises(SceneError, match=r"sides.top.displacement: .* one for y"):
        plate(sides={"bottom": "rigid", "top": {"displacement": moved}})
