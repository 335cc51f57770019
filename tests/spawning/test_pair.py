"""Agents of two minds: what both opinions prove, however a body is held and loaded."""

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from plane_bodies import plane_body

import kaju
from kaju import Deflection, Reaction, Stress
from kaju.errors import ConvergenceError, KajuError, SupportError

LEGEND = {0: "air", 1: "steel", 2: "rigid"}
PLATE = np.ones((8, 8), int)
HOLED = PLATE.copy()
HOLED[3:5, 3:5] = 0
HELD_HOLE = np.pad(np.full((3, 3), 2), 3, constant_values=1)
TWO_HELD = np.ones((16, 9), int)
TWO_HELD[3:5, 3:6] = TWO_HELD[10:12, 4:6] = 2
IN_A_ROW = np.ones((9, 8), int)
IN_A_ROW[2, 4] = IN_A_ROW[4, 4] = IN_A_ROW[7, 4] = 2
ONE_SOFT = np.ones((32, 32), int)
ONE_SOFT[31, 13] = 3  # the first agents beside it are small: their corners hang on larger ones
TOP = {"side": "top", "force": [100.0, -100.0]}
DOWN = {"side": "right", "force": [0.0, -100.0]}


def body(codes, **more):
    given = {"legend": LEGEND, "cell_size": 0.01, "thickness": 0.01, "loads": []} | more
    return kaju.Scene.from_array(codes, **given)


def proved(scene, tolerance):
    answer = kaju.solve(scene, tolerance=tolerance)
    assert answer.tolerance_kept == "proved"
    assert answer.error_bound <= tolerance
    return answer


SCENES = {
    "rollers": body(PLATE, sides={"left": "roller", "bottom": "roller"}, loads=[TOP]),
    "weight": body(PLATE, sides={"bottom": "rigid"}, gravity=[1.0, -9.81]),
    "bed": body(PLATE, sides={"bottom": {"stiffness": 1e11}, "left": "roller"}, loads=[TOP]),
    "moved": body(PLATE, sides={"bottom": "rigid", "top": {"displacement": [1e-5, 1e-6]}}),
    "held hole": body(HELD_HOLE, loads=[TOP]),
    "held hole and side": body(HELD_HOLE, sides={"bottom": "rigid"}, loads=[TOP]),
    "two held holes": body(TWO_HELD, loads=[TOP]),
    "held holes in a row": body(IN_A_ROW, sides={"bottom": "rigid"}, loads=[TOP]),
    "hole that bears a force": body(
        HELD_HOLE % 2,
        sides={"bottom": "rigid"},
        loads=[{"cell": [4, 2], "side": "top", "force": [50.0, -100.0]}],
    ),
    "ends within sides": body(
        PLATE,
        sides={"left": "rigid"},
        loads=[{"region": {"box": [[0.013, 0.08], [0.0777, 0.08]]}, "force": [10.0, -50.0]}],
    ),
    "moved beside small agents": body(
        ONE_SOFT,
        legend={1: "steel", 3: "soft"},
        materials={"soft": {"youngs_modulus": 2e9, "poissons_ratio": 0.3}},
        sides={"left": "rigid", "right": {"displacement": [1e-6, 2e-6]}},
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_bounds_of_fewer_agents_hold_those_of_more(name):
    low, high = proved(SCENES[name], 0.03).energy_bounds
    lower, upper = proved(SCENES[name], 0.006).energy_bounds
    assert low <= lower < upper <= high


def test_forces_and_moved_sides_together_have_bounds_of_second_order():
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, 1e-6]}}
    mixed = body(PLATE, sides=sides, loads=[{"side": "right", "force": [4e3, 0.0]}])
    low, high = proved(mixed, 0.02).energy_bounds
    assert high - low < 2 * 2 * 0.02**2 * high


def test_a_bar_under_tension_is_exact_from_the_first():
    sides = {"left": "roller", "bottom": "roller"}
    answer = proved(body(PLATE, sides=sides, loads=[{"side": "right", "pressure": -1e6}]), 0.02)
    low, high = answer.energy_bounds
    assert answer.agents == 64
    assert high - low < 1e-9 * high
    points = np.array([[0.002, 0.003], [0.021, 0.039], [0.08, 0.08]])
    np.testing.assert_allclose(answer.stress_at(points), [[[1e6, 0], [0, 0]]] * 3, atol=1e-2)
    last = answer.generations[-1]
    np.testing.assert_allclose([last.fitted, last.balanced], 1e6, atol=1e-2)
    steel = answer.scene.cell_materials[0]
    stretch = 0.08 * 1e6 / steel.youngs_modulus
    moved = answer.displacement_at(points)[-1]
    assert moved == pytest.approx([stretch, -steel.poissons_ratio * stretch])


