"""The lattice builders, and the continuum that lattices stand for."""

import numpy as np
import pytest

from kaju.errors import ParameterError
from kaju.model.network import (
    face_centred,
    random_geometric,
    spring_lengths_and_directions,
    square_braced,
    triangular,
)


def springs_per_node(network):
    return np.bincount(network.springs.ravel(), minlength=len(network.positions))


@pytest.mark.parametrize(
    ("width", "rows", "nodes"), [(3, 3, 8), (5, 5, 23), (9, 9, 77), (4, 2, 7), (3, 2, 5)]
)
def test_rows_of_a_triangular_lattice_have_one_node_less_in_turn(width, rows, nodes):
    network = triangular(width, rows)
    assert len(network.positions) == nodes
    assert network.initial_length == pytest.approx(1.0)


def test_the_triangular_lattice_of_the_description():
    network = triangular(5, force=0.1)
    names = np.array(network.names)
    held = names[network.held.all(axis=1)].tolist()
    assert held == [[0, 0], [0, 4], [2, 0], [2, 4], [4, 0], [4, 4]]
    pressed = {
        tuple(n): f.tolist() for n, f in zip(names, network.forces[0], strict=True) if any(f)
    }
    assert pressed == {(0, 2): [0.0, 0.1], (4, 2): [0.0, -0.1]}
    assert set(network.stiffness) == {1.0}
    assert np.array_equal(network.rest_length, network.initial_length)
    assert springs_per_node(network)[network.node((2, 2))] == 6


def test_two_middle_nodes_share_the_force():
    network = triangular(4, 5, force=0.1)
    pressed = network.forces[0, :, 1]
    assert sorted(pressed[pressed != 0.0]) == [-0.05, -0.05, 0.05, 0.05]


def test_neighbours_of_the_triangular_lattice_are_the_nodes_one_spacing_away():
    network = triangular(6, 7, spacing=2.0)
    distance = np.linalg.norm(network.positions[:, None] - network.positions, axis=2)
    near = {frozenset(pair) for pair in np.argwhere(np.isclose(distance, 2.0)).tolist()}
    assert {frozenset(pair) for pair in network.springs.tolist()} == near
    assert len(network.springs) == len(near)


def test_the_block_of_face_centred_cubes():
    network = face_centred(3, 3, 3, edge=2.0)
    assert len(network.positions) == 4 * 27 + 6 * 9 + 6 * 3 // 2 + 1
    assert springs_per_node(network).max() == 12
    assert network.initial_length == pytest.approx(np.sqrt(2.0))
    assert network.forces.sum(axis=(0, 1)) == pytest.approx([0.0, 0.0, -0.1])
    assert springs_per_node(network).min() == 3


def test_the_square_lattice_has_sides_and_braces():
    network = square_braced(4, 3, stiffness=2.0)
    assert len(network.springs) == 3 * 3 + 4 * 2 + 2 * 3 * 2
    assert network.stiffness[network.initial_length > 1.2].tolist() == [1.0] * 12
    assert network.held.all(axis=1).sum() == 4


@pytest.mark.parametrize("dimension", [2, 3])
def test_random_networks_repeat_with_their_seed(dimension):
    one, same, other = (random_geometric(60, dimension=dimension, seed=s) for s in (4, 4, 5))
    assert np.array_equal(one.positions, same.positions)
    assert np.array_equal(one.springs, same.springs)
    assert not np.array_equal(one.positions, other.positions)
    assert springs_per_node(one).min() >= dimension
    assert one.solve(2).residual.max() < 1e-12


def test_close_points_are_joined():
    network = random_geometric(50, radius=0.3)
    distance = np.linalg.norm(network.positions[:, None] - network.positions, axis=2)
    close = {(i, j) for i, j in np.argwhere(distance < 0.3).tolist() if i < j}
    assert close <= {tuple(pair) for pair in network.springs.tolist()}


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: triangular(1), "width: must be at least 2"),
        (lambda: triangular(4, 1), "rows: must be at least 2"),
        (lambda: triangular(2, 3), "at 2 only held nodes are pressed"),
        (lambda: triangular(4, spacing=0.0), "spacing: must be a length above 0"),
        (lambda: triangular(4, stiffness=-1.0), "stiffness of spring 0"),
        (lambda: square_braced(1, 4), "columns"),
        (lambda: face_centred(0, 1, 1), "columns"),
        (lambda: random_geometric(5), "nodes: must be at least 20"),
        (lambda: random_geometric(50, dimension=4), "dimension: must be 2 or 3"),
    ],
)
def test_what_cannot_be_built_is_named(build, message):
    with pytest.raises(ParameterError, match=message):
        build()


def affine_energy(network, gradient):
    """Energy that a small even strain stores in the springs of an inner part, per node."""
    inner = springs_per_node(network) == springs_per_node(network).max()
    _, direction = spring_lengths_and_directions(network.positions, network.springs)
    stretch = network.initial_length * np.einsum("ia,ab,ib->i", direction, gradient, direction)
    energy = 0.5 * network.stiffness * stretch**2
    per_node = np.zeros(len(network.positions))
    for end in (0, 1):
        np.add.at(per_node, network.springs[:, end], 0.5 * energy)
    return per_node[inner].mean()


@pytest.mark.parametrize(
    ("network", "area"),
    [(triangular(9, stiffness=3.0), np.sqrt(3.0) / 2.0), (square_braced(7, 7, stiffness=3.0), 1.0)],
)
def test_the_lattice_is_an_isotropic_sheet_with_a_poissons_ratio_of_a_third(network, area):
    stretch, shear = np.diag([1.0, 0.0]), np.array([[0.0, 0.5], [0.5, 0.0]])
    c11 = 2.0 * affine_energy(network, stretch) / area
    c66 = 2.0 * affine_energy(network, shear) / area
    both = 2.0 * affine_energy(network, np.eye(2)) / area
    c12 = both / 2.0 - c11
    assert c12 / c11 == pytest.approx(1.0 / 3.0)
    assert c66 == pytest.approx((c11 - c12) / 2.0)
    if area < 1.0:
        assert c11 - c12**2 / c11 == pytest.approx(2.0 * 3.0 / np.sqrt(3.0))
