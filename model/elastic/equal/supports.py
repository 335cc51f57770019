"""What holds a body, and whether it holds it entirely.

Cells that share a face belong to one part; those that only touch at a corner do not. Every
part needs supports that stop all its rigid motions: in two dimensions two shifts and a
turn, in three dimensions three of each. A member one cell wide is another matter: all its
corners touch air and carry no shear, so on this grid it is a chain of loose links, and the
body has to be solved on smaller cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints, rigid_motions
from kaju.model.elastic.free_motion import balanced, free_motion, unheld
from kaju.model.scene.cell_types import FOUNDATION, RIGID

from . import staggered
from .problem import ABSENT, ACTIVE, FIXED, ElasticProblem, coarse_box, is_box
from .staggered import (
    Numbering,
    around_edges,
    axis_pairs,
    cell_modulus,
    cut,
    edge_modulus,
    ends,
    padded,
)

LOOSE = 0.05
"""Of a member one cell wide beside what is 40 times softer the edges have less than this share of
its own shear modulus; beside what is a hundred times softer bars bend by a third too much."""
GRIP = 1e-7
"""Share of the body's stiffness by which a bed grips a body that nothing else holds along it, and
no load pushes there: so its middle stays where it is, and answers are off by about as little."""


def check_supports(
    problem: ElasticProblem,
    origin: tuple[int, ...] | None = None,
    division: int = 1,
    slides: bool = False,
) -> ElasticProblem:
    """Refuse a body of which a part could move without straining; return what is to be solved.

    If it `slides`, loads that do not push a part along its bed need no support there.
    """
    whole, bedded = problem, any(spring.any() for spring in problem.spring)
    while is_box(problem) and not bedded:
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
        if not (motion := free_motion(rows, problem.dimension)):
            continue
        beds, _ = _moved(parts, [spring > 0.0 for spring in problem.spring])
        if rests := slides and part in beds:
            loaded, motions = _moved(parts, [force != 0.0 for force in problem.force])
            force = np.concatenate([force[force != 0.0] for force in problem.force])
            if balanced(rows, motions[loaded == part], force[loaded == part]):
                whole = gripped(problem)
                continue
        cell = np.argwhere(parts == part)[0] - 1
        first = np.zeros(problem.dimension, int) if origin is None else np.asarray(origin)
        raise unheld((cell + first) // division, motion, len(rows) > 0, rests)
    return whole


def gripped(problem: ElasticProblem) -> ElasticProblem:
    """Return a problem whose beds hold the body a little against a slide along them."""
    rough = replace(problem, kinds=np.where(problem.kinds == FOUNDATION, RIGID, problem.kinds))
    edges = {pair: edge_modulus(problem, pair) for pair in axis_pairs(problem.dimension)}
    for pair, own in edges.items():
        grip = GRIP / max(problem.shape) * edge_modulus(rough, pair)
        edges[pair] = np.where(own > 0.0, own, grip)
    return replace(problem, edges=edges)


def _stops(problem: ElasticProblem, parts: NDArray[np.int32]) -> tuple[Ints, Floats]:
    """Return what is held: to which part it belongs, and how far every rigid motion strains it."""
    # Held faces, springs, and cells and edges that strain because held faces beside them stay.
    d, fixed = problem.dimension, [state == FIXED for state in problem.face_states]
    held = Numbering(tuple(np.where(one, ACTIVE, ABSENT) for one in fixed))
    matrix = staggered.strain_matrix(problem, held)
    some = np.flatnonzero(np.diff(matrix.indptr))
    owners = [parts[problem.kinds >= 0]] * d
    for pair in axis_pairs(d):
        around = np.maximum.reduce(around_edges(padded(parts, pair, 0), pair))
        owners.append(around[edge_modulus(problem, pair) > 0])
    owner, rows = np.concatenate(owners)[some], matrix[some] @ _moved(parts, fixed)[1]
    springs = zip(fixed, problem.spring, strict=True)
    others, more = _moved(parts, [one | (spring > 0.0) for one, spring in springs])
    return np.concatenate([owner, others]).astype(np.int64), np.concatenate([rows, more])


def _moved(parts: NDArray[np.int32], chosen: Sequence[Flags]) -> tuple[Ints, Floats]:
    """Return of chosen faces the part of each, and how far every rigid motion moves it."""
    beside = [np.maximum(*ends(padded(parts, (a,), 0), a)) for a in range(parts.ndim)]
    owner = np.concatenate([part[some] for part, some in zip(beside, chosen, strict=True)])
    motions = [_motions(np.argwhere(some), axis) for axis, some in enumerate(chosen)]
    return owner.astype(np.int64), np.concatenate(motions)


def _motions(face: Ints, axis: int) -> Floats:
    """Return how far every rigid motion about the array's corner moves faces (by index)."""
    place = face.astype(np.float64) + np.where(np.arange(face.shape[1]) == axis, 0.0, 0.5)
    return rigid_motions(place, np.full(len(face), axis))


def slender_cell(problem: ElasticProblem, share: float = 0.0) -> tuple[int, ...] | None:
    """Return a cell whose link to its neighbour carries no shear, None if there is none.

    Or no more than a share of what it would among cells of its own.
    """
    # Two cells that share a face can slide past each other if the edges at both ends of the face
    # carry no shear, unless both are kept from sliding by a support.
    if is_box(problem):
        return None
    d = problem.dimension
    states = problem.face_states
    solid, rigid = problem.kinds >= 0, problem.kinds == RIGID
    edges = {pair: edge_modulus(problem, pair) for pair in axis_pairs(d)}
    shear = np.where(solid, cell_modulus(problem, problem.moduli.shear), 1.0)  # rigid: no less
    for axis in range(d):
        low, high = cut(d, axis, slice(None, -1)), cut(d, axis, slice(1, None))
        both = (solid[low] & (solid | rigid)[high]) | (solid[high] & rigid[low])
        least = share * np.minimum(shear[low], shear[high])
        for across in range(d):
            if across == axis:
                continue
            stiff = edges[min(axis, across), max(axis, across)][cut(d, axis, slice(1, -1))]
            carries = np.maximum(*ends(stiff, across)) > least
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
