"""Loads on agents: those of equal cells on equal agents, and no moment lost on any others."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import spsolve

from kaju import Scene
from kaju.errors import SceneError, SupportError
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.leaf_supports import loose_part
from kaju.model.elastic.equal.grid import problem_of_scene
from kaju.model.elastic.equal.problem import SIDES
from kaju.model.elastic.equal.reactions import reactions
from kaju.model.elastic.equal.staggered import Numbering, internal_force, stiffness_matrix
from kaju.model.elastic.equal.supports import check_supports, slender_cell
from kaju.model.elastic.posed_body import PosedBody

SOME_ARE_LOOSE = [HealthCheck.filter_too_much, HealthCheck.too_slow]
LEGEND = {0: "air", 1: "a", 2: "b", 3: "rigid"}
MATERIALS = {
    "a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
    "b": {"youngs_modulus": 3e9, "poissons_ratio": -0.2},
}


@st.composite
def bodies(draw, held):
    """Cells with holes, two materials and all kinds of sides, pressed and dragged anywhere."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d = draw(st.sampled_from([2, 2, 3]))
    codes = rng.choice([0, 1, 1, 1, 2, 3 if held else 0], size=rng.integers(2, 8 - d, size=d))
    if draw(st.booleans()):
        codes[codes != 3] = 1
    walls = [{"stiffness": 1e9}, "free"]
    if held:
        walls += ["rigid", "roller", {"displacement": list(1e-9 * rng.normal(size=d))}]
    sides = {name: walls[rng.integers(len(walls))] for name in SIDES[d]}
    cells = np.argwhere((codes == 1) | (codes == 2))
    assume(len(cells))
    loads = []
    for _ in range(4):
        cell = cells[rng.integers(len(cells))]
        load = {"cell": cell.tolist(), "force": rng.normal(size=d).tolist()}
        loads.append(load | {"side": SIDES[d][rng.integers(2 * d)]})
    described = {"legend": LEGEND, "materials": MATERIALS, "allow_floating": True}
    described |= {"cell_size": 0.5, "sides": {k: v for k, v in sides.items() if v != "free"}}
    scene = Scene.from_array(codes, loads=loads, **described)
    try:
        drag = {"side": SIDES[d][rng.integers(2 * d)], "force": rng.normal(size=d).tolist()}
        return Scene.from_array(codes, loads=[*loads, drag], **described)
    except SceneError:
        return scene


def agents(scene, *, smallest):
    """The balance of agents of one size, that of the cells, or else of several sizes."""
    ground = PosedBody(scene, None, at_cells=smallest)
    leaves = ground.start()
    while (leaves.size > ground.cell).any():
        leaves = leaves.split(leaves.size > ground.cell, 0, np.zeros(len(leaves)))
    rng = np.random.default_rng(len(leaves))
    for step in range(0 if smallest else 3):
        # Members one agent wide have no edges that carry shear: halve them first.
        chosen = np.full(len(leaves), True) if step == 0 else rng.random(len(leaves)) < 0.1
        leaves = leaves.split(chosen, step, np.zeros(len(leaves))).balanced(step)
    return Equilibrium(CompositeGrid(ground, leaves))


def settled_cells(scene):
    """Displacements (m) of the faces of equal cells, and the problem; None if it has none."""
    problem, origin = problem_of_scene(scene)
    try:
        check_supports(problem)
    except SupportError:
        return None
    numbering = Numbering(problem.face_states)
    matrix = stiffness_matrix(problem, numbering)
    if slender_cell(problem) is not None or np.linalg.cond(matrix.toarray()) > 1e10:
        return None
    right = numbering.gather(problem.force) - numbering.gather(
        internal_force(problem, problem.fixed)
    )
    u = tuple(values.copy() for values in problem.fixed)
    numbering.scatter(spsolve(matrix.tocsc(), right), u)
    return problem, origin, u


def reactions_of_cells(scene, problem, origin, u):
    found = reactions(problem, u, scene.lattice, origin)
    return {name: problem.scales.force * force for name, force in found.items()}


