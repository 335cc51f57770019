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
from itertools import combinations, product
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.scene.cell_types import FOUNDATION

from .problem import ACTIVE, ElasticProblem, rim_layer
from .row_kernels import GHOST, Level, LevelBox, add_rows
from .staggered import axis_pairs, cell_modulus, edge_modulus

Offset = tuple[int, int, int]
Entry = tuple[int, int, Offset]
"""Two components and the offset from the first's face to the second's."""
Sums = tuple[Ints, Floats]  # Terms and their weights: see `row_kernels.add_rows`


def axes_of(dimension: int) -> tuple[int, ...]:
    """Return the axes of places that components are normal to."""
    return (0, 2) if dimension == 2 else (0, 1, 2)


HERE: Offset = (0, 0, 0)


def _moved(offset: Offset, axis: int, steps: int) -> Offset:
    x, y, z = (way + steps * (k == axis) for k, way in enumerate(offset))
    return x, y, z


def _opposite(offset: Offset) -> Offset:
    return -offset[0], -offset[1], -offset[2]


Part = tuple[Entry, float, list[tuple[int, Offset]]]
"""An entry, how many times what is added: by its number and offset; if both faces told are free."""


def _law_parts(dimension: int) -> list[Part]:
    """Return what the finest level's entries are sums of: moduli, each between two faces."""
    # Rows of the law are C₁₁, C₁₂, and 1 + a + b: the edges between components. Each belongs to a
    # product of two strains, which are sums of faces: component, offset and sign.
    axes, components = axes_of(dimension), range(dimension)
    stretch = [[(a, HERE, -1), (a, _moved(HERE, axes[a], 1), 1)] for a in components]
    energies = [(int(a != b), stretch[a], stretch[b]) for a, b in product(components, repeat=2)]
    for a, b in combinations(components, 2):
        shear = [(a, HERE, 1), (a, _moved(HERE, axes[b], -1), -1)]
        shear += [(b, HERE, 1), (b, _moved(HERE, axes[a], -1), -1)]
        energies.append((1 + a + b, shear, shear))
    found: list[Part] = []
    for modulus, ours, theirs in energies:
        for (a, here, sign), (b, there, other) in product(ours, theirs):
            x, y, z = (far - near for far, near in zip(there, here, strict=True))
            if a <= b:
                places = [(modulus, _opposite(here)), (a, HERE), (b, (x, y, z))]
                found.append(((a, b, (x, y, z)), sign * other, places))
    return found


@lru_cache
def coarsening(dimension: int, depth: int) -> tuple[list[Sums], tuple[Entry, ...]]:
    """Return the sums, axis by axis, that lead to the level at a depth, and its entries."""
    if depth > 3:
        return coarsening(dimension, 3)  # From there on all levels are alike.
    parts, reach, steps = _law_parts(dimension), 1, list[Sums]()
    if depth > 1:
        entries, reach = coarsening(dimension, depth - 1)[1], 2
        parts = _parts(entries)
        for slot, (a, b, way) in enumerate(entries):
            if a == b and any(way):  # It serves a second face of its own component, mirrored.
                parts.append(((a, b, _opposite(way)), 1.0, [(slot, _opposite(way))]))
    for axis in axes_of(dimension):
        sums, entries = _step(dimension, axis, parts, reach)
        steps.append(sums)
        parts, reach = _parts(entries), 0
    return steps, entries


def _parts(entries: tuple[Entry, ...]) -> list[Part]:
    """Return entries as what they are themselves."""
    return [(entry, 1.0, [(slot, HERE)]) for slot, entry in enumerate(entries)]


