"""The tangent and the forces, against the formula written out spring by spring."""

import numpy as np
import pytest

from kaju import SpringNetwork
from kaju.model.network import Assembler, face_centred, random_geometric, triangular


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


def test_tiny_displacements_keep_their_digits():
    network = SpringNetwork.build([[0, 0], [3, 4]], [[0, 1]], held=[True, False])
    displacement = np.array([[0.0, 0.0], [3e-18, 4e-18]])
    assert Assembler(network).geometry(displacement).elongation == pytest.approx(5e-18, rel=1e-14)


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
