"""What a bracket is made of: boxes side by side, with the stresses the staggered grid gives them.

Equal cells and agents of many sizes are both told like this; scaled, lengths in cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, RIGID, ROLLER

from .problem import ABSENT, ACTIVE, ElasticProblem, FaceFields, Floats
from .staggered import (
    Pair,
    Strains,
    axis_pairs,
    cell_modulus,
    cut,
    edge_modulus,
    force_of,
    strains,
    stresses,
)

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Law(NamedTuple):
    """C₁₁, C₁₂ and μ of boxes, each an array of as many entries."""

    stretch: Floats
    lateral: Floats
    shear: Floats


class Hanging(NamedTuple):
    """Sides with smaller boxes before them: box, side, and these, in the order of `corner_ends`."""

    box: Index
    side: Index
    fine: Index


class Loads(NamedTuple):
    """Forces that enter by sides: box, side, and vectors."""

    box: Index
    side: Index
    force: Floats


class Held(NamedTuple):
    """Sides of boxes at a wall: which, RIGID or ROLLER, and how it moves, shape (n, dimension)."""

    side: int
    box: Index
    kind: int
    value: Floats


class Bed(NamedTuple):
    """Sides of boxes on a bed: which, and its stiffness per area."""

    side: int
    box: Index
    stiffness: Floats


class Mesh(NamedTuple):
    """Where a displacement without gaps has its values.

    Attributes
    ----------
    corner : int array, shape (2^dimension, boxes)
        Nodes at the corners of the boxes.
    element : int array, shape (2^dimension, elements)
        The same for the elements: the boxes, or their parts where corners of smaller ones touch.
    owner : int array, shape (elements,)
    edge : array, shape (elements,)
    parts : int array, shape (2^dimension, boxes)
        The element at every corner of a box.
    slave, masters : int arrays, shape (n,) and (2^(dimension - 1), n)
        Nodes that lie in the middle of others on a side, or an edge, that stays straight.
    start : array, shape (nodes, dimension)
        Displacements to begin with.
    """

    corner: Index
    element: Index
    owner: Index
    edge: Floats
    parts: Index
    slave: Index
    masters: Index
    start: Floats


def whole_mesh(corner: Index, size: Floats, start: Floats) -> Mesh:
    """Return the nodes of boxes of which none is cut."""
    each, nothing = np.arange(len(size)), np.zeros((len(corner) // 2, 0), dtype=np.int64)
    parts = np.broadcast_to(each, corner.shape)
    return Mesh(corner, corner, each, size, parts, nothing[0], nothing, start)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes of material.

    Attributes
    ----------
    size : array, shape (boxes,)
        Edges.
    law : Law
    sigma : array, shape (dimension, boxes)
        Normal stresses in the middles.
    shear : dict from pair of axes to array, shape (2, 2, boxes)
        Shear stresses at the ends along both axes.
    body : array, shape (dimension, boxes)
        Force per volume within.
    beside : int array, shape (2·dimension, boxes)
        A box on each side, -1 for none.
    kind : int array, shape (2·dimension, boxes)
        What lies beyond each side: a material (from 0), AIR, RIGID, ROLLER or FOUNDATION.
    uneven : bool array, shape (boxes,)
        Round which a corner is re-entrant, or smaller ones hang, or a load acts along a side.
    hanging : Hanging
    loads : Loads
    held : list of Held
    beds : list of Bed
    mesh : Mesh
    moved : array, shape (2·dimension, boxes)
        Mean displacement of every side across itself.
    rest : array, shape (2·dimension, boxes)
        Normal stress on sides that the iteration has not balanced yet.
    unsettled : float
        Relative error in the energy norm that this is, at most.
    """

    size: Floats
    law: Law
    sigma: Floats
    shear: dict[Pair, Floats]
    body: Floats
    beside: Index
    kind: Index
    uneven: Flags
    hanging: Hanging
    loads: Loads
    held: list[Held]
    beds: list[Bed]
    mesh: Mesh
    moved: Floats
    rest: Floats | None = None
    unsettled: float = 0.0

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.sigma)

    def side_nodes(self, box: Index, side: int) -> Index:
        """Return the nodes at the corners of the elements on a side of boxes.

        Shape (2^(dimension - 1), 2^(dimension - 1), n): by corner, and by part of the side.
        """
        on = corner_ends(self.dimension)[:, side // 2] == side % 2
        return np.asarray(self.mesh.element[on][:, self.mesh.parts[on][:, box]])


def corner_ends(dimension: int) -> Index:
    """Return the corners of a box by their ends along the axes, shape (2^dimension, dimension)."""
    return np.array(list(product((0, 1), repeat=dimension)))


@lru_cache(maxsize=2)
def _bodies_at_point(dimension: int) -> Index:
    """Return the numbers of bodies round a point, by its filled octants (bits) and octant."""
    ends = corner_ends(dimension)
    beside = np.asarray(np.abs(ends[:, None] - ends).sum(axis=2) == 1)
    found = np.zeros((1 << len(ends), len(ends)), dtype=np.int64)
    for filled, row in enumerate(found):
        there = np.array([filled >> k & 1 for k in range(len(ends))], dtype=np.bool_)
        _, row[there] = connected_components(csr_array(beside[np.ix_(there, there)]))
    return found


def parted(nodes: list[Index], octants: list[int], count: int) -> tuple[list[Index], Index]:
    """Give bodies that touch at a corner, or an edge, only a node each.

    Points, and lines in solids, hold nothing together: the displacement may differ on both sides.

    Parameters
    ----------
    nodes : list of int arrays
        Nodes of boxes, none of them twice in one array.
    octants : list of int
        At which of its corners (bits, in the order of `corner_ends`) boxes have these nodes; at
        several where it is in the middle of an edge or a side.
    count : int
        Number of nodes.

    Returns
    -------
    nodes : list of int arrays
        New nodes are numbered from `count` on.
    double : int array
        For every new node the old one.
    """
    many = max(octants).bit_length()
    bodies = _bodies_at_point(2 if many <= 4 else 3)
    filled = np.zeros(count, dtype=np.int64)
    for node, bits in zip(nodes, octants, strict=True):
        filled[node] |= bits
    several = np.asarray(bodies.any(axis=1))
    if not several[filled].any():
        return nodes, np.zeros(0, dtype=np.int64)
    keys = [
        node * len(bodies) + bodies[filled[node], bits.bit_length() - 1]
        for node, bits in zip(nodes, octants, strict=True)
    ]
    more = np.unique(np.concatenate(keys))
    more = more[more % len(bodies) > 0]
    found = [
        np.where(key % len(bodies) > 0, count + np.searchsorted(more, key), node)
        for key, node in zip(keys, nodes, strict=True)
    ]
    return found, more // len(bodies)


def boxes_of_cells(
    problem: ElasticProblem, u: FaceFields, unsettled: float, grid: Scene, stage: int | None
) -> Boxes:
    """Return equal cells with the stresses of a solution.

    Parameters
    ----------
    problem : ElasticProblem
        Without loads along surfaces.
    u : tuple of arrays
        Face displacements that solve its equations, but for a relative error in the energy norm.
    unsettled : float
        That error.
    grid : Scene
        The scene on the problem's cells.
    stage : int or None
        Stage of loading.
    """
    d, kinds, moduli = problem.dimension, problem.kinds, problem.moduli
    cells = np.argwhere(kinds >= 0)
    place = tuple(cells.T)
    n, kind = len(cells), kinds[place]
    number = np.full(kinds.shape, -1)
    number[place] = np.arange(n)
    stress = stresses(problem, strains(u))
    shape = tuple(k + 1 for k in kinds.shape)
    corner = np.stack(
        [np.ravel_multi_index(tuple((cells + end).T), shape) for end in corner_ends(d)]
    )
    beside, beyond = np.empty((2 * d, n), dtype=np.int64), np.empty((2 * d, n), dtype=np.int64)
    for side in range(2 * d):
        next_to = cells.copy()
        next_to[:, side // 2] += 2 * (side % 2) - 1
        beside[side], beyond[side] = number[tuple(next_to.T)], kinds[tuple(next_to.T)]
    body, loads = _loads_of_cells(problem, grid, stage, number)
    uneven = np.zeros(n, dtype=np.bool_)
    for pair in axis_pairs(d):
        edges = reentrant_edges(problem, pair)
        uneven |= _at_ends(edges, cells, pair).any(axis=(0, 1))
    nothing = np.zeros(0, dtype=np.int64)
    start = _corner_means(problem, u)
    nodes, double = parted(list(corner), [1 << k for k in range(1 << d)], len(start))
    if len(double):
        corner = np.stack(nodes)
        start = np.concatenate([start, start[double]])
        for node, end in zip(corner, corner_ends(d), strict=True):
            # There each side has the displacement of its own faces.
            here = np.flatnonzero(np.isin(node, double) | (node >= len(start) - len(double)))
            for axis in range(d):
                at = cells[here].copy()
                at[:, axis] += end[axis]
                start[node[here], axis] = u[axis][tuple(at.T)]
    return Boxes(
        np.ones(n),
        Law(moduli.stretch[kind], moduli.lateral[kind], moduli.shear[kind]),
        np.stack([s[place] for s in stress.cells]),
        {pair: _at_ends(tau, cells, pair) for pair, tau in stress.edges.items()},
        body,
        beside,
        beyond,
        uneven,
        Hanging(nothing, nothing, nothing.reshape(0, 1 << (d - 1))),
        loads,
        list(_held_cells(problem, cells, beyond)),
        list(_beds_of_cells(problem, cells, beyond)),
        whole_mesh(corner, np.ones(n), start),
        _moved_cells(u, cells),
        _rest_of_cells(problem, u, stress, number),
        unsettled,
    )


def _moved_cells(u: FaceFields, cells: Index) -> Floats:
    """Return how the faces of cells move across themselves."""
    found = np.empty((2 * len(u), len(cells)))
    for side, moved in enumerate(found):
        axis, upper = divmod(side, 2)
        place = cells.copy()
        place[:, axis] += upper
        moved[:] = u[axis][tuple(place.T)]
    return found


def _rest_of_cells(
    problem: ElasticProblem, u: FaceFields, stress: Strains, number: Index
) -> Floats:
    """Return what the cells' faces are left with, told by the cell below them if there is one."""
    d = problem.dimension
    rest = np.zeros((2 * d, int(number.max()) + 1))
    states, force = problem.face_states(), force_of(problem, u, stress)
    for axis, state in enumerate(states):
        left = np.where(state == ACTIVE, problem.force[axis] - force[axis], 0.0)
        low, high = (left[cut(d, axis, s)] for s in (slice(None, -1), slice(1, None)))
        bare = np.pad(number >= 0, [(1, 0) if a == axis else (0, 0) for a in range(d)])
        bare = ~bare[cut(d, axis, slice(None, -1))]
        there = number >= 0
        rest[2 * axis + 1, number[there]] = -high[there]
        there &= bare
        rest[2 * axis, number[there]] = low[there]
    return rest


def _at_ends(values: NDArray[Any], cells: Index, pair: Pair) -> NDArray[Any]:
    """Return what is at the four edges of every cell, shape (2, 2, cells)."""
    found = []
    for ends in product((0, 1), repeat=2):
        at = cells.copy()
        at[:, pair] += ends
        found.append(values[tuple(at.T)])
    return np.stack(found).reshape(2, 2, -1)


def reentrant_edges(problem: ElasticProblem, pair: Pair) -> Flags:
    """Tell at which edges one of the four cells is air, the others are body, and shear acts."""
    kinds = problem.kinds
    width = [(1, 1) if axis in pair else (0, 0) for axis in range(kinds.ndim)]
    air = np.pad(kinds == AIR, width, constant_values=True)
    rigid = np.pad(kinds == RIGID, width)
    modulus = edge_modulus(problem, pair)
    count, walls = np.zeros(modulus.shape, dtype=np.int8), np.zeros(modulus.shape, dtype=np.int8)
    for first, second in product((slice(None, -1), slice(1, None)), repeat=2):
        count += air[cut(kinds.ndim, pair[0], first)][cut(kinds.ndim, pair[1], second)]
        walls += rigid[cut(kinds.ndim, pair[0], first)][cut(kinds.ndim, pair[1], second)]
    return np.asarray((count == 1) & (walls == 0) & (modulus > 0))


def _loads_of_cells(
    problem: ElasticProblem, grid: Scene, stage: int | None, number: Index
) -> tuple[Floats, Loads]:
    """Return forces within the cells, and those by their sides."""
    applied = grid.applied(stage)
    lower = np.asarray(grid.bounds()[0], dtype=np.int64)
    box = number[tuple((applied.cells - lower + 1).T)]
    force = applied.force / problem.scales.force
    body = np.zeros((problem.dimension, int(number.max()) + 1))
    within = applied.direction < 0
    np.add.at(body.T, box[within], force[within])
    return body, Loads(box[~within], applied.direction[~within], force[~within])


def _held_cells(problem: ElasticProblem, cells: Index, beyond: Index) -> list[Held]:
    found = []
    for side, kinds in enumerate(beyond):
        axis, upper = divmod(side, 2)
        for kind in (ROLLER, RIGID):
            at = np.flatnonzero(kinds == kind)
            value = np.zeros((len(at), problem.dimension))
            for component, fixed in enumerate(problem.fixed):
                place = cells[at].copy()
                place[:, axis] += upper if component == axis else 2 * upper - 1
                value[:, component] = fixed[tuple(place.T)]
            if len(at):
                found.append(Held(side, at, kind, value))
    return found


def _beds_of_cells(problem: ElasticProblem, cells: Index, beyond: Index) -> list[Bed]:
    found = []
    for side, kinds in enumerate(beyond):
        axis, upper = divmod(side, 2)
        place = cells.copy()
        place[:, axis] += upper
        stiffness = problem.spring[axis][tuple(place.T)]
        on = np.flatnonzero((stiffness > 0) & (kinds < 0))
        if len(on):
            found.append(Bed(side, on, stiffness[on]))
    return found


def _corner_means(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the displacement of all corners by the faces round them, stiff ones counting more."""
    d = problem.dimension
    stiffness = cell_modulus(problem, problem.moduli.stretch)
    found = []
    for axis, state in enumerate(problem.face_states()):
        width = [(1, 1) if a == axis else (0, 0) for a in range(d)]
        beside = np.pad(stiffness, width)
        weight = beside[cut(d, axis, slice(None, -1))] + beside[cut(d, axis, slice(1, None))]
        values, weight = (
            np.where(state == ABSENT, 0.0, u[axis]),
            np.where(state == ABSENT, 0.0, weight),
        )
        for across in range(d):
            if across != axis:
                values, weight = _between(values, weight, across)
        found.append(values.ravel())
    return np.stack(found, axis=1)


def _between(values: Floats, weight: Floats, axis: int) -> tuple[Floats, Floats]:
    """Return weighted means of neighbours along an axis; a line's end is prolonged."""
    width = [(2, 2) if a == axis else (0, 0) for a in range(values.ndim)]
    v, w = np.pad(values, width), np.pad(weight, width)
    n = values.shape[axis]

    def part(array: Floats, start: int) -> Floats:
        return array[cut(values.ndim, axis, slice(start, start + n + 1))]

    (before, low, high, after), (w0, w1, w2, w3) = (
        [part(array, k) for k in range(4)] for array in (v, w)
    )
    whole = w1 + w2
    mean = (w1 * low + w2 * high) / np.where(whole > 0, whole, 1.0)
    from_low = np.where(w0 > 0, 1.5 * low - 0.5 * before, low)
    from_high = np.where(w3 > 0, 1.5 * high - 0.5 * after, high)
    ends = np.where(w2 > 0, from_high, from_low)
    return np.where((w1 > 0) & (w2 > 0), mean, ends), whole
