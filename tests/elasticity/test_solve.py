"""`kaju.solve`: from scenes to results, and what is refused."""

import numpy as np
import pytest
from plates import PLATE, loaded
from spawning_bodies import STEEL, drawn

from kaju import ElasticResult, Scene, solve
from kaju.errors import ConvergenceError, ParameterError, ResultError, SupportError

LAW = {"youngs_modulus": 1e6, "poissons_ratio": 0.25, "density": 1000.0}
SOFT = {"material": "soft", "materials": {"soft": LAW}}


def bar(**changes):
    """A bar of 8 × 4 cells of 10 mm, E = 1 MPa and ν = 0.25, 10 mm thick."""
    usual = {"thickness": 0.01, "sides": {"left": "roller", "bottom": "roller"}, **SOFT}
    return loaded([8, 4], {"side": "right", "pressure": -1000.0}, **usual | changes)


def test_a_pulled_bar_stretches_as_it_must():
    result = solve(bar())
    points = np.array([[0.08, 0.0], [0.08, 0.04], [0.04, 0.02], [0.013, 0.037]])
    expected = points * [1e-3, -0.25e-3]
    np.testing.assert_allclose(result.displacement_at(points), expected, atol=1e-15)
    np.testing.assert_allclose(result.displacement, result.middle * [1e-3, -0.25e-3], atol=1e-15)
    np.testing.assert_allclose(result.stress_at(points), 4 * [[[1000, 0], [0, 0]]], atol=1e-6)
    line = result.profile((0.0, 0.02), (0.16, 0.02))  # of 101 points, half of them in the body
    assert len(line) == 51
    np.testing.assert_allclose(line["distance (m)"], np.linspace(0.0, 0.08, 51))
    moved = line[["displacement_x (m)", "displacement_y (m)"]]
    np.testing.assert_allclose(moved, line[["x (m)", "y (m)"]] * [1e-3, -0.25e-3], atol=1e-15)
    np.testing.assert_allclose(line["stress_xx (Pa)"], 1000.0)
    with pytest.raises(ResultError, match=r"profile: no point from \[1, 1\] to \[2, 2\] lies in"):
        result.profile((1, 1), (2, 2))
    # Parents can stretch evenly too, so the grid has no error here, and says so.
    assert result.error_estimate < 1e-6
    np.testing.assert_allclose(result.strain[..., 0, 0], 1e-3, rtol=1e-9)
    np.testing.assert_allclose(result.strain[..., 1, 1], -0.25e-3, rtol=1e-9)
    np.testing.assert_allclose(result.von_mises, 1000.0, rtol=1e-9)
    assert result.strain_energy == pytest.approx(0.5 * 1000 * 1e-3 * 0.08 * 0.04 * 0.01)
    assert result.reactions["left"][0] == pytest.approx(-1000 * 0.04 * 0.01)


def test_a_sheared_bar_leans_evenly_up_to_its_edges():
    forces = {"top": [0.8, 0.0], "right": [0.0, 0.4], "left": [0.0, -0.4]}  # 1 kPa everywhere
    loads = [{"side": side, "force": force} for side, force in forces.items()]
    points = np.array([[0.04, 0.04], [0.08, 0.02], [0.0, 0.01]])
    moved = solve(bar(sides={"bottom": "rigid"}, loads=loads)).displacement_at(points)
    np.testing.assert_allclose(moved, 2.5e-3 * points[:, [1]] * [1.0, 0.0], atol=1e-14)


def test_a_pressed_block_shortens_as_it_must():
    """Of 4 × 3 × 5 cubes of 10 mm."""
    sides = {"left": "roller", "front": "roller", "bottom": "roller"}
    result = solve(loaded([4, 3, 5], {"side": "top", "pressure": 1000.0}, sides=sides, **SOFT))
    points = np.array([[0.04, 0.03, 0.05], [0.01, 0.0, 0.02], [0.013, 0.028, 0.041]])
    expected = points * [0.25e-3, 0.25e-3, -1e-3]
    np.testing.assert_allclose(result.displacement_at(points), expected, atol=1e-14)
    tensor = np.zeros((3, 3, 3))
    tensor[:, 2, 2] = -1000.0
    np.testing.assert_allclose(result.stress_at(points), tensor, atol=1e-5)
    np.testing.assert_allclose(result.von_mises, 1000.0, rtol=1e-8)
    np.testing.assert_allclose(result.strain[..., 0, 0], 0.25e-3, rtol=1e-8)


