"""How forces enter the faces.

A force normal to a face acts on that face. A force in a cell's middle goes in halves to the
two faces across it. A force *along* a free surface is a shear stress τ on the surface. The
face that it drags lies half a cell below; the shear reaches the surface's own faces too,
as a couple of T·h/2, for u(surface) = u(below) + (h/2)(γ − ∂u_n/∂s) with γ given. Without
this couple the moment of the traction would be lost.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from kaju.arrays import Flags, Floats, Ints, moved
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.scene.cell_types import AIR, FOUNDATION, RIGID, ROLLER
from kaju.model.scene.selection import AppliedLoads

from .problem import ACTIVE, FIXED, CellLoads, ElasticProblem


def face_forces(problem: ElasticProblem, loads: CellLoads) -> None:
    """Add forces to the problem's faces, and the moments of those that lie unevenly on theirs."""
    at, direction, force = loads.cells + 1, loads.direction, loads.force / problem.scales.force
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
    portions = portions_of_cells(loads, problem.scales.force)
    for side in np.unique(portions.side):
        here = portions.side == side
        _turn(problem, int(side), at[portions.box[here]], portions.moment[here])


def portions_of_cells(loads: CellLoads | AppliedLoads, unit: float) -> Portions:
    """Return what faces have of uneven loads, in units of a force; `box` are rows of the loads."""
    uneven = loads.uneven
    if uneven is None or not len(uneven.row):
        return Portions.none(loads.cells.shape[1])
    scaled = uneven._replace(growth=uneven.growth / unit)
    size, lower = np.ones(len(uneven.row)), np.zeros(uneven.part[:, 0].shape)
    own = uneven.row, loads.direction[uneven.row], loads.force[uneven.row] / unit
    return Portions.of(*own, scaled, lower, size)


def _turn(problem: ElasticProblem, side: int, cells: Ints, moment: Floats) -> None:
    """Enter the first moments, shape (n, d, d), of forces on a side of cells."""
    normal, upper = divmod(side, 2)
    axes = [axis for axis in range(problem.dimension) if axis != normal]
    for axis in axes:
        some = moment[:, normal, axis] != 0.0
        _couple(problem, axis, normal, upper, cells[some], -moment[some, normal, axis], False)
    for first, second in combinations(axes, 2):
        twist = moment[:, first, second] - moment[:, second, first]
        some = twist != 0.0
        for end in (0, 1):
            _make_up(problem, first, second, end, cells[some], 0.5 * twist[some])


def _add(field: Floats, cells: Ints, axis: int, offset: int | Ints, value: Floats) -> None:
    np.add.at(field, tuple(moved(cells, axis, offset).T), value)


def _drag(problem: ElasticProblem, axis: int, side: int, cells: Ints, value: Floats) -> None:
    """Enter forces along `axis` by the side `side` (normal to another axis) of cells."""
    normal, upper = divmod(side, 2)
    beyond = moved(cells, normal, 2 * upper - 1)
    kind = problem.kinds[tuple(beyond.T)]
    # Smooth walls take no shear either: all of it stays with the body; ground takes it all.
    free, held = np.isin(kind, (AIR, ROLLER, FOUNDATION)), kind == RIGID
    own = np.where(free, 0.5, np.where(held, 0.0, 0.25))
    for end in (0, 1):
        _add(problem.force[axis], cells, axis, end, own * value)
        _add(problem.force[axis], beyond, axis, end, (0.5 - own) * value)
    outward = 2.0 * upper - 1.0
    # The shear stress on the edges at both ends of the loaded faces.
    pair = (min(axis, normal), max(axis, normal))
    shape = tuple(n + (a in pair) for a, n in enumerate(problem.kinds.shape))
    shear = problem.surface_shear.setdefault(pair, np.zeros(shape))
    for end in (0, 1):
        _add(shear, moved(cells[free], normal, upper), axis, end, 0.5 * outward * value[free])
    _couple(problem, axis, normal, upper, cells[free], 0.5 * outward * value[free])


