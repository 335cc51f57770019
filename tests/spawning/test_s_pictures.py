"""Pictures of agents of many sizes."""

import numpy as np
import pytest

from kaju import Scene, plot, solve
from kaju.errors import ParameterError


def spawned_by(scene, **how):
    return solve(scene, strategy="spawning", **how)


def result(dimension):
    low, high = [0.25] * (dimension - 1) + [1.0], [0.5] * (dimension - 1) + [1.0]
    force = [0.0] * (dimension - 1) + [-1.0]
    return spawned_by(
        Scene(
            body={"size": [1.0] * dimension, "cells": [8] * dimension, "material": "steel"},
            sides={"bottom": "rigid"},
            loads=[{"region": {"box": [low, high]}, "force": force}],
        ),
        tolerance=0.2,
    )


@pytest.mark.parametrize("colour", ["level", "spawn_step", "unbalanced_load", "von_mises"])
def test_every_agent_is_drawn_in_its_colour(colour):
    found = result(2)
    figure = plot(found, "agents", colour=colour, step=1)
    agents, born = (
        next(c for c in figure.axes[0].collections if c.get_gid() == name)
        for name in ("agents", "spawned")
    )
    np.testing.assert_array_equal(agents.get_array(), getattr(found, colour))
    assert len(born.get_paths()) == np.count_nonzero(found.spawn_step == 1)
    edges = [np.ptp(path.vertices[:, 0]) for path in agents.get_paths()]
    np.testing.assert_allclose(edges, found.size)


def test_plane_shows_the_agents_that_it_meets():
    found = result(3)
    figure = plot(found, "agents", cut={"z": 0.99})
    (agents,) = figure.axes[0].collections
    assert len(agents.get_paths()) == np.count_nonzero(found.lower[:, 2] + found.size > 0.99)
    assert plot(found).axes[0].get_ylabel().startswith("z")


def test_what_cannot_be_drawn_is_named():
    with pytest.raises(ParameterError, match="level"):
        plot(result(2), "agents", colour="levle")
    with pytest.raises(ParameterError, match="no agent"):
        plot(result(3), "agents", cut={"x": 3.0})
