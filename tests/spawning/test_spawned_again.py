"""Solving again after a change: previous agents stay and spawn, or others begin afresh."""

import gc
import weakref
from functools import cache

import numpy as np
import pytest
from elastic_scenes import spawned_agents

from kaju import ElasticResult, Scene, solve
from kaju.errors import ParameterError, SupportError

BODY = {"size": [0.2, 0.1], "cells": [32, 16], "thickness": 0.002, "material": "steel"}
HOLE = {"centre": [0.1, 0.05], "radius": 0.02}


def press(first=14, force=(0.0, -2.0)):
    """A load on four cells of the top."""
    low, high = first * 0.00625, (first + 4) * 0.00625
    return [{"region": {"box": [[low, 0.1], [high, 0.1]]}, "force": list(force)}]


def plate(**changes):
    return Scene(**({"body": BODY, "sides": {"bottom": "rigid"}, "loads": press()} | changes))


def spawned(scene, tolerance=0.01, **how):
    return solve(scene, strategy="spawning", tolerance=tolerance, **how)


@cache
def first_answer():
    """The answer from which most of these go on."""
    return spawned(plate())


def assert_as_good(again, fresh):
    """As near to the truth, in balance with its loads, and of not many more agents."""
    assert again.found.reached
    # Both energies are within their bounds, of the square of the error.
    gap = again.strain_energy / fresh.strain_energy - 1
    assert abs(gap) <= again.error_bound**2 + fresh.error_bound**2
    assert again.agents <= 1.4 * fresh.agents + 100
    ours, theirs = sum(again.reactions.values()), sum(fresh.reactions.values())
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max() + 1e-9)
    assert_well_placed(again)


def assert_well_placed(result):
    """Neighbours alike in size, agents in one material each, evenly loaded."""
    grid = result.found.balance.grid
    leaves, ground = grid.leaves, grid.ground
    assert len(leaves.balanced(0)) == len(leaves)
    assert not ground.unevenly_loaded(leaves).any()
    np.testing.assert_array_equal(ground.kinds_at(leaves.lower), leaves.kind)
    np.testing.assert_array_equal(
        ground.kinds_at(leaves.lower + leaves.size[:, None] - 1), leaves.kind
    )
    first = ground.start()
    assert (leaves.size <= first.size[first.find(leaves.lower)]).all()
    assert (leaves.size**2).sum() == (first.size**2).sum()


def test_a_force_changed_in_proportion_needs_no_iteration():
    first = first_answer()
    harder = spawned(plate(loads=press(force=(0.0, -6.0))), previous=first)
    assert harder.strain_energy == pytest.approx(9 * first.strain_energy, rel=1e-12)
    rise = harder.displacement - 3 * first.displacement
    assert np.abs(rise).max() < 1e-9 * first.max_displacement
    assert [g.iterations for g in harder.generations] == [0]
    assert harder.error_estimate == pytest.approx(first.error_estimate, rel=1e-9)
    np.testing.assert_allclose(harder.reactions["bottom"], [0.0, 6.0], atol=1e-8)
    coarser = spawned(plate(loads=press(force=(0.0, -6.0))), previous=first, tolerance=0.05)
    assert coarser.agents < 0.5 * first.agents


def test_agents_that_suit_another_load_keep_their_matrices():
    first = first_answer()
    turned = plate(loads=press(force=(0.3, -2.0)))
    again = spawned(turned, previous=first)
    assert again.found.balance.strains is first.found.balance.strains
    assert again.found.retired == 0
    assert_as_good(again, spawned(turned))


def test_agents_retire_where_a_load_has_gone():
    first = spawned(plate(loads=press(2)), tolerance=0.005)
    moved = plate(loads=press(26))
    again = spawned(moved, tolerance=None, previous=first)
    assert again.found.retired > 0
    assert again.summary()["retired"] == again.found.retired
    fresh = spawned(moved, tolerance=0.005)
    assert_as_good(again, fresh)

    def beside_the_old_load(result):
        middle = result.lower + 0.5 * result.size[:, None]
        return np.count_nonzero(np.linalg.norm(middle - [0.0225, 0.1], axis=1) < 0.02)

    assert beside_the_old_load(again) < 0.2 * beside_the_old_load(first)


