"""Agents of two minds: what both opinions prove, however a body is held and loaded."""

import numpy as np
import pytest
from plane_bodies import plane_body

import kaju
from kaju.errors import KajuError, SupportError
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.elastic.posed_body import PosedBody

LEGEND = {0: "air", 1: "steel", 2: "rigid"}
PLATE = np.ones((8, 8), int)
HELD_HOLE = np.pad(np.full((3, 3), 2), 3, constant_values=1)
TWO_HELD = np.ones((16, 9), int)
TWO_HELD[3:5, 3:6] = TWO_HELD[10:12, 4:6] = 2
TOP = {"side": "top", "force": [100.0, -100.0]}


def body(codes, **more):
    given = {"legend": LEGEND, "cell_size": 0.01, "thickness": 0.01, "loads": []} | more
    return kaju.Scene.from_array(codes, **given)


def proved(scene, tolerance):
    spawning = PairLoop(PosedBody(scene, None, at_cells=False, deepest=22), tolerance)
    while not spawning.finished:
        spawning.step()
    assert spawning.reached
    bounds, unit = spawning.last.bounds, spawning.body.scales.energy
    assert bounds.error <= tolerance
    return bounds.lower * unit, bounds.upper * unit, spawning.last


SCENES = {
    "rollers": body(PLATE, sides={"left": "roller", "bottom": "roller"}, loads=[TOP]),
    "weight": body(PLATE, sides={"bottom": "rigid"}, gravity=[1.0, -9.81]),
    "bed": body(PLATE, sides={"bottom": {"stiffness": 1e11}, "left": "roller"}, loads=[TOP]),
    "moved": body(PLATE, sides={"bottom": "rigid", "top": {"displacement": [1e-5, 1e-6]}}),
    "held hole": body(HELD_HOLE, loads=[TOP]),
    "held hole and side": body(HELD_HOLE, sides={"bottom": "rigid"}, loads=[TOP]),
    "two held holes": body(TWO_HELD, loads=[TOP]),
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
}


@pytest.mark.parametrize("name", SCENES)
def test_bounds_of_fewer_agents_hold_those_of_more(name):
    low, high, _ = proved(SCENES[name], 0.03)
    lower, upper, _ = proved(SCENES[name], 0.006)
    assert low <= lower < upper <= high


def test_forces_and_moved_sides_together_have_bounds_of_second_order():
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, 1e-6]}}
    mixed = body(PLATE, sides=sides, loads=[{"side": "right", "force": [4e3, 0.0]}])
    low, high, _ = proved(mixed, 0.02)
    assert high - low < 2 * 2 * 0.02**2 * high


def test_a_bar_under_tension_is_exact_from_the_first():
    sides = {"left": "roller", "bottom": "roller"}
    low, high, found = proved(
        body(PLATE, sides=sides, loads=[{"side": "right", "pressure": -1e6}]), 0.02
    )
    assert len(found.size) == 64
    assert high - low < 1e-9 * high


@pytest.mark.parametrize("shift", [1e-2, 1.0])
def test_sides_that_move_together_strain_nothing(shift):
    def moved(by):
        sides = {
            "left": {"displacement": [by, by]},
            "right": {"displacement": [by + 2e-6, by - 1e-6]},
        }
        return proved(body(PLATE, sides=sides), 0.01)[:2]

    assert moved(shift) == pytest.approx(moved(0.0), rel=1e-8)


def test_tractions_balance_in_every_agent_and_across_every_edge():
    """Of the last generation, which iterates; its load ends within a side."""
    _, _, found = proved(SCENES["ends within sides"], 0.004)
    force = found.tractions[:, :, 0]
    most = np.abs(found.sides.load).max()
    np.testing.assert_allclose(force.sum(axis=1), 0.0, atol=1e-9 * most)
    mesh = found.mesh
    whole = np.setdiff1d(
        np.arange(mesh.edges), np.concatenate([mesh.border, *mesh.halves, mesh.whole])
    )
    across = np.zeros((mesh.edges, 2))
    np.add.at(across, mesh.edge, force)
    np.testing.assert_allclose(across[whole], 0.0, atol=1e-9 * most)
    free = found.sides.given.all(axis=1)
    own = found.tractions[mesh.owner, mesh.side][free]
    wanted = found.sides.load[mesh.owner, mesh.side][free]
    np.testing.assert_allclose(own, wanted, atol=1e-9 * most)


