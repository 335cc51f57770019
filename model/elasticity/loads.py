"""How forces enter the faces.

A force normal to a face acts on that face. A force in a cell's middle goes in halves to the
two faces across it. A force *along* a free surface is a shear stress τ on the surface. The
face that it drags lies half a cell below; the shear reaches the surface's own faces too,
as a couple of T·h/2, for u(surface) = u(below) + (h/2)(γ − ∂u_n/∂s) with γ given. Without
this couple the moment of the traction would be lost.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene.kinds import AIR, FOUNDATION, ROLLER

from .problem import ACTIVE, ElasticProblem, Floats


def face_forces(
    problem: ElasticProblem,
    cells: NDArray[np.int64],
    direction: NDArray[np.int64],
    force: Floats,
) -> None:
    """Add forces (scaled) to the problem's faces.

    Parameters
    ----------
    cells : int array, shape (n, dimension)
        Cells by which the forces enter, counted without the rim.
    direction : int array, shape (n,)
        Face of the cell by which the force enters; -1 is the middle of the cell.
    force : array, shape (n, dimension)
        The forces, scaled.
    """
    at = cells + 1
    for axis in range(problem.dimension):
        component = force[:, axis]
        loaded = component != 0.0
        middle = loaded & (direction < 0)
        normal = loaded & (direction // 2 == axis) & (direction >= 0)
        for upper in (0, 1):
            _add(problem.force[axis], at[middle], axis, upper, 0.5 * component[middle])
            here = normal & (direction % 2 == upper)
            _add(problem.force[axis], at[here], axis, upper, component[here])
        along = loaded & ~middle & ~normal
        for side in np.unique(direction[along]):
            here = along & (direction == side)
            _drag(problem, axis, int(side), at[here], component[here])


def _add(
    field: Floats,
    cells: NDArray[np.int64],
    axis: int,
    offset: int | NDArray[np.int64],
    value: Floats,
) -> None:
    index = list(cells.T)
    index[axis] = index[axis] + offset
    np.add.at(field, tuple(index), value)


def _drag(
    problem: ElasticProblem, axis: int, side: int, cells: NDArray[np.int64], value: Floats
) -> None:
    """Enter forces along `axis` by the side `side` (normal to another axis) of cells."""
    normal, upper = divmod(side, 2)
    beyond = cells.copy()
    beyond[:, normal] += 2 * upper - 1
    # Smooth walls take no shear either: all of it stays with the body.
    free = np.isin(problem.kinds[tuple(beyond.T)], (AIR, ROLLER, FOUNDATION))
    for end in (0, 1):
        _add(problem.force[axis], cells[free], axis, end, 0.5 * value[free])
        for layer in (cells[~free], beyond[~free]):
            _add(problem.force[axis], layer, axis, end, 0.25 * value[~free])
    outward = 2.0 * upper - 1.0
    _record_shear(problem, axis, normal, upper, cells[free], outward * value[free])
    _couple(problem, axis, normal, upper, cells[free], 0.5 * outward * value[free])


def _record_shear(
    problem: ElasticProblem,
    axis: int,
    normal: int,
    upper: int,
    cells: NDArray[np.int64],
    stress: Floats,
) -> None:
    """Remember the shear stress on the edges at both ends of the loaded faces."""
    pair = (min(axis, normal), max(axis, normal))
    shape = tuple(n + (a in pair) for a, n in enumerate(problem.kinds.shape))
    field = problem.surface_shear.setdefault(pair, np.zeros(shape))
    for end in (0, 1):
        index = list(cells.T)
        index[axis] = index[axis] + end
        index[normal] = index[normal] + upper
        np.add.at(field, tuple(index), 0.5 * stress)


def _couple(
    problem: ElasticProblem,
    axis: int,
    normal: int,
    upper: int,
    cells: NDArray[np.int64],
    moment: Floats,
) -> None:
    """Add -moment·∂u_n/∂s: normal forces on the surface beside the loaded cells."""
    state = problem.face_states()[normal]
    surface = list(cells.T)
    surface[normal] = surface[normal] + upper

    def beside(step: int) -> NDArray[np.bool_]:
        index = list(surface)
        index[axis] = index[axis] + step
        return np.asarray(state[tuple(index)] == ACTIVE)

    before, after = beside(-1), beside(1)
    span = before.astype(np.float64) + after
    scaled = np.divide(moment, span, out=np.zeros_like(moment), where=span > 0)
    field = problem.force[normal]
    for step, present, sign in ((-1, before, 1.0), (1, after, -1.0)):
        index = [column[present] for column in surface]
        index[axis] = index[axis] + step
        np.add.at(field, tuple(index), sign * scaled[present])
        lonely = [column[present] for column in surface]
        other = (after if step < 0 else before)[present]
        np.add.at(field, tuple(c[~other] for c in lonely), -sign * scaled[present][~other])
    _lift(problem, axis, normal, upper, cells[span == 0], moment[span == 0])


def _lift(
    problem: ElasticProblem,
    axis: int,
    normal: int,
    upper: int,
    cells: NDArray[np.int64],
    moment: Floats,
) -> None:
    """Keep the moment where no surface lies beside: extrapolate from the layer below."""
    if not len(cells):
        return
    outward = 2 * upper - 1
    below = cells.copy()
    below[:, normal] -= outward
    for end in (0, 1):
        _add(problem.force[axis], cells, axis, end, 0.5 * outward * moment)
        _add(problem.force[axis], below, axis, end, -0.5 * outward * moment)
