"""What holds a body, and whether it holds it entirely.

Cells that share a face belong to one part; those that only touch at a corner do not. Every
part needs supports that stop all its rigid motions: in two dimensions two shifts and a
turn, in three dimensions three of each. A member one cell wide is another matter: all its
corners touch air and carry no shear, so on this grid it is a chain of loose links, and the
body has to be solved on smaller cells.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SupportError
from kaju.model.scene.kinds import RIGID

from .box_multigrid import is_box
from .problem import ACTIVE, FIXED, ElasticProblem, Floats
from .staggered import cut, edge_modulus

Index = NDArray[np.int64]


def check_supports(
    problem: ElasticProblem, origin: tuple[int, ...] | None = None, division: int = 1
) -> None:
    """Refuse a body of which a part could move without straining.

    Raises
    ------
    SupportError
        Naming a cell of the part (counted from `origin`, `division` times as large as the
        problem's cells) and how it could move.
    """
    from scipy.ndimage import label

    if is_box(problem):
        problem = _miniature(problem)
    labelled, count = label(problem.kinds >= 0)
    parts: NDArray[np.int32] = labelled.astype(np.int32)
    stops = [_stops(problem, parts, axis) for axis in range(problem.dimension)]
    for part in range(1, count + 1):
        rows = _modes_of_part(stops, part)
        motion = _free_motion(rows, problem.dimension)
        if motion:
            cell = np.argwhere(parts == part)[0] - 1
            first = np.zeros(problem.dimension, int) if origin is None else np.asarray(origin)
            place = ", ".join(str(int(i)) for i in (cell + first) // division)
            held_by = "nothing holds" if not len(rows) else "the supports do not hold"
            raise SupportError(
                f"sides: {held_by} the part of the body with cell ({place}): it could "
                f"{motion}; hold it by a rigid cell or side, or join it to the rest by a face "
                "(cells that touch at a corner are not joined)"
            )


def _miniature(problem: ElasticProblem) -> ElasticProblem:
    """Return a small box that is held as the large one is."""
    keep = np.r_[0:3, -3:0]
    d = problem.dimension

    faces = [np.r_[0:3, -4:0], keep]
    spring = tuple(
        np.ascontiguousarray(values[np.ix_(*[faces[int(a != axis)] for a in range(d)])])
        for axis, values in enumerate(problem.spring)
    )
    return replace(
        problem, kinds=np.ascontiguousarray(problem.kinds[np.ix_(*[keep] * d)]), spring=spring
    )


def _modes_of_part(stops: list[tuple[Index, Floats]], part: int) -> Floats:
    """Return one row per held face: how far each rigid motion would move it."""
    points = [p[owner == part] for owner, p in stops]
    everything = np.concatenate(points)
    if not len(everything):
        return np.empty((0, 0))
    centre, span = everything.mean(axis=0), np.ptp(everything, axis=0).max() or 1.0
    return np.concatenate([_modes((p - centre) / span, axis) for axis, p in enumerate(points)])


def _modes(points: Floats, axis: int) -> Floats:
    """Return displacement along `axis` at points in every rigid motion."""
    d = points.shape[1]
    columns = [np.full(len(points), float(a == axis)) for a in range(d)]
    for a, b in combinations(range(d), 2):
        turn = np.zeros(len(points))
        if axis == a:
            turn = -points[:, b]
        elif axis == b:
            turn = points[:, a]
        columns.append(turn)
    return np.stack(columns, axis=1)


def _free_motion(rows: Floats, dimension: int) -> str:
    """Return in words a rigid motion that the rows do not stop, "" if there is none."""
    if not len(rows):
        return "move anywhere"
    gram = rows.T @ rows
    values = np.linalg.eigvalsh(gram)
    if values[0] > 1e-10 * values[-1]:
        return ""
    for axis in range(dimension):
        if gram[axis, axis] <= 1e-10 * values[-1]:
            return f"move along {'xyz'[axis]}"
    return "turn"


def _stops(problem: ElasticProblem, parts: NDArray[np.int32], axis: int) -> tuple[Index, Floats]:
    """Return which part is stopped from moving along `axis`, and where (in cells)."""
    d = problem.dimension
    state = problem.face_states()[axis]
    owners, points = [], []
    low, high = cut(d, axis, slice(1, None)), cut(d, axis, slice(None, -1))
    stopped = (state == FIXED) | (problem.spring[axis] > 0)
    for face, offset in ((high, 0.0), (low, 1.0)):
        hit = stopped[face] & (parts > 0)
        owners.append(parts[hit])
        shift = np.full(d, 0.5)
        shift[axis] = offset
        points.append(np.argwhere(hit) + shift)
    for across in range(d):
        if across != axis:
            owner, point = _gripped(problem, parts, axis, across)
            owners.append(owner)
            points.append(point)
    return np.concatenate(owners).astype(np.int64), np.concatenate(points)


def _gripped(
    problem: ElasticProblem, parts: NDArray[np.int32], axis: int, across: int
) -> tuple[Index, Floats]:
    """Return where a rigid wall normal to `across` holds by friction along `axis`."""
    d = problem.dimension
    stiff = edge_modulus(problem, (min(axis, across), max(axis, across))) > 0
    rigid = problem.kinds == RIGID
    owners, points = [], []
    for step in (-1, 1):
        wall = np.roll(rigid, -step, axis=across)
        hit = (parts > 0) & wall
        edge = stiff[cut(d, across, slice(1, None) if step > 0 else slice(None, -1))]
        for end in (slice(None, -1), slice(1, None)):
            here = hit & edge[cut(d, axis, end)]
            owners.append(parts[here])
            points.append(np.argwhere(here) + 0.5)
    return np.concatenate(owners).astype(np.int64), np.concatenate(points)


def slender_cell(problem: ElasticProblem) -> tuple[int, ...] | None:
    """Return a cell whose link to its neighbour carries no shear, None if there is none.

    Two cells that share a face can slide past each other if the edges at both ends of the
    face carry no shear, unless both are kept from sliding by a support.
    """
    if is_box(problem):
        return None
    d = problem.dimension
    states = problem.face_states()
    solid = problem.kinds >= 0
    for axis in range(d):
        low, high = cut(d, axis, slice(None, -1)), cut(d, axis, slice(1, None))
        both = (solid[low] & (solid | (problem.kinds == RIGID))[high]) | (
            solid[high] & (problem.kinds == RIGID)[low]
        )
        for across in range(d):
            if across == axis:
                continue
            stiff = edge_modulus(problem, (min(axis, across), max(axis, across))) > 0
            stiff = stiff[cut(d, axis, slice(1, -1))]
            carries = stiff[cut(d, across, slice(None, -1))] | stiff[cut(d, across, slice(1, None))]
            pinned = _pinned(states[across], across) | (problem.kinds == RIGID)
            loose = both & ~carries & ~(pinned[low] & pinned[high])
            if loose.any():
                return tuple(int(i) for i in np.argwhere(loose)[0] - 1)
    return None


def _pinned(state: NDArray[np.int8], axis: int) -> NDArray[np.bool_]:
    d = state.ndim
    fixed = state != ACTIVE
    return np.asarray(
        fixed[cut(d, axis, slice(None, -1))] | fixed[cut(d, axis, slice(1, None))], dtype=np.bool_
    )
