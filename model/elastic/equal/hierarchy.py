"""Multigrid for equal cells: any form of the body and any mix of materials.

The finest level stores no matrix, only the moduli of cells and edges; a coarse level stores P'AP
(`stencils`), which is robust where the moduli jump by 10⁶ and next to holes, and needs no boundary
conditions of its own. Coarse levels of full boxes obey the law themselves, which is twice as fast.
One symmetric V-cycle with Gauss-Seidel sweeps is the preconditioner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import combinations
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of
from kaju.model.elastic.equal import row_kernels as sweeps
from kaju.model.elastic.moduli import Moduli
from kaju.model.scene.cell_types import AIR, FOUNDATION, RIGID, ROLLER

from .krylov import dot
from .problem import ElasticProblem, FaceFields, rim_layer
from .staggered import Numbering, modulus_between, stiffness_matrix
from .stencils import Stencil, Terms, coarsening, finest_entries

FIRST = 4
"""Place of the body's first cell, behind ghosts; even, so that fine and coarse places match."""
SMALLEST = {2: 8, 3: 2}
"""A level of at most so many cells along every axis is solved by its inverse."""
SWEEPS = {2: (3, 1, 2, 4), 3: (3, 1)}
"""Gauss-Seidel sweeps before and after the coarse correction: by the law, by the first stencil and
by the coarser ones, where they cost little (Bramble & Pasciak 1987).

A stencil couples a face with 30 others in the plane, 235 in space: three and eleven times as many
as the law.
"""
PLAIN_SWEEPS = {2: 2, 3: 3}
"""By the law in full boxes, whose coarse levels obey it too, and within the mixed form."""
FEWEST = 16
"""A full box of an even number of cells, at least so many, along every axis has a coarse box."""
DIRECT = 2_000
"""The last of these is solved by factors if it has at most so many faces: without stencils, which
take long to be compiled."""
ALMOST = 0.1  # A guess is taken if its residual is below this share of the coarse answer's
GUARD = 1e-11
"""Ghost unknowns may be linearly dependent: the coarsest matrix is regularised by this share of its
diagonal."""


class Level(NamedTuple):
    """One grid, as `row_kernels` wants it, and the space to work in."""

    cells: tuple[int, ...]
    arrays: tuple[Any, ...]
    stencil: Stencil | None  # None where moduli of cells and edges are all there is
    u: Floats  # Displacement and
    load: Floats  # load of all places


