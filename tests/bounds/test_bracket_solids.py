"""Bars of which everything is known, and solids that lie otherwise."""

import numpy as np
import pytest

from kaju import Scene, solve

SIDES = (("left", "right"), ("front", "back"), ("bottom", "top"))
LENGTH, WIDTH, YOUNGS = 0.12, 0.04, 1e9


AXES = [(2, 0), (2, 1), (3, 1), (3, 2)]
"""Dimensions, and axes along which bars lie."""


def bar(d, axis, sides=None, loads=None, ratio=0.3):
    """Return a bar of 4 (× 4) × 12 cells: sliding on its lower sides, pulled at its end."""
    names = SIDES if d == 3 else (SIDES[0], SIDES[2])
    body = {"cell_size": 0.01, "cells": [12 if a == axis else 4 for a in range(d)]}
    body |= {"material": "a"} if d == 3 else {"material": "a", "thickness": WIDTH}
    force = [8.0 * (a == axis) for a in range(d)]
    held = {} if sides is None else {names[axis][0]: sides}
    return Scene(
        body=body,
        materials={"a": {"youngs_modulus": YOUNGS, "poissons_ratio": ratio}},
        sides={lower: "roller" for lower, _ in names} | held,
        loads=[{"side": names[axis][1], "force": force}] if loads is None else loads,
    )


@pytest.mark.parametrize(("d", "axis"), AXES)
@pytest.mark.parametrize(
    "how", [{"strategy": "uniform"}, {"strategy": "spawning", "tolerance": 0.1}]
)
def test_a_pulled_bar_has_no_gap(d, axis, how):
    result = solve(bar(d, axis), **how)
    exact = 0.5 * 8.0**2 * LENGTH / (YOUNGS * WIDTH**2)
    assert result.energy_bounds == pytest.approx((exact, exact), rel=1e-8)
    assert result.error_bound < 1e-4


@pytest.mark.parametrize(("d", "axis"), AXES)
def test_a_bed_below_a_bar_counts_with_its_own_energy(d, axis):
    result = solve(bar(d, axis, {"stiffness": 1e10}), strategy="uniform")
    exact = 0.5 * 8.0**2 * (LENGTH / YOUNGS + 1 / 1e10) / WIDTH**2
    assert result.energy_bounds == pytest.approx((exact, exact), rel=1e-8)


@pytest.mark.parametrize(("d", "axis"), AXES)
def test_the_weight_of_a_column_lies_within(d, axis):
    """A column that does not widen: σ = ρg(L − z) is balanced exactly, its strain is not even."""
    end = [LENGTH if a == axis else WIDTH for a in range(d)]
    weight = [-1.0 * (a == axis) for a in range(d)]
    loads = [{"region": {"box": [[0.0] * d, end]}, "force": weight}]
    lower, upper = solve(bar(d, axis, loads=loads, ratio=0.0), strategy="uniform").energy_bounds
    exact = LENGTH / (6 * YOUNGS * WIDTH**2)
    assert 0.99 * exact < lower < exact * (1 + 1e-12)
    assert upper == pytest.approx(exact, rel=1e-9)


def bracket(order, how):
    """Return the answer of an L-shaped solid of two materials, its axes in another order."""
    kinds = np.zeros((4, 4, 4), int)
    kinds[2:, :, 2:] = 1
    kinds[:2, 1:3, :2] = 2
    forces = np.array([2.0, 1.0, -5.0])[list(order)]
    corners = np.array([[0.0, 0.25, 1.0], [0.25, 0.75, 1.0]])[:, list(order)]
    return solve(
        Scene(
            body={"cell_size": 0.25, "array": kinds.transpose(order)},
            legend={0: "a", 1: "air", 2: "b"},
            materials={
                "a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
                "b": {"youngs_modulus": 1e10, "poissons_ratio": 0.2},
            },
            sides={SIDES[list(order).index(2)][0]: "rigid"},
            loads=[{"region": {"box": corners.tolist()}, "force": forces.tolist()}],
        ),
        **how,
    )


@pytest.mark.parametrize(
    "how", [{"strategy": "uniform"}, {"strategy": "spawning", "tolerance": 0.25}]
)
def test_bounds_of_a_solid_do_not_depend_on_how_it_lies(how):
    there, turned = (bracket(order, how) for order in ((0, 1, 2), (2, 0, 1)))
    assert not there.no_bound
    assert there.agents == turned.agents
    assert len(np.unique(there.size)) > 1 or how["strategy"] == "uniform"
    assert there.energy_bounds == pytest.approx(turned.energy_bounds, rel=1e-7)
    assert there.energy_bounds[0] < there.strain_energy < there.energy_bounds[1]
