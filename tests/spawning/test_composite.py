"""The staggered grid on leaves of several sizes keeps what it has on equal cells."""

import numpy as np
import pytest
from goal_bodies import plate
from spawning_bodies import by_themselves, settled_energy

from kaju import Scene, solve
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import interpolation
from kaju.model.elastic.pair.leaves import LeafCells, morton
from kaju.model.elastic.posed_body import PosedBody


def ragged(dimension, seed, sides=None):
    """A block of agents of four sizes, chosen by chance."""
    body = {
        "cells": [16] * dimension,
        "cell_size": 1.0,
        "allow_floating": True,
        "material": "steel",
    }
    ground = PosedBody(Scene(body=body, sides=sides or {}), None, at_cells=False)
    rng, leaves = np.random.default_rng(seed), ground.start()
    for step in range(3 if dimension == 2 else 2):
        chosen = rng.random(len(leaves)) < 0.15
        leaves = leaves.split(chosen, step + 1, np.zeros(len(leaves))).balanced(step + 1)
    return CompositeGrid(ground, leaves)


def linear(grid, slope):
    """Face displacements of a field that varies linearly: u_a = Σ slope[a, b] x_b."""
    place = grid.place / grid.ground.cell
    return np.einsum("fb,fb->f", slope[grid.axis], place)


@pytest.mark.parametrize("dimension", [2, 3])
def test_rigid_motions_strain_nothing(dimension):
    grid = ragged(dimension, seed=1)
    turn = np.zeros((dimension, dimension))
    turn[0, 1], turn[1, 0] = 1.0, -1.0
    balance = Equilibrium(grid)
    shift = (grid.axis == dimension - 1).astype(float)
    for u in (linear(grid, turn), shift):
        assert np.abs(balance.stiffness() @ u).max() < 1e-12 * np.abs(u).max()


@pytest.mark.parametrize("dimension", [2, 3])
def test_constant_stress_balances_on_leaves_of_all_sizes(dimension):
    """The patch test: inside the body no face feels a force, corners between sizes included."""
    grid = ragged(dimension, seed=2)
    assert len(np.unique(grid.leaves.size)) >= 3
    place = grid.place / grid.ground.cell
    inside = np.all((place > 2.01) & (place < 13.99), axis=1)
    force = Equilibrium(grid).stiffness() @ linear(
        grid, np.random.default_rng(3).normal(size=(dimension, dimension))
    )
    assert np.abs(force).max() > 0.1
    assert np.abs(force[inside]).max() < 1e-12


def test_stiffness_is_symmetric():
    matrix = Equilibrium(ragged(2, seed=4)).stiffness()
    assert abs(matrix - matrix.T).max() == 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_interpolation_is_exact_for_linear_fields(dimension):
    grid, rng = ragged(dimension, seed=5), np.random.default_rng(6)
    slope = rng.normal(size=(dimension, dimension))
    u = linear(grid, slope)
    # On a free surface the slope is taken from the strain that it must have: stay inside.
    points = rng.uniform(2.5, 13.5, size=(200, dimension)) * grid.ground.cell
    leaf = grid.leaves.find(np.floor(points).astype(np.int64))
    for axis in range(dimension):
        matrix, constant = interpolation(grid, points, leaf, axis)
        expected = points / grid.ground.cell @ slope[axis]
        np.testing.assert_allclose(matrix @ u + constant, expected, atol=1e-11)


