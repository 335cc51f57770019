"""The true energy lies between two that can be computed, whatever the body."""

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from spawning_bodies import STEEL, drawn

from kaju import Scene, solve
from kaju.errors import KajuError
from kaju.model.elastic.solve import solve as solve_cells

PRECISE = 2e-6
"""Share of its energy that a truth by graded elements may be off."""


def plate(n, **changes):
    described = {
        "body": {"size": [0.2, 0.2], "cells": [n, n], "thickness": 0.002, "material": "a"},
        "materials": {"a": STEEL},
        "sides": {"bottom": "rigid"},
        "loads": [{"region": {"box": [[0.08, 0.2], [0.12, 0.2]]}, "force": [0.0, -2.0]}],
    }
    return Scene(**(described | changes))


def random_body(seed):
    """Pixels of up to three materials with re-entrant corners, pressed on across its surface."""
    rng = np.random.default_rng([9, seed])
    shape = rng.integers(3, 8, 2)
    codes = rng.integers(1, 4, shape) * (rng.random(shape) < 0.8)
    codes[:, 0] = np.maximum(codes[:, 0], 1)
    contrast = 10 ** rng.uniform(0, rng.choice([0, 1, 3, 6]))
    materials = [
        {"youngs_modulus": 1e9 * e, "poissons_ratio": float(rng.uniform(-0.5, 0.47))}
        for e in (1.0, contrast, contrast**0.5)
    ]
    solid = np.argwhere(codes > 0)
    loads = []
    for _ in range(int(rng.integers(1, 4))):
        column = int(rng.choice(solid[:, 0]))
        top = int(np.flatnonzero(codes[column]).max())
        force = [0.0, float(rng.normal())]
        loads.append({"cell": [column, top], "side": "top", "force": force})
    if rng.random() < 0.3:
        loads.append({"cell": [int(i) for i in solid[0]], "force": [1.0, 0.5]})
    sides = {"bottom": "rigid", "left": str(rng.choice(["free", "roller"]))}
    plane = str(rng.choice(["stress", "strain"]))
    return drawn(codes, materials, loads, sides=sides, plane=plane)


def holds(scene, truth, **how):
    """Solve, and tell whether the truth is inside the bounds; return the result."""
    result = solve_cells(scene, **how)
    lower, upper = result.energy_bounds
    assert lower * (1 - PRECISE) <= truth <= upper * (1 + PRECISE), (lower, truth, upper)
    return result


@pytest.mark.parametrize("how", [{}, {"tolerance": 0.05}])
def test_the_energy_lies_between_its_bounds(how):
    codes = np.ones((6, 6), dtype=int)
    codes[3:, 3:], codes[:2, 3] = 0, 2
    soft = {"youngs_modulus": 2e9, "poissons_ratio": 0.2}
    load = {"cell": [1, 5], "side": "top", "force": [0.0, -9.0]}
    result = solve(drawn(codes, [STEEL, soft], [load]), **how)
    truth = graded_elements(result.scene, order=3, levels=9).strain_energy
    lower, upper = result.energy_bounds
    assert lower * (1 - PRECISE) <= truth <= upper * (1 + PRECISE)
    least = result.found.bracket
    assert (upper - lower) > 0.9 * (least.upper / least.lower - 1.0) * lower
    assert upper / lower - 1.0 < 2.0 * (least.upper / least.lower - 1.0)


@pytest.fixture(scope="module")
def plate_energy():
    return graded_elements(plate(10), order=4, levels=14).strain_energy


def test_bounds_close_in_on_the_truth(plate_energy):
    gaps, bounds = [], []
    for n in (20, 40, 80, 160):
        result = holds(plate(n), plate_energy)
        lower, upper = result.energy_bounds
        gaps.append((upper - lower) / upper)
        bounds.append(result.error_bound)
        # The bound of the mean stress is half the distance of two answers on a circle.
        own = result.found.bracket
        assert result.error_bound == pytest.approx(0.5 * np.sqrt(own.upper / own.lower - 1), 1e-6)
    orders = np.log2(np.array(gaps[:-1]) / gaps[1:])
    assert (orders > 1.4).all(), orders
    assert gaps[-1] < 0.003
    assert bounds[-1] < 0.03


