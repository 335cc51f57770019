"""Displacement and stress between the agents, on faces, walls and surfaces."""

from itertools import product

import numpy as np
import pytest
from goal_bodies import plate as worked_plate
from spawning_bodies import STEEL, drawn, spawned_by, under_a_patch

from kaju import solve


def plate(**others):
    load = {"region": {"box": [[0.09, 0.2], [0.11, 0.2]]}, "force": [0.0, -2.0]}
    return worked_plate(**{"loads": [load]} | others)


@pytest.mark.parametrize(
    "scene", [plate(), under_a_patch(3, force=(0.3, 0.0, -1.0))], ids=["plate", "block"]
)
def test_body_does_not_leave_a_wall(scene):
    result = spawned_by(scene, tolerance=0.3)
    size = scene.lattice.size ** (1 / scene.lattice.dimension) * scene.lattice.cell_size
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, size, size=(300, scene.lattice.dimension))
    points = np.concatenate([points, np.array(list(product((0.0, size), repeat=points.shape[1])))])
    points[:, -1] = 0.0
    assert np.all(result.displacement_at(points) == 0.0)
    points[:, -1] = 1e-4 * result.size.min()
    assert np.abs(result.displacement_at(points)).max() < 1e-3 * result.max_displacement


def test_rigid_cells_inside_stand_still():
    rows = ["a" * 8] * 3 + ["aaa==aaa"] * 2 + ["a" * 8] * 3
    scene = drawn(rows, [STEEL], [{"side": "top", "force": [1.0, -2.0]}], sides={})
    result = spawned_by(scene, tolerance=0.2)
    around = np.linspace(0.03, 0.05, 41)
    for fixed, axis in product((0.03, 0.05), (0, 1)):
        points = np.insert(around[:, None], axis, fixed, axis=1)
        assert np.all(result.displacement_at(points) == 0.0)


def test_ends_of_a_loaded_surface_are_as_accurate_as_the_rest():
    scene = plate()
    fine = solve(scene, resolution=32)
    result = spawned_by(scene, tolerance=0.003)
    x = np.linspace(0.08, 0.12, 81)
    top = np.stack([x, np.full(81, 0.2)], axis=1)
    true = fine.displacement_at(top)
    error = np.abs(result.displacement_at(top) - true).max() / np.abs(true).max()
    assert error < 2e-3, "of which the equal cells are off by a third"
    below = result.displacement_at(top - [0.0, 0.01]) - fine.displacement_at(top - [0.0, 0.01])
    assert np.abs(below).max() / np.abs(true).max() < 1.5e-3
