"""The levels of a multigrid hierarchy: the finest and full boxes by the law, others P'AP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene.cell_types import AIR, FOUNDATION, RIGID, ROLLER

from .problem import ElasticProblem, rim_layer
from .row_kernels import GHOST, Level, LevelBox, coarse_operator
from .staggered import modulus_between
from .stencils import Stencil, Terms, coarsening, finest_entries

FIRST = GHOST + 1
"""Place of the body's first cell, behind ghosts; even, so that fine and coarse places match."""
_NO_COUPLINGS = np.zeros((0, 3), dtype=np.int64)


class MultigridLevel(NamedTuple):
    """One grid of the hierarchy, and the space to work in."""

    cells: tuple[int, ...]
    level: Level
    stencil: Stencil | None  # None where moduli of cells and edges are all there is
    u: Floats  # Displacement and
    load: Floats  # load of all places


def _box(
    cells: tuple[int, ...], first: int, reach: int, stencil: Stencil | None = None
) -> LevelBox:
    """Return the numbers of a level's arrays."""
    planes, *rows, length = (2 * ((n + 9) // 2) for n in cells)
    shape = planes, *(rows or (1,)), length
    begin, end = [first] * len(cells), [n + 5 for n in cells]
    if not rows:  # A plane of cells has one row in each plane of places.
        begin.insert(1, 0)
        end.insert(1, 1)
    step = (shape[1] * length, length, 1) if rows else (length, 1, 0)
    starts, after = [0] * 4, [0] * 3
    if stencil is not None:
        starts[: len(stencil.starts)], after[: len(cells)] = stencil.starts, stencil.next
    return LevelBox(
        shape,
        tuple(begin),
        tuple(end),
        len(cells),
        prod(shape),
        step,
        reach,
        0 if stencil is None else len(stencil.entries),
        tuple(map(int, starts)),
        tuple(map(int, after)),
    )


def level_by_law(problem: ElasticProblem) -> MultigridLevel:
    """Return a level of which only moduli are stored."""
    # A plane of cells that is equal to the next and to the two before has the same law and the same
    # stiffness as the plane before it: it shares the rows of that one.
    planes, kinds = problem.kinds.shape[0], problem.kinds
    shares = np.zeros(planes, dtype=np.bool_)
    if problem.edges is None:
        like = (kinds[1:] == kinds[:-1]).reshape(planes - 1, -1).all(axis=1)
        shares[2:-1] = like[:-2] & like[1:-1] & like[2:]
    kept = np.flatnonzero(~shares)
    spring = tuple(
        values[np.append(kept, planes) if axis == 0 else kept]
        for axis, values in enumerate(problem.spring)
    )
    law, inverse = _law_and_inverses(replace(problem, kinds=kinds[kept], spring=spring))
    # Rows of places, ghosts included, by the rows of those that are kept.
    box, described = _box(problem.shape, FIRST, 1), law.shape[1]
    shape = box.shape
    place = np.arange(shape[0])
    place[FIRST - 1 : FIRST - 1 + planes] = FIRST - 2 + np.cumsum(~shares)
    place[FIRST - 1 + planes :] -= planes - len(kept)
    place = np.minimum(place, described - 1)
    parts = [x.reshape(len(x), -1, shape[2]) for x in (law, inverse)]
    number = _numbered([(x[1:] == x[:-1]).all(axis=1) for part in parts for x in part])
    if 2 * number[-1] < len(number):
        parts = [x.take(np.flatnonzero(np.diff(number, prepend=-1)), 1) for x in parts]
    else:
        number = np.arange(len(number))
    rows = number.reshape(described, -1)[place].ravel()
    data, described_inverse = (x.ravel() for x in parts)
    level = Level(data, described_inverse, _NO_COUPLINGS, rows, box)
    n = problem.dimension * box.places
    return MultigridLevel(problem.shape, level, None, np.empty(n), np.empty(n))


def _law_and_inverses(problem: ElasticProblem) -> tuple[Floats, Floats]:
    """Return all places' moduli, and inverses of faces' own stiffness; 0 where held."""
    d, rim, moduli = problem.dimension, problem.kinds, problem.moduli
    shape = tuple(n for n in _box(problem.shape, FIRST, 1).shape if n > 1)
    n, steps = prod(shape), np.array([prod(shape[a + 1 :]) for a in range(d)])
    kinds = np.full(shape, AIR, dtype=np.int32)
    body = tuple(slice(FIRST - 1, FIRST - 1 + size) for size in rim.shape)
    kinds[body] = rim
    law, inverse = np.zeros((2 + d * (d - 1) // 2, n)), np.zeros((d, n))
    beyond = -min(AIR, RIGID, ROLLER, FOUNDATION)  # kinds that are no material count from the end
    for modulus, row in zip((moduli.stretch, moduli.lateral), law, strict=False):
        np.pad(modulus, (0, beyond)).take(kinds.ravel(), out=row, mode="wrap")
    first = int(steps.sum())
    for a, b in combinations(range(d), 2):  # each edge's four cells lie behind it
        back = (0, steps[a], steps[b], steps[a] + steps[b])

        def around(cells: NDArray[Any], back: tuple[int, ...] = back) -> list[NDArray[Any]]:
            return [cells[first - k : n - k] for k in back]

        law[1 + a + b, first:] = modulus_between(kinds.ravel(), moduli.shear, around)
    for (a, b), values in (problem.edges or {}).items():  # one further than the cells
        further = [size + (axis in (a, b)) for axis, size in enumerate(rim.shape)]
        places = tuple(slice(FIRST - 1, FIRST - 1 + size) for size in further)
        law[1 + a + b].reshape(shape)[places] = values
    stretch = law[0].reshape(shape)[body]
    for side in range(2 * d):
        # A foundation is a ghost cell that can only be squeezed, and whose far face is held.
        layer = rim_layer(d, side)
        face = list(layer)
        face[side // 2] = -2 if side % 2 else 1
        founded = rim[layer] == FOUNDATION
        if founded.any():
            stretch[layer][founded] = problem.spring[side // 2][tuple(face)][founded]
    solid = (kinds >= 0).ravel()
    holds = ((kinds == RIGID) | (kinds == ROLLER)).ravel()
    here = slice(first, n - first)
    for a, step in enumerate(steps):
        behind = slice(first - step, n - first - step)
        own = law[0, here] + law[0, behind]
        for b, across in enumerate(steps):
            if b != a:
                modulus = law[1 + a + b]
                own += modulus[here] + modulus[first + across : n - first + across]
        moves = (solid[here] | solid[behind]) & ~(holds[here] | holds[behind]) & (own > 0.0)
        np.divide(1.0, own, out=inverse[a, here], where=moves)
    return law.reshape(-1, *shape), inverse


def _numbered(like: Sequence[Flags]) -> Ints:
    """Return a number for every row, the same if it is like the one before in every respect."""
    return np.append(0, np.cumsum(~np.logical_and.reduce(like)))


def spread(values: NDArray[Any], level: Level) -> NDArray[Any]:
    """Return for all faces the values that a level stores for its distinct rows."""
    if values.size == level.box.components * level.box.places:
        return values
    by_rows = values.reshape(level.box.components, -1, level.box.shape[2])
    return np.asarray(by_rows.take(level.rows, 1)).ravel()


def coarse_level(above: MultigridLevel, depth: int) -> MultigridLevel:
    """Return the next coarser level: the stencil P'AP."""
    fine, cells = above.level, tuple((n + 1) // 2 for n in above.cells)
    d = len(cells)
    sums, stencil = coarsening(d, depth)
    box = _box(cells, GHOST, 2, stencil)
    rows = _shared_coarse_rows(fine, box, sums)
    described = (int(rows.max()) + 1) * box.shape[2]
    data, inverse = np.zeros(described * len(stencil.entries)), np.zeros(d * described)
    level = Level(data, inverse, _flat(stencil, box), rows, box)
    if d == 2:
        sums = (sums[0], sums[1], sums[1])
    places, ways = [step.place for step in sums], [step.rows for step in sums]
    ends, starts = (np.cumsum([0, *map(len, parts)]) for parts in (places, ways))
    weight = np.concatenate([step.weight for step in sums])
    joined = np.concatenate(places), weight, np.concatenate(ways), ends, starts
    made, length = _finest_terms(fine), fine.box.shape[2]
    few = 0 if fine.box.entries else len(sums[0].rows) * len(made)
    first, second = sums[0].sums, sums[1].sums
    sizes = few * length, (4 * first + second) * length, max(first, second) * length
    room = (*map(np.zeros, sizes), np.zeros(int(starts[-1]) + 4, dtype=np.int64))
    coarse_operator(fine, made, joined, level, stencil.own, room)
    n = d * box.places
    return MultigridLevel(cells, level, stencil, np.zeros(n), np.zeros(n))


def _shared_coarse_rows(fine: Level, box: LevelBox, sums: Sequence[Terms]) -> Ints:
    """Return numbers of coarse rows, the same as before where all fine rows are shared."""
    # Rows that are not in use share the first.
    fine_rows = fine.rows.reshape(fine.box.shape[:2])
    reach = [np.unique(sums[0].rows[:, 0]), np.array([0])]
    if len(sums) == 3:
        beside, beyond = sums[0].rows[:, 1], sums[1].rows[:, 1]
        reach[1] = np.arange(beside.min() + beyond.min(), beside.max() + beyond.max() + 1)
    if fine.box.entries == 0:  # The law of a row reaches its neighbours.
        reach = [np.arange(way.min() - 1, way.max() + 2) for way in reach]
    used = [np.arange(box.first[k], box.end[k]) for k in (0, 1)]
    seen = [
        np.clip(2 * place - 4 + way[:, None], 0, n - 1)
        for place, way, n in zip(used, reach, fine_rows.shape, strict=True)
    ]
    key = [fine_rows[p[:, None], q].ravel() for p in seen[0] for q in seen[1]]
    rows = np.zeros(box.shape[:2], dtype=np.int64)
    rows[np.ix_(*used)] = 1 + _numbered([k[1:] == k[:-1] for k in key]).reshape(
        [len(place) for place in used]
    )
    return rows.ravel()


def _flat(stencil: Stencil, box: LevelBox) -> Ints:
    """Return couplings as `row_kernels` wants them: place of coefficient and of other face."""
    (_planes, rows, length), table = box.shape, stencil.couplings
    far = (table[:, 2] * rows + table[:, 3]) * length + table[:, 4] + table[:, 1] * box.places
    row = table[:, 6] * rows + table[:, 7]
    return np.stack([row, table[:, 5] * length + table[:, 8], far], axis=1)


def _finest_terms(fine: Level) -> Ints:
    """Return the terms of the finest level's entries."""
    # The columns are: the sign (see `stencils.finest_entries`), then for the two faces that have to
    # be free to move, and for the two moduli, the component or the modulus, in how many rows from
    # its own, and how far along the row.
    entries, made = finest_entries(fine.box.components)
    step = np.array([[fine.box.shape[1], 0], [1, 0], [0, 1]])  # In rows, and along them.
    table = []
    for (a, b, way), (sign, k, axis, shift, k2, axis2, shift2) in zip(entries, made, strict=True):
        moduli = (k, *shift * step[axis]), (k2, *shift2 * step[axis2])
        table.append((sign, a, 0, 0, b, *np.dot(way, step), *moduli[0], *moduli[1]))
    return np.array(table, dtype=np.int64)
