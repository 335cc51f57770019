"""Networks of three-element springs in time."""

import numpy as np
import pytest
from exact_creep import exactly_crept, exactly_relaxed

from kaju import History, SpringNetwork, ThreeElement, creep
from kaju.errors import MechanismError

ELEMENT = ThreeElement(K_f=2.0, D_f=3.0, D_d=15.0)
BITE = History().ramp(1.0, 0.2).hold(2.0).release(0.1).hold(6.0)
TIMES = np.array([0.2, 0.5, 1.0, 2.2, 2.3, 3.0, 5.0, 8.3])


def truss(force=(0.01, -0.3), stiffness=2.0):
    """Two springs that lean on each other over a held base."""
    return SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0], [0.5, 0.8]],
        [[0, 2], [1, 2]],
        stiffness,
        held=[True, True, False],
        forces=[[0.0, 0.0], [0.0, 0.0], force],
    )


def rod():
    """Three springs of different stiffness in a row, pulled at the end."""
    return SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0], [2.5, 0.0], [3.0, 0.0]],
        [[0, 1], [1, 2], [2, 3]],
        [2.0, 6.0, 1.0],
        held=[[True, True], [False, True], [False, True], [False, True]],
        forces=[[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.5, 0.0]],
    )


def test_each_spring_may_have_its_own_element():
    elements = [ELEMENT, ThreeElement(6.0), ThreeElement(0.0, 1.0)]
    times = np.linspace(0.5, 10.0, 20)
    result = creep(rod(), BITE, 10.0, times=times, rheology=elements)
    stretch = np.diff(result.displacement[:, :, 0], axis=1)
    for column, element in zip(stretch.T, elements, strict=True):
        alone = exactly_crept(element, BITE.scaled(0.5), times)
        np.testing.assert_allclose(column, alone, atol=2e-4)


def test_a_rod_under_given_displacement_relaxes():
    network = SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0]], [[0, 1]], 2.0, held=[True, True],
        displacements=[[0.0, 0.0], [0.1, 0.0]],
    )  # fmt: skip
    result = creep(network, BITE, times=TIMES, tolerance=1e-4, rheology=ELEMENT)
    alone = exactly_relaxed(ELEMENT, BITE, TIMES)
    np.testing.assert_allclose(result.force[:, 0], 0.1 * alone, atol=1e-4)
    np.testing.assert_allclose(result.grip_force(), result.force[:, 0])
    assert result.largest_force().title == "Force"


def test_small_loads_follow_the_correspondence_principle():
    times = np.array([0.5, 2.0, 8.0])
    small = truss(force=(1e-9, -3e-8), stiffness=3.0)
    elastic = creep(
        small, History.step(), 1.0, times=[1.0], rheology=ThreeElement.spring(2.0)
    ).displacement[0]
    crept = creep(
        small, History.step(), 8.0, times=times, rheology=ELEMENT, tolerance=1e-5
    ).displacement
    grown = exactly_crept(ELEMENT, 1.0, times) * ELEMENT.K_f
    np.testing.assert_allclose(crept, grown[:, None, None] * elastic, atol=1e-5 * 3e-8)


def test_a_bent_truss_stays_bent_by_what_flowed():
    result = creep(truss(), BITE, times=TIMES, rheology=ELEMENT)
    sunk = result.displacement[:, 2, 1]
    assert sunk[0] > sunk[3]  # it creeps while held
    assert sunk[3] < sunk[-1] < 0.0  # and recovers in part
    pull, push = result.largest_force().lines.values()
    np.testing.assert_array_equal(np.stack([push, pull], axis=1), np.sort(result.force))
    voigt = creep(truss(), BITE.hold(20.0), times=[28.3], rheology=ThreeElement(2.0, 3.0))
    assert abs(voigt.displacement[-1, 2, 1]) < 1e-4


@pytest.mark.filterwarnings("error")
def test_a_chain_without_stiffness_across_is_named():
    chain = SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [[0, 1], [1, 2]], 1.0,
        held=[True, False, False], forces=[[0.0, 0.0], [0.0, 0.0], [1e-3, 0.0]],
    )  # fmt: skip
    with pytest.raises(MechanismError, match="is a mechanism"):
        creep(chain, History.step(), 3.0, rheology=ELEMENT)
