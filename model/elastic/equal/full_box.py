"""Full boxes of one material: their coarse grids are boxes that obey the law themselves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.model.elastic.moduli import Moduli
from kaju.model.scene.cell_types import RIGID

from .problem import ElasticProblem, rim_layer

FEWEST = 16
"""A full box of an even number of cells, at least so many, along every axis has a coarse box."""


def is_box(problem: ElasticProblem) -> bool:
    """Tell whether a body is a full box of one material, sides of one kind, to be coarsened."""
    # Edge moduli that are given do not follow from the cells, so coarse cells would lose them.
    if problem.edges is not None or any(n % 2 or n < FEWEST for n in problem.shape):
        return False
    inside = problem.kinds[problem.inner]
    if inside.flat[0] < 0 or not np.all(inside == inside.flat[0]):
        return False
    layers = [problem.kinds[rim_layer(problem.dimension, s)] for s in range(2 * problem.dimension)]
    return all(bool(np.all(layer == layer.flat[0])) for layer in layers)


def ghost_weights_of(problem: ElasticProblem) -> Floats:
    """Return for every side the weights of the first two faces that extrapolate to its ghosts."""
    # Beyond a rigid side they mirror: so a coarse box obeys the law on its own cells. Of other
    # bodies the weights are not used.
    sides = range(2 * problem.dimension)
    ends = [problem.kinds[rim_layer(problem.dimension, side)].flat[0] for side in sides]
    return np.array([(-1.0, 0.0) if end == RIGID else (2.0, -1.0) for end in ends])


def coarse_box(problem: ElasticProblem) -> ElasticProblem:
    """Return a full box on cells twice as large."""
    d = problem.dimension

    def halved(values: NDArray[Any]) -> NDArray[Any]:
        # The ghost cells beyond both ends stay. Along the normal the last face is kept as well;
        # across it the last two have one coarse face.
        every = [np.array([0, *range(1, n - 1, 2), n - 1]) for n in values.shape]
        return np.ascontiguousarray(values[np.ix_(*every)])

    return replace(
        problem,
        kinds=halved(problem.kinds),
        moduli=Moduli(*(2.0 ** (d - 2) * values for values in problem.moduli)),
        spring=tuple(2.0 ** (d - 1) * halved(values) for values in problem.spring),
    )
