"""Deflections and stresses lie between two values that can be computed, in solids too."""

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from spawning_bodies import drawn as coded

from kaju import Deflection, Reaction, Scene, Stress, load_result, solve

CELL = 0.05
LAWS = {
    "a": {"youngs_modulus": 200e9, "poissons_ratio": 0.3},
    "b": {"youngs_modulus": 20e9, "poissons_ratio": 0.1},
}
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(40)


def drawn(rows, loads=None, sides=None, materials=LAWS, **about):
    loads = [{"cell": [1, 3], "side": "top", "force": [1e3, -3e3]}] if loads is None else loads
    described = {"cell_size": CELL, "plane": "strain", "sides": sides or {"bottom": "rigid"}}
    return coded(rows, [*materials.values()], loads, **described | about)


def random_body(seed):
    """Pixels of two materials, dragged and pressed on, with a quantity of one of them each."""
    rng = np.random.default_rng([14, seed])
    codes = rng.choice(["a", "b", "."], (4, 4), p=[0.55, 0.3, 0.15])
    codes[-1], codes[:, 1] = "a", "b"
    cell = [1, int(rng.integers(3))]
    side = ["left", "right"][seed % 2]
    return drawn(["".join(row) for row in codes], sides={"bottom": "rigid", side: "roller"}), cell


def box_of(cell):
    return {"box": [[CELL * i for i in cell], [CELL * (i + 1) for i in cell]]}


def means(answer, cell):
    """Return the mean displacement and strain of a cell by finite elements."""
    low, half = CELL * np.array(cell), 0.5 * CELL
    line = half * (POINTS + 1.0)
    grid = np.stack([g.ravel() for g in np.meshgrid(line, line, indexing="ij")], axis=1)
    weight = np.outer(WEIGHTS, WEIGHTS).ravel() / 4.0
    moved = weight @ answer.displacement_at(low + grid)
    slope = np.empty((2, 2))
    for axis in (0, 1):
        ends = []
        for end in (0.0, CELL):
            points = np.empty((len(line), 2))
            points[:, axis], points[:, 1 - axis] = end, line
            ends.append(0.5 * WEIGHTS @ answer.displacement_at(low + points))
        slope[:, axis] = (ends[1] - ends[0]) / CELL
    return moved, 0.5 * (slope + slope.T)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_truths_of_random_bodies_lie_within(seed):
    """Those of elements of order 3, graded into every corner."""
    scene, cell = random_body(seed)
    moved, strain = means(graded_elements(scene, order=3, levels=8), cell)
    youngs, ratio = LAWS["b"].values()
    shear = youngs / (2 * (1 + ratio))
    stress = 2 * shear * (strain + ratio / (1 - 2 * ratio) * np.trace(strain) * np.eye(2))
    asked = [
        (Deflection(box_of(cell)), moved),
        (Stress(box_of(cell), "xx"), stress[0, 0]),
        (Stress(box_of(cell), "xy"), stress[0, 1]),
    ]
    quantities = [quantity for quantity, _ in asked]
    result = solve(scene, tolerance=0.05, goal=quantities)
    for goal, (_, truth) in zip(result.goals, asked, strict=True):
        off = np.linalg.norm(goal.value - truth)
        assert off <= goal.error_bound + 1e-4 * np.linalg.norm(truth)
        assert off <= 1.25 * 0.05 * goal.error_bound / goal.relative_bound
    assert result.tolerance_kept == "estimated"
    assert result.agents < 5000


def test_what_is_uniform_is_certain():
    """Of a bar that is pulled everything is known."""
    scene = drawn(
        ["aaaa", "aaaa"],
        plane="stress",
        thickness=0.01,
        sides={"left": "roller", "bottom": "roller"},
        loads=[{"side": "right", "pressure": -1e6}],
    )
    asked = [
        Deflection("right", "x"),
        Deflection({"box": [[0.1, 0.0], [0.1, 0.1]]}, "x"),
        Deflection({"box": [[0.05, 0.025], [0.15, 0.075]]}, (0.0, 1.0)),
        Stress({"box": [[0.05, 0.025], [0.15, 0.075]]}, "xx"),
        Stress({"box": [[0.05, 0.025], [0.15, 0.075]]}, "xy"),
    ]
    result = solve(scene, tolerance=1e-4, goal=asked)
    strain = 1e6 / 200e9
    exact = [0.2 * strain, 0.1 * strain, -0.3 * strain * 0.05, 1e6, 0.0]
    for goal, truth in zip(result.goals, exact, strict=True):
        scale = goal.error_bound / goal.relative_bound if goal.relative_bound else abs(truth)
        assert abs(goal.value - truth) <= goal.error_bound + 1e-9 * scale
    assert result.tolerance_kept == "proved"
    assert not result.notes