@settings(max_examples=30, suppress_health_check=SOME_ARE_LOOSE)
@given(bodies(held=True))
def test_equal_agents_answer_every_load_as_equal_cells_do(scene):
    settled = settled_cells(scene)
    assume(settled is not None)
    problem, origin, expected = settled
    balance = agents(scene, smallest=True)
    grid, d, free = balance.grid, balance.grid.dimension, balance.free
    u = grid.value.copy()
    right = (balance.load - balance.pull)[free]
    u[free] = spsolve(balance.stiffness(free).tocsc(), right)
    largest = problem.scales.displacement * max(np.abs(values).max() for values in expected)
    for axis in range(d):
        here = grid.axis == axis
        middle = np.where(np.arange(d) == axis, 0.0, 0.5)
        place = np.rint(grid.place[here] / grid.ground.cell - middle).astype(int)
        there = expected[axis][tuple((place - np.array(origin) + 1).T)]
        np.testing.assert_allclose(
            grid.ground.scales.displacement * u[here],
            problem.scales.displacement * there,
            atol=1e-8 * largest,
        )
    held = reactions_of_cells(scene, problem, origin, expected)
    total = scene.applied().force.sum(axis=0)
    size = np.abs(scene.applied().force).sum() + max(np.abs(f).max() for f in held.values())
    found = balance.reactions(u)
    for name in held.keys() | found.keys():
        force = grid.ground.scales.force * found.get(name, np.zeros(d))
        np.testing.assert_allclose(force, held.get(name, np.zeros(d)), atol=1e-8 * size)
    np.testing.assert_allclose(sum(held.values()), -total, atol=1e-8 * size)


@settings(max_examples=20)
@given(bodies(held=False))
def test_no_force_and_no_moment_is_lost_on_agents_of_several_sizes(scene):
    balance = agents(scene, smallest=False)
    grid, d = balance.grid, balance.grid.dimension
    applied = scene.applied()
    force = applied.force / grid.ground.scales.force
    place = applied.cells + 0.5
    inside = applied.direction < 0
    axis, end = np.divmod(applied.direction, 2)
    place[np.arange(len(place)), axis] += np.where(inside, 0.0, end - 0.5)
    entered = np.where(grid.axis[:, None] == np.arange(d), balance.load[:, None], 0.0)
    arm = grid.place / grid.ground.cell
    size = np.abs(force).sum() * max(scene.lattice.shape)
    np.testing.assert_allclose(entered.sum(axis=0), force.sum(axis=0), atol=1e-11 * size)
    for a, b in grid.edges:
        expected = (place[:, a] * force[:, b] - place[:, b] * force[:, a]).sum()
        moment = (arm[:, a] * entered[:, b] - arm[:, b] * entered[:, a]).sum()
        assert moment == pytest.approx(expected, abs=1e-11 * size)


@settings(max_examples=20)
@given(bodies(held=False))
def test_no_force_and_no_moment_is_lost_on_equal_cells(scene):
    fine = scene.refine(2)  # members one cell wide take no couples
    problem, origin = problem_of_scene(fine)
    applied, d = fine.applied(), fine.lattice.dimension
    force, place = applied.force / problem.scales.force, applied.cells + 0.5
    axis, end = np.divmod(applied.direction, 2)
    place[np.arange(len(place)), axis] += np.where(applied.direction < 0, 0.0, end - 0.5)
    size = np.abs(force).sum() * max(fine.lattice.shape)
    moments = np.zeros((d, d))  # of every component along every axis
    for a, entered in enumerate(problem.force):
        assert entered.sum() == pytest.approx(force[:, a].sum(), abs=1e-11 * size)
        for b in range(d):
            arm = np.arange(entered.shape[b]) - 1 + origin[b] + 0.5 * (a != b)
            others = tuple(c for c in range(d) if c != b)
            moments[a, b] = arm @ entered.sum(axis=others)
    expected = force.T @ place
    turns = moments - moments.T - (expected - expected.T)
    assert np.abs(turns).max() < 1e-11 * size


def floating(shape):
    body = {"cells": shape, "cell_size": 1.0, "material": "steel", "allow_floating": True}
    return agents(Scene(body=body), smallest=False)


def test_bodies_of_agents_of_several_sizes_are_among_those():
    assert len(np.unique(floating([4, 4]).grid.length)) > 1


@pytest.mark.parametrize("shape", [[4, 4], [3, 3, 3]])
def test_agents_of_several_sizes_that_nothing_holds_are_loose(shape):
    assert loose_part(floating(shape)) == (0, "move anywhere")


def test_agents_in_line_between_walls_are_not_loose():
    """Their turn about the line moves no face."""
    codes = np.full((3, 3, 4), 3)
    codes[1, 1, 1:3] = 1
    scene = Scene.from_array(codes, legend=LEGEND, materials=MATERIALS, cell_size=0.5)
    ground = PosedBody(scene, None, at_cells=True)
    assert loose_part(Equilibrium(CompositeGrid(ground, ground.start()))) is None


def test_force_on_a_held_face_goes_into_the_wall():
    body = {"cells": [4, 4], "cell_size": 1.0, "material": "steel"}
    load = {"cell": [1, 0], "side": "bottom", "force": [2.0, 0.0]}
    balance = agents(Scene(body=body, sides={"bottom": "rigid"}, loads=[load]), smallest=True)
    assert balance.entered.wall[2].tolist() == [1.0, 0.0]
    assert not balance.load.any()
