"""Solving again after a change: the same answer as afresh, from what was there."""

import gc
import weakref

import numpy as np
import pytest
from plates import plate as pressed

from kaju import Scene, solve
from kaju.errors import SupportError

BODY = {"size": [0.2, 0.1], "cells": [40, 20], "thickness": 0.002, "material": "steel"}


def press(first=15, force=(0.0, -2.0), steps=1):
    """A load on five cells of the top."""
    low, high = first * 0.005, (first + 5) * 0.005
    return [{"region": {"box": [[low, 0.1], [high, 0.1]]}, "force": list(force), "steps": steps}]


def plate(**changes):
    return Scene(**({"body": BODY, "sides": {"bottom": "rigid"}, "loads": press()} | changes))


@pytest.fixture(autouse=True)
def iterated(monkeypatch):
    """Few cells are iterated here as many are: factors need no start."""
    monkeypatch.setattr("kaju.model.elastic.equal.solver.FEW", {2: 0, 3: 0})


BODIES = {
    "box": plate(),
    "hole": plate().with_region(disk={"centre": [0.1, 0.05], "radius": 0.02}),
    "two materials": plate().with_region("rubber", box=[[0.0, 0.0], [0.2, 0.03]]),
    "nearly incompressible": plate(body=BODY | {"material": "rubber", "plane": "strain"}),
    "displaced": plate(sides={"bottom": "rigid", "left": {"displacement": [1e-9, 0.0]}}),
    "bed": plate(sides={"bottom": {"stiffness": 1e12}, "left": "roller"}),
}


def assert_like(one, other, digits=7):
    size = np.nanmax(np.abs(other.cells().displacement))
    np.testing.assert_allclose(
        one.cells().displacement, other.cells().displacement, rtol=0, atol=10.0**-digits * size
    )
    assert one.strain_energy == pytest.approx(other.strain_energy, rel=10.0**-digits)
    for side, force in other.reactions.items():
        np.testing.assert_allclose(one.reactions[side], force, atol=1e-6)


@pytest.mark.parametrize("name", BODIES)
def test_a_moved_load_is_solved_as_afresh(name):
    first = solve(BODIES[name])
    moved = BODIES[name].replace(loads=press(22, (0.5, -1.0)))
    again = solve(moved, previous=first)
    assert_like(again, solve(moved))
    assert again.error_estimate == pytest.approx(solve(moved).error_estimate, rel=1e-2)


def test_a_force_changed_in_proportion_needs_no_iteration():
    first = solve(plate())
    harder = solve(plate(loads=press(force=(0.0, -6.0))), previous=first)
    expected = 3 * first.cells().displacement
    largest = np.abs(expected).max()
    np.testing.assert_allclose(harder.cells().displacement, expected, rtol=0, atol=1e-10 * largest)
    assert harder.strain_energy == pytest.approx(9 * first.strain_energy, rel=1e-11)
    assert harder.summary()["iterations"] == 0


CHANGES = {
    "cut": lambda scene: scene.with_region(disk={"centre": [0.12, 0.06], "radius": 0.015}),
    "cut at a side": lambda scene: scene.with_region(box=[[0.15, 0.0], [0.2, 0.1]]),
    "filled": lambda scene: scene.with_region("rubber", box=[[0.0, 0.0], [0.05, 0.1]]),
    "softer": lambda scene: scene.replace(body=BODY | {"material": "rubber"}),
    "held elsewhere": lambda scene: scene.replace(sides={"left": "rigid"}),
    "on a bed": lambda scene: scene.replace(sides={"left": "roller", "bottom": {"stiffness": 1e9}}),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_body_is_solved_as_afresh(name):
    first = solve(plate())
    changed = CHANGES[name](plate())
    assert_like(solve(changed, previous=first), solve(changed))


def test_a_body_that_a_change_has_let_loose_is_refused():
    first = solve(plate())
    with pytest.raises(SupportError, match="could move along x"):
        solve(plate(sides={"bottom": "roller"}), previous=first)


def test_three_dimensions():
    block = pressed([10, 10, 10], [3, 4, 9], [0.0, 0.0, -1.0], size=[0.1, 0.1, 0.1])
    moved = block.replace(loads=[{"cell": [6, 4, 9], "force": [0.2, 0.0, -1.0]}])
    assert_like(solve(moved, previous=solve(block)), solve(moved))


def test_nothing_keeps_the_results_before_alive():
    result = solve(plate())
    before = []
    for first in range(5, 15):
        before.append(weakref.ref(result))
        before.append(weakref.ref(result.found.solution))
        result = solve(plate(loads=press(first)), previous=result)
    gc.collect()
    assert [reference for reference in before if reference() is not None] == []
