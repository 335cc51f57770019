"""The forces by which supports hold a body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .problem import FIXED, ElasticProblem, FaceFields, Floats
from .staggered import internal_force

INSIDE = "rigid"
"""Name of the support that rigid cells inside the array give."""


def reactions(problem: ElasticProblem, u: FaceFields, names: tuple[str, ...]) -> dict[str, Floats]:
    """Return the force (scaled) of every support on the body.

    Parameters
    ----------
    problem, u
        What was solved, and its displacements.
    names : tuple of str
        Names of the sides, lower before upper, axis by axis.

    Returns
    -------
    dict from name to array, shape (dimension,)
        Only supports that touch the body; rigid cells inside count as "rigid".
    """
    found: dict[str, Floats] = {}
    inner = internal_force(problem, u)
    for axis, force in enumerate(inner):
        held = problem.face_states()[axis] == FIXED
        # The load on a fixed face goes straight into the support.
        pull = np.where(held, force - problem.force[axis], -problem.spring[axis] * u[axis])
        owner = _owners(problem, axis)
        for index in np.unique(owner[pull != 0.0]):
            name = INSIDE if index < 0 else names[index]
            total = found.setdefault(name, np.zeros(problem.dimension))
            total[axis] += pull[owner == index].sum()
    return found


def _owners(problem: ElasticProblem, axis: int) -> NDArray[np.int64]:
    """Return for every face the side that it lies on or beyond, -1 inside the array."""
    shape = problem.face_shape(axis)
    owner = np.full(shape, -1, dtype=np.int64)
    for along in range(problem.dimension):
        reach = 2 if along == axis else 1
        lines = np.moveaxis(owner, along, 0)
        lines[:reach] = 2 * along
        lines[-reach:] = 2 * along + 1
    # Faces normal to a side belong to it before they belong to the sides beside it.
    lines = np.moveaxis(owner, axis, 0)
    lines[:2], lines[-2:] = 2 * axis, 2 * axis + 1
    return owner