def test_gravity_and_a_foundation():
    sides = {"left": "roller", "right": "roller", "bottom": {"stiffness": 1e5}}
    result = solve(bar(gravity=[0.0, -10.0], sides=sides, loads=[]))
    weight = 1000 * 10 * 0.08 * 0.04 * 0.01
    assert result.reactions["bottom"][1] == pytest.approx(weight)
    sunk = result.displacement_at(np.array([[0.04, 0.0]]))
    assert sunk[0, 1] == pytest.approx(-1000 * 10 * 0.04 / 1e5)


@pytest.mark.parametrize("wide", [[], [2]], ids=["plane", "space"])
@pytest.mark.parametrize("how", [{}, {"resolution": 2}, {"tolerance": 0.02}], ids=str)
def test_a_footing_on_a_bed_alone_tilts_as_it_must(wide, how):
    concrete = {"youngs_modulus": 30e9, "poissons_ratio": 0.2}
    part = ([0.7, *(0.0 for _ in wide), 0.2], [0.8, *(0.1 for _ in wide), 0.2])
    load = {"region": {"box": part}, "force": [0.0, *(0.0 for _ in wide), -1e4]}
    law = {"material": "concrete", "materials": {"concrete": concrete}, "cell_size": 0.05}
    law |= {} if wide else {"thickness": 0.1}
    sides = {"bottom": {"stiffness": 1e8}}
    result = solve(loaded([20, *wide, 4], load, sides=sides, **law), **how)
    ends = result.displacement_at(np.eye(2, 2 + len(wide)) * [[0.0], [1.0]][::-1])[:, -1]
    # A Timoshenko beam of finite length on Winkler's springs.
    assert ends == pytest.approx([-2.491e-3, 0.501e-3], abs=5e-6)
    assert result.reactions["bottom"][-1] == pytest.approx(1e4)
    assert np.linalg.norm(result.couples["bottom"]) == pytest.approx(2500.0)
    with pytest.raises(ParameterError, match="goal: the body could move along x on its bed"):
        solve(result.scene, tolerance=0.5, goal="right,x")


def test_a_displaced_side_pulls():
    sides = {"left": "rigid", "right": {"displacement": [1e-4, 0.0]}}
    result = solve(bar(sides=sides, loads=[]), resolution=4)
    corner = result.displacement_at(np.array([[0.08, 0.02], [0.0, 0.02], [0.04, 0.02]]))
    np.testing.assert_allclose(corner[:, 0], [1e-4, 0.0, 0.5e-4], atol=1e-12)
    pull = result.reactions["right"]
    np.testing.assert_allclose(pull, -result.reactions["left"], atol=1e-9)
    # Clamped ends stiffen the bar a little.
    assert pull[0] == pytest.approx(1e6 * (1e-4 / 0.08) * 0.04 * 0.01, rel=0.05)
    assert result.strain_energy == pytest.approx(0.5 * pull[0] * 1e-4, rel=1e-6)


def test_summary_has_the_keys_that_scripts_rely_on():
    summary = solve(Scene(**PLATE)).summary()
    keys = "rule plane strain_energy error_estimate agents levels iterations residual reaction"
    assert {*keys.split(), "max_displacement", "seconds", "kaju_version"} <= set(summary)
    assert (summary["rule"], summary["agents"]) == ("elastic", 400)
    assert summary["reaction"]["bottom"] == pytest.approx([0.0, 2.0], abs=2e-9)


def test_rigid_cells_inside_the_array_carry_reactions():
    load = {"cell": [3, 3], "force": [1.0, -2.0]}
    scene = drawn(["..aaaa.."] * 3 + ["========"], [STEEL], [load], sides={})
    result = solve(scene)
    cells = result.cells()
    assert (cells.origin, cells.body.shape) == ((2, 1), (4, 3))
    np.testing.assert_allclose(result.middle.min(axis=0), [0.025, 0.015])
    assert result.reactions == {"rigid": pytest.approx([-1.0, 2.0], rel=1e-7, abs=1e-9)}
    for answer in (result, solve(scene, 0.3)):
        assert answer.couples == {"rigid": pytest.approx(0.02)}
    np.testing.assert_allclose(result.displacement_at([[0.03, 0.01], [0.05, 0.01]]), 0, atol=1e-20)


