"""The true energy lies between two that can be computed, whatever the sizes of the agents."""

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from goal_bodies import plate
from spawning_bodies import STEEL
from spawning_bodies import drawn as coded

from kaju import Scene, solve

SOFT = {"youngs_modulus": 2e9, "poissons_ratio": 0.45}


def drawn(rows, loads, sides=None, plane="strain", size=0.05, materials=(STEEL, SOFT)):
    """A body of steel (a), a soft material (b) and air (.)."""
    sides = sides or {"bottom": "rigid"}
    return coded(rows, materials, loads, sides=sides, plane=plane, cell_size=size)


PRESSED = [{"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [0.0, -50.0]}]
DRAGGED = [{"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [20.0, -50.0]}]
L_SHAPE = ["aa..", "aa..", "aaaa", "aaaa"]
BODIES = {
    "an L, pressed": drawn(L_SHAPE, PRESSED),
    "an L, dragged up to its edges": drawn(L_SHAPE, DRAGGED),
    "an L, dragged up to a wall": drawn(L_SHAPE, DRAGGED, {"left": "rigid"}),
    "a block, dragged in its middle": drawn(
        ["aaaa"] * 4, [{"region": {"box": [[0.05, 0.2], [0.15, 0.2]]}, "force": [1.0, 0.0]}]
    ),
    "two materials": drawn(["bb..", "ab..", "aabb", "bbaa"], PRESSED, plane="stress"),
    "a hole beside a roller": drawn(
        ["aaaa", "a.aa", "aaaa", "bbbb"], PRESSED, {"bottom": "rigid", "left": "roller"}
    ),
}


def assert_within(result, truth):
    """The truth by finite elements is off by a few millionths at most, from below."""
    assert not result.no_bound
    lower, upper = result.energy_bounds
    assert lower <= truth * (1 + 1e-5)
    assert truth <= upper * (1 + 1e-9)


@pytest.mark.parametrize("name", BODIES)
def test_truths_lie_within(name):
    scene = BODIES[name]
    truth = graded_elements(scene, order=3, levels=9).strain_energy
    bounds = []
    for tolerance in (0.2, 0.04):
        result = solve(scene, strategy="spawning", tolerance=tolerance)
        assert_within(result, truth)
        bounds.append(result.error_bound)
    assert len(np.unique(result.size)) > 1
    assert bounds[1] < 0.7 * bounds[0]
    assert bounds[1] < (0.15 if name == "two materials" else 0.05)


def test_equal_agents_have_the_bounds_of_equal_cells():
    scene = BODIES["an L, pressed"]
    cells = solve(scene, strategy="uniform", resolution=4)
    tree = cells.found.tree
    assert tree.bracket.lower == pytest.approx(cells.found.bracket.lower, rel=1e-4)
    assert tree.bracket.upper == pytest.approx(cells.found.bracket.upper, rel=1e-9)


def test_weight_bends_agents_of_many_sizes():
    scene = drawn(L_SHAPE, [{"region": {"box": [[0.0, 0.0], [0.2, 0.2]]}, "force": [3.0, -9.0]}])
    truth = graded_elements(scene, order=3, levels=9).strain_energy
    result = solve(scene, strategy="spawning", tolerance=0.05)
    assert_within(result, truth)
    assert result.error_bound < 0.06


def test_a_bed_and_a_moved_side_under_agents_of_many_sizes():
    moved = {"bottom": "rigid", "top": {"displacement": ["free", -1e-6]}}
    for sides in ({"bottom": {"stiffness": 1e12}, "left": "roller"}, moved):
        scene = drawn(L_SHAPE, [] if sides is moved else PRESSED, sides)
        fine = solve(scene, strategy="spawning", tolerance=0.015)
        coarse = solve(scene, strategy="spawning", tolerance=0.15)
        assert not coarse.no_bound
        below, above = fine.energy_bounds
        lower, upper = coarse.energy_bounds
        assert lower <= below <= above <= upper


def test_bounds_do_not_depend_on_how_a_body_lies():
    scene = BODIES["an L, dragged up to its edges"]
    turned = drawn(
        ["aaaa", "aaaa", "aa..", "aa.."],
        [{"region": {"box": [[0.0, 0.0], [0.1, 0.0]]}, "force": [20.0, 50.0]}],
        {"top": "rigid"},
    )
    results = [solve(s, strategy="spawning", tolerance=0.1) for s in (scene, turned)]
    assert results[0].agents == results[1].agents
    assert results[0].energy_bounds == pytest.approx(results[1].energy_bounds, rel=1e-7)


def test_a_tolerance_is_kept_by_its_bound():
    result = solve(BODIES["two materials"], strategy="spawning", tolerance=0.06)
    assert result.tolerance_kept == "proved"
    assert result.error_bound <= 0.06
    summary = result.summary()
    assert summary["tolerance_kept"] == "proved"
    assert summary["error_bound"] == result.error_bound
    assert summary["error_estimate"] == result.error_bound
    # The estimate of first order is not content yet.
    assert result.generations[-1].error > 0.06


def cube(material):
    return Scene(
        body={"cell_size": 0.25, "cells": [4, 4, 4], "material": "a"},
        materials={"a": material},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[0.25, 0.25, 1], [0.75, 0.75, 1]]}, "force": [0, 0, -1.0]}],
    )


