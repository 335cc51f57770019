"""The forces by which supports hold a body."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene.cell_types import FOUNDATION, INSIDE, RIGID, ROLLER
from kaju.model.scene.lattice import Lattice

from .problem import FIXED, ElasticProblem, FaceFields
from .staggered import internal_force


def reactions(
    problem: ElasticProblem,
    u: FaceFields,
    lattice: Lattice,
    origin: tuple[int, ...] | Ints,
    counted: tuple[Flags, ...] | None = None,
) -> dict[str, Floats]:
    """Return the force (scaled) of every support on the body; of cells inside as "rigid"."""
    # `origin` is the lattice's cell that is the arrays' first; `counted` are the faces that count,
    # if the cells are a part of a body.
    found: dict[str, Floats] = {}
    kinds, nothing = problem.kinds, 2 * problem.dimension
    side = np.full(kinds.shape, -1, dtype=np.int64)
    for index in range(nothing):
        axis, upper = divmod(index, 2)
        end = origin[axis] + problem.shape[axis] == lattice.shape[axis]
        # Ends of arrays that were cut to the body are no sides: cells inside may hold it there.
        if end if upper else origin[axis] == 0:
            np.moveaxis(side, axis, 0)[-upper] = index
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
            name = INSIDE if index < 0 else lattice.sides[index]
            total = found.setdefault(name, np.zeros(problem.dimension))
            total[axis] += pull[owner == index].sum()
    return found
