"""Two materials along true outlines: exact truths inside both bounds, tractions, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kaju

THICKNESS = 0.01
MATRIX = {"youngs_modulus": 1e9, "poissons_ratio": 0.3}
ROLLERS = {"left": "roller", "bottom": "roller"}


def grain(modulus: float, ratio: float = 0.3) -> dict[str, dict[str, float]]:
    """Return the materials of a scene whose inclusion has these moduli (in those outside)."""
    return {
        "matrix": MATRIX,
        "grain": {"youngs_modulus": 1e9 * modulus, "poissons_ratio": ratio},
        "lead": {"youngs_modulus": 0.1e9, "poissons_ratio": 0.44},
    }


def region(material: str, name: str | None = None, **shape: Any) -> dict[str, Any]:
    """Return a region with a true outline."""
    named = {"name": name} if name else {}
    return {"material": material, "outline": "true"} | shape | named


def disk(radius: float, material: str = "grain", name: str | None = "grain") -> dict[str, Any]:
    """Return a disk about the lower left corner."""
    return region(material, name, disk={"centre": [0.0, 0.0], "radius": radius})


def plate(modulus=5.0, ratio=0.2, regions=None, size=1.0, cells=8, **body: Any) -> kaju.Scene:
    """Return a quarter of a plate with an inclusion, pulled to the right by 1 MPa."""
    own = {"size": [size, size], "cells": [cells, cells], "material": "matrix"}
    own |= {"thickness": THICKNESS, "regions": [disk(0.31)] if regions is None else regions}
    loads = [{"side": "right", "pressure": -1e6}]
    return kaju.Scene(body=own | body, materials=grain(modulus, ratio), sides=ROLLERS, loads=loads)


def lined(modulus: float, ratio: float, plane: str) -> tuple[kaju.Scene, float]:
    """Return a quarter of a tube with a liner under pressure, and its energy (J) by Lamé."""
    a, c, b = 0.05, 0.11, 0.2
    materials = grain(modulus, ratio)
    body = {"size": [0.21, 0.21], "cells": [6, 6], "material": "air", "thickness": THICKNESS}
    body |= {"regions": [disk(b, "matrix", "rim"), disk(c), disk(a, "air", "bore")], "plane": plane}
    loads = [{"outline": "bore", "pressure": 1e6}]
    scene = kaju.Scene(body=body, materials=materials, sides=ROLLERS, loads=loads)
    rows = []  # u = p r + q / r in both: the bore, the liner's edge twice, the rim
    (e, n), (f, m) = (
        (of["youngs_modulus"], of["poissons_ratio"])
        for of in (materials["grain"], materials["matrix"])
    )
    if plane == "strain":
        (e, n), (f, m) = ((k / (1 - v**2), v / (1 - v)) for k, v in ((e, n), (f, m)))
    inner, outer = (
        (lambda r, k=k, v=v: (k / (1 - v), -k / (1 + v) / r**2)) for k, v in ((e, n), (f, m))
    )
    rows = [
        [*inner(a), 0.0, 0.0],
        [*inner(c), *(-part for part in outer(c))],
        [c, 1 / c, -c, -1 / c],
        [0.0, 0.0, *outer(b)],
    ]
    p, q, _, _ = np.linalg.solve(np.array(rows), [-1e6, 0.0, 0.0, 0.0])
    return scene, 0.5 * 1e6 * (p * a + q / a) * 0.5 * np.pi * a * THICKNESS


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize(("modulus", "ratio"), [(8.0, 0.2), (0.1, 0.4), (1.05, 0.1), (0.9, 0.45)])
def test_the_energy_of_a_lined_tube_lies_within(modulus: float, ratio: float, plane: str) -> None:
    scene, truth = lined(modulus, ratio, plane)
    for tolerance in (0.3, 0.05):
        answer = kaju.solve(scene, tolerance=tolerance)
        lower, upper = answer.energy_bounds
        assert lower < truth < upper
        assert answer.error_bound <= tolerance
    assert answer.agents < 4000


def goodier(modulus: float, ratio: float) -> tuple[float, float]:
    """Return the largest hoop stress outside and tension across a disk under unit tension.

    In plane stress (Goodier 1933; Muskhelishvili, §58).
    """
    g, h = 0.5 / 1.3, 0.5 * modulus / (1.0 + ratio)
    k, m = 2.7 / 1.3, (3.0 - ratio) / (1.0 + ratio)
    d, s = (h - g) / (g + h * k), (g * (m - 1) - h * (k - 1)) / (2 * h + g * (m - 1))
    return 0.5 * (1 + s + (1 - 3 * d)), 0.5 * (1 - s + (1 + d))


def wide(modulus: float, ratio: float) -> kaju.ElasticResult:
    return kaju.solve(plate(modulus, ratio, [disk(1.0)], size=20.0), tolerance=0.01)


# of the last neither material is the stiffer one: what lies between polygons is softer than both
@pytest.mark.parametrize(
    ("modulus", "ratio", "off"), [(0.2, 0.4, 0.02), (0.01, 0.3, 0.02), (1.0, 0.49, 0.1)]
)
def test_the_peak_beside_a_soft_inclusion_is_goodiers(modulus, ratio, off) -> None:
    answer = wide(modulus, ratio)
    peak = goodier(modulus, ratio)[0]
    assert answer.outline_stress("grain")[1].max() == pytest.approx(1e6 * peak, rel=off)
    assert answer.agents < 400


@pytest.mark.parametrize(("modulus", "ratio"), [(5.0, 0.2), (100.0, 0.3)])
def test_the_stress_in_a_stiff_inclusion_is_goodiers(modulus: float, ratio: float) -> None:
    answer, peak = wide(modulus, ratio), goodier(modulus, ratio)[1]
    inside = answer.stress_at(np.array([[0.2, 0.3], [0.5, 0.1]]))
    assert inside[:, 0, 0] == pytest.approx(1e6 * peak, rel=0.02)


@pytest.mark.parametrize("beside", [1e-3, 1e-6, 1e-8, 2e-9, 1e-10, 0.0, -1e-9, -1e-7])
def test_slivers_of_a_material_beside_lines_between_agents_are_no_cracks(beside: float) -> None:
    # no Poisson's ratio: two bars in a row, one stress; the inclusion touches three sides
    box = [[0.5 + beside, 0.0], [1.0, 1.0]]
    materials = {"matrix": MATRIX | {"poissons_ratio": 0.0}, "grain": grain(4.0, 0.0)["grain"]}
    scene = plate(regions=[region("grain", "half", box=box)], cells=4).replace(materials=materials)
    for modulus in (4.0, 0.25):
        materials["grain"] = grain(modulus, 0.0)["grain"]
        answer = kaju.solve(scene.replace(materials=materials), tolerance=0.3)
        truth = 0.5 * 1e6**2 / 1e9 * THICKNESS * (0.5 + beside + (0.5 - beside) / modulus)
        lower, upper = answer.energy_bounds
        assert lower < truth < upper
        assert upper == pytest.approx(truth, rel=1e-4)


@settings(max_examples=6, deadline=None)
@given(
    boxes=st.lists(
        st.tuples(
            *[st.integers(0, 12)] * 2,
            *[st.integers(1, 8)] * 2,
            st.sampled_from(["grain", "lead", "matrix", "air"]),
        ),
        min_size=1,
        max_size=3,
    ),
    modulus=st.floats(-2.0, 2.0),
    ratio=st.floats(0.0, 0.45),
    plane=st.sampled_from(["stress", "strain"]),
)
def test_boxes_are_the_bodies_of_cells_that_they_are(boxes, modulus, ratio, plane) -> None:
    # on lines of 16 cells, not on those of 5: both proofs are of one body
    regions = []
    for x, y, width, height, material in boxes:
        corners = [[x / 16, y / 16], [min(x + width, 15) / 16, min(y + height, 15) / 16]]
        if material == "air":
            corners[0] = [max(x, 2) / 16, max(y, 2) / 16]
        if all(corners[0][axis] < corners[1][axis] for axis in (0, 1)):
            regions.append({"box": corners, "material": material})
    regions.append({"box": [[0.25, 0.0], [0.5, 0.4375]], "material": "grain"})
    scene = plate(10.0**modulus, ratio, [], plane=plane).replace(sides={"left": "rigid"})

    def drawn(cells: int, outline: str) -> kaju.Scene:
        given = {"body.cells": [cells, cells], "body.size": [1.0, 1.0]}
        given["body.regions"] = [at | {"outline": outline} for at in regions]
        return scene.with_overrides(given)

    try:
        exact = kaju.solve(drawn(16, "cells"), tolerance=0.1).energy_bounds
    except kaju.errors.SupportError:
        return
    bounds = kaju.solve(drawn(5, "true"), tolerance=0.2).energy_bounds
    assert bounds[0] < exact[1] * (1 + 1e-9)
    assert exact[0] < bounds[1] * (1 + 1e-9)


@pytest.mark.slow
def test_bounds_of_all_grids_hold_one_energy_where_three_materials_and_air_meet() -> None:
    regions = [
        region("grain", disk={"centre": [0.4, 0.5], "radius": 0.3}),
        region("lead", polygon=[[0.3, 0.1], [1.0, 0.2], [0.6, 0.61]]),
        region("matrix", ellipse={"centre": [0.4, 0.5], "radii": [0.2, 0.1], "angle": 20.0}),
        region("air", "gap", disk={"centre": [0.55, 0.45], "radius": 0.11}),
    ]
    bounds = np.array(
        [
            kaju.solve(plate(6.0, 0.45, regions, cells=cells), tolerance=tolerance).energy_bounds
            for cells, tolerance in ((4, 0.3), (5, 0.2), (11, 0.15), (8, 0.06))
        ]
    )
    assert bounds[:, 0].max() < bounds[:, 1].min()
    assert bounds[:, 1].min() < 1.02 * bounds[:, 0].max()


@pytest.mark.slow
def test_regions_may_share_a_curve_or_be_drawn_twice() -> None:
    def hole(material: str, radius: float = 0.105) -> dict[str, Any]:
        return region(material, disk={"centre": [0.55, 0.26], "radius": radius})

    ring = region("grain", ring={"centre": [0.55, 0.26], "inner": 0.105, "outer": 0.15})
    for ways in (
        [[ring, hole("air")], [hole("grain", 0.15), hole("air")]],
        [[hole("air")], [hole("air")] * 2, [hole("grain"), hole("air")]],
    ):
        bounds = np.array(
            [kaju.solve(plate(0.5, regions=w), tolerance=0.01).energy_bounds for w in ways]
        )
        assert bounds[:, 0].max() < bounds[:, 1].min()
        assert bounds[:, 1].max() < 1.002 * bounds[:, 0].min()


@pytest.mark.parametrize("load", [{"outline": "gap"}, {"side": "top"}])
def test_loads_at_a_tip_without_thickness_are_refused(load: dict[str, str]) -> None:
    scene = plate(regions=[region("air", "gap", disk={"centre": [0.4, 0.75], "radius": 0.25})])
    with pytest.raises(kaju.errors.SceneError, match=r"^loads: .*'gap' touches the side 'top'"):
        kaju.solve(scene.replace(loads=[load | {"pressure": 1e5}]), tolerance=0.1)
    assert kaju.solve(scene, tolerance=0.1).tolerance_kept == "proved"


def test_an_answer_with_an_inclusion_is_kept_drawn_and_written(tmp_path: Path) -> None:
    answer = kaju.solve(plate(), tolerance=0.1)
    again = kaju.load_result(answer.save(tmp_path / "grain"))
    assert again.summary() == answer.summary()
    assert np.array_equal(again.outline_stress("grain")[1], answer.outline_stress("grain")[1])
    assert answer.area.sum() == pytest.approx(1.0)
    assert len(kaju.plot(answer).axes) == 2
    assert all(np.array_equal(r[0], r[-1]) for r, _ in kaju.view.layers.rings_of(answer.found))
    kaju.export_page(answer, tmp_path / "grain.html")
    assert answer.to_vtk(tmp_path / "grain.vtu").exists()
    with pytest.raises(kaju.KajuError, match=r"outline_stress: .*'korn'"):
        answer.outline_stress("korn")
    with pytest.raises(kaju.KajuError, match=r"value_of: along 'grain' the body does not end"):
        kaju.solve(plate(1.0, 0.3), tolerance=0.1).value_of(kaju.Stress("grain", "hoop"))


def test_materials_too_unlike_for_the_tolerance_are_refused_before_agents_spawn() -> None:
    with pytest.raises(kaju.KajuError, match="rounding alone"):
        kaju.solve(plate(1e9), tolerance=0.1)
