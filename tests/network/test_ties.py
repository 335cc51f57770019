"""What is equally large but for rounding is told the same on every processor."""

from dataclasses import replace

import numpy as np
import pytest

from kaju.arrays import all_largest, first_largest
from kaju.model.network import solve, triangular


@pytest.fixture(scope="module")
def pressed():
    return solve(triangular(5, 9, force=0.1))


@pytest.mark.parametrize("last_bits", [-1e-13, 0.0, 1e-13])
def test_the_node_that_moved_farthest_does_not_hang_on_the_last_bits(pressed, last_bits):
    farthest, _ = pressed.largest_displacement()
    moved = pressed.displacement.copy()
    tied = all_largest(np.linalg.norm(moved[-1], axis=1))
    assert len(tied) == 2, "the upper and the lower tip move towards each other"
    moved[-1, tied[1]] *= 1.0 + last_bits
    again = replace(pressed, displacement=moved)
    assert again.largest_displacement()[0] == farthest == pressed.network.names[tied[0]]


def test_what_is_larger_by_more_than_rounding_is_the_largest():
    assert first_largest(np.array([1.0, 1.0 + 1e-8])) == 1
    assert first_largest(np.array([1.0, 1.0 + 1e-12])) == 0
    assert first_largest(np.array([-3.0, -2.0, -2.0])) == 1
    assert all_largest(np.zeros(2)).tolist() == [0, 1]
