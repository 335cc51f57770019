"""Bodies of hexagons as spring networks."""

import numpy as np
import pytest
from plates import loaded

from kaju.errors import SceneError
from kaju.model.network import hexagon_body, solve

LOAD = {"cell": [3, 4], "force": [0.0, -0.5]}


def body(load=LOAD, cells=(6, 5), ratio=1.0 / 3.0, **changes):
    """Hexagons of rubber on rigid ground, as a network."""
    rubber = {"youngs_modulus": 1e6, "poissons_ratio": ratio}
    usual = {"material": "rubber", "materials": {"rubber": rubber}, "thickness": 0.002}
    scene = loaded(list(cells), load, lattice="hexagon", **usual | changes)
    return hexagon_body(scene)


def test_every_cell_is_a_node_and_every_shared_face_a_spring():
    network = body()
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
    result = solve(body(), 4)
    assert result.residual.max() < 1e-12
    assert result.reactions().sum(axis=0) == pytest.approx([0.0, 0.5])


def test_a_sheet_under_even_pressure_has_the_materials_constants():
    pressure = 100.0
    load, sides = {"side": "top", "pressure": pressure}, dict.fromkeys(["bottom", "left"], "roller")
    network = body(load, (24, 25), sides=sides)
    result = solve(network, 1)
    x, y = network.positions.T
    inner = (np.abs(x - x.mean()) < 0.04) & (np.abs(y - y.mean()) < 0.04)
    plane = np.stack([x, y, 0 * x + 1], axis=1)[inner]
    strain = np.linalg.lstsq(plane, result.displacement[-1][inner], rcond=None)[0]
    assert pressure / -strain[1, 1] == pytest.approx(1e6, rel=0.03)
    assert -strain[0, 0] / strain[1, 1] == pytest.approx(1.0 / 3.0, rel=0.05)


def test_plane_strain_is_stiffer():
    stress, strain = (body(plane=plane, ratio=0.25) for plane in ("stress", "strain"))
    assert strain.stiffness[0] / stress.stiffness[0] == pytest.approx(1.0 / (1.0 - 0.25**2))
    assert strain.notes == ()
    assert "ratio 0.25" in stress.notes[0]
    assert solve(stress, 1).summary()["notes"] == list(stress.notes)


def test_a_wall_that_moves_takes_the_body_along():
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, -0.001]}}
    network = body({"cell": [3, 2], "force": [0.0, -1e-9]}, sides=sides)
    moved = network.displacements[0][:, 1]
    assert sorted(set(moved.tolist())) == [-0.001, 0.0]
    assert (moved != 0.0).sum() == 12
    result = solve(network, 1)
    assert result.reactions()[moved != 0.0, 1].sum() < 0.0


def test_loads_grow_by_the_scenes_stages():
    network = body(LOAD | {"steps": 5})
    assert network.stages == 5
    assert network.forces[:, network.node((3, 4)), 1] == pytest.approx(
        [-0.1, -0.2, -0.3, -0.4, -0.5]
    )


def test_two_materials_meet_over_half_a_spring_of_each():
    materials = {
        name: {"youngs_modulus": modulus, "poissons_ratio": 1.0 / 3.0}
        for name, modulus in (("steel", 1e6), ("rubber", 3e6))
    }
    load, how = {"cell": [1, 1], "force": [0.0, -1.0]}, {"lattice": "hexagon", "thickness": 1.0}
    scene = loaded("aabb\n====", load, materials=materials, sides={}, **how)
    network = hexagon_body(scene)
    soft = np.sqrt(3.0) / 2.0 * 1e6
    inner = network.stiffness[(network.springs < 4).all(axis=1)]
    assert inner == pytest.approx([soft, 1.5 * soft, 3.0 * soft])


def test_cells_of_squares_are_refused():
    with pytest.raises(SceneError, match='set lattice = "hexagon"'):
        hexagon_body(loaded([3, 3]))


def test_an_elastic_foundation_is_refused():
    with pytest.raises(SceneError, match=r"sides\.bottom: a spring network has no"):
        body(sides={"bottom": {"stiffness": 1e6}})