SCENES = {
    "drag": plate(
        cells=[10, 10],
        loads=[{"region": {"box": [[0.1, 0.2], [0.2, 0.2]]}, "force": [1.0, -2.0]}],
    ),
    "hole, two materials, bed": plate(
        cells=[12, 12],
        plane="strain",
        regions=[
            {"material": "air", "disk": {"centre": [0.1, 0.1], "radius": 0.05}},
            {"material": "oak", "box": [[0.0, 0.0], [0.05, 0.05]]},
        ],
        materials={"oak": {"youngs_modulus": 1e10, "poissons_ratio": 0.3}},
        sides={"bottom": "rigid", "left": "roller", "right": {"stiffness": 1e9}},
        loads=[
            {"side": "top", "pressure": 1e5},
            {"cell": [1, 4], "force": [1.0, 2.0]},
            {"region": {"box": [[0.2, 0.1], [0.2, 0.15]]}, "force": [0.0, 5.0]},
        ],
    ),
    "displaced": plate(
        size=[0.1, 0.2],
        cells=[4, 8],
        sides={"bottom": "rigid", "top": {"displacement": [1e-5, -1e-4]}},
        loads=[],
    ),
    "cubes": Scene(
        body={
            "size": [0.1] * 3,
            "cells": [6] * 3,
            "material": "steel",
            "regions": [{"material": "air", "box": [[0, 0, 0.05], [0.05, 0.05, 0.1]]}],
        },
        sides={"bottom": "rigid"},
        loads=[
            {"side": "top", "force": [0.0, 0.0, -2.0]},
            {
                "region": {"box": [[0.0667, 0.0333, 0.1], [0.0833, 0.0667, 0.1]]},
                "force": [1.0, 0.5, 0.0],
            },
        ],
    ),
}


@pytest.mark.parametrize("name", [name for name in SCENES if name != "cubes"])
def test_agents_of_one_size_are_the_uniform_grid(name):
    scene = SCENES[name]
    uniform = solve(scene, tolerance=1e-12, strategy="uniform")
    spawned = solve(scene, tolerance=1e-6, resolution=1, strategy="spawning")
    cell = scene.lattice.cell_size
    np.testing.assert_allclose(spawned.size, cell, rtol=1e-12)
    assert settled_energy(spawned) == pytest.approx(settled_energy(uniform), rel=1e-9)
    for side, force in uniform.reactions.items():
        atol = 1e-8 * np.abs(force).max()
        np.testing.assert_allclose(spawned.reactions[side], force, rtol=1e-8, atol=atol)
    place = np.rint(spawned.lower / cell).astype(int) - np.asarray(uniform.cells().origin)
    expected = uniform.cells().stress[tuple(place.T)]
    stress = by_themselves(spawned).stress
    np.testing.assert_allclose(stress, expected, atol=1e-7 * np.abs(expected).max())


def test_morton_codes_keep_families_together():
    points = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    code = morton(points)
    assert sorted(code) == list(range(512))
    assert len(set(code[(points // 4 == 1).all(axis=1)] // 64)) == 1


def test_leaves_are_found_split_and_merged_again():
    zeros = np.zeros(4, dtype=np.int64)
    lower = np.array([[0, 0], [8, 0], [0, 8], [8, 8]])
    leaves = LeafCells.of(lower, zeros + 8, zeros, zeros, np.zeros(4))
    split = leaves.split(leaves.lower[:, 0] == 0, 1, np.arange(4.0))
    assert len(split) == 10
    at = split.find(np.array([[3, 3], [4, 3], [9, 2], [16, 0], [-1, 0]]))
    assert split.size[at[:3]].tolist() == [4, 4, 8]
    assert at[3:].tolist() == [-1, -1]
    assert split.step[at[:3]].tolist() == [1, 1, 0]
    np.testing.assert_array_equal(split.merged().lower, leaves.lower)


def test_neighbours_differ_by_two_at_most_and_not_at_all_between_materials():
    lower = np.array([[0, 0], [16, 0], [0, 16], [16, 16]])
    kind = np.array([0, 0, 0, 1])
    zeros = np.zeros(4, dtype=np.int64)
    leaves = LeafCells.of(lower, zeros + 16, kind, zeros, np.zeros(4))
    for _ in range(3):
        corner = leaves.find(np.array([[15, 15]]))
        chosen = np.arange(len(leaves)) == corner
        leaves = leaves.split(chosen, 1, np.zeros(len(leaves)))
    leaves = leaves.balanced(2)
    for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
        beside = leaves.find(leaves.lower + np.array(step) * leaves.size[:, None])
        there = beside >= 0
        ratio = leaves.size[there] / leaves.size[beside[there]]
        assert set(ratio) <= {0.5, 1.0, 2.0}
        other = leaves.kind[there] != leaves.kind[beside[there]]
        if 0 in step:
            assert set(ratio[other]) <= {1.0}