class Hierarchy:
    """Multigrid on the equal cells of a body.

    Its vectors hold all components' places with ghosts around them; see `gather` and `scatter`.
    `moduli` may replace the problem's own: the mixed form leaves the pressure's part out.
    """

    def __init__(self, problem: ElasticProblem, moduli: Moduli | None = None) -> None:
        self.dimension = problem.dimension
        by_law, *by_stencil = SWEEPS[self.dimension]
        self.plain = is_box(problem)
        if self.plain or moduli is not None:
            by_law = PLAIN_SWEEPS[self.dimension]
        own = replace(problem, moduli=moduli or problem.moduli)
        self.levels = [_by_law(own)]
        self._ghost_weights = ghost_weights_of(problem)
        while is_box(own):
            own = coarse_box(own)
            self.levels.append(_by_law(own))
        self._laws = laws = len(self.levels)
        few = self.plain and self.dimension * prod(self.levels[-1].cells) <= DIRECT
        while not few and (
            len(self.levels) == laws or max(self.levels[-1].cells) > SMALLEST[self.dimension]
        ):
            self.levels.append(_coarse_level(self.levels[-1], len(self.levels) + 1 - laws))
        self._sweeps = [by_law] * laws + by_stencil + by_stencil[-1:] * len(self.levels)
        self._parity = np.resize([1.0, 0.0], max(level.arrays[3][2] for level in self.levels) + 2)
        self._direct = _Direct(self.levels[-1], own if few else None)

    @cached_property
    def moving(self) -> Flags:
        """Which entries of a vector are faces that can move."""
        arrays = self.levels[0].arrays
        return _spread(arrays[1] > 0.0, arrays)

    def resisted(self, x: Floats) -> Floats:
        """Return the force with which faces resist x by their own stiffness, in the same array."""
        arrays = self.levels[0].arrays
        inverse = _spread(arrays[1], arrays)
        resisted: Floats = np.divide(x, inverse, out=x, where=self.moving)
        return resisted

    def gather(self, fields: FaceFields) -> Floats:
        """Return the values of the faces that can move; all else is 0."""
        vector = np.zeros(self.levels[0].u.size)
        free = self.views(self.moving)
        for view, values, moves in zip(self.views(vector), fields, free, strict=True):
            np.copyto(view, values, where=moves)
        return vector

    def scatter(self, vector: Floats, fields: FaceFields) -> None:
        """Add the values of the faces that can move to arrays of all faces."""
        for view, values in zip(self.views(vector), fields, strict=True):
            values += view

    def views(self, vector: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Return a vector as one array per axis, ghost cells included."""
        level = self.levels[0]
        box = level.arrays[3]
        shape = (box[0], box[2]) if self.dimension == 2 else tuple(box[:3])
        part = vector.reshape(self.dimension, *shape)
        views = []
        for axis in range(self.dimension):
            ends = [FIRST + n + 1 + (a == axis) for a, n in enumerate(level.cells)]
            views.append(part[axis][tuple(slice(FIRST - 1, end) for end in ends)])
        return tuple(views)

    def apply(self, x: Floats, out: Floats | None = None) -> Floats:
        """Return the stiffness times x."""
        out = np.empty_like(x) if out is None else out
        self._pass(0, x, x, out, 0, sweeps.RESIDUAL, share=0.0)
        return np.negative(out, out=out)

    def precondition(self, load: Floats, out: Floats | None = None) -> Floats:
        """Return one V-cycle's answer to a load."""
        out = np.empty_like(load) if out is None else out
        self._cycle(0, load, out)
        return out

    def full_multigrid(self, load: Floats, guess: Floats | None = None) -> tuple[Floats, float]:
        """Start from the coarsest answer and improve it level by level."""
        # On the finest level from the guess, whatever the size of its loads, if that is far better.
        # Also returns the potential energy there of the coarse answer.
        loads = [load]
        for at in range(len(self.levels) - 1):
            loads.append(self.restrict(at, loads[at]))
        x, energy = self._direct.solve(loads[-1]), 0.0
        for at in range(len(self.levels) - 2, -1, -1):
            x, residual, more = self.prolong(at, x), self.levels[at].load, self.levels[at].u
            self._pass(at, x, loads[at], residual, 0, sweeps.RESIDUAL)
            if at == 0:
                energy = -0.5 * (dot(load, x) + dot(residual, x))
                if guess is not None:
                    force = self.apply(guess)
                    size = dot(guess, load) / (dot(guess, force) or 1.0)
                    other = load - size * force
                    if dot(other, other) < ALMOST**2 * dot(residual, residual):
                        x, residual = size * guess, other
            self._cycle(at, residual, more)
            x += more
        return x, energy

    def prolong(self, at: int, coarse: Floats) -> Floats:
        """Return a displacement interpolated from the next coarser level."""
        x: Floats = np.zeros(self.levels[at].u.size)
        self._pass(at, x, x, coarse, 0, sweeps.FROM_COARSE)
        return x

    def restrict(self, at: int, load: Floats) -> Floats:
        """Return a load restricted to the next coarser level."""
        coarse: Floats = np.empty_like(self.levels[at + 1].load)
        self._pass(at, load, load, coarse, 0, sweeps.TO_COARSE)
        return coarse

    def rough(self, x: Floats) -> Floats:
        """Return about what the next coarser level cannot represent: x less its means there."""
        weight, mean = self.restrict(0, self.moving.astype(np.float64)), self.restrict(0, x)
        np.divide(mean, weight, out=mean, where=weight > 0.1)
        mean[weight <= 0.1] = 0.0
        return np.asarray(x - self.prolong(0, mean))

    def _cycle(self, at: int, load: Floats, u: Floats) -> None:
        if at == len(self.levels) - 1:
            u[:] = self._direct.solve(load)
            return
        below, count = self.levels[at + 1], self._sweeps[at]
        self._pass(at, u, load, below.load, count, sweeps.TO_COARSE)
        self._cycle(at + 1, below.load, below.u)
        self._pass(at, u, load, below.u, count, sweeps.FROM_COARSE)

    def _pass(
        self,
        at: int,
        u: Floats,
        load: Floats,
        out: Floats,
        count: int,
        way: int,
        share: float = 1.0,
    ) -> None:
        """Take `row_kernels.pass_level`, which says what the vectors are."""
        level, coarse = self.levels[at].arrays, self.levels[at + 1].arrays[3]
        plain = at + 1 < self._laws
        if plain and way == sweeps.FROM_COARSE:
            _extrapolate_to_ghosts(out, coarse, self._ghost_weights, back=False)
        sweeps.pass_level(u, load, out, level, coarse, self._parity, count, way, share)
        if plain and way == sweeps.TO_COARSE:
            _extrapolate_to_ghosts(out, coarse, self._ghost_weights, back=True)


class _Direct:
    """The smallest level: its inverse, or the factors of a full box by its problem."""

    def __init__(self, level: Level, problem: ElasticProblem | None) -> None:
        self._there = np.flatnonzero(_spread(level.arrays[1], level.arrays))
        if problem is None:
            self._solve = self._by_stencil(level)
        else:
            matrix = stiffness_matrix(problem, Numbering(problem.face_states))
            self._solve = factors_of(matrix).solve

    def solve(self, load: Floats) -> Floats:
        x = np.zeros_like(load)
        x[self._there] = self._solve(load[self._there])
        return x

    def _by_stencil(self, level: Level) -> Callable[[Floats], Floats]:
        assert level.stencil is not None
        number = np.full(level.u.size, -1)
        number[self._there] = np.arange(len(self._there))
        data, _, _, box, like = level.arrays
        planes, rows, length = box[:3]
        coefficients = data.reshape(-1, box[sweeps.ENTRIES], length)
        n = planes * rows * length
        matrix = np.zeros((len(self._there),) * 2)
        for a, b, *way, entry, p, q, j in level.stencil.couplings:
            here = self._there[(a * n <= self._there) & (self._there < (a + 1) * n)]
            other = here + (b - a) * n + (way[0] * rows + way[1]) * length + way[2]
            spot = here - a * n + (p * rows + q) * length + j
            some = number[other] >= 0
            value = coefficients[like[spot // length], entry, spot % length]
            matrix[number[here[some]], number[other[some]]] = value[some]
        size = np.sqrt(matrix.diagonal())
        matrix /= np.outer(size, size)
        matrix[np.diag_indices_from(matrix)] += GUARD
        inverse: Floats = np.linalg.inv(matrix) / np.outer(size, size)
        return lambda load: np.asarray(inverse @ load)


def _box(cells: tuple[int, ...], first: int, reach: int, stencil: Stencil | None = None) -> Ints:
    """Return the measures of a level's arrays; see `row_kernels`."""
    d = len(cells)
    sizes = [2 * ((n + 9) // 2) for n in cells]
    ranges = [(first, n + 5) for n in cells]
    steps = [sizes[-1], 1, 0]
    if d == 2:
        sizes.insert(1, 1)
        ranges.insert(1, (0, 1))
    else:
        steps = [sizes[1] * sizes[2], sizes[2], 1]
    ends = [end for pair in ranges for end in pair]
    entries, starts, after = 0, [0] * 4, [0] * 3
    if stencil is not None:
        entries = len(stencil.entries)
        starts[: d + 1], after[:d] = stencil.starts, stencil.next
    counts = (reach, entries, d, prod(sizes))
    return np.array([*sizes, *ends, *counts, *steps, *starts, *after], dtype=np.int64)


_NO_COUPLINGS = np.zeros((0, 3), dtype=np.int64)


def is_box(problem: ElasticProblem) -> bool:
    """Tell whether a body is a full box of one material, sides of one kind, to be coarsened."""
    # Edge moduli that are given do not follow from the cells, so coarse cells would lose them.
    if problem.edges is not None or any(n % 2 or n < FEWEST for n in problem.shape):
        return False
    inside = problem.kinds[problem.inner]
    if inside.flat[0] < 0 or not np.all(inside == inside.flat[0]):
        return False
    layers = [problem.kinds[rim_layer(problem.dimension, s)] for s in range(2 * problem.dimension)]
    return all(bool(np.all(layer == layer.flat[0])) for layer in layers)


def _by_law(problem: ElasticProblem) -> Level:
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
    place = np.arange(box[0])
    place[FIRST - 1 : FIRST - 1 + planes] = FIRST - 2 + np.cumsum(~shares)
    place[FIRST - 1 + planes :] -= planes - len(kept)
    place = np.minimum(place, described - 1)
    parts = [x.reshape(len(x), -1, int(box[2])) for x in (law, inverse)]
    number = _numbered([(x[1:] == x[:-1]).all(axis=1) for part in parts for x in part])
    if 2 * number[-1] < len(number):
        parts = [x.take(np.flatnonzero(np.diff(number, prepend=-1)), 1) for x in parts]
    else:
        number = np.arange(len(number))
    rows = number.reshape(described, -1)[place].ravel()
    arrays = (*(x.ravel() for x in parts), _NO_COUPLINGS, box, rows)
    n = problem.dimension * int(box[sweeps.SIZE])
    return Level(problem.shape, arrays, None, np.empty(n), np.empty(n))


def _law_and_inverses(problem: ElasticProblem) -> tuple[Floats, Floats]:
    """Return all places' moduli, and inverses of faces' own stiffness; 0 where held."""
    d, rim, moduli = problem.dimension, problem.kinds, problem.moduli
    shape = _shape(_box(problem.shape, FIRST, 1))
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


def _spread(values: NDArray[Any], arrays: tuple[Any, ...]) -> NDArray[Any]:
    """Return for all faces the values that a level stores for its distinct rows."""
    box, rows = arrays[3:]
    if values.size == box[sweeps.COUNT] * box[sweeps.SIZE]:
        return values
    spread: NDArray[Any] = values.reshape(box[sweeps.COUNT], -1, box[2]).take(rows, 1)
    return spread.ravel()


def _shape(box: Ints) -> tuple[int, ...]:
    """Return the shape of a level's arrays of places."""
    return tuple(int(n) for n in box[:3] if n > 1)


def ghost_weights_of(problem: ElasticProblem) -> Floats:
    """Return for every side the weights of the first two faces that extrapolate to its ghosts."""
    # Beyond a rigid side they mirror: so a coarse box obeys the law on its own cells. Of other
    # bodies the weights are not used.
    sides = range(2 * problem.dimension)
    ends = [problem.kinds[rim_layer(problem.dimension, side)].flat[0] for side in sides]
    return np.array([(-1.0, 0.0) if end == RIGID else (2.0, -1.0) for end in ends])


def coarse_box(problem: ElasticProblem) -> ElasticProblem:
    """Return a full box on cells twice as large."""
    d = problem.dimension

    def halved(values: NDArray[Any]) -> NDArray[Any]:
        # The ghost cells beyond both ends stay. Along the normal the last face is kept as well;
        # across it the last two have one coarse face.
        every = [np.array([0, *range(1, n - 1, 2), n - 1]) for n in values.shape]
        return np.ascontiguousarray(values[np.ix_(*every)])

    return replace(
        problem,
        kinds=halved(problem.kinds),
        moduli=Moduli(*(2.0 ** (d - 2) * values for values in problem.moduli)),
        spring=tuple(2.0 ** (d - 1) * halved(values) for values in problem.spring),
    )


def _extrapolate_to_ghosts(g: Floats, coarse: Ints, outside: Floats, *, back: bool) -> None:
    """Extrapolate to the ghosts beyond a full box; back, add their loads inside: the transpose."""
    count = int(coarse[sweeps.COUNT])
    fields = g.reshape(count, *coarse[:3])
    for a in range(count):
        # Corners follow from the sides, so loads go back in the opposite order.
        for b in reversed(range(count)) if back else range(count):
            axis = 2 if b == count - 1 else b
            lines = fields[a] if axis == 0 else np.moveaxis(fields[a], axis, 0)
            for side in range(2 if a != b else 0):
                ends = coarse[sweeps.FIRST + 2 * axis], coarse[sweeps.END + 2 * axis] - 2
                layer, inward, (near, far) = ends[side], 1 - 2 * side, outside[2 * b + side]
                one, two, ghost = (lines[layer + k * inward] for k in (0, 1, -1))
                if back:
                    one += near * ghost
                    two += far * ghost
                    ghost[...] = 0.0
                else:
                    ghost[...] = near * one + far * two


def _coarse_level(fine: Level, depth: int) -> Level:
    cells = tuple((n + 1) // 2 for n in fine.cells)
    d = len(cells)
    sums, stencil = coarsening(d, depth)
    box = _box(cells, FIRST - 1, 2, stencil)
    rows = _shared_coarse_rows(fine, box, sums)
    described = (int(rows.max()) + 1) * int(box[2])
    coefficients, inverse = np.zeros(described * len(stencil.entries)), np.zeros(d * described)
    if d == 2:
        sums = (sums[0], sums[1], sums[1])
    places, ways = [step.place for step in sums], [step.rows for step in sums]
    ends, starts = (np.cumsum([0, *map(len, parts)]) for parts in (places, ways))
    weight = np.concatenate([step.weight for step in sums])
    joined = np.concatenate(places), weight, np.concatenate(ways), ends, starts
    made, length = _finest_terms(fine.arrays[3]), int(fine.arrays[3][sweeps.LENGTH])
    few = 0 if fine.stencil else len(sums[0].rows) * len(made)
    first, second = sums[0].sums, sums[1].sums
    sizes = few * length, (4 * first + second) * length, max(first, second) * length
    room = (*map(np.zeros, sizes), np.zeros(int(starts[-1]) + 4, dtype=np.int64))
    sweeps.galerkin(fine.arrays, made, joined, box, rows, stencil.own, room, coefficients, inverse)
    arrays = (coefficients, inverse, _flat(stencil, box), box, rows)
    space = d * int(box[sweeps.SIZE])
    return Level(cells, arrays, stencil, np.zeros(space), np.zeros(space))


def _shared_coarse_rows(fine: Level, box: Ints, sums: Sequence[Terms]) -> Ints:
    """Return numbers of coarse rows, the same as before where all fine rows are shared."""
    # Rows that are not in use share the first.
    fine_rows = fine.arrays[4].reshape(fine.arrays[3][:2])
    reach = [np.unique(sums[0].rows[:, 0]), np.array([0])]
    if len(sums) == 3:
        beside, beyond = sums[0].rows[:, 1], sums[1].rows[:, 1]
        reach[1] = np.arange(beside.min() + beyond.min(), beside.max() + beyond.max() + 1)
    if fine.stencil is None:  # The law of a row reaches its neighbours.
        reach = [np.arange(way.min() - 1, way.max() + 2) for way in reach]
    used = [np.arange(box[k], box[k + 1]) for k in (sweeps.FIRST, sweeps.FIRST_ROW)]
    seen = [
        np.clip(2 * place - 4 + way[:, None], 0, n - 1)
        for place, way, n in zip(used, reach, fine_rows.shape, strict=True)
    ]
    key = [fine_rows[p[:, None], q].ravel() for p in seen[0] for q in seen[1]]
    rows = np.zeros(box[:2], dtype=np.int64)
    rows[np.ix_(*used)] = 1 + _numbered([k[1:] == k[:-1] for k in key]).reshape(
        [len(place) for place in used]
    )
    return rows.ravel()


def _flat(stencil: Stencil, box: Ints) -> Ints:
    """Return couplings as `row_kernels` wants them: place of coefficient and of other face."""
    (_, rows, length), n = box[:3], box[sweeps.SIZE]
    table = stencil.couplings
    far = (table[:, 2] * rows + table[:, 3]) * length + table[:, 4] + table[:, 1] * n
    row = table[:, 6] * rows + table[:, 7]
    return np.stack([row, table[:, 5] * length + table[:, 8], far], axis=1)


def _finest_terms(box: Ints) -> Ints:
    """Return the terms of the finest level's entries."""
    # The columns are: the sign (see `stencils.finest_entries`), then for the two faces that have to
    # be free to move, and for the two moduli, the component or the modulus, in how many rows from
    # its own, and how far along the row.
    entries, made = finest_entries(int(box[sweeps.COUNT]))
    step = np.array([[box[1], 0], [1, 0], [0, 1]])  # In rows, and along them.
    table = []
    for (a, b, way), (sign, k, axis, shift, k2, axis2, shift2) in zip(entries, made, strict=True):
        moduli = (k, *shift * step[axis]), (k2, *shift2 * step[axis2])
        table.append((sign, a, 0, 0, b, *np.dot(way, step), *moduli[0], *moduli[1]))
    return np.array(table, dtype=np.int64)
