"""Answers with true outlines are exported and compared as far as that has a meaning."""

from __future__ import annotations

import meshlane
import numpy as np
import pytest

import kaju

HOLE = {"disk": {"centre": [0.1, 0.1], "radius": 0.031}, "material": "air", "name": "bore"}
PLATE = {"size": [0.2, 0.2], "cells": [8, 8], "material": "steel", "thickness": 0.01}


def plate(outline: str = "true") -> kaju.Scene:
    """Return a plate with a round hole, pulled to the right."""
    return kaju.Scene(
        body=PLATE | {"regions": [HOLE | {"outline": outline}]},
        sides={"left": "rigid"},
        loads=[{"side": "right", "force": [1e4, 0.0]}],
    )


@pytest.fixture(scope="module")
def answer() -> kaju.ElasticResult:
    return kaju.solve(plate(), tolerance=0.1)


@pytest.mark.parametrize("ending", ["vtu", "vtk"])
def test_polygons_of_a_file_fill_the_body(answer, tmp_path, ending) -> None:
    mesh = meshlane.read(answer.to_vtk(tmp_path / f"plate.{ending}"))
    agent = np.concatenate([block.astype(int) for block in mesh.cell_data["agent"]])
    area, moved, corners = [], [], []
    for block in mesh.cells:
        assert block.type == "polygon"
        x, y, z = np.moveaxis(mesh.points[block.data], 2, 0)
        assert not z.any()
        area += (0.5 * (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)).tolist()
        corners += mesh.points[block.data][:, 0, :2].tolist()
        moved += mesh.point_data["displacement"][block.data][:, 0, :2].tolist()
    body = 0.04 - np.pi * 0.031**2
    assert min(area) > 0.0
    held = np.bincount(agent, area, answer.agents)
    assert (held > answer.area * (1.0 - 1e-9)).all()  # polygons round it, and within
    assert answer.area.sum() < body < sum(area) < body * 1.01
    stress = np.concatenate(mesh.cell_data["stress"])
    np.testing.assert_allclose(stress, answer.stress[agent].reshape(-1, 4), rtol=1e-12)
    np.testing.assert_allclose(
        np.concatenate(mesh.cell_data["von_mises"]), answer.von_mises[agent], rtol=1e-12
    )
    far = np.hypot(*(np.array(corners) - 0.1).T) > 0.0311
    told = answer.displacement_at(np.clip(np.array(corners)[far], 0.0, 0.2))
    largest = np.abs(told).max()
    np.testing.assert_allclose(np.array(moved)[far], told, atol=1e-6 * largest)


def test_answers_within_one_outline_are_compared_in_the_body(answer, tmp_path) -> None:
    finer = kaju.solve(plate(), tolerance=0.05)
    told = kaju.compare(kaju.load_result(answer.save(tmp_path / "plate.npz")), finer)
    assert np.hypot(*(told.points - 0.1).T).min() > 0.031
    assert len(told.points) == pytest.approx(64**2 * (1.0 - np.pi * 0.031**2 / 0.2**2), rel=0.02)
    assert 0.0 < told.energy_error < answer.error_bound * 4.0
    assert kaju.compare(finer, finer).stress.misfit == 0.0
    along = told.along((0.0, 0.1), (0.2, 0.1))
    assert np.abs(along.points[:, 0] - 0.1).min() > 0.03


def test_generations_are_kept_in_a_file_and_drawn(tmp_path) -> None:
    fresh = kaju.solve(plate(), tolerance=0.03)
    for result in (fresh, kaju.load_result(fresh.save(tmp_path / "plate.npz"))):
        agents = [one.agents for one in result.generations]
        assert agents == sorted(set(agents))
        assert len(agents) == result.summary()["generations"] > 1
        assert result.generations[-1].error == result.error_bound <= 0.03
        np.testing.assert_array_equal(result.gap, fresh.gap)
        assert result.gap.sum() == pytest.approx(2.0 * np.diff(result.energy_bounds)[0], rel=0.05)
        np.testing.assert_array_equal(result.level, fresh.level)
        kaju.plot(result, "agents", generation=0, colour="gap")
