"""Mechanisms, buckling and elements turned inside out are reported, never hidden."""

import numpy as np
import pytest

from kaju import NetworkModel, SpringNetwork
from kaju.errors import BucklingError, ConvergenceError, MechanismError
from kaju.model.network import load_in_increments, solve, triangular


def chain(force, braced=False):
    """Two springs in a line, pressed at the free end, held aside there but not in the middle."""
    positions, springs = [[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]]
    held, forces = [[1, 1], [0, 0], [0, 1]], [[0, 0], [0, 0], [force, 0]]
    stiffness = [1.0, 1.0]
    if braced:  # soft springs across hold the middle against slipping aside
        positions += [[1, 50], [1, -50]]
        springs += [[1, 3], [1, 4]]
        held += [[1, 1], [1, 1]]
        forces += [[0, 0], [0, 0]]
        stiffness += [0.05, 0.05]
    return SpringNetwork.build(positions, springs, stiffness, held=held, forces=forces)


def test_a_loose_node_is_named_among_many():
    lattice = triangular(6)
    loose = len(lattice.positions)
    network = SpringNetwork.build(
        np.concatenate([lattice.positions, [[2.5, 9.0]]]),
        np.concatenate([lattice.springs, [[loose - 1, loose]]]),
        held=np.concatenate([lattice.held, [[False, False]]]),
        forces=np.concatenate([lattice.forces, np.zeros((1, 1, 2))], axis=1),
    )
    with pytest.raises(MechanismError) as caught:
        solve(network)
    assert caught.value.nodes == (loose,)


def test_a_braced_chain_buckles_at_its_critical_force():
    """The middle slips aside once 2 P/L exceeds the stiffness of the braces, 0.1."""
    critical = 0.1 / (2.0 + 0.1)  # L = 1 - P, so 2 P = 0.1 (1 - P)
    held = solve(chain(-0.99 * critical, braced=True), 10)
    assert held.displacement[-1, 1, 1] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(BucklingError, match="buckles: under its pressed springs the nodes 1 ") as e:
        solve(chain(-2.0 * critical, braced=True), 10)
    assert e.value.nodes == (1,)
    reached = e.value.result
    assert reached.stage[-1] == pytest.approx(0.5, abs=1e-3)
    assert reached.tension[-1, 0] == pytest.approx(-critical, rel=3e-3)


def test_what_was_computed_before_a_lattice_gave_way_is_handed_over():
    model = NetworkModel(triangular(5, force=1.0), 10)
    with pytest.raises(BucklingError) as caught:
        model.run()
    assert not model.running
    reached = caught.value.result
    assert model.result().stage[-1] == model.stage == reached.stage[-1]
    assert reached.stage[:4] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert 0.399 < reached.stage[-1] < 0.4
    assert (4, 2) in caught.value.nodes
    same = solve(triangular(5, force=reached.stage[-1]), 10)
    assert same.displacement[-1] == pytest.approx(reached.displacement[-1], abs=1e-8)


def test_an_arch_snaps_through_at_its_limit():
    """A shallow arch of two springs carries 2K (λ/L − 1) h/L at height h, at most so much."""
    rise = 0.3
    heights = np.linspace(0.0, rise, 100_001)
    length = np.hypot(1.0, heights)
    limit = (2.0 * (np.hypot(1.0, rise) / length - 1.0) * heights).max()

    def arch(force):
        return SpringNetwork.build(
            [[-1, 0], [0, rise], [1, 0]],
            [[0, 1], [1, 2]],
            held=[[1, 1], [1, 0], [1, 1]],
            forces=[[0, 0], [0, -force], [0, 0]],
        )

    assert solve(arch(0.995 * limit), 10).residual.max() < 1e-12
    with pytest.raises(BucklingError) as caught:
        solve(arch(2.0 * limit), 10)
    assert caught.value.result.stage[-1] == pytest.approx(0.5, abs=2e-3)


def test_a_triangle_pulled_through_its_base_is_reported():
    corners, sides = [[0, 0], [2, 0], [1, 1]], [[0, 1], [1, 2], [2, 0]]
    moved = [[0, 0], [0, 0], [0, -3]]
    network = SpringNetwork.build(corners, sides, held=[1] * 3, displacements=moved, names="abc")
    result = solve(network, 30)
    assert result.triangles_turned_over(9) == []
    assert [set(corners) for corners in result.triangles_turned_over()] == [{"a", "b", "c"}]
    assert result.summary()["triangles_turned_over"] == 1
    assert result.triangles_turned_over(0) == []


def test_without_correction_what_gives_way_is_seen_too():
    with pytest.raises(ConvergenceError, match="take more than 2 increments"):
        load_in_increments(triangular(5, force=4.0), 2)
    with pytest.raises(ConvergenceError, match="snaps through"):
        load_in_increments(triangular(5, force=0.5), 40)
    with pytest.raises(BucklingError):
        load_in_increments(chain(-0.1, braced=True), 40)
    with pytest.raises(MechanismError, match="a mechanism: the nodes 1 ") as caught:
        solve(chain(0.1))
    assert caught.value.nodes == (1,)
