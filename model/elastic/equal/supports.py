"""What holds a body, and whether it holds it entirely.

Cells that share a face belong to one part; those that only touch at a corner do not. Every
part needs supports that stop all its rigid motions: in two dimensions two shifts and a
turn, in three dimensions three of each. A member one cell wide is another matter: all its
corners touch air and carry no shear, so on this grid it is a chain of loose links, and the
body has to be solved on smaller cells.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints, moved
from kaju.factors import rigid_motions
from kaju.model.elastic.free_motion import free_motion, unheld
from kaju.model.scene.cell_types import FOUNDATION, RIGID

from .problem import ACTIVE, FIXED, ElasticProblem, coarse_box, is_box
from .staggered import around_edges, axis_pairs, cut, edge_modulus, ends


def check_supports(
    problem: ElasticProblem, origin: tuple[int, ...] | None = None, division: int = 1
) -> None:
    """Refuse a body of which a part could move without straining."""
    while is_box(problem):
        problem = coarse_box(problem)  # which is held as the large one is
    parts, count = parts_of(problem.kinds >= 0)
    owner, stops = _stops(problem, parts)
    for part in range(1, count + 1):
        rows = stops[owner == part]
        motion = free_motion(rows, problem.dimension)
        if motion:
            cell = np.argwhere(parts == part)[0] - 1
            first = np.zeros(problem.dimension, int) if origin is None else np.asarray(origin)
            raise unheld((cell + first) // division, motion, touched=len(rows) > 0)


def parts_of(body: Flags) -> tuple[NDArray[np.int32], int]:
    """Return the number of every cell's part of the body, from 1, and how many there are."""
    if body[(slice(1, -1),) * body.ndim].all():  # for which nothing needs to be imported
        return body.astype(np.int32), 1
    from scipy.ndimage import label

    labelled, count = label(body)
    return labelled.astype(np.int32), count


def _stops(problem: ElasticProblem, parts: NDArray[np.int32]) -> tuple[Ints, Floats]:
    """Return what is held: to which part it belongs, and how far every rigid motion strains it."""
    # These are held faces, springs, and edges that shear when faces round them stay.
    d = problem.dimension
    states = problem.face_states
    owners: list[Ints] = []
    rows: list[Floats] = []
    bedded = bool(np.any(problem.kinds == FOUNDATION))
    for axis in range(d):
        stopped = states[axis] == FIXED
        if bedded:
            stopped |= problem.spring[axis] > 0
        for face in (slice(1, None), slice(None, -1)):
            cell = np.argwhere(stopped[cut(d, axis, face)])
            cell = cell[parts[tuple(cell.T)] > 0]
            owners.append(parts[tuple(cell.T)].astype(np.int64))
            rows.append(_motions(moved(cell, axis, face.start or 0), axis, d))
    for pair in axis_pairs(d):
        # Edges that shear because held faces round them stay where they are.
        shape = [n + (a in pair) for a, n in enumerate(problem.kinds.shape)]
        near = np.zeros(shape, dtype=np.bool_)
        for axis, across in (pair, pair[::-1]):
            for end in ends(near, across):
                end |= states[axis] == FIXED
        edge = np.argwhere(near & (edge_modulus(problem, pair) > 0))
        strained = np.zeros((len(edge), d + d * (d - 1) // 2))
        owner = np.zeros(len(edge), dtype=np.int32)
        for axis, across in (pair, pair[::-1]):
            for step in (-1, 0):
                at = moved(edge, across, step)
                pull = np.where(states[axis][tuple(at.T)] == FIXED, 2.0 * step + 1.0, 0.0)
                strained += pull[:, None] * _motions(at, axis, d)
                for side in (-1, 0):
                    owner = np.maximum(owner, parts[tuple(moved(at, axis, side).T)])
        some = strained.any(axis=1)
        owners.append(owner[some].astype(np.int64))
        rows.append(strained[some])
    return np.concatenate(owners), np.concatenate(rows)


def _motions(face: Ints, axis: int, dimension: int) -> Floats:
    """Return how far every rigid motion about the array's corner moves faces (by index)."""
    place = face.astype(np.float64) + np.where(np.arange(dimension) == axis, 0.0, 0.5)
    return rigid_motions(place, np.full(len(face), axis))


def slender_cell(problem: ElasticProblem) -> tuple[int, ...] | None:
    """Return a cell whose link to its neighbour carries no shear, None if there is none."""
    # Two cells that share a face can slide past each other if the edges at both ends of the face
    # carry no shear, unless both are kept from sliding by a support.
    if is_box(problem):
        return None
    d = problem.dimension
    states = problem.face_states
    solid = problem.kinds >= 0
    edges = {pair: edge_modulus(problem, pair) > 0 for pair in axis_pairs(d)}
    for axis in range(d):
        low, high = cut(d, axis, slice(None, -1)), cut(d, axis, slice(1, None))
        both = (solid[low] & (solid | (problem.kinds == RIGID))[high]) | (
            solid[high] & (problem.kinds == RIGID)[low]
        )
        for across in range(d):
            if across == axis:
                continue
            stiff = edges[min(axis, across), max(axis, across)][cut(d, axis, slice(1, -1))]
            carries = np.logical_or(*ends(stiff, across))
            pinned = np.logical_or(*ends(states[across] != ACTIVE, across))
            pinned |= problem.kinds == RIGID
            loose = both & ~carries & ~(pinned[low] & pinned[high])
            if loose.any():
                # A rigid ghost before the first cell is no cell of the body.
                return tuple(int(i) for i in np.maximum(np.argwhere(loose)[0] - 1, 0))
    return None


def is_torn(problem: ElasticProblem) -> bool:
    """Tell whether held faces side by side are moved apart: the finer, the more energy it takes."""
    for axis, across in permutations(range(problem.dimension), 2) if problem.moved.any() else ():
        pair = (axis, across)
        width = [(1, 1) if a in pair else (0, 0) for a in range(problem.dimension)]
        body = np.logical_or.reduce(around_edges(np.pad(problem.kinds >= 0, width), pair))
        held = np.logical_and(*ends(problem.face_states[axis] == FIXED, across))
        apart = np.not_equal(*ends(problem.fixed[axis], across))
        if np.any(held & apart & body[cut(problem.dimension, across, slice(1, -1))]):
            return True
    return False
