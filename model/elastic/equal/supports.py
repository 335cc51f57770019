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

from kaju.arrays import Floats, Ints, rigid_motions
from kaju.model.elastic.free_motion import free_motion, unheld
from kaju.model.scene.cell_types import RIGID

from . import staggered
from .problem import ABSENT, ACTIVE, FIXED, ElasticProblem, coarse_box, is_box
from .staggered import Numbering, around_edges, axis_pairs, cut, edge_modulus, ends, padded


def check_supports(
    problem: ElasticProblem, origin: tuple[int, ...] | None = None, division: int = 1
) -> None:
    """Refuse a body of which a part could move without straining."""
    while is_box(problem):
        problem = coarse_box(problem)  # which is held as the large one is
    body = problem.kinds >= 0
    parts, count = body.astype(np.int32), 1
    if not body[problem.inner].all():
        from scipy.ndimage import label  # which a full box does without

        found, count = label(body)
        parts = found.astype(np.int32)
    owner, stops = _stops(problem, parts)
    for part in range(1, count + 1):
        rows = stops[owner == part]
        if motion := free_motion(rows, problem.dimension):
            cell = np.argwhere(parts == part)[0] - 1
            first = np.zeros(problem.dimension, int) if origin is None else np.asarray(origin)
            raise unheld((cell + first) // division, motion, touched=len(rows) > 0)


def _stops(problem: ElasticProblem, parts: NDArray[np.int32]) -> tuple[Ints, Floats]:
    """Return what is held: to which part it belongs, and how far every rigid motion strains it."""
    # Held faces, springs, and cells and edges that strain because held faces beside them stay.
    d = problem.dimension
    held = Numbering(tuple(np.where(s == FIXED, ACTIVE, ABSENT) for s in problem.face_states))
    moved = [_motions(np.argwhere(number >= 0), axis) for axis, number in enumerate(held.number)]
    matrix = staggered.strain_matrix(problem, held)
    some = np.flatnonzero(np.diff(matrix.indptr))
    owners = [parts[problem.kinds >= 0]] * d
    for pair in axis_pairs(d):
        around = np.maximum.reduce(around_edges(padded(parts, pair, 0), pair))
        owners.append(around[edge_modulus(problem, pair) > 0])
    owners, rows = [np.concatenate(owners)[some]], [matrix[some] @ np.concatenate(moved)]
    for axis, spring in enumerate(problem.spring):
        stopped = (problem.face_states[axis] == FIXED) | (spring > 0.0)
        owners.append(np.maximum(*ends(padded(parts, (axis,), 0), axis))[stopped])
        rows.append(_motions(np.argwhere(stopped), axis))
    return np.concatenate(owners).astype(np.int64), np.concatenate(rows)


def _motions(face: Ints, axis: int) -> Floats:
    """Return how far every rigid motion about the array's corner moves faces (by index)."""
    place = face.astype(np.float64) + np.where(np.arange(face.shape[1]) == axis, 0.0, 0.5)
    return rigid_motions(place, np.full(len(face), axis))


def slender_cell(problem: ElasticProblem) -> tuple[int, ...] | None:
    """Return a cell whose link to its neighbour carries no shear, None if there is none."""
    # Two cells that share a face can slide past each other if the edges at both ends of the face
    # carry no shear, unless both are kept from sliding by a support.
    if is_box(problem):
        return None
    d = problem.dimension
    states = problem.face_states
    solid, rigid = problem.kinds >= 0, problem.kinds == RIGID
    edges = {pair: edge_modulus(problem, pair) > 0 for pair in axis_pairs(d)}
    for axis in range(d):
        low, high = cut(d, axis, slice(None, -1)), cut(d, axis, slice(1, None))
        both = (solid[low] & (solid | rigid)[high]) | (solid[high] & rigid[low])
        for across in range(d):
            if across == axis:
                continue
            stiff = edges[min(axis, across), max(axis, across)][cut(d, axis, slice(1, -1))]
            carries = np.logical_or(*ends(stiff, across))
            pinned = np.logical_or(*ends(states[across] != ACTIVE, across)) | rigid
            loose = both & ~carries & ~(pinned[low] & pinned[high])
            if loose.any():
                # A rigid ghost before the first cell is no cell of the body.
                return tuple(int(i) for i in np.maximum(np.argwhere(loose)[0] - 1, 0))
    return None


def is_torn(problem: ElasticProblem) -> bool:
    """Tell whether held faces side by side are moved apart: the finer, the more energy it takes."""
    for axis, across in permutations(range(problem.dimension), 2) if problem.moved.any() else ():
        pair = (axis, across)
        body = np.logical_or.reduce(around_edges(padded(problem.kinds >= 0, pair, False), pair))
        held = np.logical_and(*ends(problem.face_states[axis] == FIXED, across))
        apart = np.not_equal(*ends(problem.fixed[axis], across))
        if np.any(held & apart & body[cut(problem.dimension, across, slice(1, -1))]):
            return True
    return False