def test_a_body_that_something_leaves_free_is_refused():
    with pytest.raises(SupportError, match="could move along x"):
        proved(body(PLATE, sides={"bottom": "roller"}, loads=[TOP]), 0.1)
    torn = {"bottom": "rigid", "left": {"displacement": [1e-6, 0.0]}}
    with pytest.raises(SupportError, match="two displacements at once"):
        proved(body(PLATE, sides=torn), 0.1)


@pytest.mark.parametrize("seed", range(30))
def test_random_bodies_have_the_same_energy_as_equal_cells_bound(seed):
    try:
        scene = plane_body(seed)
        bounds = kaju.solve(scene, resolution=2).energy_bounds
    except KajuError:
        pytest.skip("no body, or one that moves freely")
    spawning = PairLoop(PosedBody(scene, None, at_cells=False, deepest=22), 0.1, 5_000)
    while not spawning.finished:
        spawning.step()
    own, unit = spawning.last.bounds, spawning.body.scales.energy
    assert own.error < np.inf
    if bounds is not None:
        assert max(bounds[0], own.lower * unit) <= min(bounds[1], own.upper * unit) * (1 + 1e-9)


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
    _, _, found = proved(body(codes, sides=sides, loads=down), tolerance)
    assert len(found.size) < 250
    assert found.reactions()["bottom"] * found.body.scales.force == pytest.approx([0.0, 100.0])


def test_the_fields_of_a_bar_are_those_of_even_tension():
    sides = {"left": "roller", "bottom": "roller"}
    _, _, found = proved(body(PLATE, sides=sides, loads=[{"side": "right", "pressure": -1e6}]), 0.1)
    agent, inside = np.array([0, 17, 63]), np.array([[0.2, 0.3], [0.5, 0.9], [1.0, 1.0]])
    for stress in found.stresses_at(agent, inside):
        np.testing.assert_allclose(stress * found.body.scales.stress, [[1e6, 0, 0]] * 3, atol=1e-2)
    moved = found.displacement_at(agent, inside)[-1] * found.body.scales.displacement
    steel = found.body.scene.cell_materials[0]
    stretch = 0.08 * 1e6 / steel.youngs_modulus
    assert moved == pytest.approx([stretch, -steel.poissons_ratio * stretch])


def test_the_work_of_the_loads_is_twice_the_energy_and_reactions_balance():
    low, high, found = proved(SCENES["held hole and side"], 0.01)
    work = sum(
        found.sides.load[found.mesh.owner, found.mesh.side, 0][k]
        @ found.displacement_at(found.mesh.owner[[k]], np.array([[0.5, 1.0]]))[0]
        for k in np.flatnonzero(found.mesh.side == 1)
    )
    work *= found.body.scales.energy
    assert work / 2 == pytest.approx(0.5 * (low + high), rel=0.01)
    borne = sum(found.reactions().values()) * found.body.scales.force
    assert borne == pytest.approx([-100.0, 100.0])
    assert set(found.reactions()) == {"bottom", "rigid"}


def test_a_side_that_moves_beside_small_first_agents_is_moved_without_gaps():
    """Beside the soft cell the first agents are small: corners of theirs hang on larger ones."""
    codes = np.ones((32, 32), int)
    codes[31, 13] = 3
    materials = {"soft": {"youngs_modulus": 2e9, "poissons_ratio": 0.3}}
    sides = {"left": "rigid", "right": {"displacement": [1e-6, 2e-6]}}
    scene = body(codes, legend={1: "steel", 3: "soft"}, materials=materials, sides=sides)
    low, high, _ = proved(scene, 0.05)
    lower, upper, _ = proved(scene, 0.01)
    assert low <= lower < upper <= high
