"""Solids with true outlines: which cells are cut, energies between bounds, refusals by name."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

import kaju
from kaju.model.scene.level_sets import SampledShape
from kaju.model.scene.shapes import Ball, Box, Cylinder
from kaju.model.scene.surfaces import ClosedSurface
from kaju.model.solid.solid_agents import CUT, EMPTY, WHOLE, SolidBody

STEEL = {"steel": {"youngs_modulus": 206e9, "poissons_ratio": 0.3}}
SIDES = {"left": "roller", "front": "roller", "bottom": "roller"}
PULLED = [{"side": "top", "force": [0.0, 0.0, 1.0]}]
BALL = {"ball": {"centre": [0.0, 0.0, 0.0], "radius": 0.62}}
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
FACES += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)[FACES]
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]


def block(cells: int, *regions: dict[str, Any], **asked: Any) -> kaju.Scene:
    """Return a cube of 1 m with regions cut out, pulled at its top."""
    drawn = [{"material": "air", "outline": "true"} | region for region in regions]
    body = {"size": [1, 1, 1], "cells": [cells] * 3, "material": "steel", "regions": drawn}
    return kaju.Scene(body=body, materials=STEEL, **({"sides": SIDES, "loads": PULLED} | asked))


def stl(path: Path, corners: np.ndarray) -> str:
    """Write triangles as a binary STL file."""
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *one.ravel(), 0) for one in corners)
    path.write_bytes(bytes(80) + struct.pack("<I", len(corners)) + rows)
    return str(path)


def wavy(points: np.ndarray) -> np.ndarray:
    """Return something like the distance from a ball with dents."""
    away = points - 0.47
    return np.linalg.norm(away, axis=1) - 0.3 - 0.04 * np.cos(9.0 * away).prod(axis=1)


SHAPES = {
    "ball": Ball(centre=(0.43, 0.52, 0.47), radius=0.31),
    "box": Box((0.21, 0.3, 0.25), (0.7, 0.62, 0.75)),
    "cylinder": Cylinder(ends=((0.3, 0.4, 0.3), (0.7, 0.6, 0.65)), radius=0.2),
    "samples": SampledShape(
        Box((0.0,) * 3, (1.0,) * 3),
        -wavy(np.argwhere(np.ones((14,) * 3)) / 13).reshape(14, 14, 14),
        0,
    ),
    "surface": ClosedSurface(0.5 + 0.23 * CUBE @ TURN),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("filled", [False, True])
def test_cells_are_whole_or_empty_for_certain(name: str, filled: bool) -> None:
    shape = SHAPES[name]
    solid = SolidBody((9, 9, 9), 1 / 9, filled, [(shape, not filled)])
    sorts = solid.cells()
    points = np.random.default_rng(2).uniform(size=(60_000, 3))
    inside = shape.contains(points) != filled
    cell = tuple((9 * points).astype(int).T)
    assert inside[sorts[cell] == WHOLE].all()
    assert not inside[sorts[cell] == EMPTY].any()
    seen = np.zeros((2, 9, 9, 9), dtype=bool)
    seen[(inside.astype(int), *cell)] = True
    asked = (sorts == CUT) & ~seen.all(axis=0)
    assert asked.sum() < 0.35 * (sorts == CUT).sum()  # corners that 80 points do not find
    share = solid.shares(sorts).mean()
    assert share == pytest.approx(inside.mean(), abs=6e-3)


def test_eighths_of_cut_cells_are_filled_where_they_lie() -> None:
    solid = SolidBody((2, 2, 2), 0.5, False, [(Box((-1, -1, -1), (2, 2, 0.375)), True)])
    layers = solid.shares(solid.cells()).mean(axis=(0, 1))
    np.testing.assert_allclose(layers, [1.0, 0.5, 0.0, 0.0], atol=1e-9)


def test_shapes_along_the_cells_cut_none() -> None:
    for shape in (Box((0.25,) * 3, (0.75,) * 3), ClosedSurface(0.5 + 0.25 * CUBE)):
        sorts = SolidBody((8, 8, 8), 0.125, False, [(shape, True)]).cells()
        assert (sorts != CUT).all()
        assert (sorts == WHOLE).sum() == 64


def test_a_ball_shaped_void_is_better_by_fractions_than_by_whole_cells() -> None:
    answers = [kaju.solve(block(cells, BALL)) for cells in (6, 9)]
    assert [answer.energy_bounds for answer in answers] == [None, None]
    energy = np.array([answer.strain_energy for answer in answers])
    # 3.4022 pJ: 16, 24 and 32 cells continued to none
    assert abs(energy[-1] / 3.4022e-12 - 1.0) < 7e-3
    staircase = kaju.solve(block(9, BALL | {"outline": "cells"})).strain_energy
    assert abs(staircase - 3.4022e-12) > 4.0 * abs(energy[-1] - 3.4022e-12)


@pytest.mark.parametrize("region", [
    {"image": kaju.sampled_shape(wavy, (0.0,) * 3, (1.0,) * 3, (21,) * 3)},
    {"cylinder": {"ends": [[0.3, 0.4, 0.3], [0.7, 0.6, 0.5]], "radius": 0.2}},
], ids=["samples", "cylinder"])  # fmt: skip
def test_two_grids_tell_one_energy(region: dict[str, Any]) -> None:
    energy = [kaju.solve(block(6, region), resolution=k).strain_energy for k in (1, 2)]
    assert energy[0] == pytest.approx(energy[1], rel=0.02)


def test_a_hole_through_a_block_is_that_of_the_plane() -> None:
    hole = {"cylinder": {"ends": [[0, -1, 0], [0, 2, 0]], "radius": 0.37}}
    answer = kaju.solve(block(8, hole, sides=SIDES | {"back": "roller"}))
    disk = {"disk": {"centre": [0, 0], "radius": 0.37}, "material": "air", "outline": "true"}
    body = {"size": [1, 1], "cells": [8, 8], "material": "steel", "regions": [disk]}
    sides, loads = {"left": "roller", "bottom": "roller"}, [{"side": "top", "force": [0.0, 1.0]}]
    body["plane"] = "strain"
    plane = kaju.Scene(body=body, materials=STEEL, sides=sides, loads=loads)
    low, high = kaju.solve(plane, tolerance=0.03).energy_bounds
    assert answer.strain_energy == pytest.approx(0.5 * (low + high), rel=1e-2)


def test_a_round_bar_is_loaded_at_its_end() -> None:
    bar: dict[str, Any] = {"cylinder": {"ends": [[-1.0, 0.5, 0.5], [9.0, 0.5, 0.5]], "radius": 0.4}}
    body = {"size": [8, 1, 1], "cells": [64, 8, 8], "material": "air"}
    body["regions"] = [bar | {"material": "steel", "outline": "true"}]

    def ended(**load: Any) -> Any:
        loads, sides = [{"side": "right", **load}], {"left": "rigid"}
        return kaju.solve(kaju.Scene(body=body, materials=STEEL, sides=sides, loads=loads))

    area, bent, answer = np.pi * 0.4**2, np.pi * 0.4**4 / 4.0, ended(force=[1.0, 0.0, 1.0])
    moved = 206e9 * answer.displacement_at(np.array([[8.0, 0.5, 0.5]]))[0]
    shear = 8.0 * 2.6 / area * (7.0 + 6.0 * 0.3) / (6.0 * 1.3)  # Cowper's
    assert moved == pytest.approx([8.0 / area, 0.0, 8.0**3 / 3.0 / bent + shear], rel=0.03, abs=9.0)
    assert answer.couples["left"] == pytest.approx([0.0, 8.0, 0.0], abs=1e-6)
    assert all(check.holds for check in answer.checks())
    bar["cylinder"]["ends"] = [[0.0, 0.5, 0.5], [8.0, 0.5, 0.5]]  # the same, for the array ends it
    same = ended(force=[1.0, 0.0, 1.0])
    assert same.strain_energy == pytest.approx(answer.strain_energy, rel=1e-6)
    for wrong in ({"pressure": 1.0}, {"force": [1.0, 0.0, 0.0]}):
        with pytest.raises(kaju.KajuError, match="an outline meets the side it acts on"):
            ended(**wrong)
        bar["cylinder"]["ends"][1][1] = 0.9  # a slanted one


def test_a_surface_is_the_body(tmp_path: Path) -> None:
    path = stl(tmp_path / "part.stl", (500.0 + 180.0 * CUBE @ TURN).astype(np.float32))
    scene = block(6, {"surface": {"file": path, "scale": 0.001}})
    answer = kaju.solve(scene)

    def away(points: np.ndarray) -> np.ndarray:
        return np.abs((points - 0.5) @ TURN.T).max(axis=1) - 0.18

    turned = kaju.sampled_shape(away, (0,) * 3, (1,) * 3, (61,) * 3)
    like = kaju.solve(block(6, {"image": turned}))
    assert answer.strain_energy == pytest.approx(like.strain_energy, rel=2e-3)
    scene.save(tmp_path / "scene.toml")
    assert kaju.load_scene(tmp_path / "scene.toml") == scene


def test_an_open_surface_is_refused(tmp_path: Path) -> None:
    for number, corners in enumerate((CUBE[:-1], CUBE[1:])):
        path = stl(tmp_path / f"{number}.stl", 0.5 + 0.2 * corners)
        with pytest.raises(kaju.KajuError, match=r"surface\.file: is not closed"):
            block(6, {"surface": path})


def test_answers_are_stored_and_drawn(tmp_path: Path) -> None:
    answer = kaju.solve(block(6, BALL))
    answer.save(tmp_path / "answer.npz")
    again = kaju.load_result(tmp_path / "answer.npz")
    assert again.strain_energy == answer.strain_energy
    assert again.scene == answer.scene
    np.testing.assert_allclose(again.stress, answer.stress)
    table, told = answer.to_dataframe(), answer.summary()
    assert told["agents"] == len(table) == len(answer.energy)
    assert table["volume (m³)"].sum() == pytest.approx(1.0 - np.pi * 0.62**3 / 6.0, rel=1e-3)
    assert "off by a third" in told["largest_stress_Pa_doubt"]
    aligned = kaju.solve(block(4, {"box": [[0.0] * 3, [0.5] * 3]})).summary()
    assert aligned["largest_stress_Pa_doubt"] == "may be off by about 32% or more"
    assert 0.0 < again.seconds == answer.seconds < 600.0
    assert answer.energy.sum() == pytest.approx(answer.strain_energy)
    assert any("fraction" in note or "share" in note for note in answer.notes)
    np.testing.assert_allclose(again.cuts("z").carried, 1.0, rtol=1e-6)
    for name in ("von_mises", "deformed", "scene", "cuts"):
        plt.close(kaju.plot(again, name))
    assert all(check.holds for check in answer.checks())
