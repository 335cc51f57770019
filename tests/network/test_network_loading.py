"""Networks under load: balance, paths, results; mechanisms and buckling are reported."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scattered import scattered

from kaju import NetworkModel, NetworkResult, SpringNetwork
from kaju.errors import BucklingError, ConvergenceError, ParameterError
from kaju.model.network import solve, triangular


def tip(result):
    """Displacement of the node that is pressed from above."""
    network = result.network
    top = network.positions[:, 1].max()
    pressed = np.flatnonzero(network.forces[-1].any(axis=1) & (network.positions[:, 1] == top))
    return result.displacement[-1, pressed[0], 1]


def test_without_correction_the_error_falls_with_the_increment():
    network = triangular(5, force=0.2)
    exact = tip(solve(network))
    errors = [abs(tip(NetworkModel(network, n, "euler").run()) - exact) for n in (5, 10, 20, 40)]
    assert errors == pytest.approx([7.4e-3, 3.9e-3, 2.0e-3, 1.0e-3], rel=0.02)
    slope = np.polyfit(np.log([5, 10, 20, 40]), np.log(errors), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.05)


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


def test_a_given_displacement_needs_the_force_that_gives_it():
    network = triangular(5)
    top = network.node((4, 2))
    held, shift = network.held.copy(), np.zeros_like(network.positions)
    held[top], shift[top, 1] = True, -0.2
    network = replace(network, held=held, displacements=shift[None], forces=0.0 * network.forces)
    pressed = solve(network, 4)
    reaction = pressed.reactions()[top]
    forces = np.zeros_like(network.positions)
    forces[top] = reaction
    loose = triangular(5).with_loads(forces)
    assert solve(loose, 4).displacement[-1] == pytest.approx(pressed.displacement[-1], abs=1e-11)
    assert pressed.work() == pytest.approx(pressed.strain_energy(), rel=1e-4)
    assert solve(network, 32).work() == pytest.approx(pressed.strain_energy(), rel=1e-9)


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


def test_unloaded_it_comes_back_and_the_work_done_is_stored():
    network = triangular(6, force=0.15)
    cycle = network.with_loads(np.stack([network.forces[-1], 0.0 * network.forces[-1]]))
    result = solve(cycle, 32)
    assert np.abs(result.displacement[32]).max() > 0.05
    assert result.work(1) == pytest.approx(result.strain_energy(32), rel=1e-9)
    assert np.abs(result.displacement[-1]).max() < 1e-13
    assert result.strain_energy() < 1e-25
    assert result.work() == pytest.approx(0.0, abs=1e-6 * result.work(1))


def in_a_line(stiffness, rest_length=None, end=(1, 1), force=0.0):
    """Two springs of 1 m from a support, guided along their line."""
    return SpringNetwork.build(
        [[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]], stiffness, rest_length,
        held=[[1, 1], [0, 1], end], forces=[[0, 0], [0, 0], [force, 0]],
    )  # fmt: skip


def test_two_springs_in_a_line_by_hand():
    network = in_a_line([2.0, 3.0], end=(0, 1), force=0.6)
    for result in (solve(network, 1), NetworkModel(network, 1, "euler").run()):
        assert result.displacement[-1, :, 0] == pytest.approx([0.0, 0.3, 0.5])
        assert result.tension[-1] == pytest.approx([0.6, 0.6])
        assert result.reactions()[0] == pytest.approx([-0.6, 0.0])
        assert result.strain_energy() == pytest.approx(0.5 * 0.6 * 0.5)
    # A middle node between two springs of rest lengths ½ and 1 goes where they pull alike.
    settled = solve(in_a_line(1.0, [0.5, 1.0]), 1)
    assert settled.displacement[0, 1, 0] == pytest.approx(-0.25)
    assert settled.tension[0] == pytest.approx([0.25, 0.25])
    with pytest.raises(ConvergenceError, match="rest_length: "):
        solve(in_a_line(1.0, [0.01, 5.0]))


def test_a_step_of_the_model_is_an_increment():
    model = NetworkModel(triangular(5), increments=4)
    assert (model.steps, model.stage, model.running) == (0, 0.0, True)
    model.step()
    assert (model.steps, model.stage, model.running) == (1, 0.25, True)
    assert model.run(1).increments == 2
    assert model.run(lambda now: now.stage > 0.6).increments == 3
    result = model.run(progress=False)
    model.step()
    assert (model.steps, model.stage, model.running) == (4, 1.0, False)
    assert np.array_equal(result.displacement, solve(triangular(5), 4).displacement)
    assert np.array_equal(model.positions, result.positions())
    for option in ({"increments": 0}, {"tolerance": 0.0}, {"scheme": "middle"}):
        with pytest.raises(ParameterError, match=next(iter(option))):
            NetworkModel(triangular(3), **option)


# What a result answers.


@pytest.fixture(scope="module")
def result():
    found = solve(triangular(5), 4)
    assert found.stage.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    return found


def test_a_saved_result_is_the_same(result, tmp_path):
    again = NetworkResult.load(result.save(tmp_path / "pressed"))
    for name in ("stage", "displacement", "tension", "residual", "corrections"):
        assert np.array_equal(getattr(again, name), getattr(result, name))
    assert again.summary() == result.summary()
    graph = again.to_graph()
    top = graph.nodes[4, 2]
    assert top["position"][1] == pytest.approx(top["pos"][1] + top["displacement"][1])
    solved = solve(SpringNetwork.from_graph(graph), 4)
    assert solved.displacement[-1] == pytest.approx(result.displacement[-1], abs=1e-13)


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


def test_a_braced_chain_buckles_at_its_critical_force():
    """The middle slips aside once 2 P/L exceeds the stiffness of the braces, 0.1."""
    critical = 0.1 / (2.0 + 0.1)  # L = 1 - P, so 2 P = 0.1 (1 - P)
    held = solve(chain(-0.99 * critical, braced=True), 10)
    assert held.displacement[-1, 1, 1] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(BucklingError, match="buckles: pressed springs let the node 1 ") as e:
        solve(chain(-2.0 * critical, braced=True), 10)
    assert e.value.nodes == (1,)
    reached = e.value.result
    assert reached.stage[-1] == pytest.approx(0.5, abs=1e-3)
    assert reached.tension[-1, 0] == pytest.approx(-critical, rel=3e-3)


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
