"""The forces by which supports hold a body."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Flags, Floats
from kaju.model.scene.cell_types import FOUNDATION, INSIDE, RIGID, ROLLER

from .problem import FIXED, ElasticProblem, FaceFields
from .staggered import internal_force


def reactions(
    problem: ElasticProblem,
    u: FaceFields,
    names: tuple[str, ...],
    counted: tuple[Flags, ...] | None = None,
) -> dict[str, Floats]:
    """Return the force (scaled) of every support on the body; of cells inside as "rigid"."""
    # `names` are those of the sides, lower before upper, axis by axis; `counted` the faces that
    # count, if the cells are a part of a body.
    found: dict[str, Floats] = {}
    kinds, nothing = problem.kinds, 2 * problem.dimension
    side = np.full(kinds.shape, -1, dtype=np.int64)
    for index, name in enumerate(names):
        # At a corner of arrays that were cut to the body, the side is the one not cut.
        if name != INSIDE:
            np.moveaxis(side, index // 2, 0)[-1 if index % 2 else 0] = index
    holding = np.where(np.isin(kinds, (RIGID, ROLLER, FOUNDATION)), side, nothing)
    inner = internal_force(problem, u)
    for axis, force in enumerate(inner):
        held = problem.face_states[axis] == FIXED
        # The load on a fixed face goes straight into the support.
        pull = np.where(held, force - problem.force[axis], -problem.spring[axis] * u[axis])
        if counted is not None:
            pull = np.where(counted[axis], pull, 0.0)
        # The side whose cells hold a face; -1 if cells inside the array do.
        width = [(1, 1) if a == axis else (0, 0) for a in range(kinds.ndim)]
        lines = np.moveaxis(np.pad(holding, width, constant_values=nothing), axis, 0)
        owner = np.moveaxis(np.minimum(lines[:-1], lines[1:]), 0, axis)
        for index in np.unique(owner[pull != 0.0]):
            name = INSIDE if index < 0 else names[index]
            total = found.setdefault(name, np.zeros(problem.dimension))
            total[axis] += pull[owner == index].sum()
    return found
