"""Blocks of agents are the same operator as agents one by one, and give the same answers."""

import numpy as np
import pytest
from plates import plate as pressed
from spawning_bodies import BRASS, STEEL, blotched, drawn, pierced, quarter, ragged

from kaju import Scene, solve
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement
from kaju.model.elastic.bounds.bounds_of_blocks import boxes_of_blocks
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.energy_bounds import PROVED_AT
from kaju.model.elastic.cells.cell_fields import CellFields
from kaju.model.elastic.multigrid.block_cycle import BlockCycle
from kaju.model.elastic.multigrid.blocks import BlockOperator, Window
from kaju.model.elastic.multigrid.forest import first_forest
from kaju.model.elastic.posed_body import ground_of
from kaju.model.elastic.refine.block_loop import MEASURED, spawner_of
from kaju.model.elastic.refine.estimator import indicate


@pytest.fixture(autouse=True)
def in_blocks(monkeypatch):
    """Agents stand in blocks here where single ones would do: in the plane, and few."""
    monkeypatch.setattr(
        "kaju.model.elastic.refine.block_loop.blocks_for",
        lambda ground, tolerance: first_forest(ground),
    )


def plate(**changes):
    return pressed([20, 20], [10, 19], **changes)


def dragged():
    top = {"region": {"box": [[0.05, 0.2], [0.1, 0.2]]}, "force": [3.0, -1.0]}
    return plate(sides={"left": "rigid", "bottom": "roller"}, loads=[top])


def layered():
    codes = np.ones((8, 8), dtype=int)
    codes[:, 4:] = 2
    codes[5:, 6:] = 0
    return drawn(codes, [STEEL, BRASS], [{"side": "left", "pressure": 1e5}])


BODIES = {
    "plate": plate,
    "dragged": dragged,
    "layered": layered,
    "pierced": pierced,
    "blotched": blotched,
    "ragged": lambda: ragged(1),
    "cube": lambda: quarter(0.3),
    "cube with another": lambda: quarter(0.3, {"youngs_modulus": 0.01, "poissons_ratio": 0.2}),
}


def random_blocks(scene, seed=0):
    """Return blocks that have spawned by chance, and the same agents one by one."""
    forest, rng = first_forest(ground_of(scene, None, None)), np.random.default_rng(seed)
    steps, share = (3, 0.15) if forest.dimension == 2 else (2, 0.03)
    for step in range(steps):
        forest = forest.refined(rng.random(len(forest)) < share, step + 1)
    return BlockOperator(forest), Window(forest, forest.leaves)


@pytest.mark.parametrize("name", BODIES)
def test_forces_and_loads_are_those_of_single_agents(name):
    blocks, window = random_blocks(BODIES[name]())
    balance = window.balance
    place, free = window.place[balance.free], balance.free
    assert blocks.forest.depth > 1
    np.testing.assert_array_equal(np.sort(place), blocks.unknowns)
    x = np.random.default_rng(1).normal(size=len(free))
    u, force = blocks.zeros(), blocks.zeros()
    u.ravel()[place] = x
    energy = blocks.apply(u, force)
    expected = balance.stiffness(free) @ x
    scale = np.abs(expected).max()
    np.testing.assert_allclose(force.ravel()[place], expected, rtol=0, atol=4e-15 * scale)
    assert energy == pytest.approx(x @ expected, rel=1e-13)
    load = blocks.load.ravel()
    np.testing.assert_allclose(load[place], balance.load[free], atol=1e-14)
    assert np.count_nonzero(load) == np.count_nonzero(balance.load[free])


