"""A tolerance and no strategy: agents spawn."""

from math import sqrt

import numpy as np
import pytest
from elastic_scenes import spawned_agents
from goal_bodies import plate
from spawning_bodies import STEEL, drawn

from kaju import Scene, solve
from kaju.errors import SceneError, SupportError

LIMIT = 1.32302e-8
"""Strain energy (J) of the plate by converged quadratic finite elements."""


def bar(cells=16):
    """A bar clamped on the left and bent."""
    return Scene(
        body={"size": [0.4, 0.05], "cells": [8 * cells, cells], "material": "steel"},
        sides={"left": "rigid"},
        loads=[{"side": "right", "force": [0.0, -100.0]}],
    )


def beam(cells=4, force=(0.0, 0.0, -100.0)):
    """A beam clamped on the left and bent."""
    body = {"size": [0.4, 0.1, 0.1], "cells": [4 * cells, cells, cells], "material": "steel"}
    end = {"side": "right", "force": list(force)}
    return Scene(body=body, sides={"left": "rigid"}, loads=[end])


def cube(**changes):
    """A cube of steel on rigid ground under 2 N on one cell of its top."""
    body = {"size": [0.2] * 3, "cells": [4] * 3, "material": "steel"}
    body |= {key: changes.pop(key) for key in changes.keys() & {"regions"}}
    loads = [{"cell": [2, 2, 3], "side": "top", "force": [0.0, 0.0, -2.0]}]
    return Scene(**{"body": body, "sides": {"bottom": "rigid"}, "loads": loads} | changes)


def assert_same_faces(one, other):
    moved = zip(one.cells().face_displacement, other.cells().face_displacement, strict=True)
    for ours, theirs in moved:
        np.testing.assert_array_equal(ours, theirs)


def test_small_patch_of_load_makes_agents_spawn():
    result = solve(plate(), tolerance=0.01)
    assert spawned_agents(result)
    assert result.error_bound <= 0.01
    assert sqrt(abs(result.strain_energy / LIMIT - 1)) < 0.01
    assert result.notes == result.caveats, "there is no choice to be told of"


def test_body_of_a_million_million_cells_is_never_rasterised():
    load = {"region": {"box": [[0.5, 1.0], [0.5625, 1.0]]}, "force": [0.0, -1.0]}
    scene = plate(loads=[load], size=[1.0, 1.0], cells=[2**20, 2**20])
    assert spawned_agents(solve(scene, tolerance=0.1))


def test_agents_go_where_members_are_too_thin_for_equal_cells():
    """Cells that hang together by single faces, about which they turn freely."""
    load = {"cell": [0, 5], "side": "top", "force": [1.0, -1.0]}
    scene = drawn(["a.", "aa", ".a", "aa", "a.", "aa"], [STEEL], [load])
    with pytest.raises(SceneError, match="turn freely"):
        solve(scene)
    result = solve(scene, tolerance=0.1)
    assert spawned_agents(result)
    assert result.error_bound <= 0.1


def test_loose_bodies_are_refused_at_once():
    with pytest.raises(SupportError, match="move along x"):
        solve(plate(sides={"bottom": "roller"}), tolerance=0.1)