PUSHED = {"bottom": "rigid", "top": {"displacement": [0.0, -1e-10]}}
FROM_THE_RIGHT = [{"region": {"box": [[0.2, 0.025], [0.2, 0.05]]}, "force": [-1.0, 0.5]}]
CHANGES = {
    "moved": plate(loads=press(4)),
    "moved by a cell": plate(loads=press(15)),
    "another load more": plate(loads=[*press(), *press(2, (1.0, 0.0))]),
    "cut": plate().with_region(disk=HOLE),
    "softer": plate().with_region("rubber", box=[[0.0, 0.0], [0.2, 0.1]]),
    "two materials": plate().with_region("oak", box=[[0.0, 0.0], [0.1, 0.05]]),
    "held elsewhere": plate(sides={"left": "rigid"}),
    "displaced": plate(sides=PUSHED, loads=FROM_THE_RIGHT),
    "on a bed": plate(sides={"left": "roller", "bottom": {"stiffness": 1e13}}),
    "strained": plate(body=BODY | {"plane": "strain"}),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_scene_is_answered_as_afresh_there_and_back(name):
    first = first_answer()
    changed = spawned(CHANGES[name], previous=first)
    assert_as_good(changed, spawned(CHANGES[name]))
    assert_as_good(spawned(plate(), previous=changed), first)


def test_stages_of_a_displaced_wall_follow_from_each_other():
    scene = plate(sides=PUSHED, loads=[FROM_THE_RIGHT[0] | {"steps": 3}])
    result = None
    for stage in (1, 2, 3):
        result = spawned(scene, stage=stage, previous=result)
        assert_as_good(result, spawned(scene, stage=stage))


def test_another_tolerance_goes_on_from_the_same_agents():
    first = spawned(plate(), tolerance=0.02)
    finer = spawned(plate(), tolerance=0.005, previous=first)
    assert finer.generations[0].agents == first.agents
    assert_as_good(finer, spawned(plate(), tolerance=0.005))
    coarser = spawned(plate(), tolerance=0.04, previous=finer)
    assert coarser.found.retired > 0.5 * finer.agents
    assert_as_good(coarser, spawned(plate(), tolerance=0.04))
    assert spawned(plate(), tolerance=None, previous=finer).tolerance == 0.005


def test_a_resolution_bounds_the_agents_again():
    first = spawned(plate(), tolerance=0.01)
    assert first.size.min() < 0.2 / 32
    bounded = spawned(plate(), tolerance=0.01, resolution=1, previous=first)
    assert bounded.size.min() >= 0.999 * 0.2 / 32
    assert_well_placed(bounded)
    assert spawned(plate(), previous=bounded).resolution == 1


def test_twice_the_same_gives_the_same():
    first = first_answer()
    one, other = (spawned(CHANGES["moved"], previous=first) for _ in range(2))
    np.testing.assert_array_equal(one.found.displacement, other.found.displacement)
    np.testing.assert_array_equal(one.lower, other.lower)


@pytest.mark.slow
def test_agents_do_not_pile_up_over_many_moves():
    random, result, ratio = np.random.default_rng(5), None, []
    for _ in range(12):
        scene = plate(loads=press(int(random.integers(0, 28)), (float(random.normal()), -1.0)))
        result = spawned(scene, previous=result)
        fresh = spawned(scene)
        assert_as_good(result, fresh)
        ratio.append(result.agents / fresh.agents)
    assert np.mean(ratio) < 1.2


@pytest.mark.parametrize("loads", [press(force=(0.3, -2.0)), press(4)])
def test_a_tolerance_of_the_displacement_goes_on_too(loads):
    first = spawned(plate(), tolerance=0.005, goal="displacement")
    again = spawned(plate(loads=loads), tolerance=None, previous=first)
    assert again.tolerance_at == "displacement"
    assert again.found.reached
    assert again.found.aimed.error <= 0.005
    fresh = spawned(plate(loads=loads), tolerance=0.005, goal="displacement")
    assert again.agents <= 1.4 * fresh.agents
    gap = again.displacement_at(fresh.middle) - fresh.displacement_at(fresh.middle)
    assert np.abs(gap).max() < 0.01 * fresh.max_displacement
    np.testing.assert_allclose(again.reactions["bottom"], fresh.reactions["bottom"], atol=1e-8)


@pytest.mark.parametrize("loads", [press(4), press(force=(0.3, -2.0)), press(force=(0.0, -3.0))])
def test_history_starts_with_the_agents_taken_over(loads):
    first = first_answer()
    again = spawned(plate(loads=loads), previous=first)
    assert (again.spawn_step >= 0).all()
    assert again.spawn_step.max() == len(again.generations) - 1
    assert (again.cause[again.spawn_step == 0] == 0.0).all()
    working = again.family.rows[again.family.working]
    np.testing.assert_array_equal(working["spawn_step"], again.spawn_step)


def test_a_stored_answer_serves_too(tmp_path):
    first = first_answer()
    stored = ElasticResult.load(first.save(tmp_path / "first"))
    for scene in (plate(loads=press(force=(0.3, -2.0))), CHANGES["moved"]):
        assert_as_good(spawned(scene, previous=stored), spawned(scene))


def test_nothing_keeps_the_answers_before_alive():
    result, before = spawned(plate()), []
    for first in (14, 15, 2, 2, 20, 21, 22):
        before += [weakref.ref(result), weakref.ref(result.found)]
        before.append(weakref.ref(result.found.balance))
        result = spawned(plate(loads=press(first)), previous=result)
    gc.collect()
    assert [reference for reference in before if reference() is not None] == []


def test_what_cannot_go_on_says_so():
    first = first_answer()
    other = plate(body=BODY | {"cells": [64, 32]})
    with pytest.raises(ParameterError, match=r"stand on 32 x 16 cells of 0\.00625 m"):
        spawned(other, previous=first)
    with pytest.raises(ParameterError, match="its cells are all equal"):
        spawned(plate(), previous=solve(plate()))
    with pytest.raises(ParameterError, match="its agents are of many sizes"):
        solve(plate(), strategy="uniform", previous=first)
    with pytest.raises(SupportError):
        spawned(plate(sides={"bottom": "roller"}), previous=first)
    assert spawned_agents(solve(plate(), previous=first))
