"""The levels of a multigrid hierarchy: the finest and full boxes by the law, others P'AP.

A coarse level's stiffness is an array of coefficients: entry e = (a, b, d) couples the face of
component a at place q with the face of component b at q + d. It is symmetric, so b > a is stored,
and for b = a only half of the offsets. P'AP (Galerkin's condition) is formed one axis after the
other: along its normal a face follows its coarse faces by (1 | ½ ½), across it by (¾ ¼). Beyond the
surface there are coarse faces too, *ghosts*, as unknowns like any others, so that free surfaces and
walls need no weights of their own. Places have three axes; a plane has one place along the middle.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import chain, combinations, pairwise, product
from math import prod
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.scene.cell_types import AIR, FOUNDATION, RIGID, ROLLER

from .problem import ElasticProblem, rim_layer
from .row_kernels import GHOST, Level, LevelBox
from .staggered import modulus_between

Offset = tuple[int, int, int]
Entry = tuple[int, int, Offset]
"""Two components and the offset from the first's face to the second's."""


def axes_of(dimension: int) -> tuple[int, ...]:
    """Return the axes of places that components are normal to."""
    return (0, 2) if dimension == 2 else (0, 1, 2)


HERE: Offset = (0, 0, 0)


def _moved(offset: Offset, axis: int, steps: int) -> Offset:
    x, y, z = (way + steps * (k == axis) for k, way in enumerate(offset))
    return x, y, z


def _opposite(offset: Offset) -> Offset:
    return -offset[0], -offset[1], -offset[2]


@lru_cache
def law_entries(dimension: int) -> dict[Entry, list[tuple[int, Offset, int]]]:
    """Return the finest level's entries: sums of moduli, each with where it lies and its sign."""
    # Rows of the law are C₁₁, C₁₂, and 1 + a + b: the edges between components. Each belongs to a
    # product of two strains, which are sums of faces: component, offset and sign.
    axes, components = axes_of(dimension), range(dimension)
    stretch = [[(a, HERE, -1), (a, _moved(HERE, axes[a], 1), 1)] for a in components]
    energies = [(int(a != b), stretch[a], stretch[b]) for a, b in product(components, repeat=2)]
    for a, b in combinations(components, 2):
        shear = [(a, HERE, 1), (a, _moved(HERE, axes[b], -1), -1)]
        shear += [(b, HERE, 1), (b, _moved(HERE, axes[a], -1), -1)]
        energies.append((1 + a + b, shear, shear))
    found: dict[Entry, list[tuple[int, Offset, int]]] = {}
    for modulus, ours, theirs in energies:
        for (a, here, sign), (b, there, other_sign) in product(ours, theirs):
            x, y, z = (far - near for far, near in zip(there, here, strict=True))
            if a <= b:
                found.setdefault((a, b, (x, y, z)), []).append((modulus, here, sign * other_sign))
    return found


def _mirrored(entries: tuple[Entry, ...]) -> list[int]:
    """Return which entries serve a second face of their own component, mirrored."""
    return [slot for slot, (a, b, way) in enumerate(entries) if a == b and any(way)]


@lru_cache
def coarsening(
    dimension: int, depth: int
) -> tuple[tuple[sp.csr_array, ...], tuple[Entry, ...], tuple[Entry, ...]]:
    """Return the sums, axis by axis, that lead to the level at a depth; finer entries, and its."""
    if depth > 3:
        return coarsening(dimension, 3)  # From there on all levels are alike.
    finer: tuple[Entry, ...] = ()
    entries = tuple(law_entries(dimension))
    if depth > 1:
        finer = coarsening(dimension, depth - 1)[2]
        back = [(*finer[slot][:2], _opposite(finer[slot][2])) for slot in _mirrored(finer)]
        entries = (*finer, *back)
    steps = []
    for axis in axes_of(dimension):
        step, entries = _step(dimension, axis, entries)
        steps.append(step)
    return tuple(steps), finer, entries