def test_a_re_entrant_corner_lies_within():
    def corner(n):
        codes = np.ones((n, n), dtype=int)
        codes[n // 2 :, n // 2 :] = 0
        load = {"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [0.0, -50.0]}
        return drawn(codes, [STEEL], [load], cell_size=0.2 / n, plane="strain")

    truth = graded_elements(corner(4), order=4, levels=16).strain_energy
    bounds = [holds(corner(n), truth).error_bound for n in (4, 8, 16, 64)]
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] < 0.025


@pytest.mark.parametrize(
    ("seed", "order", "levels"),
    [
        *((n, 3, 6) for n in range(4)),
        *(pytest.param(n, 4, 10, marks=pytest.mark.slow) for n in range(60)),
    ],
)
def test_random_bodies_lie_within(seed, order, levels):
    """Coarser elements err to the side of the lower bound, which is far enough from them."""
    try:
        scene = random_body(seed)
        truth = graded_elements(scene, order=order, levels=levels).strain_energy
    except KajuError:
        pytest.skip("not held, or a load inside")
    for resolution in (2, 4):
        result = solve_cells(scene, 1e-10, resolution)
        if result.no_bound:
            assert result.energy_bounds is None
            assert result.error_bound is None
            continue
        holds(scene, truth, resolution=resolution, tolerance=1e-10)


def test_a_cube_lies_within():
    def cube(n):
        return Scene(
            body={"cell_size": 1.0 / n, "cells": [n] * 3, "material": "a"},
            materials={"a": {"youngs_modulus": 1.0, "poissons_ratio": 0.3}},
            sides={"bottom": "rigid"},
            loads=[
                {"region": {"box": [[0.375, 0.375, 1], [0.625, 0.625, 1]]}, "force": [0, 0, -1.0]}
            ],
        )

    gaps = []
    for n in (8, 16):
        # Quadratic elements on 24³ give 1.67885 from below, bilinear ones 1.65296.
        lower, upper = solve(cube(n)).energy_bounds
        assert lower < 1.6789 < upper
        gaps.append((upper - lower) / upper)
    assert gaps[1] < 0.55 * gaps[0]


@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.parametrize(
    "sides",
    [
        {"left": "rigid", "right": {"displacement": [1e-4, 0.0]}},
        {"bottom": "rigid", "top": {"displacement": [1e-4, -1e-4]}},
        {"bottom": {"displacement": [0.0, 1e-5]}, "top": {"displacement": [1e-4, 0.0]}},
        {"bottom": "rigid", "top": {"displacement": ["free", -1e-4]}},
    ],
)
def test_the_estimate_of_a_moved_side_falls_with_its_bound(sides, hole):
    regions = [{"material": "air", "box": [[0.06, 0.06], [0.1, 0.12]]}] if hole else []
    body = {"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "a"}
    scene = plate(20, body={**body, "regions": regions}, sides=sides, loads=[])
    coarse, fine = (solve(scene, resolution=k) for k in (1, 4))
    for result in (coarse, fine):
        assert result.error_bound < result.error_estimate < 20 * result.error_bound
    assert fine.error_estimate < 0.55 * coarse.error_estimate
    assert fine.error_bound < 0.5 * coarse.error_bound


def test_a_row_of_cells_between_two_moved_sides_is_solved():
    # One cell across, held along both long sides: the strain is that of the sides.
    moved = {"displacement": [0.0, -2e-6]}
    body = {"cell_size": 0.01, "cells": [6, 1], "thickness": 0.01, "material": "a"}
    sides = {"bottom": "rigid", "top": moved, "left": "roller", "right": "roller"}
    soft = {"a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3}}
    scene = plate(1, body=body, materials=soft, loads=[], sides=sides)
    result = solve(scene)
    stiff = 1e9 / (1 - 0.3**2)
    assert result.strain_energy == pytest.approx(0.5 * stiff * (2e-4) ** 2 * 0.06 * 0.01 * 0.01)
    lower, upper = result.energy_bounds
    assert lower == pytest.approx(upper)


def test_where_supports_contradict_each_other_there_is_no_bound_and_it_says_why():
    scene = plate(8, sides={"bottom": "rigid", "left": {"displacement": [1e-5, 0.0]}})
    result = solve(scene)
    assert result.error_bound is None
    assert result.energy_bounds is None
    assert "two displacements at once" in result.no_bound


def test_an_answer_that_does_not_balance_has_no_bound(monkeypatch):
    from kaju.model.elastic.bounds import energy_bounds as bracket

    monkeypatch.setattr(bracket, "BALANCED", 1e-20)
    result = solve(plate(8))
    assert result.error_bound is None
    assert "does not balance" in result.no_bound


def test_nobody_passes_on_what_an_answer_is_left_with_all_over(monkeypatch):
    from kaju.model.elastic.bounds import admissible_stress as balanced
    from kaju.model.elastic.multigrid import nested
    from kaju.model.elastic.refine import refine_loop

    auxetic = plate(8, materials={"a": {"youngs_modulus": 1e9, "poissons_ratio": -0.9}})
    monkeypatch.setattr(refine_loop, "LAST", 0.1)
    monkeypatch.setattr(nested, "DIRECT", {2: 20, 3: 20})
    monkeypatch.setattr(balanced, "MOST_UNBALANCED", 10)
    monkeypatch.setattr(balanced, "equilibrate", None)
    result = solve(auxetic, tolerance=0.3)
    assert result.error_bound is None
    assert "does not balance" in result.no_bound
    assert result.tolerance_kept == "estimated"


def test_the_mean_stress_is_better_than_either(plate_energy):
    # Against the stress of a grid four times as fine, averaged over the cells.
    coarse = solve(plate(20))
    fine = solve(plate(20), resolution=8)
    truth = fine.cells().stress.reshape(20, 8, 20, 8, 2, 2).mean(axis=(1, 3)).reshape(-1, 2, 2)
    off = np.linalg.norm(coarse.mean_stress - truth) / np.linalg.norm(truth)
    plain = np.linalg.norm(coarse.stress - truth) / np.linalg.norm(truth)
    assert off < 1.1 * plain
    assert off < coarse.error_bound


def test_bounds_are_the_same_for_a_mirrored_body():
    scene = plate(16, loads=[{"region": {"box": [[0.02, 0.2], [0.06, 0.2]]}, "force": [0.0, -2.0]}])
    other = plate(16, loads=[{"region": {"box": [[0.14, 0.2], [0.18, 0.2]]}, "force": [0.0, -2.0]}])
    bounds = [solve(s).energy_bounds for s in (scene, other)]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-9)


def test_loads_that_meet_on_a_face_are_bounded_as_their_sum():
    """Beside a load along a surface, where agents of many sizes and their units tell the bounds."""

    def pressed(*forces):
        loads = [{"cell": [5, 9], "side": "top", "force": list(force)} for force in forces]
        return solve(plate(10, loads=loads))

    one, two = pressed((0.5, -3.0)), pressed((0.5, -1.0), (0.0, -2.0))
    np.testing.assert_allclose(two.energy_bounds, one.energy_bounds, rtol=1e-9)
    largest = np.abs(one.mean_stress).max()
    np.testing.assert_allclose(two.mean_stress, one.mean_stress, rtol=0, atol=1e-8 * largest)
    off = np.linalg.norm(one.mean_stress - one.stress, axis=(1, 2))
    assert np.median(off / np.linalg.norm(one.stress, axis=(1, 2))) < 0.1


@pytest.mark.parametrize("sides", [{"bottom": "rigid"}, {"left": "rigid", "bottom": "roller"}])
def test_an_answer_of_few_iterations_settles_until_its_bound_is_hardly_wider(sides, monkeypatch):
    monkeypatch.setattr("kaju.model.elastic.equal.solver.FEW", {2: 0, 3: 0})  # by iterations
    scene = plate(40, sides=sides)
    rough = solve_cells(scene, 0.05, 1)
    exact = solve(scene)
    assert rough.found.solution.algebraic > 1e-3
    assert exact.error_bound < rough.error_bound < 1.06 * exact.error_bound
    rough, exact = rough.found.bracket, exact.found.bracket
    assert rough.lower == pytest.approx(exact.lower, rel=1e-4)
    assert exact.upper < rough.upper < exact.upper + 0.2 * (exact.upper - exact.lower)