@pytest.mark.parametrize("depth", [(), (0.02,)])
@pytest.mark.parametrize(
    ("outline", "tolerance"), [("cells", None), ("cells", 0.3), ("true", None)]
)
def test_a_couple_is_about_the_middle_of_where_the_body_is_held(outline, tolerance, depth):
    """An L whose leg, held on its end, is narrower than the array that it lies in."""
    away = {"box": [[0.03, *(0.0 for _ in depth), 0.03], [0.16, *depth, 0.16]], "material": "air"}
    body = {"size": [0.16, *depth, 0.16], "cells": [16, *(2 for _ in depth), 16]}
    body |= {"material": "steel", "regions": [away | {"outline": outline}]}
    load = {"side": "right", "force": [0.0, *(0.0 for _ in depth), -1e3]}
    answer = solve(Scene(body=body, sides={"top": "rigid"}, loads=[load]), tolerance)
    assert np.linalg.norm(answer.couples["top"]) == pytest.approx(1e3 * (0.16 - 0.015))


def test_a_member_one_cell_wide_is_solved_on_halved_cells():
    load = {"cell": [2, 3], "force": [1.0, -1.0]}
    result = solve(drawn(["aaaaaa"] + ["a....a"] * 3, [STEEL], [load]))
    assert result.subdivision == 2
    assert "one cell wide" in result.summary()["notes"][0]
    assert np.isfinite(result.max_displacement)


@pytest.mark.parametrize(("sides", "how"), [
    ({"bottom": "roller"}, "move along x"),
    ({"left": "roller"}, "move along y"),
    ({"bottom": {"stiffness": 1.0}}, "the loads push .* where its bed, which presses across"),
])  # fmt: skip
@pytest.mark.parametrize("cells", [(32, 16), (9, 5)])
def test_a_body_that_can_slide_is_refused(sides, how, cells):
    load = {"cell": [1, 1], "force": [1.0, -1.0]}
    for tolerance in (None, 0.1):
        with pytest.raises(SupportError, match=how):
            solve(drawn(np.ones(cells, int), [STEEL], [load], sides=sides), tolerance)


def test_no_convergence_gives_the_best_field(monkeypatch):
    for limit in ("solver.FEW", "iterative.DIRECT_LIMIT"):
        monkeypatch.setattr(f"kaju.model.elastic.equal.{limit}", {2: 0, 3: 0})
    monkeypatch.setattr("kaju.model.elastic.equal.iterative.MOST", 20)
    codes = np.ones((96, 96), int)
    codes[(np.arange(96) // 4) % 2 == 1, 24:] = 0
    loads = [{"cell": [8 * i, 95], "force": [1.0, -1.0]} for i in range(12)]
    scene = drawn(codes, [STEEL], loads)
    with pytest.raises(ConvergenceError, match="residual") as caught:
        solve(scene)
    assert isinstance(caught.value.best, ElasticResult)
    assert caught.value.residuals


@pytest.mark.parametrize("tolerance", [None, 0.1])
@pytest.mark.parametrize(("point", "force"), [
    ([1.0, 0.1], [1000.0, 0.0]), ([1.0, 0.05], [0.0, -1000.0]), ([1.0, 0.0], [-300.0, 500.0]),
    ([0.51, 0.06], [300.0, -1000.0]), ([0.5, 0.05], [300.0, -1000.0]), ([0.37, 0.1], [9.0, -1.0]),
])  # fmt: skip
def test_a_force_at_a_point_keeps_its_moment(point, force, tolerance):
    body = {"size": [1.0, 0.1], "cells": [20, 2], "thickness": 0.02, "material": "steel"}
    load = {"point": point, "force": force}
    answer = solve(Scene(body=body, sides={"left": "rigid"}, loads=[load]), tolerance)
    turned = (point[1] - 0.05) * force[0] - point[0] * force[1]
    assert answer.couples["left"] == pytest.approx(turned, rel=1e-6)
