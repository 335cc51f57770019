"""The levels of a multigrid hierarchy: the finest and full boxes by the law, others P'AP.

A coarse level's stiffness is an array of coefficients: entry e = (a, b, d) couples the face of
component a at place q with the face of component b at q + d. It is symmetric, so b > a is stored,
and for b = a only half of the offsets. P'AP (Galerkin's condition) is formed one axis after the
other: along its normal a face follows its coarse faces by (1 | ½ ½), across it by (¾ ¼). Beyond the
surface there are coarse faces too, *ghosts*, as unknowns like any others, so that free surfaces and
walls need no weights of their own. Places have three axes; a plane has one place along the middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
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

Offset = tuple[int, int, int]
Entry = tuple[int, int, Offset]
"""Two components and the offset from the first's face to the second's."""

TOGETHER = 4  # Terms that are added at once


class Terms(NamedTuple):
    """Sums of weighted rows: `place` (sum, row, entry, shift) and `weight` of every term."""

    place: Ints  # Ordered by sums, `TOGETHER` to the group. Shape (terms, 4)
    weight: Floats  # Shape (terms,)
    rows: Ints  # The rows that terms name, by their distance along the first two axes. Shape (n, 2)
    sums: int  # Number of sums


class Stencil(NamedTuple):
    """The entries of one level and how they couple its faces."""

    entries: tuple[Entry, ...]
    couplings: Ints
    """Component, other component, offset of the other, entry, offset of where it is stored: an
    entry serves its own row and, mirrored, the other one. A component's first is its own. Shape
    (couplings, 9)."""
    starts: Ints  # First coupling of every component, and the end
    own: Ints
    next: Ints
    """Entries of a face with itself, and with its next in the row."""


def axes_of(dimension: int) -> tuple[int, ...]:
    """Return the axes of places that components are normal to."""
    return (0, 2) if dimension == 2 else (0, 1, 2)


def _unit(axis: int, length: int = 1) -> Offset:
    first, second, third = (length * (axis == k) for k in range(3))
    return first, second, third


def _add(one: Offset, other: Offset) -> Offset:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _opposite(offset: Offset) -> Offset:
    return -offset[0], -offset[1], -offset[2]


@lru_cache
def finest_entries(dimension: int) -> tuple[tuple[Entry, ...], Ints]:
    """Return the entries of the finest level, and what they are made of."""
    # An entry is sign · (modulus + modulus) / 2 or the whole sum; the columns are: sign (±1 for a
    # sum, 0 for one modulus taken negative, 2 for the diagonal), then twice a row of the law (0:
    # C₁₁, 1: C₁₂, 1 + a + b: the edges between components) and the axis along which it is shifted,
    # with the length of the shift.
    axes = axes_of(dimension)
    entries: list[Entry] = []
    made: list[tuple[int, ...]] = []

    def note(a: int, b: int, offset: Offset, sign: int, *moduli: tuple[int, int, int]) -> None:
        entries.append((a, b, offset))
        made.append((sign, *moduli[0], *moduli[-1]))

    for a in range(dimension):
        along = axes[a]
        note(a, a, (0, 0, 0), 2, (0, 0, 0))
        note(a, a, _unit(along), 0, (0, 0, 0))
        note(a, a, _unit(along, -1), 0, (0, along, -1))
        for b in range(dimension):
            if b != a:
                note(a, a, _unit(axes[b]), 0, (1 + a + b, axes[b], 1))
                note(a, a, _unit(axes[b], -1), 0, (1 + a + b, 0, 0))
        for b in range(a + 1, dimension):
            edge, side, back = 1 + a + b, axes[b], _unit(along, -1)
            note(a, b, (0, 0, 0), 1, (1, 0, 0), (edge, 0, 0))
            note(a, b, _unit(side), -1, (1, 0, 0), (edge, side, 1))
            note(a, b, back, -1, (1, along, -1), (edge, 0, 0))
            note(a, b, _add(_unit(side), back), 1, (1, along, -1), (edge, side, 1))
    return tuple(entries), np.array(made, dtype=np.int64)


@lru_cache
def coarsening(dimension: int, depth: int) -> tuple[tuple[Terms, ...], Stencil]:
    """Return the sums, axis by axis, that lead to the level at a depth, and its stencil."""
    if depth > 3:
        return coarsening(dimension, 3)  # From there on all levels are alike.
    if depth == 1:
        entries = finest_entries(dimension)[0]
        sources = {entry: ((0, 0), slot, 0) for slot, entry in enumerate(entries)}
    else:
        entries = coarsening(dimension, depth - 1)[1].entries
        sources = {}
        for slot, (a, b, way) in enumerate(entries):
            sources[a, b, way] = ((0, 0), slot, 0)
            if a == b and any(way):
                back = _opposite(way)
                sources[a, b, back] = ((back[0], back[1]), slot, back[2])
    steps = []
    for axis in axes_of(dimension):
        terms, entries = _step(dimension, axis, sources)
        steps.append(terms)
        sources = {entry: ((0, 0), slot, 0) for slot, entry in enumerate(entries)}
    return tuple(steps), stencil_of(dimension, entries)


def _step(
    dimension: int, axis: int, sources: dict[Entry, tuple[tuple[int, int], int, int]]
) -> tuple[Terms, tuple[Entry, ...]]:
    """Return the sums that coarsen one axis, and the entries that they make."""
    # Weights of a coarse face for fine ones, by their distance from twice its place: along its
    # normal, and across it.
    normal, across = {-1: 0.5, 0: 1.0, 1: 0.5}, {-1: 0.25, 0: 0.75, 1: 0.75, 2: 0.25}
    axes = axes_of(dimension)
    found: dict[Entry, list[tuple[tuple[int, int], int, int, float]]] = {}
    for (a, b, way), (row, slot, shift) in sources.items():
        ours, theirs = (normal if axes[c] == axis else across for c in (a, b))
        for fine, weight in ours.items():
            for other, other_weight in theirs.items():
                between = fine + way[axis] - other
                if between % 2:
                    continue
                new = _add(way, _unit(axis, between // 2 - way[axis]))
                # An offset whose first step, up to the axis, is backward is stored the other way.
                if a == b and next((step < 0 for step in new[: axis + 1] if step), False):
                    continue
                if axis == 2:  # Rows were split into even and odd places.
                    source = ((fine % 2, 0), slot, fine // 2 - 2)
                else:
                    source = (_add((*row, 0), _unit(axis, fine))[:2], slot, shift)
                found.setdefault((a, b, new), []).append((*source, weight * other_weight))
    entries = tuple(sorted(found))
    rows = sorted({term[0] for terms in found.values() for term in terms})
    number = {row: k for k, row in enumerate(rows)}
    place, weights = [], []
    for slot, entry in enumerate(entries):
        terms = found[entry]
        terms += [(*terms[0][:3], 0.0)] * (-len(terms) % TOGETHER)
        place += [(slot, number[row], source, shift) for row, source, shift, _ in terms]
        weights += [weight for *_, weight in terms]
    return (Terms(np.array(place), np.array(weights), np.array(rows), len(entries)), entries)


def stencil_of(dimension: int, entries: tuple[Entry, ...]) -> Stencil:
    """Return the stencil of a level with given entries."""
    zero: Offset = (0, 0, 0)
    found: list[tuple[int, ...]] = []
    for slot, (a, b, way) in enumerate(entries):
        found.append((a, b, *way, slot, *zero))
        if a != b or any(way):
            back = _opposite(way)
            found.append((b, a, *back, slot, *back))
    found.sort(key=lambda c: (c[0], c[:5] != (c[0], c[0], *zero), c[6:9], c[5]))
    starts = np.searchsorted([c[0] for c in found], range(dimension + 1))
    number = {entry: slot for slot, entry in enumerate(entries)}
    own, after = (
        np.array([number[c, c, way] for c in range(dimension)]) for way in (zero, (0, 0, 1))
    )
    return Stencil(entries, np.array(found), starts.astype(np.int64), own, after)


FIRST = GHOST + 1
"""Place of the body's first cell, behind ghosts; even, so that fine and coarse places match."""


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
    level = Level(data, described_inverse, np.zeros((0, 3), dtype=np.int64), rows, box)
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
    # The columns are: the sign (see `finest_entries`), then for the two faces that have to
    # be free to move, and for the two moduli, the component or the modulus, in how many rows from
    # its own, and how far along the row.
    entries, made = finest_entries(fine.box.components)
    step = np.array([[fine.box.shape[1], 0], [1, 0], [0, 1]])  # In rows, and along them.
    table = []
    for (a, b, way), (sign, k, axis, shift, k2, axis2, shift2) in zip(entries, made, strict=True):
        moduli = (k, *shift * step[axis]), (k2, *shift2 * step[axis2])
        table.append((sign, a, 0, 0, b, *np.dot(way, step), *moduli[0], *moduli[1]))
    return np.array(table, dtype=np.int64)
