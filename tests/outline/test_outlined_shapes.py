"""True outlines of all shapes: what is exact under pressure all round, and the same body twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kaju
from kaju.errors import SceneError

E, NU, THICKNESS = 206e9, 0.3, 0.01
STEEL = {"youngs_modulus": E, "poissons_ratio": NU}
CENTRE = [0.0, 0.0]


def body(*regions: dict[str, Any], material: str = "air", **scene: Any) -> kaju.Scene:
    """Return a quarter of a body, its middle in the lower left corner."""
    true = [{"material": "steel", "outline": "true"} | region for region in regions]
    asked = {"size": [0.1, 0.1], "cells": [5, 5], "thickness": THICKNESS, "material": material}
    usual = {"sides": {"left": "roller", "bottom": "roller"}, "materials": {"steel": STEEL}}
    return kaju.Scene(body=asked | {"regions": true}, **(usual | scene))


BULB = (
    "M 0.09 0 C 0.09 0.03 0.06 0.02 0.05 0.04 S 0.05 0.08 0 0.08 "
    "S -0.04 0.06 -0.05 0.04 S -0.09 0.03 -0.09 0 L -0.05 -0.05 H 0.05 z"
)


def disk(x: float, y: float, radius: float) -> dict[str, Any]:
    return {"disk": {"centre": [x, y], "radius": radius}}


def slot(start: float, end: float, y: float, radius: float) -> dict[str, Any]:
    return {"slot": {"ends": [[start, y], [end, y]], "radius": radius}}


OVAL = {"box": [[-0.09, -0.07], [0.09, 0.07]], "radius": 0.03}
TUBE = {"centre": CENTRE, "inner": 0.04, "outer": 0.08}
FULL = np.pi / 4  # of a quarter of a disk, in its radius squared
ALL_ROUND = {
    "disk": (disk(0.0, 0.0, 0.073), FULL * 0.073**2),
    "ellipse": ({"ellipse": {"centre": CENTRE, "radii": [0.09, 0.03]}}, FULL * 0.0027),
    "slot": (slot(-0.05, 0.05, 0.0, 0.031), 0.05 * 0.031 + FULL * 0.031**2),
    "rounded box": ({"rounded_box": OVAL}, 0.09 * 0.07 - (1 - FULL) * 0.03**2),
    "path": ({"path": BULB}, 0.004624997),  # by fine straight lines
    "ring": ({"ring": TUBE}, FULL * (0.08**2 - 0.04**2)),
}


@pytest.mark.parametrize("name", ALL_ROUND)
def test_pressure_all_round_is_the_same_everywhere(name: str) -> None:
    region, area = ALL_ROUND[name]
    pressed = body(region | {"name": "rim"}, loads=[{"outline": "rim", "pressure": 1e6}])
    thick = name in ("disk", "ring")
    plane = {"body.plane": "strain" if thick else "stress"}
    answer = kaju.solve(pressed.with_overrides(plane), tolerance=0.05)
    lower, upper = answer.energy_bounds
    stretch = ((1 + NU) * (1 - 2 * NU) if thick else 1 - NU) * 1e6 / E
    truth = stretch * 1e6 * area * THICKNESS
    assert lower < truth * (1 + 1e-5)
    assert upper > truth * (1 - 1e-5)
    assert answer.tolerance_kept == "proved"
    assert answer.outline_stress("rim")[1] == pytest.approx(-1e6, rel=1e-3)
    if name == "disk":
        at = np.array([[0.04, 0.02]])
        assert answer.displacement_at(at) == pytest.approx(-stretch * at, rel=0.02)


PULLED = {"loads": [{"side": "right", "force": [1e3, 0.0]}], "material": "steel"}


def hole(**shape: Any) -> dict[str, Any]:
    return shape | {"material": "air"}


HUMP = "c.0066667 .0133333 .0133333 .0133333 .02 0 .0066667-.0133333 .0133333-.0133333 .02 0"
CRESCENT = "A.03 .03 0 0 0 .02658126 .04125 A.025 .025 0 0 1 .07341874 .04125 z"
SQUARE = {"box": [[0.04, 0.035], [0.06, 0.065]]}
WASHER = {"ring": {"centre": [0.05, 0.05], "inner": 0.01, "outer": 0.02}}
TWICE = {
    "a circle drawn": (
        [hole(**disk(0.05, 0.05, 0.02))],
        [hole(path="M.07.05a.02.02 0 1 1-.04 0 .02.02 0 1 1 .04 0")],
    ),
    "parabolas as cubics": (
        [hole(path="M.03.04Q.04.06.05.04T.07.04V.02H.03Z")],
        [hole(path=f"M.03,.04{HUMP}l0-.02-.04 0z")],
    ),
    "an ellipse turned": (
        [hole(ellipse={"centre": [0.05, 0.05], "radii": [0.03, 0.01], "angle": 90.0})],
        [hole(ellipse={"centre": [0.05, 0.05], "radii": [0.01, 0.03]})],
    ),
    "a slot of three": (
        [hole(**slot(0.04, 0.06, 0.05, 0.015))],
        [hole(**part) for part in (SQUARE, disk(0.04, 0.05, 0.015), disk(0.06, 0.05, 0.015))],
    ),
    "an island in a hole": (
        [hole(**WASHER)],
        [hole(**disk(0.05, 0.05, 0.02)), disk(0.05, 0.05, 0.01)],
    ),
    "a crescent": (
        [hole(**disk(0.05, 0.05, 0.025)), disk(0.05, 0.06, 0.03)],
        [hole(path=f"M.07341874 .04125 {CRESCENT}")],
    ),
}


@pytest.mark.parametrize("name", TWICE)
def test_two_ways_to_say_a_body_have_one_truth(name: str) -> None:
    one, other = (
        kaju.solve(body(*regions, **PULLED, sides={"left": "rigid"}), tolerance=0.1)
        for regions in TWICE[name]
    )
    assert one.area.sum() == pytest.approx(other.area.sum(), rel=0.01)
    assert one.energy_bounds[0] < other.energy_bounds[1]
    assert other.energy_bounds[0] < one.energy_bounds[1]


NO_PATHS = ["", "L 1 1", "M 0 0 1", "M 0 0 X", "M 0 0 A 1 1 0 2 0 1 1 z", "M 0 0 H 1 Z 3"]


@pytest.mark.parametrize(("region", "key"), [
    ({"path": "M.02.02 L.08.08 L.08.02 L.02.08z"}, "body.regions.0"),
    ({"polygon": [[0.02, 0.02], [0.08, 0.08], [0.08, 0.02], [0.02, 0.08]]}, "body.regions.0"),
    ({"ring": {"centre": [0.05, 0.05], "inner": 0.02, "outer": 0.01}}, "body.regions.0.ring"),
    ({"rounded_box": {"box": [[0.0, 0.0], [0.1, 0.02]], "radius": 0.01}}, "body.regions.0"),
    ({"slot": {"ends": [[0.05, 0.05], [0.05, 0.05]], "radius": 0.01}}, "body.regions.0.slot"),
    *(({"path": text}, ".*path") for text in NO_PATHS),
])  # fmt: skip
def test_shapes_that_are_none_are_refused(region: dict[str, Any], key: str) -> None:
    with pytest.raises(SceneError, match=f"^{key}"):
        kaju.solve(body(hole(**region), **PULLED, sides={"left": "rigid"}), tolerance=0.2)


def test_samples_of_a_circle_are_a_body_near_to_it(tmp_path: Path) -> None:
    def away(points: Any) -> Any:
        return np.hypot(*(points - 0.05).T) - 0.02

    image = kaju.sampled_shape(away, (0.0, 0.0), (0.1, 0.1), (41, 41))
    drawn = body(hole(image=image, name="hole"), **PULLED, sides={"left": "rigid"})
    round_ = body(*TWICE["a circle drawn"][0], **PULLED, sides={"left": "rigid"})
    one, other = (kaju.solve(scene, tolerance=0.04) for scene in (drawn, round_))
    assert one.strain_energy == pytest.approx(other.strain_energy, rel=0.003)
    assert one.area.sum() == pytest.approx(other.area.sum(), rel=0.003)
    again = kaju.load_result(one.save(tmp_path / "drawn"))
    points = np.array([[0.0705, 0.05], [0.02, 0.02]])
    assert np.array_equal(again.displacement_at(points), one.displacement_at(points))


@pytest.mark.parametrize("corner", [[1.0, -1.0], [-1.0, 1.0]])  # lower left, upper right
def test_samples_of_a_plane_end_in_a_straight_line(tmp_path: Path, corner: list[float]) -> None:
    np.save(tmp_path / "fall.npy", np.diag(corner))
    region = {"image": {"file": str(tmp_path / "fall.npy"), "level": 0.5}}
    answer = kaju.solve(body(hole(**region), **PULLED, sides={"left": "rigid"}), tolerance=0.2)
    assert answer.area.sum() == pytest.approx(0.01 * 7 / 8, rel=1e-9)


def test_a_force_along_an_outline_is_even_across_its_direction() -> None:
    # a rounded end, pushed along its axis: the same as a force on a straight end
    pin, load = slot(0.0, 0.07, 0.0, 0.02) | {"name": "pin"}, {"outline": "pin"}
    answer = kaju.solve(body(pin, loads=[load | {"force": [-1e3, 0.0]}]), tolerance=0.04)
    area = 0.07 * 0.02 + FULL * 0.02**2
    stress = 1e3 / (0.02 * THICKNESS)  # one stress in all of it
    truth = 0.5 * stress**2 / E * area * THICKNESS
    assert answer.energy_bounds[0] < truth * (1 + 1e-6)
    assert answer.energy_bounds[1] > truth * (1 - 1e-6)
    assert answer.stress[:, 0, 0] == pytest.approx(-stress, rel=0.02)