def test_a_corner_alone_holds_nothing_together():
    scene = drawn(["a.aa", "aaa.", ".aa.", "aaaa"], PRESSED)
    truth = graded_elements(scene, order=3, levels=9).strain_energy
    cells = solve(scene, strategy="uniform", resolution=8)
    agents = solve(scene, strategy="spawning", tolerance=0.05)
    assert_within(cells, truth)
    assert_within(agents, truth)
    assert agents.error_bound < 0.08


def test_a_long_solid_has_bounds_from_end_to_end():
    """Sixteen cells of 2¹⁶ parts each are as long as codes of places reach."""
    beam = Scene(
        body={"size": [1.0, 0.25, 0.25], "cells": [16, 4, 4], "material": "steel"},
        sides={"left": "rigid"},
        loads=[{"side": "right", "force": [0.0, 0.0, -1.0]}],
    )
    bent = solve(beam)
    lower, upper = bent.energy_bounds
    # Bending and shear of a slender bar: F²L³/6EI + F²L/2κGA.
    youngs, inertia, area = 206e9, 0.25**4 / 12, 0.25**2
    exact = 1 / (6 * youngs * inertia) + 1.3 / (5 / 6 * youngs * area)
    assert lower < 1.01 * exact
    assert 0.97 * exact < upper < 1.2 * exact
    assert lower > 0.85 * upper


@pytest.mark.parametrize("ratio", [0.499999, 0.4999999, 0.499999998])
def test_bounds_go_on_up_to_incompressible_bodies(ratio):
    """Neither field cares how stiff against compression a body is that hardly shrinks."""

    def bridge(ratio):
        gum = {"youngs_modulus": 1.8e11, "poissons_ratio": ratio}
        stiff = {"youngs_modulus": 3.9e11, "poissons_ratio": 0.31}
        drag = [{"cell": [8, 5], "side": "top", "force": [0.4, 0.2]}]
        rows = ["aaabbbaaa"] * 3 + ["aaa...aaa"] * 3
        sides = {"left": "roller", "bottom": "rigid"}
        return drawn(rows, drag, sides, size=0.01, materials=(gum, stiff))

    usual, answer = solve(bridge(0.49999)), solve(bridge(ratio))
    np.testing.assert_allclose(answer.energy_bounds, usual.energy_bounds, rtol=0.03)
    assert answer.error_bound == pytest.approx(usual.error_bound, rel=0.05)


def test_a_proof_found_on_the_way_counts_however_many_agents_there_are(monkeypatch):
    """In the plane agents are bounded in larger numbers than a result works out unasked."""
    monkeypatch.setattr("kaju.model.elastic.bounds.energy_bounds.MOST_PROVED", {2: 1_000})
    result = solve(plate(), tolerance=0.005, strategy="spawning")
    assert result.agents > 1_000
    assert result.tolerance_kept == "proved"
