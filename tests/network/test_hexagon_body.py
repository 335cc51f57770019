"""Bodies of hexagons as spring networks."""

import numpy as np
import pytest

from kaju.errors import SceneError
from kaju.model.network import SpringNetwork, hexagon_body
from kaju.model.scene import Scene


def scene(sides="", materials="", body="", loads="", cells="[6, 5]", ratio="0.3333333333"):
    return Scene.from_toml(
        f"""
        [body]
        cells = {cells}
        cell_size = 0.01
        lattice = "hexagon"
        material = "rubber"
        thickness = 0.002
        {body}
        [materials.rubber]
        youngs_modulus = 1e6
        poissons_ratio = {ratio}
        {materials}
        [sides]
        {sides or 'bottom = "rigid"'}
        {loads or "[[loads]]" + chr(10) + "cell = [3, 4]" + chr(10) + "force = [0.0, -0.5]"}
        """
    )


def test_every_cell_is_a_node_and_every_shared_face_a_spring():
    network = hexagon_body(scene())
    cells = 30
    contacts = 2 * 6  # two lower faces of each cell in the bottom row
    assert len(network.positions) == cells + contacts
    assert len(network.springs) == 6 * 5 - 5 + 4 * (2 * 6 - 1) + contacts
    stiffness = np.sqrt(3.0) / 2.0 * 1e6 * 0.002
    inner = (network.springs < cells).all(axis=1)
    assert network.stiffness[inner] == pytest.approx(stiffness)
    assert network.initial_length[inner] == pytest.approx(0.01)
    assert network.stiffness[~inner] == pytest.approx(2.0 * stiffness)
    assert network.initial_length[~inner] == pytest.approx(0.005)
    assert np.flatnonzero(network.held.all(axis=1)).tolist() == list(range(cells, cells + contacts))
    assert network.names[0] == (0, 0)
    assert network.names[cells] == (0, 0, 4)
    assert network.forces[0, network.node((3, 4))].tolist() == [0.0, -0.5]


def test_the_network_of_a_scene_is_solved_like_any_other():
    result = SpringNetwork.from_scene(scene()).solve(4)
    assert result.residual.max() < 1e-12
    assert result.reactions().sum(axis=0) == pytest.approx([0.0, 0.5])


def test_a_sheet_under_even_pressure_has_the_materials_constants():
    pressure = 100.0
    network = hexagon_body(
        scene(
            sides='bottom = "roller"\nleft = "roller"',
            loads=f'[[loads]]\nside = "top"\npressure = {pressure}',
            cells="[24, 25]",
        )
    )
    result = network.solve(1)
    x, y = network.positions.T
    inner = (np.abs(x - x.mean()) < 0.04) & (np.abs(y - y.mean()) < 0.04)
    plane = np.stack([x, y, 0 * x + 1], axis=1)[inner]
    strain = np.linalg.lstsq(plane, result.displacement[-1][inner], rcond=None)[0]
    assert pressure / -strain[1, 1] == pytest.approx(1e6, rel=0.03)
    assert -strain[0, 0] / strain[1, 1] == pytest.approx(1.0 / 3.0, rel=0.05)


def test_plane_strain_is_stiffer():
    stress, strain = (hexagon_body(scene(body=f'plane = "{p}"', ratio="0.25")) for p in PLANES)
    assert strain.stiffness[0] / stress.stiffness[0] == pytest.approx(1.0 / (1.0 - 0.25**2))
    assert strain.notes == ()
    assert "ratio 0.25" in stress.notes[0]
    assert stress.solve(1).summary()["notes"] == list(stress.notes)


PLANES = ("stress", "strain")

DRAWN = """
[body]
lattice = "hexagon"
cell_size = 0.01
thickness = 1.0
drawing = '''
aabb
====
'''
[legend]
a = "soft"
b = "hard"
"=" = "rigid"
[materials.soft]
youngs_modulus = 1e6
poissons_ratio = 0.3333333333
[materials.hard]
youngs_modulus = 3e6
poissons_ratio = 0.3333333333
[[loads]]
cell = [1, 1]
force = [0.0, -1.0]
"""


def test_a_wall_that_moves_takes_the_body_along():
    network = hexagon_body(
        scene(
            sides='bottom = "rigid"\ntop = {displacement = [0.0, -0.001]}',
            loads="[[loads]]\ncell = [3, 2]\nforce = [0.0, -1e-9]",
        )
    )
    moved = network.displacements[0][:, 1]
    assert sorted(set(moved.tolist())) == [-0.001, 0.0]
    assert (moved != 0.0).sum() == 12
    result = network.solve(1)
    assert result.reactions()[moved != 0.0, 1].sum() < 0.0


def test_loads_grow_by_the_scenes_stages():
    network = hexagon_body(scene(loads="[[loads]]\ncell = [3, 4]\nforce = [0.0, -0.5]\nsteps = 5"))
    assert network.stages == 5
    assert network.forces[:, network.node((3, 4)), 1] == pytest.approx(
        [-0.1, -0.2, -0.3, -0.4, -0.5]
    )


def test_two_materials_meet_over_half_a_spring_of_each():
    network = hexagon_body(Scene.from_toml(DRAWN))
    soft = np.sqrt(3.0) / 2.0 * 1e6
    inner = network.stiffness[(network.springs < 4).all(axis=1)]
    assert inner == pytest.approx([soft, 1.5 * soft, 3.0 * soft])


def test_cells_of_squares_are_refused():
    squares = Scene.from_toml(
        """
        [body]
        cells = [3, 3]
        size = [0.1, 0.1]
        material = "steel"
        [sides]
        bottom = "rigid"
        """
    )
    with pytest.raises(SceneError, match='set lattice = "hexagon"'):
        hexagon_body(squares)


def test_an_elastic_foundation_is_refused():
    with pytest.raises(SceneError, match=r"sides\.bottom: a spring network has no"):
        hexagon_body(scene(sides="bottom = {stiffness = 1e6}"))