@pytest.mark.parametrize("shift", [1e-2, 1.0])
def test_sides_that_move_together_strain_nothing(shift):
    def moved(by):
        sides = {
            "left": {"displacement": [by, by]},
            "right": {"displacement": [by + 2e-6, by - 1e-6]},
        }
        return proved(body(PLATE, sides=sides), 0.01)

    there, here = moved(shift), moved(0.0)
    assert there.energy_bounds == pytest.approx(here.energy_bounds, rel=1e-8)
    assert there.displacement_at([[0.0, 0.04]]) == pytest.approx(np.array([[shift, shift]]))


@pytest.mark.parametrize("shift", [0.1, 30.0, -7.3])
def test_a_proof_holds_to_the_last_digits_of_bodies_that_move_far(shift):
    sides = {
        "left": {"displacement": [shift, "free"]},
        "right": {"displacement": [shift + 1e-6, "free"]},
        "bottom": {"displacement": ["free", shift]},
    }
    steel = kaju.material("steel")
    stretch = (shift + 1e-6) - shift  # of two close numbers, without rounding
    lower, upper = proved(body(PLATE, sides=sides), 0.01).energy_bounds
    assert lower <= 0.5 * steel.youngs_modulus * stretch**2 * 0.01 <= upper


def test_a_body_that_something_leaves_free_is_refused():
    with pytest.raises(SupportError, match="could move along x"):
        kaju.solve(body(PLATE, sides={"bottom": "roller"}, loads=[TOP]), tolerance=0.1)
    torn = {"bottom": "rigid", "left": {"displacement": [1e-6, 0.0]}}
    with pytest.raises(SupportError, match="two displacements at once"):
        kaju.solve(body(PLATE, sides=torn), tolerance=0.1)


@pytest.mark.parametrize("seed", range(24))
def test_bounds_of_random_bodies_hold_the_energy_of_elements_and_of_more_agents(seed):
    try:
        scene = plane_body(seed)
        coarse, fine = (proved(scene, t) for t in (0.1, 0.03))
    except ConvergenceError as error:
        coarse = fine = error.best
    except KajuError:
        pytest.skip("no body, or one that moves freely")
    low, high = coarse.energy_bounds
    lower, upper = fine.energy_bounds
    assert max(low, lower) <= min(high, upper) * (1 + 1e-9)
    held = {side.kind for side in scene.sides.values()}
    if held <= {"rigid", "roller"} and scene.loads[0].cell is None:
        # Elements have less energy than is true where no side moves.
        pytest.importorskip("skfem")
        elements = graded_elements(scene, order=2, levels=3).strain_energy
        assert elements <= min(high, upper) * (1 + 1e-9)
        assert elements > 0.9 * lower


def test_a_corner_is_proved_to_a_part_in_five_thousand():
    """The smallest agents are 4e-6 of the first: global values lose the bounds to rounding."""
    codes = np.ones((16, 16), int)
    codes[8:, 8:] = 0
    load = {"region": {"box": [[0.0, 0.16], [0.08, 0.16]]}, "force": [100.0, 0.0]}
    proved(body(codes, plane="strain", sides={"bottom": "rigid"}, loads=[load]), 2e-4)


def test_materials_of_a_million_times_the_stiffness_are_proved():
    codes = PLATE.copy()
    codes[2:6, 3:6] = 3
    materials = {"soft": {"youngs_modulus": 2e5, "poissons_ratio": 0.3}}
    legend = LEGEND | {3: "soft"}
    more = {"legend": legend, "materials": materials, "sides": {"bottom": "rigid"}, "loads": [TOP]}
    del legend[0], legend[2]
    proved(body(codes, **more), 0.002)


@pytest.mark.parametrize("tolerance", [0.05, 0.01])
def test_a_stiff_bed_under_a_corner_is_refined_where_it_disagrees(tolerance):
    codes = PLATE.copy()
    codes[4:, 4:] = 0
    sides = {"bottom": {"stiffness": 1e12}, "left": "roller"}
    down = [{"side": "top", "force": [0.0, -100.0]}]
    answer = proved(body(codes, sides=sides, loads=down), tolerance)
    assert answer.agents < 250
    assert answer.reactions["bottom"] == pytest.approx([0.0, 100.0])


