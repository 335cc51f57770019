"""Agents spawn where their opinions differ, until the error is within the tolerance."""

import numpy as np
import pytest
from goal_bodies import plate
from spawning_bodies import spawned_by, under_a_patch

from kaju import Scene

LIMIT = 1.32302e-8
"""Strain energy (J) of the plate by converged quadratic finite elements."""


def test_energy_of_the_plate_tends_to_the_finite_elements_limit():
    """With half the error for less than three times the agents, below the plate's corners."""
    results = [spawned_by(plate(), tolerance=t) for t in (0.02, 0.004)]
    errors = [result.error_bound for result in results]
    slope = np.log(errors[1] / errors[0]) / np.log(results[1].agents / results[0].agents)
    assert slope < -0.65
    for result, error in zip(results, errors, strict=True):
        lower, upper = result.energy_bounds
        assert lower < LIMIT < upper < (1.0 + 4.1 * error**2) * lower
        np.testing.assert_allclose(result.reactions["bottom"], [0.0, 2.0], atol=2e-9)


def test_block_of_cubes_costs_what_the_load_reaches():
    """16,384³ cells, of which a few thousand agents stand for all."""
    load = {"region": {"box": [[0.499, 0.499, 1.0], [0.501, 0.501, 1.0]]}, "force": [0, 0, -1.0]}
    body = {"size": [1.0, 1.0, 1.0], "cells": [16384] * 3, "material": "steel"}
    scene = Scene(body=body, sides={"bottom": "rigid"}, loads=[load])
    result = spawned_by(scene, tolerance=0.25)
    assert result.tolerance_kept == "estimated"
    assert result.agents < 10_000
    np.testing.assert_allclose(result.reactions["bottom"], [0, 0, 1.0], atol=1e-4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_vtk_file_holds_the_agents(tmp_path, dimension):
    meshlane = pytest.importorskip("meshlane")
    result = spawned_by(under_a_patch(dimension), tolerance=0.3)
    mesh = meshlane.read(result.to_vtk(tmp_path / "agents.vtu"))
    assert len(mesh.cells[0].data) == result.agents
    corner = mesh.points[mesh.cells[0].data]
    edge = np.ptp(corner[..., 0], axis=1)
    np.testing.assert_allclose(edge, result.size)
    np.testing.assert_allclose(mesh.cell_data["level"][0], result.level)
    assert np.abs(mesh.point_data["displacement"]).max() > 0
