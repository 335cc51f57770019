"""The tolerance where it matters: deflections, stresses and reactions of places."""

import json
from functools import cache

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from goal_bodies import STEEL, beam, cantilever, cube, pierced, plate
from plane_bodies import plane_body
from spawning_bodies import drawn as coded

from kaju import Deflection, Reaction, Scene, Stress, load_result, material, solve
from kaju.errors import KajuError, ParameterError, ResultError
from kaju.model.elastic.goals.duals import goal_of

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
    result = solve(scene, tolerance=0.05, goal=[quantity for quantity, _ in asked])
    for goal, (_, truth) in zip(result.goals, asked, strict=True):
        off = np.linalg.norm(goal.value - truth)
        assert off <= goal.error_bound + 1e-4 * np.linalg.norm(truth)
        assert goal.relative_error <= 0.05
    assert result.tolerance_kept == "proved"
    assert result.agents < 1500


def places_of(scene, seed):
    """Return quantities of a random cell of a body, and of its sides."""
    rng, h = np.random.default_rng(seed), scene.lattice.cell_size
    cells = np.argwhere(scene.rasterise() >= 0)
    low = cells[rng.integers(len(cells))]
    high = np.minimum(low + rng.integers(1, 3, 2), scene.lattice.shape)
    box = {"box": [(h * low).tolist(), (h * high).tolist()]}
    inner = {"box": [(h * (low + 0.25)).tolist(), (h * (low + 0.75)).tolist()]}
    section = {"box": [(h * low).tolist(), (h * np.array([high[0], low[1]])).tolist()]}
    held = [name for name in scene.lattice.sides if scene.side_condition(name).kind != "free"]
    asked = [Deflection(box), Deflection(section, "y"), Stress(box, "xx"), Stress(inner, "xy")]
    return [*asked, *map(Reaction, held)]


@pytest.mark.parametrize("seed", [0, 1, 3, 5, 6, 20, 25])
def test_intervals_of_few_agents_hold_those_of_more(seed):
    try:
        scene = plane_body(seed)
        coarse = solve(scene, tolerance=0.2, goal=places_of(scene, seed))
    except KajuError:
        pytest.skip("no body, one that moves freely, or a hinge")
    fine = solve(scene, tolerance=0.05, goal=places_of(scene, seed))
    for first, second in zip(coarse.goals, fine.goals, strict=True):
        if first.error_bound is None:
            assert "meets another" in first.no_bound
            continue
        off = np.linalg.norm(np.asarray(first.value) - second.value)
        assert off <= first.error_bound + second.error_bound


def test_reactions_are_proved_along_ways_in_which_supports_meet_no_other():
    sides = {"left": "roller", "bottom": "rigid"}
    asked = [Reaction("bottom", "y"), Reaction("bottom", "x"), Reaction("left", "x")]
    along, *across = solve(plate(sides=sides), tolerance=0.05, goal=asked).goals
    assert [along.no_bound, along.value] == ["", pytest.approx(2.0, abs=along.error_bound)]
    assert all("meets another" in goal.no_bound for goal in across)
    pushed = plate(sides=sides | {"bottom": "roller"}, loads=[{"side": "left", "force": [50, 0]}])
    answer = solve(pushed, tolerance=0.2)
    assert answer.reactions["left"] == pytest.approx([-50.0, 0.0])
    assert answer.couples == {"left": 0.0, "bottom": 0.0}
    between = pierced(sides=sides | {"bottom": "roller", "right": "roller"})
    coarse, fine = (solve(between, t, goal=Reaction("left")).goals[0] for t in (0.2, 0.01))
    assert coarse.value == pytest.approx(fine.value, abs=coarse.error_bound)
    assert fine.error_bound < 0.01 * fine.value[0] < coarse.error_bound


