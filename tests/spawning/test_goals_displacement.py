"""The largest displacement error: estimated, and kept within a tolerance."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from goal_bodies import (
    FLAT,
    GROUND,
    STEEL,
    beam,
    cube,
    inclusion,
    pierced,
    plate,
    rubber,
    sheared,
)
from spawning_bodies import by_themselves, spawned_by

from kaju import Scene, load_result, solve
from kaju.errors import ParameterError

DATA = Path(__file__).parents[1] / "data" / "spawning"


FINER = (pierced, rubber, sheared)
"""Bodies of which small errors are measured too."""


@cache
def fine(body):
    tolerance = {cube: 0.02, beam: 0.01}.get(body, 1.5e-3 if body in FINER else 4e-3)
    return spawned_by(body(), tolerance=tolerance, goal="displacement")


def true_error(result, body):
    """Largest difference from a much finer answer, at corners and middles of its agents."""
    truth = fine(body)
    points = np.concatenate([truth.lower + c * truth.size[:, None] for c in (0.0, 0.5, 1.0)])
    points = points[:: max(1, truth.agents // 5_000)]
    off = result.displacement_at(points) - truth.displacement_at(points)
    return np.linalg.norm(off, axis=1).max() / truth.max_displacement


@pytest.mark.parametrize(
    "body",
    [
        pytest.param(
            body, id=body.__name__, marks=pytest.mark.slow if body in (inclusion, cube) else ()
        )
        for body in FLAT
    ],
)
def test_estimate_is_within_its_factors_of_the_true_error(body):
    for tolerance in (0.2, 0.08) if body in FLAT else (0.3, 0.15):
        result = spawned_by(body(), tolerance=tolerance)
        of_agents = true_error(by_themselves(result), body)
        effectivity = result.displacement_error_estimate / of_agents
        assert 0.8 < effectivity < 4.5
        # What the result tells is nearer in the plane, where it is read off a proved field: but for
        # rubber, whose agents are as good.
        nearer = 0.9 if body in FLAT and body is not rubber else 1.1
        assert true_error(result, body) < nearer * of_agents


LONG = {"cube-rubber": pytest.mark.slow}


@pytest.mark.parametrize("tolerance", [0.3, 0.15])
def test_it_knows_of_what_agents_do_not_see_between_stiff_parts(tolerance):
    """They touch at a corner of a body five hundred times as soft."""
    scene = Scene(
        body={"cell_size": 0.01, "drawing": "ssff\nssff\nffss\nffss", "plane": "strain"},
        legend={"s": "stiff", "f": "soft"},
        materials={
            "stiff": {"youngs_modulus": 5e11, "poissons_ratio": 0.3},
            "soft": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
        },
        sides=GROUND,
        loads=[{"side": "right", "force": [0.0, -100.0]}],
    )
    truth = graded_elements(scene, order=3, levels=12)
    result = spawned_by(scene, tolerance=tolerance)
    there = truth.displacement_at(result.middle)
    off = np.linalg.norm(result.displacement - there, axis=1).max()
    assert 0.8 * off < result.displacement_error_estimate * np.linalg.norm(there, axis=1).max()


@pytest.mark.parametrize("body", FINER)
def test_an_agent_takes_as_much_off_the_displacement_as_one_that_the_energy_asks_for(body):
    """They stand at corners, where the body turns by a lot and stores little."""
    aimed = spawned_by(body(), tolerance=4e-3, goal="displacement")
    assert aimed.goal_error_estimate == aimed.displacement_error_estimate <= 4e-3
    assert aimed.error_share.sum() == pytest.approx(1.0)
    by_energy = spawned_by(body(), tolerance=aimed.error_bound)
    ours, theirs = (r.agents * true_error(by_themselves(r), body) for r in (aimed, by_energy))
    assert ours < 1.1 * theirs


def test_finer_cells_of_one_size_agree():
    """The largest difference from 320² equal cells is within the estimate."""
    result = spawned_by(plate(), tolerance=0.01, goal="displacement")
    uniform = solve(plate(), resolution=16)
    rng = np.random.default_rng(2)
    points = rng.uniform(0.0, 0.2, size=(500, 2))
    off = result.displacement_at(points) - uniform.displacement_at(points)
    assert np.linalg.norm(off, axis=1).max() < 0.01 * uniform.max_displacement


def test_body_that_only_shifts_has_no_error():
    body = {"size": [0.4, 0.1], "cells": [16, 4], **STEEL}
    moved = Scene(body=body, sides={"left": {"displacement": [1e-3, 2e-3]}})
    result = spawned_by(moved, tolerance=1e-3, goal="displacement")
    assert len(result.generations) == 1
    assert result.displacement_error_estimate < 1e-9
    still = Scene(body=body, sides={"left": "rigid"})
    assert spawned_by(still, tolerance=0.1).displacement_error_estimate == 0.0


def test_estimate_survives_being_stored(tmp_path):
    by_energy = spawned_by(plate(), tolerance=0.2)
    again = load_result(by_energy.save(tmp_path / "energy"))
    assert again.displacement_error_estimate == pytest.approx(
        by_energy.displacement_error_estimate, rel=1e-4
    )
    assert again.goal_error_estimate == again.error_estimate
    aimed = spawned_by(plate(), tolerance=0.05, goal="displacement")
    again = load_result(aimed.save(tmp_path / "aimed"))
    assert again.tolerance_at == "displacement"
    assert again.summary() == aimed.summary()
    np.testing.assert_array_equal(again.error_share, aimed.error_share)


def test_agents_spawn_for_an_aim():
    assert solve(plate(), tolerance=0.3, goal="displacement").tolerance == 0.3
    with pytest.raises(ParameterError, match=r"no side 'stress'.*'displacement'"):
        solve(plate(), goal="stress")
