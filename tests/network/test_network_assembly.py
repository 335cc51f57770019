"""The tangent and the forces, against the formula written out spring by spring."""

import numpy as np
import pytest

from kaju.model.network import Assembler, SpringNetwork, face_centred, random_geometric, triangular
from kaju.model.network.assembler import elimination_order


def looped(network, displacement, tension, stiffness):
    """The definition: B = k d dᵀ + (T/L)(1 − d dᵀ), added to the diagonal, taken off it."""
    n, dim = network.positions.shape
    tangent, force = np.zeros((n * dim, n * dim)), np.zeros((n, dim))
    x = network.positions + displacement
    for (i, j), t, k in zip(network.springs, tension, stiffness, strict=True):
        length = np.linalg.norm(x[i] - x[j])
        d = (x[i] - x[j]) / length
        block = k * np.outer(d, d) + t / length * (np.eye(dim) - np.outer(d, d))
        rows, columns = slice(i * dim, (i + 1) * dim), slice(j * dim, (j + 1) * dim)
        tangent[rows, rows] += block
        tangent[columns, columns] += block
        tangent[rows, columns] -= block
        tangent[columns, rows] -= block
        force[i] -= t * d
        force[j] += t * d
    return tangent, force


def partly_held():
    held = np.zeros((23, 2), dtype=bool)
    held[:4, 1] = held[0, 0] = True
    lattice = triangular(5)
    return SpringNetwork.build(lattice.positions, lattice.springs, held=held)


def doubled():
    lattice = triangular(3)
    springs = np.concatenate([lattice.springs, lattice.springs[:3, ::-1]])
    return SpringNetwork.build(lattice.positions, springs, held=lattice.held)


@pytest.mark.parametrize(
    "network",
    [triangular(5), partly_held(), doubled(), face_centred(1, 2, 1), random_geometric(30)],
)
def test_tangent_and_force_are_those_of_the_definition(network):
    rng = np.random.default_rng(3)
    displacement = 0.05 * rng.standard_normal(network.positions.shape)
    tension, stiffness = rng.standard_normal((2, len(network.springs)))
    assembler = Assembler(network)
    geometry = assembler.geometry(displacement)
    tangent, force = looped(network, displacement, tension, stiffness)
    free = assembler.free
    assert assembler.tangent(geometry, tension, stiffness).toarray() == pytest.approx(
        tangent[np.ix_(free, free)], abs=1e-13
    )
    assert assembler.internal_force(geometry, tension) == pytest.approx(force, abs=1e-13)
    step = rng.standard_normal(network.positions.shape)
    assert assembler.force_change(geometry, tension, stiffness, step).ravel() == pytest.approx(
        -tangent @ step.ravel(), abs=1e-12
    )
    assert assembler.resistance(geometry, tension, stiffness, step) == pytest.approx(
        step.ravel() @ tangent @ step.ravel()
    )


def test_the_tangent_is_how_the_force_changes():
    network = triangular(4)
    assembler = Assembler(network)
    rng = np.random.default_rng(5)
    displacement, step = 0.03 * rng.standard_normal((2, *network.positions.shape))
    step[network.held] = 0.0

    def force(u):
        return assembler.internal_force(
            assembler.geometry(u), network.stiffness * assembler.geometry(u).elongation
        )

    geometry = assembler.geometry(displacement)
    tangent = assembler.tangent(geometry, geometry.elongation, network.stiffness)
    h = 1e-5
    slope = (force(displacement + h * step) - force(displacement - h * step)) / (2 * h)
    assert tangent @ assembler.restrict(step) == pytest.approx(-assembler.restrict(slope), abs=1e-9)


def test_tiny_displacements_keep_their_digits():
    network = SpringNetwork.build([[0, 0], [3, 4]], [[0, 1]], held=[True, False])
    displacement = np.array([[0.0, 0.0], [3e-18, 4e-18]])
    assert Assembler(network).geometry(displacement).elongation == pytest.approx(5e-18, rel=1e-14)


def test_restrict_and_expand_undo_each_other():
    assembler = Assembler(partly_held())
    field = np.arange(46.0).reshape(23, 2)
    kept = assembler.expand(assembler.restrict(field))
    assert np.array_equal(kept, np.where(assembler.network.held, 0.0, field))


@pytest.mark.parametrize("nodes", [1, 30, 500])
def test_every_node_is_eliminated_once(nodes):
    positions = np.random.default_rng(nodes).random((nodes, 2))
    springs = np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1)
    assert sorted(elimination_order(positions, springs)) == list(range(nodes))


def test_the_order_keeps_the_factors_sparse():
    from scipy.sparse.linalg import splu

    def fill(network, order_by_position):
        assembler = Assembler(network)
        geometry = assembler.geometry(np.zeros_like(network.positions))
        tangent = assembler.tangent(geometry, 0 * network.stiffness, network.stiffness)
        if not order_by_position:
            rows = np.argsort(assembler.free)
            tangent = tangent[rows][:, rows].tocsc()
        options = {"SymmetricMode": True}
        return splu(tangent, "NATURAL", diag_pivot_thresh=0.0, options=options).nnz

    assert fill(triangular(60), True) < 0.6 * fill(triangular(60), False)
