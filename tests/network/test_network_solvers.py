"""The two ways to solve with a tangent agree, and tell alike when it gives way."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from kaju import SpringNetwork
from kaju.errors import BucklingError, MissingExtraError
from kaju.model.network import Assembler, face_centred, square_braced, tangent_solver, triangular
from kaju.model.network.linear import (
    DirectSolver,
    MultigridSolver,
    SingularTangentError,
    rigid_body_modes,
)


@pytest.mark.parametrize(
    "network", [triangular(25), square_braced(20, 24), face_centred(4, 3, 4)], ids=["2", "2s", "3"]
)
def test_multigrid_and_factors_agree(network):
    direct = network.solve(2, method="direct")
    iterated = network.solve(2, method="multigrid")
    assert iterated.displacement == pytest.approx(direct.displacement, abs=1e-9)
    assert iterated.residual.max() < 1e-12
    assert direct.method == "sparse LU"
    assert "multigrid" in iterated.method


def test_rollers_do_not_stop_multigrid():
    lattice = square_braced(12, 12)
    held = lattice.held.copy()
    held[:12, 0] = False
    held[0, 0] = True
    network = replace(lattice, held=held)
    direct, iterated = (network.solve(1, method=m) for m in ("direct", "multigrid"))
    assert iterated.displacement == pytest.approx(direct.displacement, abs=1e-9)


def test_size_chooses_the_way(monkeypatch):
    assembler = Assembler(triangular(6))
    assert isinstance(tangent_solver(assembler), DirectSolver)
    monkeypatch.setattr("kaju.model.network.linear._DIRECT_UP_TO", {2: 10, 3: 10})
    assert isinstance(tangent_solver(assembler), MultigridSolver)
    assert isinstance(tangent_solver(assembler, "direct"), DirectSolver)


def test_without_pyamg_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyamg", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'kaju\[amg\]'"):
        triangular(4).solve(method="multigrid")


def test_both_ways_report_buckling():
    network = square_braced(4, 40, force=2.0)
    stages = []
    for method in ("direct", "multigrid"):
        with pytest.raises(BucklingError) as caught:
            network.solve(4, method=method)
        stages.append(caught.value.result.stage[-1])
        assert all(row > 20 for _, row in caught.value.nodes)
    assert stages[0] == pytest.approx(stages[1], rel=0.01)


@pytest.mark.parametrize("dimension", [2, 3])
def test_rigid_body_modes_stretch_no_spring(dimension):
    lattice = triangular(6) if dimension == 2 else face_centred(2, 2, 2)
    one = np.zeros(lattice.positions.shape, dtype=bool)
    one[0] = True
    network = SpringNetwork.build(lattice.positions, lattice.springs, held=one)
    assembler = Assembler(network)
    geometry = assembler.geometry(np.zeros(network.positions.shape))
    modes = rigid_body_modes(assembler)
    assert modes.shape[1] == (3 if dimension == 2 else 6)
    about_held = network.positions - network.positions[0]
    turn = np.zeros_like(about_held)
    turn[:, 0], turn[:, 1] = -about_held[:, 1], about_held[:, 0]
    tangent = assembler.tangent(geometry, 0.0 * network.stiffness, network.stiffness)
    assert np.abs(tangent @ assembler.restrict(turn)).max() < 1e-13
    restricted = assembler.restrict(turn)
    share, *_ = np.linalg.lstsq(modes, restricted, rcond=None)
    assert modes @ share == pytest.approx(restricted, abs=1e-12)


@pytest.mark.parametrize(
    ("matrix", "weak"),
    [
        (np.diag([2.0, 0.0, 3.0]), [0, 1, 0]),
        (np.diag([2.0, -1.0, 3.0]), [0, 1, 0]),
        (np.array([[0.0, 1.0], [1.0, 0.0]]), [1, -1]),
        (np.array([[1.0, -1.0], [-1.0, 1.0]]), [1, 1]),
        (np.array([[2.0, 0.0, -2.0], [0.0, 1.0, 0.0], [-2.0, 0.0, 2.0]]), [1, 0, 1]),
    ],
)
def test_factors_name_the_direction_that_gives_way(matrix, weak):
    from scipy.sparse import csc_array

    with pytest.raises(SingularTangentError) as caught:
        DirectSolver().factorise(csc_array(matrix))
    direction = caught.value.direction
    assert direction @ matrix @ direction <= 1e-12
    expected = np.array(weak) / np.linalg.norm(weak)
    if np.linalg.det(matrix) == 0.0:
        assert abs(direction @ expected) == pytest.approx(1.0)


@pytest.mark.slow
def test_a_hundred_thousand_nodes_come_into_balance():
    lattice = triangular(317)
    height = lattice.positions[:, 1]
    how = {"held": height == 0.0, "forces": np.zeros_like(lattice.positions)}
    how["forces"][height == height.max(), 1] = -0.001
    network = SpringNetwork.build(lattice.positions, lattice.springs, **how)
    direct, iterated = (network.solve(1, method=method) for method in ("direct", "multigrid"))
    assert direct.residual.max() < 1e-12
    assert iterated.residual.max() < 1e-12
    size = np.abs(direct.displacement).max()
    assert np.abs(iterated.displacement - direct.displacement).max() < 1e-8 * size