def _step(
    dimension: int, axis: int, entries: tuple[Entry, ...]
) -> tuple[sp.csr_array, tuple[Entry, ...]]:
    """Return the sums that coarsen one axis, and the entries that they make."""
    # Weights of a coarse face for fine ones, by their distance from twice its place: along its
    # normal, and across it. Columns are the entries at distance -1, then those at 0, 1 and 2.
    normal, across = {-1: 0.5, 0: 1.0, 1: 0.5}, {-1: 0.25, 0: 0.75, 1: 0.75, 2: 0.25}
    axes, found = axes_of(dimension), []
    for slot, (a, b, way) in enumerate(entries):
        ours, theirs = (normal if axes[c] == axis else across for c in (a, b))
        for fine, other in product(ours, theirs):
            between = fine + way[axis] - other
            if between % 2:
                continue
            new = _moved(way, axis, between // 2 - way[axis])
            # An offset whose first step, up to the axis, is backward is stored the other way.
            if a != b or not next((step < 0 for step in new[: axis + 1] if step), False):
                column = (fine + 1) * len(entries) + slot
                found.append(((a, b, new), column, ours[fine] * theirs[other]))
    made, columns, weights = zip(*found, strict=True)
    number = {entry: row for row, entry in enumerate(sorted(set(made)))}
    rows, shape = [number[entry] for entry in made], (len(number), 4 * len(entries))
    return sp.csr_array((weights, (rows, columns)), shape=shape), tuple(number)


TOGETHER = 2**12  # Places of the planes that are coarsened at once, which are two at least

FIRST = GHOST + 1
"""Place of the body's first cell, behind ghosts; even, so that fine and coarse places match."""


class MultigridLevel(NamedTuple):
    """One grid of the hierarchy, and the space to work in."""

    cells: tuple[int, ...]
    level: Level
    u: Floats  # Displacement and
    load: Floats  # load of all places


def _box(cells: tuple[int, ...], first: int, reach: int) -> LevelBox:
    """Return the numbers of the arrays of a level by the law."""
    planes, *rows, length = (2 * ((n + 9) // 2) for n in cells)
    shape = planes, *(rows or (1,)), length
    begin, end = [first] * len(cells), [n + 5 for n in cells]
    if not rows:  # A plane of cells has one row in each plane of places.
        begin.insert(1, 0)
        end.insert(1, 1)
    step = (shape[1] * length, length, 1) if rows else (length, 1, 0)
    places, nothing = prod(shape), (0, 0, 0)
    numbers = len(cells), places, step, reach, 0, (*nothing, 0), nothing
    return LevelBox(shape, tuple(begin), tuple(end), *numbers)


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
    alike = [(x[1:] == x[:-1]).all(axis=1) for part in parts for x in part]
    number = np.append(0, np.cumsum(~np.logical_and.reduce(alike)))
    if 2 * number[-1] < len(number):
        parts = [x.take(np.flatnonzero(np.diff(number, prepend=-1)), 1) for x in parts]
    else:
        number = np.arange(len(number))
    rows = number.reshape(described, -1)[place].ravel()
    data, described_inverse = (x.ravel() for x in parts)
    level = Level(data, described_inverse, np.zeros((0, 3), dtype=np.int64), rows, box)
    n = problem.dimension * box.places
    return MultigridLevel(problem.shape, level, np.empty(n), np.empty(n))


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


def spread(values: NDArray[Any], level: Level) -> NDArray[Any]:
    """Return for all faces the values that a level stores for its distinct rows."""
    if values.size == level.box.components * level.box.places:
        return values
    by_rows = values.reshape(level.box.components, -1, level.box.shape[2])
    return np.asarray(by_rows.take(level.rows, 1)).ravel()


def coarse_level(above: MultigridLevel, depth: int) -> MultigridLevel:
    """Return the next coarser level: the stencil P'AP."""
    fine, cells = above.level, tuple((n + 1) // 2 for n in above.cells)
    d, reach = len(cells), fine.box.reach
    steps, finer, stencil = coarsening(d, depth)
    box, couplings = _coupled(stencil, _box(cells, GHOST, 2))
    (planes, many, length), first, end = box.shape, box.first, box.end
    rows, entries = np.zeros((planes, many), dtype=np.int64), len(stencil)
    # The first row is that of places that are not in use. Memory is taken as rows are written.
    data, count = np.zeros((1 + planes * many, entries, length)), 1
    shared = fine.rows.reshape(fine.box.shape[:2])
    new = _unlike(shared, first[0], end[0], reach)
    while new:
        # Few planes at once: all of them would take far more memory than the level.
        few = max(2, TOGETHER // prod(fine.box.shape[1:]))
        together = [p for k, p in enumerate(new[:few]) if p == new[0] + k]
        new = new[len(together) :]
        near = shared.take(_made_of(together, reach), 0, mode="wrap")
        lanes, wanted, places = [0], np.zeros(1, dtype=np.int64), [0]
        if many > 1:
            lanes = _unlike(near.T, first[1], end[1], reach)
            wanted = _made_of(lanes, reach)
            places = np.searchsorted(wanted, 2 * np.array(lanes) - 5).tolist()
        at = (
            range(0, 2 * len(together), 2),
            places,
            range(1, 2 * (end[2] - first[2]), 2),
        )
        fields = _coefficients(fine, finer, near.take(wanted, 1, mode="wrap"))
        for axis, step in zip(axes_of(d), steps, strict=True):
            lines = np.ascontiguousarray(np.moveaxis(fields, (1 + axis, 0), (0, 1)))
            sums = [step @ lines[k : k + 4].reshape(step.shape[1], -1) for k in at[axis]]
            sizes = len(sums), step.shape[0], *lines.shape[2:]
            fields = np.moveaxis(np.reshape(sums, sizes), (0, 1), (1 + axis, 0))
        made = np.moveaxis(fields, 0, 2).reshape(-1, entries, fields.shape[-1])
        data[count : count + len(made), :, first[2] : end[2]] = made
        number = count + np.arange(len(made)).reshape(len(together), -1)
        which = np.searchsorted(lanes, range(first[1], end[1]), "right") - 1
        rows[together, first[1] : end[1]] = number[:, which]
        count += len(made)
    for p in range(first[0], end[0]):
        rows[p] = rows[p] if rows[p].any() else rows[p - 1]
    own = np.moveaxis(data[:count, [stencil.index((a, a, HERE)) for a in range(d)]], 1, 0)
    inverse = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0.0)
    level = Level(data[:count].ravel(), inverse.ravel(), couplings, rows.ravel(), box)
    n = d * box.places
    return MultigridLevel(cells, level, np.zeros(n), np.zeros(n))


def _made_of(places: list[int], reach: int) -> Ints:
    """Return the fine places that make coarse ones, 2p - 5 to 2p - 2, and those these reach."""
    span = np.arange(-5 - reach, -1 + reach)
    return np.unique(2 * np.array(places)[:, None] + span)


def _unlike(rows: Ints, first: int, end: int, reach: int) -> list[int]:
    """Return the coarse places, from first to end, that are not made of what the one before is."""
    near = [rows.take(_made_of([p], reach), 0, mode="wrap") for p in range(first, end)]
    unlike = [not np.array_equal(*two) for two in pairwise(near)]
    return [first, *(p for p, new in enumerate(unlike, first + 1) if new)]


def _coefficients(level: Level, entries: tuple[Entry, ...], near: Ints) -> Floats:
    """Return a level's entries on some of its rows, mirrored ones too: (entries, *places)."""
    # Of planes only those that others within reach surround; in memory planes come first, as they
    # are summed first. The ends of all axes are 0 or not asked for, so they may be rolled.
    length, reach, laws = level.box.shape[2], level.box.reach, law_entries(level.box.components)
    inner, mirrored = slice(reach, len(near) - reach), _mirrored(entries)
    count, planes = len(entries or laws) + len(mirrored), len(near) - 2 * reach
    found = np.moveaxis(np.empty((planes, count, near.shape[1], length)), 1, 0)
    if entries:
        data = level.data.reshape(-1, len(entries), length)
        for plane, rows in zip(np.moveaxis(found, 1, 0), near[inner], strict=True):
            plane[: len(entries)] = data[rows].swapaxes(0, 1)
        for entry, slot in zip(found[len(entries) :], mirrored, strict=True):
            *beside, along = entries[slot][2]
            entry[:] = np.roll(data[np.roll(near, beside, (0, 1))[inner], slot], along, 2)
    else:
        inverse = level.inverse.reshape(level.box.components, -1, length)
        law, around = level.data.reshape(-1, *inverse.shape[1:])[:, near], (0, 1, 2)
        moves, needed = inverse[:, near] > 0.0, {part[:2] for part in chain(*laws.values())}
        shifted = {at: np.roll(law[at[0]], at[1], around)[inner] for at in needed}
        for entry, ((a, b, way), parts) in zip(found, laws.items(), strict=True):
            whole = sum(sign * shifted[k, here] for k, here, sign in parts)
            free = moves[a] & np.roll(moves[b], _opposite(way), around)
            entry[:] = np.where(free[inner], whole, 0.0)
    return found


def _coupled(entries: tuple[Entry, ...], box: LevelBox) -> tuple[LevelBox, Ints]:
    """Return a level's numbers with those of its couplings, and these: see `Level.couplings`."""
    # An entry serves its own row and, mirrored, the row of the other face.
    found: list[tuple[int, Offset, int, int, Offset]] = []
    for slot, (a, b, way) in enumerate(entries):
        found.append((a, HERE, slot, b, way))
        if a != b or any(way):
            found.append((b, _opposite(way), slot, a, _opposite(way)))
    found.sort()
    starts = tuple(sum(a < c for a, *_ in found) for c in range(4))
    after = [entries.index((a, a, (0, 0, 1))) for a in range(box.components)]
    (_planes, rows, length), table = box.shape, []
    for _, (plane, row, place), slot, other, way in found:
        far = ((way[0] * rows + way[1]) * length + way[2]) + other * box.places
        table.append((plane * rows + row, slot * length + place, far))
    box = box._replace(entries=len(entries), starts=starts, after=(*after, 0)[:3])
    return box, np.array(table)
