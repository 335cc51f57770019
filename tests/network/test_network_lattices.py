"""The lattice builders, and the continuum that lattices stand for."""

import numpy as np
import pytest

from kaju.errors import ParameterError
from kaju.model.network import spring_lengths_and_directions, triangular


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


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: triangular(1), "width: must be at least 2"),
        (lambda: triangular(4, 1), "rows: must be at least 2"),
        (lambda: triangular(2, 3), "at 2 only held nodes are pressed"),
        (lambda: triangular(4, spacing=0.0), "spacing: must be a length above 0"),
        (lambda: triangular(4, stiffness=-1.0), "stiffness of spring 0"),
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


def test_the_lattice_is_an_isotropic_sheet_with_a_poissons_ratio_of_a_third():
    network, area = triangular(9, stiffness=3.0), np.sqrt(3.0) / 2.0
    stretch, shear = np.diag([1.0, 0.0]), np.array([[0.0, 0.5], [0.5, 0.0]])
    c11 = 2.0 * affine_energy(network, stretch) / area
    c66 = 2.0 * affine_energy(network, shear) / area
    both = 2.0 * affine_energy(network, np.eye(2)) / area
    c12 = both / 2.0 - c11
    assert c12 / c11 == pytest.approx(1.0 / 3.0)
    assert c66 == pytest.approx((c11 - c12) / 2.0)
    assert c11 - c12**2 / c11 == pytest.approx(2.0 * 3.0 / np.sqrt(3.0))
