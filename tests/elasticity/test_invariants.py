"""What must hold for every body: balance, reciprocity, superposition, and any units."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label
from spawning_bodies import drawn, laws

from kaju import solve


def scene_of(codes, materials, loads, cell_size=0.01, sides=None):
    loads = [{"cell": cell, "side": "top", "force": force} for cell, force in loads]
    sides = {"bottom": "rigid"} | (sides or {})
    return drawn(codes + 1, materials, loads, cell_size=cell_size, sides=sides)


@st.composite
def bodies(draw):
    """Pixels of up to three materials that stand on the ground, and two sets of loads."""
    d = draw(st.sampled_from([2, 2, 3]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    codes = rng.choice([-1, 0, 0, 0, 1, 2], size=rng.integers(2, 5 if d == 2 else 4, d))
    codes[..., 0] = 0
    codes = np.kron(codes, np.ones((2,) * d, dtype=int))
    parts, _ = label(codes >= 0)
    codes[parts != parts[(0,) * d]] = -1
    drawn_laws = [(1e9 * 10.0 ** rng.uniform(-3, 3), rng.uniform(-0.5, 0.44)) for _ in range(3)]
    sides = {"left": draw(st.sampled_from(["free", "roller", {"stiffness": 1e10}]))}
    places = np.argwhere(codes >= 0)
    sets = [
        [
            (places[k].tolist(), rng.normal(size=d).tolist())
            for k in rng.integers(len(places), size=3)
        ]
        for _ in range(2)
    ]
    return codes, laws(*drawn_laws), sides, sets


@settings(max_examples=25)
@given(bodies())
@pytest.mark.slow
def test_loads_are_borne_add_up_and_work_on_one_another_alike(body):
    codes, materials, sides, (first, second) = body
    away = [(cell, [-f for f in force]) for cell, force in second]
    one, other, both, apart = (
        solve(scene_of(codes, materials, loads, sides=sides))
        for loads in (first, second, first + second, first + away)
    )
    for answer, loads in ((one, first), (both, first + second)):
        pushed = np.sum([force for _, force in loads], axis=0)
        borne = np.sum(list(answer.reactions.values()), axis=0)
        scale = np.abs([force for _, force in loads]).sum()
        np.testing.assert_allclose(borne, -pushed, atol=1e-7 * scale)
    most = np.abs([one.displacement, other.displacement, both.displacement]).max()
    moved = one.displacement + other.displacement
    np.testing.assert_allclose(both.displacement, moved, atol=1e-7 * most)
    energy = 2.0 * (one.strain_energy + other.strain_energy)
    assert both.strain_energy + apart.strain_energy == pytest.approx(energy, rel=1e-7, abs=0.0)


@pytest.mark.parametrize(
    ("modulus", "size", "force"),
    [(1e-12, 1e-9, 1e12), (1e-12, 1e6, 1e-12), (1e15, 1e-9, 1e-12), (1e15, 1e6, 1e12)],
)
@pytest.mark.parametrize("shape", [(16, 16), (5, 6), (3, 4, 4)])
def test_units_do_not_matter(modulus, size, force, shape):
    d = len(shape)
    cell = [2] * (d - 1) + [shape[-1] - 1]

    def moved(e, h, f):
        push = [0.3 * f] + [-f] * (d - 1)
        scene = scene_of(np.zeros(shape, int), laws((e, 0.3)), [(cell, push)], h)
        return solve(scene).displacement

    # In two dimensions u is F/(E t) whatever the size, in three F/(E h).
    factor = force / modulus / (size if d == 3 else 1.0)
    expected = factor * moved(1.0, 1.0, 1.0)
    found = moved(modulus, size, force)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())
