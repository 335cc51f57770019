"""How forces enter the faces of equal cells.

A force normal to a face acts on that face, one in a cell's middle in halves on the two faces across
it. What forces along a side, and moments, put on the faces round a cell depends on the 3^d cells
there alone: they are entered once for each such neighbourhood, on a composite grid (`leaf_loads`),
and the result is added as a stencil wherever it recurs.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from kaju.arrays import Floats, Ints, moved
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.scene.cell_types import FOUNDATION
from kaju.model.scene.selection import AppliedLoads

from .problem import CellLoads, ElasticProblem

KINDS = -FOUNDATION + 1  # Kinds of cells: body, and those that are none


def face_forces(problem: ElasticProblem, loads: CellLoads) -> None:
    """Add forces to the problem's faces, and the moments of those that lie unevenly on theirs."""
    at, direction, force = loads.cells + 1, loads.direction, loads.force / problem.scales.force
    d = problem.dimension
    for axis, upper in product(range(d), (0, 1)):
        for some, share in ((direction < 0, 0.5), (direction == 2 * axis + upper, 1.0)):
            face = tuple(moved(at[some], axis, upper).T)
            np.add.at(problem.force[axis], face, share * force[some, axis])
    # Unit loads are a force along every axis, then a moment of every component along every axis.
    portions = portions_of_cells(loads, problem.scales.force)
    moment = np.zeros((len(at), d, d))
    moment[portions.box] = portions.moment
    along = np.where(np.arange(d) == direction[:, None] // 2, 0.0, force)
    amount = np.concatenate([along, moment.reshape(-1, d * d)], axis=1)
    across = (direction >= 0) & amount.any(axis=1)
    for side in np.unique(direction[across]):
        here = across & (direction == side)
        _add_stencils(problem, int(side), at[here], amount[here])


def portions_of_cells(loads: CellLoads | AppliedLoads, unit: float) -> Portions:
    """Return what faces have of uneven loads, in units of a force; `box` are rows of the loads."""
    uneven = loads.uneven
    if uneven is None or not len(uneven.row):
        return Portions.none(loads.cells.shape[1])
    scaled = uneven._replace(growth=uneven.growth / unit)
    size, lower = np.ones(len(uneven.row)), np.zeros(uneven.part[:, 0].shape)
    own = uneven.row, loads.direction[uneven.row], loads.force[uneven.row] / unit
    return Portions.of(*own, scaled, lower, size)


def _add_stencils(problem: ElasticProblem, side: int, cells: Ints, amount: Floats) -> None:
    """Add amounts of the unit loads on a side of cells, shape (n, unit loads)."""
    from kaju.model.elastic.cells.leaf_loads import stencils

    steps = np.array(list(product((-1, 0, 1), repeat=problem.dimension)))
    kinds = problem.kinds[tuple(np.moveaxis(cells[:, None] + steps, -1, 0))]
    kinds = np.minimum(kinds, 0).astype(np.int8)  # all materials are body
    digits = -kinds.astype(np.int64) @ KINDS ** np.arange(len(steps))
    _, first, which = np.unique(digits, return_index=True, return_inverse=True)
    units = np.flatnonzero(amount.any(axis=0))
    own = kinds[first].tobytes(), problem.dimension, side, tuple(units.tolist())
    faces, shears = stencils(*own)

    def add(field: Floats, step: Ints, weight: Floats) -> None:
        value = np.einsum("nj,nj->n", weight[which], amount[:, units])
        np.add.at(field, tuple((cells + step).T), value)

    for axis, *place in np.argwhere(faces.any(axis=(-1, -2))).tolist():
        add(problem.force[axis], np.array(place) - 1, faces[(axis, *place)])
    for pair, shear in shears.items():
        for ends in np.argwhere(shear.any(axis=(-1, -2))):
            shape = [n + (a in pair) for a, n in enumerate(problem.kinds.shape)]
            step = np.zeros(problem.dimension, dtype=np.int64)
            step[list(pair)] = ends
            add(problem.surface_shear.setdefault(pair, np.zeros(shape)), step, shear[tuple(ends)])
