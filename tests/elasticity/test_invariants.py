"""What must hold for every body: balance, reciprocity, superposition, symmetry, scaling."""

import numpy as np
import pytest
from elastic_cases import Body, bodies, random_loads
from hypothesis import given, settings

from kaju.model.elastic.equal.problem import FIXED, CellLoads
from kaju.model.elastic.equal.staggered import internal_force

EXAMPLES = settings(max_examples=25)


def face_places(problem, axis):
    """Positions of all faces, rim included, in cells counted from the body's corner."""
    grid = np.indices(problem.face_shape(axis)).astype(float) - 0.5
    grid[axis] -= 0.5
    return grid


def moment(place, force):
    """Moment of forces about the origin, all components."""
    d = len(force)
    pairs = [(a, b) for a in range(d) for b in range(a + 1, d)]
    return np.array([(place[a] * force[b] - place[b] * force[a]).sum() for a, b in pairs])


@EXAMPLES
@given(bodies())
def test_forces_and_moments_balance(case):
    check_balance(case[0])


@pytest.mark.slow
@settings(max_examples=200)
@given(bodies())
def test_forces_and_moments_balance_on_two_hundred_bodies(case):
    check_balance(case[0])


def check_balance(body):
    """Loads and reactions sum up to nothing, and so do their moments."""
    _, problem, solution = body.solve()
    d = problem.dimension
    force_unit = problem.scales.force
    inner = internal_force(problem, solution.displacement)
    total, turning = np.zeros(d), 0.0
    for axis in range(d):
        held = problem.face_states[axis] == FIXED
        pull = np.where(held, inner[axis] - problem.force[axis], 0.0)
        pull -= problem.spring[axis] * solution.displacement[axis]
        total[axis] = force_unit * pull.sum()
        vector = np.zeros((d, *pull.shape))
        vector[axis] = force_unit * pull
        turning = turning + moment(face_places(problem, axis), vector)
    cells, direction, force = body.loads[:3]
    place = cells + 0.5
    for axis in range(d):
        for upper in (0, 1):
            here = direction == 2 * axis + upper
            place[here, axis] += upper - 0.5
    scale = np.abs(force).sum()
    np.testing.assert_allclose(total + force.sum(axis=0), 0, atol=1e-9 * scale)
    balance = turning + moment(place.T, force.T)
    np.testing.assert_allclose(balance, 0, atol=1e-9 * scale * max(body.kinds.shape))


@EXAMPLES
@given(bodies())
def test_energy_is_half_of_load_times_displacement(case):
    body, _ = case
    _, problem, solution = body.solve()
    work = sum(np.vdot(f, u) for f, u in zip(problem.force, solution.displacement, strict=True))
    assert solution.energy == pytest.approx(0.5 * work, rel=1e-8)
    stored = internal_force(problem, solution.displacement)
    direct = sum(np.vdot(f, u) for f, u in zip(stored, solution.displacement, strict=True))
    assert solution.energy == pytest.approx(0.5 * direct, rel=1e-7)


@EXAMPLES
@given(bodies())
def test_betti_and_superposition(case):
    body, rng = case
    other = random_loads(body, rng)
    both = CellLoads(
        *(np.concatenate(pair) for pair in zip(body.loads[:3], other[:3], strict=True))
    )
    (u, first, _), (v, second, _) = body.solve(), body.solve(other)
    unit = [first.scales.force, second.scales.force]
    there = sum(unit[0] * np.vdot(f, x) for f, x in zip(first.force, v, strict=True))
    back = sum(unit[1] * np.vdot(f, x) for f, x in zip(second.force, u, strict=True))
    size = np.sqrt(
        abs(sum(unit[0] * np.vdot(f, x) for f, x in zip(first.force, u, strict=True)))
        * abs(sum(unit[1] * np.vdot(f, x) for f, x in zip(second.force, v, strict=True)))
    )
    assert there == pytest.approx(back, abs=1e-9 * size)
    w, _, _ = body.solve(both)
    largest = max(np.abs(x).max() for x in (*u, *v, *w))
    for a, b, c in zip(u, v, w, strict=True):
        np.testing.assert_allclose(a + b, c, atol=1e-8 * largest)


def assert_moves_like(image, moved, body):
    """The image of a body is displaced like the image of its displacement."""
    u, _, _ = body.solve()
    v, _, _ = image.solve()
    largest = max(np.abs(x).max() for x in u)
    for found, expected in zip(v, moved(u), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-8 * largest)


@EXAMPLES
@given(bodies(dimension=2))
def test_a_mirrored_body_moves_mirrored(case):
    body, _ = case
    swap = {"left": "right", "right": "left"}
    cells, direction, force = body.loads[:3]
    columns = body.kinds.shape[0]
    mirrored = CellLoads(
        np.stack([columns - 1 - cells[:, 0], cells[:, 1]], axis=1),
        np.where(direction == 0, 1, np.where(direction == 1, 0, direction)),
        force * [-1.0, 1.0],
    )
    sides = {swap.get(name, name): side for name, side in body.sides.items()}
    image = Body(body.kinds[::-1], body.materials, sides, mirrored, body.plane)
    assert_moves_like(image, lambda u: (-u[0][::-1], u[1][::-1]), body)


@EXAMPLES
@given(bodies(dimension=2))
def test_a_turned_body_moves_turned(case):
    body, _ = case
    # A quarter turn: x becomes y, y becomes -x.
    turn = {"left": "bottom", "right": "top", "bottom": "right", "top": "left"}
    cells, direction, force = body.loads[:3]
    rows = body.kinds.shape[1]
    faces = {-1: -1, 0: 2, 1: 3, 2: 1, 3: 0}
    turned = CellLoads(
        np.stack([rows - 1 - cells[:, 1], cells[:, 0]], axis=1),
        np.array([faces[int(d)] for d in direction]),
        np.stack([-force[:, 1], force[:, 0]], axis=1),
    )
    sides = {turn[name]: side for name, side in body.sides.items()}
    image = Body(body.kinds.T[::-1], body.materials, sides, turned, body.plane)
    assert_moves_like(image, lambda u: (-u[1].T[::-1], u[0].T[::-1]), body)


@pytest.mark.parametrize(
    ("modulus", "size", "force"),
    [(1e-12, 1e-9, 1e12), (1e-12, 1e6, 1e-12), (1e15, 1e-9, 1e-12), (1e15, 1e6, 1e12)],
)
@pytest.mark.parametrize("shape", [(16, 16), (16, 16, 16), (5, 6), (3, 4, 4)])
def test_units_do_not_matter(modulus, size, force, shape):
    d = len(shape)

    def body(e, h, f):
        top = np.array([[2] * (d - 1) + [shape[-1] - 1]])
        push = np.full((1, d), -f)
        push[0, 0] = 0.3 * f
        loads = CellLoads(top, np.array([2 * d - 1]), push)
        ratio = [(e, 0.3), (2 * e, 0.2)]
        return Body(np.zeros(shape, int), ratio, {"bottom": "rigid"}, loads, None, h)

    u, _, _ = body(1.0, 1.0, 1.0).solve()
    v, _, _ = body(modulus, size, force).solve()
    # In two dimensions u is F/(E t) whatever the size, in three F/(E h).
    factor = force / modulus / (size if d == 3 else 1.0)
    for a, b in zip(u, v, strict=True):
        np.testing.assert_allclose(b, factor * a, rtol=1e-9, atol=1e-10 * factor * np.abs(a).max())
        assert np.isfinite(b).all()
