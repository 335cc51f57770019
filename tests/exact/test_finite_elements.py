"""Graded finite elements, the truth that others are measured by, on bodies with known answers."""

import numpy as np
import pytest
from peers.problems import PLATE
from plates import plate

from kaju import compare, finite_elements, solve
from kaju.errors import ParameterError, SceneError

pytest.importorskip("skfem")

from exact.graded_elements import graded_elements

STUFF = {"stuff": {"youngs_modulus": 2e6, "poissons_ratio": 0.0, "density": 1000.0}}


def test_worked_plate_is_that_of_the_benchmark():
    """Computed by another program of the same elements, to nine digits."""
    answer, truth = graded_elements(PLATE.scene(1), order=4, levels=10), PLATE.truth()
    assert answer.strain_energy == pytest.approx(truth.strain_energy, rel=1e-8)
    away = answer.displacement_at(PLATE.points) - truth.displacement
    assert np.abs(away).max() < 1e-8 * np.abs(truth.displacement).max()


@pytest.mark.parametrize("shape", [[4, 2], [4, 2, 2]])
def test_parts_of_a_load_that_meet_within_a_face_are_the_whole(shape):
    """Their energy is that of the load on the whole side."""
    edge, d = 0.1, len(shape)
    size = [edge * n for n in shape]

    def energy(*ends):
        loads = [{"region": {"box": box}, "pressure": 1e3} for box in ends]
        held = {"material": "stuff", "materials": STUFF, "sides": {"left": "rigid"}}
        scene = plate(shape, None, cell_size=edge, loads=loads, **held)
        return finite_elements(scene).strain_energy

    low, high = [size[0]] + [0.0] * (d - 1), size
    cut = [[size[0], 0.037, *high[2:]], [size[0], 0.037, *low[2:]]]
    assert energy([low, cut[0]], [cut[1], high]) == pytest.approx(energy([low, high]), rel=1e-12)


@pytest.mark.parametrize("ratio", [0.3, 0.4999])
def test_bar_of_cubes_under_tension(ratio):
    """u = σ/E (x, −νy, −νz) on three rollers, also where ν is nearly ½."""
    materials = {"a": {"youngs_modulus": 1e6, "poissons_ratio": ratio}}
    sides = dict.fromkeys(("left", "front", "bottom"), "roller")
    pulled = {"sides": sides, "loads": [{"side": "right", "pressure": -1e3}]}
    scene = plate([4, 2, 2], None, cell_size=0.1, material="a", materials=materials, **pulled)
    answer = finite_elements(scene)
    assert answer.strain_energy == pytest.approx(1e3**2 / 2e6 * 0.016, rel=1e-9)
    points = np.array([[0.4, 0.2, 0.2], [0.13, 0.07, 0.0]])
    expected = 1e-3 * points * [1, -ratio, -ratio]
    np.testing.assert_allclose(answer.displacement_at(points), expected, atol=1e-9)


def test_what_elements_do_not_know_is_named():
    bed = {"bottom": {"stiffness": 1e9}}
    with pytest.raises(ParameterError, match="rollers"):
        finite_elements(plate([2, 2], [1, 1], sides=bed))
    with pytest.raises(SceneError, match="hexagons"):
        finite_elements(plate([2, 2], [1, 1], lattice="hexagon"))


ELEMENTS = [lambda scene: finite_elements(scene, split=4), lambda s: graded_elements(s, levels=4)]


@pytest.mark.parametrize("elements", ELEMENTS, ids=["squares", "triangles"])
def test_it_is_believed_by_compare_all_over_the_body(elements, tmp_path):
    """Points that are no middles of cells are answered too; a file keeps the middles."""
    scene = PLATE.scene(1)
    truth = elements(scene)
    found = solve(scene, tolerance=0.05)
    assert compare(found, truth).displacement.max_error < 0.02
    points = np.array([[0.0513, 0.0321], [0.15, 0.123]])
    assert compare(found, truth, points=points).displacement.max_error < 0.02
    assert len(compare(found, truth.load(truth.save(tmp_path / "fem"))).points) == 400
