"""What holds for every elastic body holds for agents of many sizes."""

import numpy as np
import pytest
from spawning_bodies import (
    CELL,
    FOAM,
    STEEL,
    drawn,
    joined,
    on_top,
    ragged,
    spawned_by,
    under_a_patch,
)


def codes_of(seed=5, size=12):
    """A ragged body of two materials."""
    rng = np.random.default_rng(seed)
    codes = (rng.random((size // 2,) * 2) < 0.8).repeat(2, axis=0).repeat(2, axis=1)
    codes[:, 0] = True
    inside = (rng.random((size // 4,) * 2) < 0.4).repeat(4, axis=0).repeat(4, axis=1)
    return joined(codes) * (1 + inside)


CODES = codes_of()
FIRST, SECOND = on_top(CODES, 2, (0.7, -1.5)), on_top(CODES, 9, (-0.4, -1.0))


# Generations that are factorised settle to rounding; of others the last digits depend on the
# order of the agents, and with them, now and then, who spawns.


def turned_plate(turns):
    """A plate with a step, held on one side, turned by quarters."""
    codes = np.ones((12, 12), dtype=int)
    codes[7:, 8:] = 0
    codes[2:4, 4:8] = 2
    force, cell = np.array([0.5, -1.0]), np.array([3, 11])
    sides = ["bottom", "right", "top", "left"]
    way = ["top", "left", "bottom", "right"]
    for _ in range(turns):
        codes = codes[:, ::-1].T
        cell, force = np.array([11 - cell[1], cell[0]]), np.array([-force[1], force[0]])
    load = {"cell": cell.tolist(), "side": way[turns], "force": force.tolist()}
    return drawn(codes, [STEEL, FOAM], [load], sides={sides[turns]: "rigid"})


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turned_body_moves_like_the_upright_one(turns):
    upright, turned = (spawned_by(turned_plate(k), tolerance=0.15) for k in (0, turns))
    assert [g.agents for g in upright.generations] == [g.agents for g in turned.generations]
    place = points = upright.lower + [0.3, 0.6] * upright.size[:, None]
    u = upright.displacement_at(points)
    for _ in range(turns):
        place = np.stack([0.12 - place[:, 1], place[:, 0]], axis=1)
        u = np.stack([-u[:, 1], u[:, 0]], axis=1)
    np.testing.assert_allclose(turned.displacement_at(place), u, atol=1e-8 * np.abs(u).max())


def test_force_stiffness_and_size_only_scale():
    """u ~ F/(E t) for any size of the plane body; the agents are the same."""
    codes = CODES > 0
    base = drawn(codes, [STEEL], [FIRST], thickness=1.0)
    load = FIRST | {"force": [-3 * f for f in FIRST["force"]]}
    soft = STEEL | {"youngs_modulus": 206e6}
    changed = drawn(codes, [soft], [load], cell_size=8 * CELL, thickness=0.25)
    here, there = (spawned_by(s, tolerance=0.1) for s in (base, changed))
    np.testing.assert_allclose(8 * here.lower, there.lower)
    u, v = here.displacement, there.displacement
    np.testing.assert_allclose(v, -3 * 1e3 / 0.25 * u, atol=1e-8 * np.abs(v).max())


def pressed(codes):
    load = {"region": {"box": [[0.05, 0.16], [0.07, 0.16]]}, "force": [0.3, -1.0]}
    return drawn(codes, [STEEL], [load])


def test_idle_body_beside_changes_nothing():
    """A plate under a load, and beside it another that stands on the same ground."""
    codes = np.zeros((28, 16), dtype=int)
    codes[:16] = codes[20:] = 1
    alone, beside = (spawned_by(pressed(c), tolerance=0.1) for c in (codes[:16], codes))
    near = beside.lower[:, 0] < 0.16
    mine, theirs = np.lexsort(alone.lower.T), np.flatnonzero(near)
    theirs = theirs[np.lexsort(beside.lower[near].T)]
    np.testing.assert_array_equal(alone.lower[mine], beside.lower[theirs])
    np.testing.assert_array_equal(alone.size[mine], beside.size[theirs])
    u, v = alone.displacement[mine], beside.displacement[theirs]
    np.testing.assert_allclose(v, u, atol=1e-12 * np.abs(u).max())
    assert np.abs(beside.displacement[~near]).max() < 1e-13 * np.abs(u).max()


@pytest.mark.parametrize("scene", [ragged(1), under_a_patch(3)], ids=["ragged", "cubes"])
def test_same_numbers_bit_by_bit(scene):
    first, second = (spawned_by(scene, tolerance=0.15) for _ in range(2))
    np.testing.assert_array_equal(first.displacement, second.displacement)
    assert first.residuals == second.residuals
    assert first.error_estimate == second.error_estimate