def test_one_quantity_has_one_number():
    bent = body(np.ones((16, 2), int), cell_size=0.025, sides={"left": "rigid"}, loads=[DOWN])
    answer, tip, top = proved(bent, 0.05), (0.4, 0.025), (0.2, 0.05)
    moved = answer.displacement_at([tip])[0]
    np.testing.assert_array_equal(answer.value_of(tip), moved)
    assert moved[1] == pytest.approx(-1.0041e-4, rel=0.003)
    stress = answer.stress_at([top])[0]
    assert answer.value_of(Stress(top, "xx")) == pytest.approx(stress[0, 0], rel=1e-12)
    found = answer.found
    both = found.opinions.stresses_at(*found.placed(*found.located([top])))
    np.testing.assert_allclose(stress, found.scales.stress * np.mean(both, axis=0)[0], rtol=1e-12)
    np.testing.assert_array_equal(answer.value_of(Reaction("left")), answer.reactions["left"])
    assert answer.reactions["left"] / 100.0 == pytest.approx([0.0, 1.0])  # shares of the load
    # The work of the load, by the mean displacement of its side, is twice the energy.
    low, high = answer.energy_bounds
    work = -50.0 * answer.value_of(Deflection("right", "y"))
    assert 0.99 * low <= work <= high
    assert answer.strain_energy == pytest.approx(0.5 * (low + high))
    assert answer.energy.sum() == pytest.approx(answer.strain_energy)
    last = answer.generations[-1]
    assert (last.lower, last.upper, last.error) == (low, high, answer.error_bound)
    assert answer.gap.sum() == pytest.approx(2 * (high - low), rel=1e-6)
    assert answer.error_estimate == answer.error_bound == answer.summary()["error_bound"]
    np.testing.assert_array_equal(answer.gap, last.gap)


def test_a_stored_answer_has_its_agents_and_finds_its_fields_again(tmp_path):
    answer = proved(SCENES["held hole and side"], 0.01)
    again = kaju.load_result(answer.save(tmp_path / "answer.npz"))
    assert again.summary() == answer.summary()
    points = answer.lower + 0.3 * answer.size[:, None]
    np.testing.assert_array_equal(again.displacement_at(points), answer.displacement_at(points))
    np.testing.assert_array_equal(again.stress, answer.stress)
    for name in answer.family.rows.dtype.names:
        np.testing.assert_array_equal(again.family.rows[name], answer.family.rows[name])


def test_agents_that_run_out_say_so_and_keep_what_they_have(monkeypatch):
    monkeypatch.setattr("kaju.model.elastic.pair.loop.MOST_AGENTS", 100)
    with pytest.raises(ConvergenceError, match="more than the 100") as caught:
        kaju.solve(SCENES["weight"], tolerance=0.001)
    assert caught.value.best.tolerance_kept == "missed"
    coarse = kaju.solve(SCENES["weight"], tolerance=0.001, resolution=1)
    assert "a larger resolution allows smaller ones" in coarse.notes[0]
    assert coarse.size.min() == 0.01


def test_a_corner_that_no_agents_prove_is_given_up_early():
    hopeless = kaju.solve(plane_body(94), tolerance=0.03)  # foam and a stiff corner
    assert hopeless.agents < 6000
    assert "even the smallest agents possible" in hopeless.notes[0]


def test_a_load_straight_onto_a_support_is_borne_by_it_alone():
    straight = {"cell": [1, 0], "side": "bottom", "force": [3.0, -5.0]}
    loads = [straight, {"side": "top", "force": [0.0, -7.0]}]
    answer = kaju.solve(body(PLATE, sides={"bottom": "rigid"}, loads=loads), tolerance=0.05)
    assert answer.reactions["bottom"] == pytest.approx([-3.0, 12.0])
    alone = kaju.solve(body(PLATE, sides={"bottom": "rigid"}, loads=loads[1:]), tolerance=0.05)
    assert answer.energy_bounds == pytest.approx(alone.energy_bounds)


@pytest.mark.parametrize("codes", [PLATE, HOLED], ids=["plate", "hole"])
def test_a_symmetric_body_keeps_symmetric_agents(codes):
    """To a tolerance at which equations are iterated."""
    load = {"region": {"box": [[0.03, 0.08], [0.05, 0.08]]}, "force": [0.0, -100.0]}
    answer = proved(body(codes, sides={"bottom": "rigid"}, loads=[load]), 1e-3)
    mirrored = answer.lower * [-1, 1] + (0.08 - answer.size)[:, None] * [1, 0]
    unit = answer.size.min()
    whole = [
        np.rint(np.column_stack([lower, answer.size]) / unit) for lower in (answer.lower, mirrored)
    ]
    one, other = (np.lexsort(rows.T) for rows in whole)
    np.testing.assert_array_equal(whole[0][one], whole[1][other])
    np.testing.assert_allclose(answer.gap[one], answer.gap[other], rtol=1e-4)