@pytest.mark.parametrize("how", [{"tolerance": 0.05}, {"resolution": 4}])
def test_a_quantity_is_one_number_however_it_is_asked_for(how):
    result, end = solve(cantilever(), **how), (0.4, 0.025)
    assert result.value_of(Deflection(end, "y")) == result.displacement_at([end])[0, 1]
    assert result.value_of(Stress((0.2, 0.05), "xx")) == result.stress_at([(0.2, 0.05)])[0, 0, 0]
    assert result.value_of(Reaction("left", "y")) == result.reactions["left"][1]
    work = -100.0 * result.value_of(Deflection("right", "y"))
    assert work / 2 == pytest.approx(result.strain_energy, rel=0.01)


def bar(dimension):
    """Pulled with 1 MPa: u = σ/E (x, -νy, -νz)."""
    size = [0.4, 0.1, 0.1][:dimension]
    body = {"size": size, "cells": [round(edge / 0.025) for edge in size], **STEEL}
    sides = dict.fromkeys(["left", "bottom", "front"][:dimension], "roller")
    return Scene(body=body, sides=sides, loads=[{"side": "right", "pressure": -1e6}])


@pytest.mark.parametrize(("at", "middle"), [
    ((0.4, 0.03, 0.0), (0.4, 0.03, 0.0)),
    ({"box": [[0.11, 0.02, 0.01], [0.23, 0.07, 0.07]]}, (0.17, 0.045, 0.04)),
    ({"box": [[0.1, 0.0, 0.0], [0.1, 0.1, 0.1]]}, (0.1, 0.05, 0.05)),
    ("right", (0.4, 0.05, 0.05)),
    ("bottom", (0.2, 0.0, 0.0)),
])  # fmt: skip
@pytest.mark.parametrize("dimension", [2, 3])
def test_mean_of_a_linear_field_is_its_value_in_the_middle(at, middle, dimension):
    middle = middle[:dimension]
    if dimension == 2 and not isinstance(at, str):
        at = at[:2] if isinstance(at, tuple) else {"box": [corner[:2] for corner in at["box"]]}
    elif dimension == 3 and at == "bottom":
        middle = (0.2, 0.05, 0.0)
    steel = material("steel")
    ratio = np.array([1.0, -steel.poissons_ratio, -steel.poissons_ratio])[:dimension]
    quantities = [Deflection(at), Stress(at, "xx"), Stress(at, "von_mises"), Stress(at, "xy")]
    result = solve(bar(dimension), tolerance=1e-4, goal=quantities)
    moved, stress, equivalent, shear = (goal.value for goal in result.goals)
    exact = 1e6 / steel.youngs_modulus * ratio * np.array(middle)
    np.testing.assert_allclose(moved, exact, atol=1e-8 * np.abs(exact).max())
    assert [stress, equivalent] == pytest.approx([1e6, 1e6], rel=1e-8)
    assert abs(shear) < 1e-2
    assert result.goal_error < 1e-4


@pytest.mark.parametrize("make", [plate, pytest.param(cube, marks=pytest.mark.slow)])
def test_everything_is_stored(tmp_path, make):
    low = [0.25, 0.25, 0.5] if make is cube else [0.05, 0.05]
    box = {"box": [low, [x + 0.25 if make is cube else x + 0.03 for x in low]]}
    result = solve(make(), tolerance=0.3, goal=["top", Stress(box, "xx"), Reaction("bottom", "y")])
    again = load_result(result.save(tmp_path / "answer"))
    assert again.goals == result.goals
    assert again.summary() == result.summary()
    told = json.loads(json.dumps(result.summary()))
    assert [entry["quantity"] for entry in told["goal"]] == ["Deflection", "Stress", "Reaction"]
    errors = [entry["relative_error"] for entry in told["goals"]]
    assert errors == [goal.relative_error for goal in result.goals]
    assert result.goal_error == max(errors)


TOP, INSIDE = (
    [[0.375, 0.375, 1.0], [0.625, 0.625, 1.0]],
    [[0.375, 0.375, 0.5], [0.625, 0.625, 0.75]],
)
finely = cache(lambda make: solve(make(), tolerance=0.01))