def _step(
    dimension: int, axis: int, parts: list[Part], reach: int
) -> tuple[Sums, tuple[Entry, ...]]:
    """Return the sums that coarsen one axis, and the entries that they make."""
    # Weights of a coarse face for fine ones, by their distance from twice its place: along its
    # normal, and across it.
    normal, across = {-1: 0.5, 0: 1.0, 1: 0.5}, {-1: 0.25, 0: 0.75, 1: 0.75, 2: 0.25}
    axes, found = axes_of(dimension), list[tuple[Entry, list[float]]]()
    for (a, b, way), times, places in parts:
        ours, theirs = (normal if axes[c] == axis else across for c in (a, b))
        for fine, other in product(ours, theirs):
            between, near = fine + way[axis] - other, fine + 1
            new = _moved(way, axis, between // 2 - way[axis])
            # An offset whose first step, up to the axis, is backward is stored the other way.
            back = a == b and next((step < 0 for step in new[: axis + 1] if step), False)
            if back or between % 2:
                continue
            term = list[int]()
            for slot, (x, y, z) in places:
                row = (near + reach + x) * (2 * reach + 1) + reach + y
                term += row, slot, MARGIN + z
            if axis == 2:  # There is one row of even places and one of odd ones.
                term = [0, 2 * term[1] + (near + 1) % 2, (near + 1) // 2]
            found.append(((a, b, new), [*term, times * ours[fine] * theirs[other]]))
    number = {entry: row for row, entry in enumerate(sorted({entry for entry, _ in found}))}
    table = np.array(sorted((number[entry], *term) for entry, term in found))
    return (table[:, :-1].astype(np.int64), table[:, -1].copy()), tuple(number)


TOGETHER = 8  # Coarse rows made at once: 2 to 16 take as long, a plane twice as long
MARGIN = 2  # Places at the ends of rows that sums leave out, as they reach beyond
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
    law, inverse = np.zeros((2 + d * (d - 1) // 2, *shape)), np.zeros((d, *shape))

    def part(of: NDArray[Any], like: NDArray[Any], axis: int = 0, by: int = 0) -> NDArray[Any]:
        """Return the places of an array of cells, faces or edges, or those by one along an axis."""
        first = [FIRST - 1 + by * (a == axis) for a in range(d)]
        return of[tuple(slice(k, k + n) for k, n in zip(first, like.shape, strict=True))]

    for row, modulus in zip(law, (moduli.stretch, moduli.lateral), strict=False):
        part(row, rim)[...] = cell_modulus(problem, modulus)
    for a, b in axis_pairs(d):
        modulus = edge_modulus(problem, (a, b))
        part(law[1 + a + b], modulus)[...] = modulus
    stretch = part(law[0], rim)
    for side in range(2 * d):
        # A foundation is a ghost cell that can only be squeezed, and whose far face is held.
        layer = rim_layer(d, side)
        face = list(layer)
        face[side // 2] = -2 if side % 2 else 1
        founded = rim[layer] == FOUNDATION
        if founded.any():
            stretch[layer][founded] = problem.spring[side // 2][tuple(face)][founded]
    for a, state in enumerate(problem.face_states):
        own = part(law[0], state) + part(law[0], state, a, -1)
        for b in (b for b in range(d) if b != a):
            own += part(law[1 + a + b], state) + part(law[1 + a + b], state, b, 1)
        np.divide(1.0, own, out=part(inverse[a], state), where=state == ACTIVE)
    return law, inverse.reshape(d, -1)


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
    steps, stencil = coarsening(d, depth)
    box, couplings = _coupled(stencil, _box(cells, GHOST, 2))
    (planes, many, length), first, end = box.shape, box.first, box.end
    rows = np.zeros((planes, many), dtype=np.int64)
    # The first row is that of places that are not in use. Memory is taken as rows are written.
    data, count = np.zeros((1 + planes * many, len(stencil), length)), 1
    shared = fine.rows.reshape(fine.box.shape[:2])
    inverse = fine.inverse.reshape(d, -1, fine.box.shape[2])
    source = fine.data.reshape(-1, fine.box.entries or inverse.shape[1], inverse.shape[2])
    # Coarse rows are alike whose fine rows are: those at 2p - 5 to 2p - 2, and all in their reach.
    span, seen = np.arange(-5 - reach, -1 + reach), dict[bytes, int]()
    beside = 2 * np.arange(first[1], end[1])[:, None] + span
    for p in range(first[0], end[0]):
        near = shared.take(2 * p + span, 0, mode="wrap")
        windows = np.moveaxis(near.take(beside, 1, mode="wrap"), 1, 0)
        known = [seen.setdefault(one.tobytes(), len(seen) + 1) for one in windows]
        rows[p, first[1] : end[1]] = known
        number, place = np.unique(rows[p], return_index=True)
        new = place[number >= count]
        for lanes in (new[k : k + TOGETHER, None] for k in range(0, len(new), TOGETHER)):
            wanted = np.unique(2 * lanes + span[reach:-reach]) if many > 1 else new
            around = near.take(wanted[:, None] + np.arange(-reach, reach + 1), 1, mode="wrap")
            fields = _summed(source, np.moveaxis(around, 1, 0), steps[0], inverse)
            if many > 1:
                at = np.searchsorted(wanted, 2 * lanes - 5) + np.arange(4)
                fields = _summed(fields, at, steps[1], inverse)
            # Of each entry the even places, then the odd ones.
            halves = fields.reshape(*fields.shape[:2], -1, 2).swapaxes(2, 3)
            halves = halves.reshape(len(lanes), -1, halves.shape[3])
            made, here = data[count : count + len(lanes)], np.arange(len(lanes))[:, None]
            add_rows(made, halves, halves, here, *steps[-1], first[2], end[2] - first[2])
            count += len(lanes)
    own = np.moveaxis(data[:count, [stencil.index((a, a, HERE)) for a in range(d)]], 1, 0)
    inverse = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0.0)
    level = Level(data[:count].ravel(), inverse.ravel(), couplings, rows.ravel(), box)
    n = d * box.places
    return MultigridLevel(cells, level, np.zeros(n), np.zeros(n))


def _summed(source: Floats, where: Ints, sums: Sums, inverse: Floats) -> Floats:
    """Return weighted sums of rows of a source: see `row_kernels.add_rows`."""
    found = np.zeros((len(where), sums[0][-1, 0] + 1, source.shape[2]))
    where = where.reshape(len(where), -1)
    add_rows(found, source, inverse, where, *sums, MARGIN, source.shape[2] - 2 * MARGIN)
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
