"""Agents stop to spawn when the bound keeps the tolerance, whatever the estimate says."""

import pytest
from goal_bodies import plate as worked_plate

from kaju import Deflection, solve


def plate(force=-2.0, **changes):
    load = {"region": {"box": [[0.08, 0.2], [0.12, 0.2]]}, "force": [0.0, force]}
    return worked_plate(**{"cells": [10, 10], "loads": [load]} | changes)


def spawned(tolerance, scene=None, **how):
    return solve(scene or plate(), tolerance=tolerance, strategy="spawning", **how)


@pytest.mark.parametrize("tolerance", [0.03, 0.01])
def test_the_bound_is_what_ends_it(tolerance):
    result = spawned(tolerance)
    assert result.tolerance_kept == "proved"
    assert result.error_bound <= tolerance < result.generations[-1].error
    assert result.error_estimate == result.error_bound
    assert not any("above the tolerance" in note for note in result.notes)
    fewest = result.agents
    for looser in (1.15, 1.3, 1.45, 1.6):
        other = spawned(looser * tolerance)
        if other.error_bound <= tolerance:
            fewest = min(fewest, other.agents)
    assert result.agents <= 1.4 * fewest


def test_in_the_plane_single_agents_keep_any_tolerance():
    result = spawned(0.001)
    assert type(result.found).__name__ == "Spawning"
    assert 0.5 * 0.001 < result.error_bound <= 0.001


def test_without_a_bound_the_estimate_ends_it():
    sides = {"bottom": "rigid", "left": {"displacement": [1e-6, 0.0]}}
    result = spawned(0.2, plate(sides=sides))
    assert result.no_bound
    assert result.tolerance_kept == "estimated"
    assert result.error_estimate <= 0.2


def test_what_a_bound_keeps_is_kept_again():
    first = spawned(0.05)
    again = spawned(0.05, plate(force=-4.0), previous=first)
    assert [g.iterations for g in again.generations] == [0]
    assert again.error_bound == pytest.approx(first.error_bound)


def test_goals_are_not_ended_by_the_bound_of_the_energy():
    result = spawned(0.05, goal=Deflection("top", "y"))
    assert result.goals[0].relative_error <= 0.05