def _couple(
    problem: ElasticProblem,
    axis: int,
    normal: int,
    upper: int,
    cells: Ints,
    moment: Floats,
    dragged: bool = True,
) -> None:
    """Add -moment·∂u_n/∂s: normal forces on the surface beside the loaded cells."""
    # The slope is taken between a cell's two ends, where u_n is the mean of the faces on both
    # sides, the wall's own value at a wall, and that of the cell where the surface ends. A uniform
    # shear then leaves every corner in balance; what of the moment is lost at an end is made up for
    # inside.
    state = problem.face_states[normal]
    surface = moved(cells, normal, upper)
    field = problem.force[normal]
    lost = np.zeros_like(moment)
    running = []
    for step in (-1, 1):
        beside, beyond = moved(surface, axis, step), moved(cells, axis, step)
        runs_on = state[tuple(beside.T)] == ACTIVE
        walled = dragged & ~runs_on & (problem.kinds[tuple(beyond.T)] == RIGID)
        there = np.where(runs_on, 0.5, np.where(walled, 1.0, 0.0))
        np.add.at(field, tuple(beside.T), -step * there * moment)
        np.add.at(field, tuple(surface.T), step * there * moment)
        lost += np.where(runs_on | walled, 0.0, 0.5 * moment)
        running.append((step, beside, runs_on))
        # The wall's face stands half a cell beyond the wall, which bears the difference.
        edge = _edge_below(cells[walled], axis, normal, upper, step)
        whole = _along(problem, axis, normal, edge, least=FIXED)
        _tilt(problem, axis, normal, edge[whole], -0.5 * moment[walled][whole])
    ended = np.flatnonzero(lost)
    left = _make_up(problem, axis, normal, upper, cells[ended], lost[ended])
    for step, beside, runs_on in running:
        rest = -step * np.where(runs_on[ended], left, 0.0)
        np.add.at(field, tuple(beside[ended].T), rest)
        np.add.at(field, tuple(surface[ended].T), -rest)


def _edge_below(cells: Ints, axis: int, normal: int, upper: int, step: int) -> Ints:
    """Return the edge at one end of cells, one row below the surface."""
    return moved(moved(cells, axis, int(step > 0)), normal, 1 - upper)


def _along(problem: ElasticProblem, component: int, across: int, edge: Ints, least: int) -> Flags:
    """Tell whether both faces of one component at edges are FIXED or ACTIVE at least."""
    before = moved(edge, across, -1)
    state = problem.face_states[component]
    return np.asarray((state[tuple(before.T)] >= least) & (state[tuple(edge.T)] >= least))


def _tilt(problem: ElasticProblem, component: int, across: int, edge: Ints, moment: Floats) -> None:
    """Add +moment·∂u/∂x at edges: u is one component, x the axis across its faces."""
    _add(problem.force[component], edge, across, -1, -moment)
    _add(problem.force[component], edge, across, 0, moment)


def _make_up(
    problem: ElasticProblem, axis: int, normal: int, upper: int, cells: Ints, moment: Floats
) -> Floats:
    """Enter moments as a turn of the four faces round the edges below the surface."""
    # Where there are no such faces u(surface) is extrapolated from the layer below, and without a
    # layer below the moment is returned.
    edges = [_edge_below(cells, axis, normal, upper, step) for step in (-1, 1)]
    turns = np.stack(
        [
            _along(problem, axis, normal, edge, least=ACTIVE)
            & _along(problem, normal, axis, edge, least=ACTIVE)
            for edge in edges
        ]
    )
    kind = problem.kinds[tuple(moved(cells, normal, 1 - 2 * upper).T)]
    lifts = ~turns.any(axis=0) & ((kind >= 0) | (kind == RIGID))
    for edge, turn in zip(edges, turns, strict=True):
        share = np.where(lifts, 0.5, turn / np.maximum(turns.sum(axis=0), 1)) * moment
        _tilt(problem, axis, normal, edge, np.where(turn, 0.5, 1.0) * share)
        _tilt(problem, normal, axis, edge, np.where(turn, -0.5, 0.0) * share)
    return np.where(lifts | turns.any(axis=0), 0.0, moment)
