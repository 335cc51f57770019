"""Loading a network: the figures of the method's description, and what must hold."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scattered import scattered

from kaju import SpringNetwork
from kaju.errors import ConvergenceError, ParameterError
from kaju.model.network import load_in_increments, solve, triangular


def tip(result):
    """Displacement of the node that is pressed from above."""
    network = result.network
    top = network.positions[:, 1].max()
    pressed = np.flatnonzero(network.forces[-1].any(axis=1) & (network.positions[:, 1] == top))
    return result.displacement[-1, pressed[0], 1]


def test_without_correction_the_error_falls_with_the_increment():
    network = triangular(5, force=0.2)
    exact = tip(solve(network))
    errors = [abs(tip(load_in_increments(network, n)) - exact) for n in (5, 10, 20, 40)]
    assert errors == pytest.approx([7.4e-3, 3.9e-3, 2.0e-3, 1.0e-3], rel=0.02)
    slope = np.polyfit(np.log([5, 10, 20, 40]), np.log(errors), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.05)


@pytest.mark.parametrize(("width", "share"), [(5, 0.0330), (9, 0.0216), (17, 0.0135), (33, 0.0081)])
def test_with_more_nodes_the_strain_is_a_smaller_share_of_the_height(width, share):
    result = solve(triangular(width, force=0.1))
    assert result.share_of_height() == pytest.approx(share, abs=5e-5)


@pytest.mark.parametrize("network", [triangular(7), scattered(80), scattered(60, dimension=3)])
def test_corrected_states_are_in_balance(network):
    result = solve(network, 4)
    assert result.residual.max() < 1e-12
    free = ~network.held
    for record in range(1, 5):
        forces = network.force_at(record / 4)
        pulled = nodal(result, record)
        assert np.abs((pulled + forces)[free]).max() < 1e-12 * np.abs(forces).max() * 10
        total = result.reactions(record).sum(axis=0) + forces.sum(axis=0)
        assert total == pytest.approx(0.0, abs=1e-13)


def nodal(result, record):
    """Forces of the springs on the nodes, straight from the definition."""
    network, x = result.network, result.positions(record)
    first, second = network.springs.T
    ends = x[first] - x[second]
    length = np.linalg.norm(ends, axis=1, keepdims=True)
    pull = -network.stiffness[:, None] * (length - network.rest_length[:, None]) * ends / length
    forces = np.zeros_like(x)
    np.add.at(forces, first, pull)
    np.add.at(forces, second, -pull)
    return forces


def test_the_state_does_not_depend_on_the_path():
    network = triangular(6, force=0.15)
    at_once, slowly = solve(network, 1), solve(network, 13)
    assert at_once.displacement[-1] == pytest.approx(slowly.displacement[-1], abs=1e-12)
    over, forces = [1.2, 0.3, 1.0], network.forces[-1]
    detour = solve(network.with_loads(np.multiply.outer(over, forces)), 3)
    assert detour.stage.tolist() == pytest.approx(np.arange(10) / 3)
    assert detour.displacement[-1] == pytest.approx(slowly.displacement[-1], abs=1e-12)


def test_unloaded_it_comes_back():
    network = triangular(6, force=0.15)
    cycle = network.with_loads(np.stack([network.forces[-1], 0.0 * network.forces[-1]]))
    result = solve(cycle, 4)
    assert np.abs(result.displacement[4]).max() > 0.05
    assert np.abs(result.displacement[-1]).max() < 1e-13
    assert result.strain_energy() < 1e-25
    assert result.work() == pytest.approx(0.0, abs=1e-6 * result.work(1))


def test_the_work_done_is_stored():
    result = solve(triangular(6, force=0.15), 32)
    assert result.work() == pytest.approx(result.strain_energy(), rel=1e-9)


def in_a_line(stiffness, rest_length=None, end=(1, 1), force=0.0):
    """Two springs of 1 m from a support, guided along their line."""
    return SpringNetwork.build(
        [[0, 0], [1, 0], [2, 0]],
        [[0, 1], [1, 2]],
        stiffness,
        rest_length,
        held=[[1, 1], [0, 1], end],
        forces=[[0, 0], [0, 0], [force, 0]],
    )


def test_two_springs_in_a_line_by_hand():
    network = in_a_line([2.0, 3.0], end=(0, 1), force=0.6)
    for result in (solve(network, 1), load_in_increments(network, 1)):
        assert result.displacement[-1, :, 0] == pytest.approx([0.0, 0.3, 0.5])
        assert result.tension[-1] == pytest.approx([0.6, 0.6])
        assert result.reactions()[0] == pytest.approx([-0.6, 0.0])
        assert result.strain_energy() == pytest.approx(0.5 * 0.6 * 0.5)


def test_a_node_drawn_down_between_two_walls_by_hand():
    """Two springs from (∓1, 0) meet in the middle; sunk by s they pull by 2K(L − 1) s/L."""
    sag = 0.75
    length = np.hypot(1.0, sag)
    force = 2.0 * (length - 0.8) * sag / length
    how = {"held": [True, False, True], "forces": [[0, 0], [0, -force], [0, 0]]}
    walls = [[-1, 0], [0, 0], [1, 0]]
    network = SpringNetwork.build(walls, [[0, 1], [1, 2]], 1.0, 0.8, **how)
    assert solve(network, 3).displacement[-1, 1] == pytest.approx([0.0, -sag], abs=1e-14)


def given_displacement(depth):
    network = triangular(5)
    top = network.node((4, 2))
    held = network.held.copy()
    held[top] = True
    shift = np.zeros_like(network.positions)
    shift[top, 1] = -depth
    return replace(network, held=held, displacements=shift[None], forces=0.0 * network.forces), top


def test_a_given_displacement_needs_the_force_that_gives_it():
    network, top = given_displacement(0.2)
    pressed = solve(network, 4)
    reaction = pressed.reactions()[top]
    forces = np.zeros_like(network.positions)
    forces[top] = reaction
    loose = triangular(5).with_loads(forces)
    assert solve(loose, 4).displacement[-1] == pytest.approx(pressed.displacement[-1], abs=1e-11)
    assert pressed.work() == pytest.approx(pressed.strain_energy(), rel=1e-4)
    assert solve(network, 32).work() == pytest.approx(pressed.strain_energy(), rel=1e-9)


def test_without_correction_a_given_displacement_is_met_too():
    network, top = given_displacement(0.2)
    exact = solve(network, 1).displacement[-1]
    errors = []
    for increments in (10, 20):
        found = load_in_increments(network, increments).displacement[-1]
        assert found[top] == pytest.approx([0.0, -0.2], abs=1e-15)
        errors.append(np.abs(found - exact).max())
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.2)


def test_springs_stretched_from_the_start_settle_first():
    """A middle node between two springs of rest lengths ½ and 1 goes where they pull alike."""
    result = solve(in_a_line(1.0, [0.5, 1.0]), 1)
    assert result.displacement[0, 1, 0] == pytest.approx(-0.25)
    assert result.tension[0] == pytest.approx([0.25, 0.25])


def test_rest_lengths_far_from_the_first_are_refused():
    with pytest.raises(ConvergenceError, match="rest_length: so far from the first lengths"):
        solve(in_a_line(1.0, [0.01, 5.0]))


def test_a_given_displacement_may_be_large_in_one_increment():
    network, top = given_displacement(0.6)
    at_once, slowly = solve(network, 1), solve(network, 12)
    assert at_once.displacement[-1] == pytest.approx(slowly.displacement[-1], abs=1e-11)
    assert at_once.corrections[-1] > 0
    assert at_once.displacement[-1, top, 1] == pytest.approx(-0.6)


def test_everything_held_leaves_nothing_to_solve():
    shift = [[0.0, 0.0], [0.1, 0.0]]
    network = SpringNetwork.build([[0, 0], [1, 0]], [[0, 1]], held=[1, 1], displacements=shift)
    result = solve(network, 2)
    assert result.tension[:, 0] == pytest.approx([0.0, 0.05, 0.1])
    assert result.reactions()[1] == pytest.approx([0.1, 0.0])


@settings(max_examples=25)
@given(angle=st.floats(0.0, 2.0 * np.pi), shift=st.floats(-50.0, 50.0))
def test_turning_and_shifting_the_network_turns_the_answer(angle, shift):
    network = triangular(4, force=0.1)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    loads = {"held": network.held, "forces": network.forces @ turn.T}
    turned = SpringNetwork.build(network.positions @ turn.T + shift, network.springs, **loads)
    expected = solve(network, 2).displacement[-1] @ turn.T
    assert solve(turned, 2).displacement[-1] == pytest.approx(expected, abs=1e-12)


@settings(max_examples=25)
@given(scale=st.floats(1e-6, 1e6), stiffness=st.floats(1e-6, 1e12))
def test_length_and_stiffness_only_set_the_units(scale, stiffness):
    plain = solve(triangular(4, force=0.1), 2)
    force = 0.1 * scale * stiffness
    other = solve(triangular(4, spacing=scale, stiffness=stiffness, force=force), 2)
    assert other.displacement[-1] / scale == pytest.approx(plain.displacement[-1], abs=1e-11)
    assert other.residual.max() < 1e-12


@pytest.mark.parametrize("options", [{"increments": 0}, {"tolerance": 0.0}])
def test_options_outside_their_rule_are_refused(options):
    with pytest.raises(ParameterError, match=next(iter(options))):
        solve(triangular(3), **options)
