"""Agents in space: quadratic bricks on an octree, to an estimated error."""

import numpy as np
import pytest
from plates import loaded
from spawning_bodies import STEEL, drawn, laws, quarter

import kaju
from kaju.errors import ConvergenceError

YOUNGS = 1e9
MIRRORS = {"left": "roller", "front": "roller", "bottom": "roller"}


def block(sides, loads=(), cells=(4, 4, 4), ratio=0.3, **body):
    material = {"youngs_modulus": YOUNGS, "poissons_ratio": ratio, "density": 1e3}
    usual = {"cell_size": 0.25, "material": "a", "materials": {"a": material}, "sides": sides}
    return loaded(list(cells), *loads, **usual | body)


def patch(side=16, width=1, **changes):
    """A cube of 1 m under a load on some of its cells in the middle of its top."""
    low, high = 0.5 - width / side, 0.5 + width / side
    load = {"region": {"box": [[low, low, 1.0], [high, high, 1.0]]}, "force": [0.0, 0.0, -1.0]}
    return block({"bottom": "rigid"}, [load], [side] * 3, cell_size=1.0 / side, **changes)


def test_an_even_pull_is_exact_and_so_is_a_moved_side():
    pulled = kaju.solve(block(MIRRORS, [{"side": "top", "pressure": -1e6}]), tolerance=0.01)
    assert pulled.strain_energy == pytest.approx(0.5 * 1e6**2 / YOUNGS, rel=1e-12)
    np.testing.assert_allclose(pulled.reactions["bottom"], [0, 0, -1e6], atol=1e-6)
    np.testing.assert_allclose(pulled.stress[:, 2, 2], 1e6, rtol=1e-10)
    top = {"displacement": ["free", "free", 1e-3]}
    moved = kaju.solve(block(MIRRORS | {"top": top}), tolerance=0.01)
    assert moved.strain_energy == pytest.approx(0.5 * YOUNGS * 1e-6, rel=1e-12)
    np.testing.assert_allclose(moved.reactions["top"], [0, 0, 1e6], atol=1e-6)


def test_a_bed_takes_its_share_of_the_energy():
    sides = MIRRORS | {"bottom": {"stiffness": 1e10}}
    result = kaju.solve(block(sides, [{"side": "top", "pressure": 1e6}]), tolerance=0.01)
    assert result.strain_energy == pytest.approx(0.5e12 * (1 / YOUNGS + 1e-10), rel=1e-12)
    np.testing.assert_allclose(result.reactions["bottom"], [0, 0, 1e6], atol=1e-5)
    np.testing.assert_allclose(result.displacement_at([[0.5, 0.5, 0.0]])[0, 2], -1e-4)


def test_a_narrow_load_is_seen_to_a_thousandth_by_a_few_thousand_agents():
    """Six displacements against 12,300 bricks continued to none."""
    points = [(0.5, 0.5, 1), (0.5, 0.5, 0.5), (0.45, 0.48, 0.97), (0.25, 0.25, 0.75)]
    points += [(0.8, 0.8, 0.9), (0.56, 0.5, 0.99)]
    truth = np.array([-8.0820, -0.71115, -5.4575, -0.7260, -0.6354, -5.559]) * 1e-9
    result = kaju.solve(patch(), tolerance=0.03)
    moved = result.displacement_at(points)[:, 2]
    assert np.abs(moved - truth).max() < 9e-4 * 8.082e-9
    assert result.agents < 4000
    assert result.tolerance_kept == "estimated"
    assert result.energy_bounds is None
    true_error = np.sqrt(1.0 - result.strain_energy / 3.40178e-9)
    assert 0.5 < result.error_estimate / true_error < 2.0


def test_energies_rise_to_the_true_one():
    """They are lower bounds; estimates of the first generations tell of no end, as they rise."""
    hole = {"box": [[0, 0.25, 0.25], [1, 0.5, 0.5]], "material": "air"}
    load = {"side": "top", "force": [-1.0, -2.0, -1.0]}
    pierced = block({"bottom": "rigid"}, [load], (4, 3, 3), 0.41, regions=[hole])
    first, *later = generations = kaju.solve(pierced, tolerance=0.2).generations
    assert first.error == pytest.approx(1.5 * np.sqrt(first.gap.sum() / (2.0 * first.energy)))
    assert len(later) > 2
    assert np.all(np.diff([generation.energy for generation in generations]) > 0.0)


@pytest.mark.parametrize("ratio", [0.0, 0.45])
def test_estimates_are_near_the_truth(ratio):
    rough, fine = (kaju.solve(quarter(ratio), tolerance=t) for t in (0.15, 0.03))
    true_error = np.sqrt(1.0 - rough.strain_energy / fine.strain_energy)
    assert 0.5 < rough.error_estimate / true_error < 2.0


def test_a_couple_turns_the_end_of_a_beam():
    beam = block({"bottom": "rigid"}, [{"side": "top", "couple": [0, 1e3, 0]}], [2, 2, 8], 0.0)
    result = kaju.solve(beam, tolerance=0.01, resolution=4)
    assert result.strain_energy == pytest.approx(1e3**2 * 12.0 / YOUNGS / 0.5**4, rel=2e-2)
    assert result.couples["bottom"] == pytest.approx([0.0, -1e3, 0.0], abs=1e-3)


def test_stress_goes_on_where_agents_of_two_sizes_meet():
    result = kaju.solve(patch(8), tolerance=0.1)
    large = result.size > result.size.min()
    step, jumps = 1e-9, []
    for axis in range(3):
        side = result.middle[large] + 0.13 * result.size[large, None] * (np.arange(3) != axis)
        side[:, axis] = result.lower[large, axis] + result.size[large]
        side = side[side[:, axis] < 1.0]
        away = step * (np.arange(3) == axis)
        jumps.append(np.abs(result.stress_at(side - away) - result.stress_at(side + away)).max())
    assert max(jumps) < 1e-5 * np.abs(result.stress).max()


def test_solids_that_touch_along_an_edge_end_soon():
    """They are a hinge, of which more and more agents see more."""
    codes = np.ones((3, 2, 3), int)
    codes[1] = [[1, 0, 0], [0, 0, 1]]
    load = {"side": "right", "force": [0.0, 0.0, -1.0]}
    scene = drawn(codes, [STEEL], [load], cell_size=0.1, sides={"left": "rigid"})
    with pytest.raises(ConvergenceError, match="needs more") as caught:
        kaju.solve(scene, tolerance=0.02)
    assert caught.value.best.agents < 50_000


def test_an_estimate_is_about_the_error_of_random_solids():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        codes = np.ones(rng.integers(2, 5, 3), int)
        codes[: rng.integers(1, 3), :1, : rng.integers(1, 3)] = 2
        materials = laws(*((1e9 * 10 ** rng.uniform(0, 2), 0.3) for _ in "ab"))
        load = {"side": "top", "force": rng.normal(size=3).tolist()}
        scene = drawn(codes, materials, [load], cell_size=0.1)
        rough, fine = (kaju.solve(scene, tolerance=tolerance) for tolerance in (0.2, 0.08))
        truth = fine.strain_energy * (1.0 + fine.error_estimate**2)
        error = np.sqrt(1.0 - rough.strain_energy / truth)
        assert 0.5 * error <= rough.error_estimate <= 2.0 * error
