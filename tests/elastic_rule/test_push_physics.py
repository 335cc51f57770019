"""Where the agents come to rest is linear elasticity."""

import numpy as np
import pytest
from elastic_scenes import (
    block,
    direct_solution,
    displacement,
    energy_norm,
    plate,
    ragged,
    relative_error,
    run,
    run_random,
    scenes,
)
from hypothesis import given, settings
from plates import loaded

from kaju.model.scene.cell_types import AIR

ORDERS = ["wave", "largest first", "multilevel"]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [plate, ragged, block])
def test_every_order_comes_to_rest_at_the_direct_solution(make, order):
    scene = make(order=order, tolerance=1e-5)
    if order == "largest first":
        model, result = run(scene, pushes_per_step=10_000)
    else:
        model, result = run(scene)
    assert result.outcome.startswith("at rest")
    # One level's meter is a lower bound of the error, by the number of cells at most.
    assert relative_error(model) < (1.5e-5 if order == "multilevel" else 1e-4)


@settings(max_examples=30)
@given(scene=scenes())
def test_at_rest_the_error_keeps_the_bound_that_the_threshold_implies(scene):
    model, result = run_random(scene)
    assert result.outcome.startswith(("at rest", "no load"))
    finest = model.table.levels[0]
    n = finest.size
    assert model.state.levels[0].measured.max() <= model.threshold
    root = np.sqrt(finest.stiffness)
    scaled = root[:, None] * (np.eye(n) - finest.shares[:, :n].toarray()) / root
    smallest = np.linalg.eigvalsh(scaled)[0]
    error = energy_norm(model, displacement(model) - direct_solution(model))
    bound = model.threshold * np.sqrt(n / model.table.reference / smallest)
    assert error <= bound * (1 + 1e-9)


@settings(max_examples=40)
@given(scene=scenes())
def test_every_newton_is_accounted_for_and_energy_never_rises(scene):
    _, result = run_random(scene, max_steps=300)
    assert np.all(np.diff(result.energy, prepend=0.0) <= 0.0)
    assert result.ledger.imbalance < 1e-12
    assert [check.allowed for check in result.checks()] == [1e-6]
    left = result.ledger.applied - result.ledger.resting + result.reaction
    assert np.abs(left).max() <= 1e-12 * result.ledger.turnover
    supports = result.boundary.kind != AIR
    total = result.boundary.reaction[supports].sum(axis=0)
    np.testing.assert_allclose(total, result.reaction, atol=1e-12 * result.ledger.turnover)


def test_above_a_large_threshold_the_load_rests_before_it_reaches_the_ground():
    # Prescribed or elastic: below γ nothing more happens, and the books say so.
    _, result = run(plate(order="wave", threshold=0.2))
    assert not result.reaction.any()
    np.testing.assert_allclose(result.ledger.resting, (0.0, -2.0), atol=1e-12)
    _, parents = run(plate(order="multilevel", threshold=0.2))
    assert parents.reaction[1] == pytest.approx(2.0, abs=0.3)


def test_a_pushed_wall_strains_the_body_without_any_load():
    sides = {"left": {"displacement": [1e-6, 0.0]}, "right": "roller", "bottom": "roller"}
    rule = {"kind": "elastic", "tolerance": 1e-10}
    model, result = run(loaded([4, 3], sides=sides, rule=rule))
    np.testing.assert_allclose(result.displacement[0][0], 1e-6, rtol=1e-12)
    assert relative_error(model) < 1e-9
    np.testing.assert_allclose(result.reaction, 0.0, atol=1e-6 * result.ledger.turnover)
    assert result.boundary.reaction[:, 0].max() > 1e3
