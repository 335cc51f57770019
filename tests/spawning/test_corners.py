"""Where stress grows without limit, and along dragged sides, few agents do."""

from itertools import product

import numpy as np
import pytest

from kaju import Scene, solve

STEEL = {"material": "steel"}


def angle(force=(100.0, 0.0)):
    """An L of 0.8 m on its ground, loaded along its whole top."""
    cut = {"box": [[0.4, 0.4], [0.8, 0.8]], "material": "air"}
    top = {"region": {"box": [[0.0, 0.8], [0.4, 0.8]]}, "force": list(force)}
    body = {"size": [0.8, 0.8], "cells": [8, 8], "thickness": 1.0, "regions": [cut], **STEEL}
    return Scene(body=body, sides={"bottom": "rigid"}, loads=[top])


@pytest.mark.parametrize("tolerance", [0.02, 0.005])  # of these the second is kept by blocks
def test_a_corner_costs_few_agents(tolerance):
    """Agents fall like 1/tolerance² as in a body without corners, and the bound uses all of it."""
    result = solve(angle(), tolerance=tolerance)
    assert result.tolerance_kept == "proved"
    assert 0.8 * tolerance < result.error_bound <= tolerance
    assert result.agents < 4.5 / tolerance**2


def test_agents_round_a_corner_are_the_smallest():
    result = solve(angle(), tolerance=0.05)
    for end in product((-1, 1), repeat=2):
        if end != (1, 1):
            at = np.argmin(np.abs(result.middle - 0.4 - 1e-6 * np.array(end)).max(axis=1))
            assert result.size[at] == result.size.min()


def test_pure_shear_is_bounded_but_for_its_corners():
    """All sides are dragged, the ground holds: one shear everywhere, and U = F² / (2 G t)."""
    force = 100.0
    ways = {"top": [force, 0.0], "right": [0.0, force], "left": [0.0, -force]}
    loads = [{"side": side, "force": way} for side, way in ways.items()]
    body = {"size": [0.2, 0.2], "cells": [10, 10], "thickness": 1.0, **STEEL}
    scene = Scene(body=body, sides={"bottom": "rigid"}, loads=loads)
    result = solve(scene, tolerance=0.01)
    (steel,) = scene.cell_materials
    true = force**2 * (1.0 + steel.poissons_ratio) / steel.youngs_modulus
    lower, upper = result.energy_bounds
    assert lower * (1.0 - 1e-9) <= true <= upper < 1.0003 * true
    assert result.error_bound < 0.01