@pytest.mark.parametrize(
    ("sides", "at"),
    [
        ({"bottom": "rigid", "top": {"displacement": [1e-5, -1e-5]}}, "xy"),
        ({"bottom": "rigid", "top": {"displacement": ["free", -1e-5]}}, "yy"),
        ({"bottom": {"stiffness": 1e11}, "left": "roller"}, "yy"),
    ],
)
def test_moved_sides_and_beds_have_bounds_that_close_in(sides, at):
    loads = [] if "top" in sides else [{"side": "top", "pressure": 1e6}]
    scene = drawn(["aaaa", "a.bb", "aabb", "aaaa"], sides=sides, loads=loads)
    asked = [Stress(box_of([2, 1]), at), Deflection(box_of([2, 2]), "y")]
    coarse, fine = (solve(scene, tolerance=t, goal=asked) for t in (0.05, 0.01))
    for first, second in zip(coarse.goals, fine.goals, strict=True):
        assert abs(first.value - second.value) <= first.error_bound + second.error_bound
        assert second.error_bound < 0.5 * first.error_bound


def test_solids_have_bounds_too():
    body = {"size": [0.1] * 3, "cells": [4] * 3, "material": "steel"}
    load = {"region": {"box": [[0.025, 0.025, 0.1], [0.075, 0.075, 0.1]]}, "force": [5, 0, -9.0]}
    scene = Scene(body=body, sides={"bottom": "rigid"}, loads=[load])
    asked = [
        Deflection({"box": [[0.025, 0.025, 0.1], [0.075, 0.075, 0.1]]}),
        Stress({"box": [[0.025] * 3, [0.075] * 3]}, "zz"),
    ]
    coarse, fine = (solve(scene, tolerance=t, goal=asked) for t in (0.2, 0.05))
    for first, second in zip(coarse.goals, fine.goals, strict=True):
        assert np.linalg.norm(first.value - second.value) <= first.error_bound + second.error_bound
        assert second.error_bound < 0.6 * first.error_bound


def test_the_deflection_under_the_load_is_known_as_well_as_the_energy():
    """There the load itself asks for it."""
    scene = drawn(["aaaa"] * 4, loads=[{"cell": [1, 3], "side": "top", "force": [0.0, -3e3]}])
    under = Deflection({"box": [[CELL, 4 * CELL], [2 * CELL, 4 * CELL]]}, "y")
    result = solve(scene, tolerance=0.02, goal=under)
    (goal,) = result.goals
    lower, upper = result.found.bracket.lower, result.found.bracket.upper
    assert goal.relative_bound == pytest.approx((upper - lower) / (upper + lower), rel=0.05)


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ((0.1, 0.1), "no energy bounds the value at a point"),
        (Stress({"box": [[0.0, 0.0], [0.1, 0.1]]}, "von_mises"), "no linear quantity"),
        (Stress("top", "yy"), "no energy bounds the stress of a surface"),
        (Deflection({"disk": {"centre": [0.1, 0.1], "radius": 0.05}}), "round or slanted"),
        (Deflection({"box": [[0.0, 0.0], [0.07, 0.1]]}), "no multiples of 1/4 of a cell"),
        (Reaction("bottom", "x"), "not bounded"),
    ],
)
def test_where_no_theorem_reaches_it_says_why(asked, why):
    result = solve(drawn(["aaaa"] * 4), tolerance=0.2, goal=asked)
    (goal,) = result.goals
    assert goal.error_bound is None
    assert goal.relative_bound is None
    assert why in goal.no_bound
    assert result.tolerance_kept == "estimated"
    assert sum(why in note for note in result.notes) == 1


def test_what_is_certain_is_told_and_stored(tmp_path):
    asked = [Deflection("top", "y"), (0.1, 0.1)]
    result = solve(drawn(["aaaa"] * 4), tolerance=0.01, goal=asked)
    goal = result.goals[0]
    assert result.summary()["goals"][0]["error_bound"] == goal.error_bound > 0.0
    assert load_result(result.save(tmp_path / "plate")).goals[0] == goal
    lower = solve(drawn(["aaaa"] * 4), tolerance=1e-3, goal=asked[0])
    goal = lower.goals[0]
    told = f"is estimated as {goal.relative_error:.2g}, and proved to be below"
    assert sum(f"{told} {goal.relative_bound:.2g}" in note for note in lower.notes) == 1
    assert lower.tolerance_kept == "estimated"


def test_agents_that_do_not_see_a_hinge_go_on_until_they_do():
    """Two stiff parts touch at a corner in a body two hundred times as soft."""
    scene = drawn(
        ["bbaa", "bbaa", "aabb", "aabb"],
        materials={"a": LAWS["a"], "b": LAWS["b"] | {"youngs_modulus": 1e9}},
    )
    right = Deflection("right", "y")
    few = solve(scene, tolerance=0.1, goal=right)
    fine = solve(scene, tolerance=0.01, goal=right)
    (goal,), (truth,) = few.goals, fine.goals
    assert abs(goal.value - truth.value) <= goal.error_bound
    assert abs(goal.value / truth.value - 1.0) < 0.1
    assert few.tolerance_kept != "missed"