@pytest.mark.parametrize(
    ("real", "rounding"),
    [(np.float32, 1e-6), pytest.param(np.float64, 1e-12, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name", ["plate", "pierced", "cube with another"])
def test_a_cycle_is_symmetric(name, real, rounding):
    blocks, _ = random_blocks(BODIES[name]())
    multigrid, rng = BlockCycle(blocks, real=real), np.random.default_rng(2)
    loads = [blocks.zeros(), blocks.zeros()]
    for load in loads:
        load.ravel()[blocks.unknowns] = rng.normal(size=len(blocks.unknowns))
    answers = [multigrid.precondition(load).copy() for load in loads]
    (ours, theirs), leaves = loads, blocks.forest.leaves
    one = np.vdot(ours[leaves], answers[1][leaves])
    other = np.vdot(theirs[leaves], answers[0][leaves])
    size = np.vdot(ours[leaves], answers[0][leaves])
    assert size > 0.0
    assert abs(one - other) < rounding * size


def pressed_cube():
    """Return a cube of eight blocks, held below and pressed on a quarter of its top."""
    body = {"cells": [2, 2, 2], "cell_size": 0.5, "material": "steel"}
    part = {"box": [[0.0, 0.0, 1.0], [0.5, 0.5, 1.0]]}
    loads = [{"region": part, "force": [0.0, 0.0, -1.0]}]
    return Scene(body=body, materials={"steel": STEEL}, sides={"bottom": "rigid"}, loads=loads)


def test_a_cycle_leaves_less_of_every_error():
    # Two small blocks that touch along an edge, large ones beside both: there rows have many faces.
    forest = first_forest(ground_of(pressed_cube(), None, None))
    marked = np.zeros(len(forest), dtype=bool)
    marked[forest.leaves[[0, 3]]] = True
    blocks = BlockOperator(forest.refined(marked, 1))
    multigrid, free = BlockCycle(blocks, real=np.float64), blocks.unknowns
    error = np.random.default_rng(0).normal(size=len(free))
    for _ in range(12):
        u, force = blocks.zeros(), blocks.zeros()
        u.ravel()[free] = error
        energy = blocks.apply(u, force)
        change = multigrid.precondition(force).ravel()[free]
        assert 0.0 < np.vdot(change, force.ravel()[free]) < 2.0 * energy
        error = error - change
        error /= np.abs(error).max()


def test_loads_across_sides_concern_the_loaded_agents_alone(monkeypatch):
    blocks, seen = BlockOperator(first_forest(ground_of(pressed_cube(), None, None))), []

    def recorded(*args):
        seen.append(Window(*args))
        return seen[-1]

    monkeypatch.setattr("kaju.model.elastic.multigrid.blocks.Window", recorded)
    assert np.count_nonzero(blocks.load) == 8**2
    assert [len(window.leaves) for window in seen] == [8**2]


def test_bounds_worked_out_early_are_those_of_a_settled_answer(monkeypatch):
    early = {3: (4_000, 100_000)}
    monkeypatch.setattr("kaju.model.elastic.refine.block_loop.BOUNDED_EARLY", early)
    loop = spawner_of(ground_of(pressed_cube(), None, None), 0.01, None)
    guess = loop.target
    loop.step()
    bounds = loop._bounds()
    assert bounds.error < 0.95 * loop.error
    assert loop.target == pytest.approx(guess * PROVED_AT[3] * loop.error / bounds.error)
    assert loop.spare == MEASURED


@pytest.mark.parametrize("name", ["plate", "dragged", "layered"])
def test_answers_are_those_of_single_agents(name):
    result = solve(BODIES[name](), tolerance=0.015, strategy="spawning")
    balance = result.found.balance
    u = result.found.displacement
    left = balance.force(u)[balance.free] - balance.load[balance.free]
    assert np.abs(left).max() < 1e-7 * np.abs(balance.load).max()
    assert balance.energy(u) == pytest.approx(result.found.energy, rel=1e-8)
    assert result.agents == len(balance.grid.leaves) == len(result.cause)
    assert len(balance.grid.leaves.balanced(0)) == result.agents


@pytest.mark.parametrize(("name", "tolerance"), [("dragged", 0.004), ("layered", 0.012)])
def test_what_is_looked_up_near_by_is_what_all_agents_say(name, tolerance):
    result = solve(BODIES[name](), tolerance=tolerance, strategy="spawning")
    spawning, scales = result.found, result.found.scales
    every = CellFields(spawning.balance, spawning.displacement)
    np.testing.assert_allclose(spawning.moved, every.displacement, atol=1e-13)
    agent = np.random.default_rng(3).integers(0, result.agents, 5)
    fields, at = spawning.near(agent)
    assert len(fields.stress) < 0.6 * result.agents
    np.testing.assert_allclose(fields.stress[at], every.stress[agent], atol=1e-12)
    for name, force in spawning.balance.reactions(spawning.displacement).items():
        np.testing.assert_allclose(
            result.reactions[name], scales.force * force, atol=1e-9 * scales.force
        )
    total = sum(result.reactions.values())
    applied = result.scene.applied(None).force.sum(axis=0)
    np.testing.assert_allclose(total, -applied, atol=1e-9 * np.abs(applied).max())


@pytest.mark.parametrize("name", BODIES)
def test_bounds_are_told_what_all_agents_say(name):
    blocks, window = random_blocks(BODIES[name]())
    u = blocks.zeros()
    u.ravel()[blocks.unknowns] = np.random.default_rng(4).normal(size=len(blocks.unknowns))
    blocks.fill_coarse(u)
    ours = boxes_of_blocks(blocks, u)
    theirs = boxes_of_agents(window.balance, window.displacement(u))
    for one, other in zip(said_of(ours), said_of(theirs), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(other).max(initial=0.0))
    ends = []
    for boxes in (ours, theirs):
        field = AdmissibleDisplacement(boxes)
        held = np.linalg.norm(field.force(field.displacement))
        ends.append([*field.energies(), field.work(), held])
    np.testing.assert_allclose(*ends, rtol=1e-9)


def said_of(boxes):
    """Return what boxes are, but for the numbers of their nodes."""
    held = [column for held in boxes.held for column in held]
    plain = (boxes.size, *boxes.law, boxes.sigma, *boxes.shear.values(), boxes.body, boxes.beside)
    others = (boxes.kind, boxes.uneven, boxes.moved, *boxes.hanging, *boxes.loads)
    return *plain, *others, *held, boxes.mesh.start[boxes.mesh.corner]


def test_blocks_ask_for_no_more_than_the_tolerance():
    coarse = solve(plate(), tolerance=0.015, strategy="spawning")
    fine = solve(plate(), tolerance=0.004, strategy="spawning")
    assert 0.5 * 0.015 < coarse.error_bound <= 0.015
    assert 0.5 * 0.004 < fine.error_bound <= 0.004
    last = coarse.generations[-1]
    gap = last.energy / fine.generations[-1].energy - 1
    assert 0.3 * last.error**2 < gap < 2.0 * last.error**2
    assert len(fine.generations) == fine.summary()["generations"]
    assert fine.generations[-1].agents == fine.agents


def test_what_short_numbers_cannot_settle_long_ones_do(monkeypatch):
    usual = solve(plate(), strategy="spawning", tolerance=0.015)
    settles, cycles = BlockCycle.solve, []

    def stuck(self, load, u, done, most=100):
        cycles.append(self.real)
        short = self.real is np.float32
        run = settles(self, load, u, done, 1 if short else most)
        run.converged &= not short
        return run

    monkeypatch.setattr(BlockCycle, "solve", stuck)
    result = solve(plate(), strategy="spawning", tolerance=0.015)
    assert set(cycles) == {np.float32, np.float64}
    assert result.residuals[-1] <= 1e-9
    assert result.strain_energy == pytest.approx(usual.strain_energy, rel=1e-4)
    assert result.tolerance_kept == "proved"


def test_family_of_blocks_is_a_family():
    result = solve(plate(), tolerance=0.015, strategy="spawning")
    family = result.family
    np.testing.assert_array_equal(np.sort(family.rows["code"][family.working]),
                                  np.sort(result.found.leaves.code))  # fmt: skip
    np.testing.assert_array_equal(family.rows["cause"][family.working], result.cause)
    assert np.nanmax(result.cause) > 0.0


def test_a_mirror_image_has_the_image_of_the_answer():
    load = {"region": {"box": [[0.08, 0.2], [0.12, 0.2]]}, "force": [0.0, -2.0]}
    result = solve(plate(loads=[load]), tolerance=0.006, strategy="spawning")
    image = result.middle * [-1.0, 1.0] + [0.2, 0.0]
    order = np.lexsort(np.rint(result.middle.T * 1e9))
    turned = np.lexsort(np.rint(image.T * 1e9))
    np.testing.assert_allclose(result.middle[order], image[turned], atol=1e-15)
    u = result.displacement
    np.testing.assert_array_equal(u[order], u[turned] * [-1.0, 1.0])


@pytest.mark.parametrize("name", ["plate", "layered", "cube"])
def test_agents_leave_unbalanced_what_single_agents_leave(name):
    """Wherever neighbours are of one size and the body goes on: also across two blocks."""
    forest = first_forest(ground_of(BODIES[name](), None, None))
    forest = forest.refined(np.ones(len(forest), dtype=bool), 1)
    blocks, window = BlockOperator(forest), Window(forest, forest.leaves)
    u, free = blocks.zeros(), window.place >= 0
    x = window.grid.place[free] / window.grid.place.max()  # bends alike fill_coarse
    bent = np.random.default_rng(2).normal(size=(x.shape[1], x.shape[1], x.shape[1]))
    moved = np.einsum("ni,nj,aij->na", x, x, bent)
    u.ravel()[window.place[free]] = moved[np.arange(len(x)), window.grid.axis[free]]
    ours = blocks.indicator(u)
    theirs = indicate(window.balance, window.displacement(u))
    grid = window.grid
    beside = grid.beside
    whole = np.all((beside >= 0) & (grid.leaves.kind[beside] == grid.leaves.kind[:, None]), axis=1)
    for side in range(beside.shape[1]):  # nor may there be a surface at a corner
        whole &= np.all(beside[beside[:, side]] >= 0, axis=1) & (beside[:, side] >= 0)
    kinds = grid.leaves.kind
    whole &= np.all(kinds[beside[beside]] == kinds[:, None, None], axis=(1, 2))
    assert whole.sum() > 0.2 * len(whole)
    np.testing.assert_allclose(ours.square[whole], theirs.square[whole], rtol=1e-7)
    np.testing.assert_allclose(ours.load[whole], theirs.load[whole], rtol=1e-5)
