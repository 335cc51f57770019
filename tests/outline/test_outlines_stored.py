"""Answers with true outlines are exported and compared as far as that has a meaning."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

import kaju
from kaju.errors import ResultError
from kaju.model.study.compare import load_answer

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
def answer() -> kaju.OutlineResult:
    return kaju.solve(plate(), tolerance=0.1)


@pytest.mark.parametrize("ending", ["vtu", "vtk"])
def test_polygons_of_a_file_fill_the_body(answer, tmp_path, ending) -> None:
    mesh = meshio.read(answer.to_vtk(tmp_path / f"plate.{ending}"))
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
    np.testing.assert_allclose(stress, answer.mean_stress[agent][:, [0, 2, 2, 1]], rtol=1e-12)
    np.testing.assert_allclose(
        np.concatenate(mesh.cell_data["von_mises"]), answer.von_mises[agent], rtol=1e-12
    )
    far = np.hypot(*(np.array(corners) - 0.1).T) > 0.0311
    told = answer.displacement_at(np.clip(np.array(corners)[far], 0.0, 0.2))
    largest = np.abs(told).max()
    np.testing.assert_allclose(np.array(moved)[far], told, atol=1e-6 * largest)


def test_an_outline_is_followed_without_a_leap(answer) -> None:
    at, _ = answer.outline_stress("bore")
    np.testing.assert_allclose(np.hypot(*(at - 0.1).T), 0.031, rtol=0.02)
    turn = np.unwrap(np.arctan2(*(at - 0.1).T[::-1]))
    steps = np.diff(turn) * np.sign(turn[-1] - turn[0])
    assert steps.min() > 0.0
    assert steps.max() < 0.8
    assert abs(turn[-1] - turn[0]) < 2.0 * np.pi


def test_a_quarter_of_an_outline_is_followed_from_end_to_end() -> None:
    hole = HOLE | {"disk": {"centre": [0.0, 0.0], "radius": 0.031}, "outline": "true"}
    scene = kaju.Scene(
        body=PLATE | {"regions": [hole]},
        sides={"left": "roller", "bottom": "roller"},
        loads=[{"side": "right", "force": [1e4, 0.0]}],
    )
    at, hoop = kaju.solve(scene, tolerance=0.1).outline_stress("bore")
    turn = np.arctan2(*at.T[::-1])
    assert (np.diff(turn) * np.sign(turn[-1] - turn[0]) > 0.0).all()
    assert hoop[turn.argmax()] > 0.0 > hoop[turn.argmin()]


def test_cells_and_outlines_are_not_compared_point_by_point(answer, tmp_path) -> None:
    cells = kaju.solve(plate("cells"))
    for pair in ((answer, cells), (cells, answer), (answer, answer)):
        with pytest.raises(ResultError, match="energy_bounds"):
            kaju.compare(*pair)
    stored = answer.save(tmp_path / "plate.npz")
    with pytest.raises(ResultError, match="energy_bounds"):
        load_answer(stored)