@pytest.mark.parametrize(("make", "quantity"), [
    pytest.param(cube, Deflection({"box": TOP}, "z"), marks=pytest.mark.slow),
    pytest.param(cube, Stress({"box": INSIDE}, "zz"), marks=pytest.mark.slow),
    (beam, Deflection("right", "z")),
    (beam, Reaction("left")),
])  # fmt: skip
def test_goals_in_space_are_estimated(make, quantity):
    result = solve(make(), tolerance=0.05, goal=quantity)
    truth = finely(make).value_of(quantity)
    off = np.linalg.norm(np.asarray(result.goals[0].value) - truth) / np.linalg.norm(truth)
    assert off <= 1.5 * result.goal_error + 1e-3
    assert result.tolerance_kept == "estimated"
    assert result.goals[0].error_bound is None
    assert "in space" in result.goals[0].no_bound


@pytest.mark.parametrize(("asked", "match"), [
    ((0.3, 0.1), r"\(0\.3, 0\.1\) m lies outside the body"),
    ((0.1, 0.1, 0.1), "must have 2 coordinates"),
    ("botom", "no side 'botom'.*did you mean 'bottom'"),
    ([], "a point, a box .* is needed"),
    (Deflection((0.1, 0.1), "z"), "along must be x, y or a direction of 2 numbers, got 'z'"),
    (Stress((0.1, 0.1), "zz"), "no stress 'zz'; there is xx, xy, yy, von_mises"),
    (Reaction("left"), "nothing holds the body at 'left'; supports are bottom"),
    ([(0.1, 0.1)] * 51, "51 quantities are more than 50"),
])  # fmt: skip
def test_what_cannot_be_asked_is_told_in_one_line(asked, match):
    with pytest.raises(ParameterError, match=match) as caught:
        solve(plate(), tolerance=0.1, goal=asked)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("goal")
    with pytest.raises(ParameterError, match=r"component: .*'hop' \(did you mean 'hoop'"):
        Stress("hole", "hop")
    with pytest.raises(ParameterError, match="component: is needed; there is xx"):
        Stress("hole")


def test_a_region_of_cells_is_asked_for_its_outline():
    scene = plate().with_region(disk={"centre": [0.1, 0.1], "radius": 0.03}, name="hole")
    told = r"'hole' is a region of cells; give it outline = \"true\""
    with pytest.raises(ParameterError, match=f"^goal: {told}"):
        solve(scene, tolerance=0.1, goal="hole")
    for component, kind in (("hoop", ResultError), ("von_mises", ParameterError)):
        with pytest.raises(kind, match=told):
            solve(scene).value_of(Stress("hole", component))


def test_air_and_empty_regions_are_outside():
    with pytest.raises(ParameterError, match="outside the body"):
        solve(pierced(), tolerance=0.1, goal=(0.1, 0.1))
    with pytest.raises(ParameterError, match="no body at"):
        solve(pierced(), tolerance=0.1, goal={"box": [[0.09, 0.09], [0.11, 0.11]]})
    air = {"box": [[0.0, 0.0, 0.0], [0.25, 0.25, 0.25]]}
    cut = {"cells": [4, 4, 4], "cell_size": 0.25, "regions": [air | {"material": "air"}], **STEEL}
    with pytest.raises(ParameterError, match="no body at"):
        solve(cube().replace(body=cut), tolerance=0.2, goal=Stress(air, "xx"))


def test_the_dual_strain_of_von_mises_is_its_slope():
    quantity = Stress((0.06, 0.11), "von_mises")
    found = solve(plate(), tolerance=0.1).found
    goal = goal_of(quantity, found.ground)
    (stress,) = np.mean(found.stresses_at(*goal.where.points(found)[:2]), axis=0)
    (xx, xy), (_, yy) = stress
    slope = np.array([xx - 0.5 * yy, yy - 0.5 * xx, 3.0 * xy]) / goal.read(found)[0]
    np.testing.assert_allclose(goal._slope(found), slope, rtol=1e-6)
